"""Processor time of a small campaign, relative to an old commit and to a loop in pure Python."""

import os
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OLD = "54ea1fc"
OLD_MAIN = "from grasp.cli import main"
MAIN = "from grasp.cli.main import main"
TURNS = 2  # each tree; the least time counts, because other processes only add to it
LOOPS = 3_000_000


@pytest.fixture
def old_tree(tmp_path: Path) -> Path:
    """The files of the old commit."""
    archive = tmp_path / "old.tar"
    command = ("git", "-C", str(ROOT), "archive", "--output", str(archive), OLD)
    if subprocess.run(command, check=False, capture_output=True).returncode:
        pytest.skip(f"the history lacks commit {OLD}")
    with tarfile.open(archive) as files:
        files.extractall(tmp_path / "old", filter="data")
    return tmp_path / "old"


def campaign_s(tree: Path, main: str, out: Path) -> float:
    """Processor time of `grasp campaign run paper --repetitions 1 --jobs 1` in that tree, s."""
    words = ("campaign", "run", "paper", "--repetitions", "1", "--jobs", "1", "--out", str(out))
    code = f"import sys; sys.argv = ['grasp', *{words!r}]; {main}; sys.exit(main())"
    before = os.times()
    subprocess.run(
        [sys.executable, "-c", code], cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)},
        check=True, capture_output=True,
    )  # fmt: skip
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


def loop_s() -> float:
    """Processor time of a loop in pure Python, s: the speed of this machine."""
    start, total = time.process_time(), 0
    for i in range(LOOPS):
        total += i & 3
    return time.process_time() - start


@pytest.mark.bench
@pytest.mark.timeout(1200)  # both trees compile first
def test_campaign_against_an_old_commit_and_a_python_loop(old_tree: Path, tmp_path: Path) -> None:
    trees = {"this tree": (ROOT, MAIN), OLD: (old_tree, OLD_MAIN)}
    spent: dict[str, list[float]] = {name: [] for name in (*trees, "loop")}
    for turn in range(TURNS + 1):  # in the first one both compile
        for name, (tree, main) in trees.items():
            spent[name].append(campaign_s(tree, main, tmp_path / f"{name}-{turn}.sqlite"))
        spent["loop"].append(loop_s())
    new_s, old_s, unit_s = (min(each[1:]) for each in spent.values())
    print(f"\n12 trials: {new_s:.1f} s, at {OLD} {old_s:.1f} s: {new_s / old_s:.2f} times as long")
    print(f"this tree takes {new_s / unit_s:.0f} times as long as {LOOPS:,} turns of a Python loop")
