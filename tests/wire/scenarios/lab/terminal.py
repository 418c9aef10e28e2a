"""The command line as a program, with nobody at its terminal."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from tests.wire.scenarios.test_rigs import ENVIRONMENT, GRASP


def grasp(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run to its end."""
    return subprocess.run(
        [*GRASP, *words], env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=100,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


@contextmanager
def started(*words: str, asked: bool = False) -> Iterator["subprocess.Popen[str]"]:
    """While it runs; ``asked``: somebody is there to answer."""
    answers = subprocess.PIPE if asked else subprocess.DEVNULL
    with subprocess.Popen(
        [*GRASP, *words], env=ENVIRONMENT, stdin=answers, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.kill()
