"""Does a change leave every message of every run as it was? Compares this tree with a commit.

    python scripts/same_messages.py HEAD~1 [--objects can ball] [--seeds 0 1] [--topics]

Both trees run the same lifts, taps and acquisitions on the simulated rig, each from its own
checkout with this interpreter; then the recordings are compared message by message: channel, log
time and bytes. Metadata (settings, versions) are left out, since a commit may rename a setting.
Renames listed in RENAMED are undone in the new bytes first. Exit 1 if anything differs.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

HOME = Path(__file__).resolve().parent.parent
OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
ACQUISITION = ("acquire", "--surface", "sphere", "--direction", "45", "--seconds", "20")

# What a recording says now, and what the same thing was called before: undone before comparing.
RENAMED: tuple[tuple[bytes, bytes], ...] = (
    (b'"impulse_n_s":', b'"impulse_ns":'),
    (b',"late_ns":0,"took_ns":0,"doubt":""', b""),  # of /control
    # phases that were parts of others
    (b'"phase":"rest"', b'"phase":"approach"'),
    (b'"phase":"squeeze"', b'"phase":"grasp"'),
    (b'"phase":"settle"', b'"phase":"grasp"'),
    (b'"phase":"relax"', b'"phase":"grasp"'),
    (b'"phase":"listen"', b'"phase":"grasp"'),
    (b'"phase":"retreat"', b'"phase":"release"'),
)

# Channels that a scenario has had since: not compared with a tree that had none of them.
ADDED = {"acquire": ("/tactile", "/arm", "/press", "/truth")}

Key = tuple[str, int]  # channel and its n-th message, or a recording's array
Contents = dict[Key, tuple[int, bytes]]  # log time in ns, bytes


def main() -> int:
    """Run both trees and print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit", help="to compare with")
    parser.add_argument("--objects", nargs="+", default=OBJECTS, choices=OBJECTS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--topics", action="store_true", help="say how much differs by channel")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, _tree(asked.commit, Path(scratch)) as before:
        runs = list(_runs(asked.objects, asked.seeds))
        old, new = (
            _record_all(tree, runs, Path(scratch) / name)
            for tree, name in ((before, "old"), (HOME, "new"))
        )
        return _report(runs, old, new, asked.topics)


def _runs(objects: list[str], seeds: list[int]) -> Iterator[tuple[str, ...]]:
    for scenario in ("lift", "tap"):
        for name in objects:
            for seed in seeds:
                yield (scenario, "--object", name, "--seed", str(seed))
    yield (*ACQUISITION, "--seed", "0")


@contextlib.contextmanager
def _tree(commit: str, scratch: Path) -> Iterator[Path]:
    """The files of a commit, without touching this checkout."""
    path = scratch / "tree"
    path.mkdir()
    archive = subprocess.run(
        ["git", "archive", commit], cwd=HOME, check=True, stdout=subprocess.PIPE
    ).stdout
    subprocess.run(["tar", "-x", "-C", str(path)], input=archive, check=True)
    yield path


def _record_all(tree: Path, runs: list[tuple[str, ...]], folder: Path) -> list[Contents]:
    found = []
    for i, run in enumerate(runs):
        told = f"{folder.name} tree, run {i + 1} of {len(runs)}: {' '.join(run)}"
        print(told, file=sys.stderr, flush=True)
        found.append(_record(tree, run, folder / str(i)))
    return found


def _record(tree: Path, run: tuple[str, ...], folder: Path) -> Contents:
    """One run of ``grasp``, and what it left."""
    start = f"import sys; from {_entry(tree)} import main; sys.exit(main())"
    command = (
        sys.executable, "-P", "-c", start,
        "run", *run, *_once(tree, run[0]), "--rig", "simulated", "--runs", str(folder), "--json",
    )  # fmt: skip
    where = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(command, env=where, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):  # 1: the verdict is a failure
        raise SystemExit(f"{tree}: grasp run {' '.join(run)}: {done.stderr or done.stdout}")
    contents: Contents = {}
    for path in sorted(folder.rglob("*.mcap")):
        contents |= _messages(path)
    for path in sorted(folder.rglob("*.npz")):
        with np.load(path) as arrays:
            contents |= {
                (name, 0): (0, arrays[name].tobytes()) for name in arrays if name != "header"
            }
    verdict = json.loads(done.stdout)
    contents["outcome", 0] = 0, str(verdict.get("outcome", verdict.get("samples"))).encode()
    return contents


def _once(tree: Path, scenario: str) -> tuple[str, ...]:
    """One tap, in the words of a tree's own command line."""
    if scenario != "tap":
        return ()
    return ("--trials" if (tree / "grasp/cli/trials.py").is_file() else "--taps", "1")


def _entry(tree: Path) -> str:
    return "grasp.cli.main" if (tree / "grasp/cli/main.py").exists() else "grasp.cli"


def _messages(path: Path) -> Contents:
    contents: Contents = {}
    numbers: dict[str, int] = {}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            number = numbers[channel.topic] = numbers.get(channel.topic, -1) + 1
            contents[channel.topic, number] = message.log_time, message.data
    return contents


def _report(
    runs: list[tuple[str, ...]], old: list[Contents], new: list[Contents], topics: bool
) -> int:
    total = different = 0
    for run, before, after in zip(runs, old, new, strict=True):
        # on both sides: the commit compared with may have some of the new names already
        old_names, new_names = _undone(before), _undone(after)
        added = set(ADDED.get(run[0], ())) - {topic for topic, _ in old_names}
        new_names = {key: said for key, said in new_names.items() if key[0] not in added}
        keys = sorted(old_names.keys() | new_names.keys())
        wrong = [key for key in keys if old_names.get(key) != new_names.get(key)]
        total += len(keys)
        different += len(wrong)
        print(f"{' '.join(run)}: {len(keys)} messages, {len(wrong)} differ")
        if wrong and topics:
            for topic in sorted({topic for topic, _ in wrong}):
                print(f"    {topic}: {sum(name == topic for name, _ in wrong)}")
        for key in wrong[:1]:
            print(
                f"    first: {key}\n      {old_names.get(key)}\n      {new_names.get(key)}"[:1200]
            )
    print(f"{total} messages of {len(runs)} runs, {different} differ")
    return int(different > 0)


def _undone(contents: Contents) -> Contents:
    return {key: (t_ns, _earlier(data)) for key, (t_ns, data) in contents.items()}


def _earlier(data: bytes) -> bytes:
    for now, earlier in RENAMED:
        data = data.replace(now, earlier)
    return data


if __name__ == "__main__":
    sys.exit(main())
