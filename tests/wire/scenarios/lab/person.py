"""Somebody at the terminal of a program: answers each question as they know."""

import re
from collections.abc import Callable

from tests.wire.scenarios.lab.terminal import started

QUESTION = ">>> "


def played(answer: Callable[[str], str], *words: str) -> tuple[int, str, str]:
    """Exit code, standard output, and all that was said on standard error; ``answer`` gives a line
    for each question."""
    said: list[str] = []
    with started(*words, asked=True) as run:
        assert run.stderr is not None and run.stdin is not None
        for line in run.stderr:
            said.append(line)
            asked = line.startswith(QUESTION) and re.search(r"type|Enter|\?", line)
            if asked and (reply := answer(line.removeprefix(QUESTION))) is not None:
                run.stdin.write(reply + "\n")
                run.stdin.flush()
        out = run.stdout.read() if run.stdout is not None else ""
        return run.wait(30), out, "".join(said)
