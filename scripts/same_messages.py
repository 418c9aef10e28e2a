"""Does a change leave every message of every run as it was? Compares this tree with a commit.

    python scripts/same_messages.py HEAD~1 [--objects can ball] [--seeds 0 1] [--topics]
    python scripts/same_messages.py a8380c3 --profile paper     where the default's weights changed

Both trees run the same lifts, taps and acquisitions on the simulated rig, each from its own
checkout with this interpreter; then the recordings are compared message by message: channel, log
time and bytes. Metadata (settings, versions) are left out, since a commit may rename a setting;
log times count from the epoch of virtual time, where a recording has one.

A listed rename is made in the old bytes, and nothing else is. Two things that the earlier tree had
as one are counted as one, in the new bytes, and that is said; two that both trees tell apart are
compared as they stand. Exit 1 if anything differs.
"""

import argparse
import ast
import contextlib
import functools
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from grasp.clock import VIRTUAL_EPOCH_NS

HOME = Path(__file__).resolve().parent.parent
OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
ACQUISITION = ("acquire", "--surface", "sphere", "--direction", "45", "--seconds", "20")

# What a recording said before, and what the same thing is called now: one name for another.
RENAMED: tuple[tuple[bytes, bytes], ...] = ((b'"impulse_ns":', b'"impulse_n_s":'),)

# Fields that say nothing had happened, of a message that had none of them before.
ADDED_FIELDS: tuple[tuple[str, bytes], ...] = (
    ("/control", b',"late_ns":0,"took_ns":0,"doubt":""'),
    ("/arm", b',"speed_fraction":1.0'),
    ("/gripper", b',"took_ns":0'),
)

# A field that every message has, which says what the old tree did not record at all.
ADDED_TIMES: tuple[tuple[str, bytes], ...] = (("/arm", rb',"sampled_ns":-?\d+'),)

# A phase that was part of another, and of which.
PARTS: tuple[tuple[str, str], ...] = (
    ("relax", "settle"),  # and that of grasp
    ("listen", "settle"),
    ("settle", "grasp"),
    ("oppose", "grasp"),
    ("squeeze", "grasp"),
    ("rest", "approach"),
    ("retreat", "release"),
    ("home", "approach"),
    ("kept", "hold"),
    ("done", "idle"),
)

# Channels that a scenario has had since: not compared with a tree that had none of them.
FOR_VIEWERS = ("/log", "/tf", "/scene", "/forces", "/taxels")
ADDED = {
    "lift": FOR_VIEWERS,
    "tap": FOR_VIEWERS,
    "acquire": (*FOR_VIEWERS, "/tactile", "/arm", "/press", "/truth"),
}

Key = tuple[str, int]  # channel and its n-th message, or a recording's array
Contents = dict[Key, tuple[int, bytes]]  # log time in ns, bytes


def main() -> int:
    """Run both trees and print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit", help="to compare with")
    parser.add_argument("--objects", nargs="+", default=OBJECTS, choices=OBJECTS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--profile", help="of lifts and taps; those of it alone are compared")
    parser.add_argument("--topics", action="store_true", help="say how much differs by channel")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, _tree(asked.commit, Path(scratch)) as before:
        runs = list(_runs(asked.objects, asked.seeds, asked.profile))
        old, new = (
            _record_all(tree, runs, Path(scratch) / name)
            for tree, name in ((before, "old"), (HOME, "new"))
        )
        folded = folded_into(phases_of(before), phases_of(HOME))
    for one, several in folded.items():
        print(f"counted as one, {one}, since {asked.commit} did: {one}, {', '.join(several)}")
    return _report(runs, old, new, folded, asked.topics)


def phases_of(tree: Path) -> set[str]:
    """The names of the phases in a tree's table."""
    parsed = ast.parse((tree / "grasp" / "phases.py").read_text(encoding="utf-8"))
    phase = next(n for n in parsed.body if isinstance(n, ast.ClassDef) and n.name == "Phase")
    given = (node.value for node in phase.body if isinstance(node, ast.Assign))
    return {str(value.value) for value in given if isinstance(value, ast.Constant)}


def folded_into(known: set[str], now: set[str]) -> dict[str, list[str]]:
    """Phase that an earlier tree knew, to those of now that were part of it there."""
    folded: dict[str, list[str]] = {}
    for part in sorted(now):
        whole = _known_whole(part, known)
        if whole not in ("", part):
            folded.setdefault(whole, []).append(part)
    return folded


def _known_whole(part: str, known: set[str]) -> str:
    """The phase itself, or the nearest that it was part of and that is known; empty if none is."""
    while part and part not in known:
        part = dict(PARTS).get(part, "")
    return part


def _runs(
    objects: list[str], seeds: list[int], profile: str | None = None
) -> Iterator[tuple[str, ...]]:
    chosen = ("--profile", profile) if profile else ()
    for scenario in ("lift", "tap"):
        for name in objects:
            for seed in seeds:
                yield (scenario, "--object", name, "--seed", str(seed), *chosen)
    if not profile:
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
        found.append(record(tree, run, folder / str(i)))
    return found


def record(tree: Path, run: tuple[str, ...], folder: Path) -> Contents:
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
        if not contents.keys().isdisjoint(more := _messages(path)):
            raise SystemExit(f"{tree}: grasp run {' '.join(run)}: left several recordings")
        contents |= more
    for path in sorted(folder.rglob("*.npz")):
        with np.load(path) as arrays:
            contents |= {
                (name, 0): (0, arrays[name].tobytes()) for name in arrays if name != "header"
            }
    if not contents:
        raise SystemExit(f"{tree}: grasp run {' '.join(run)}: left no message: {done.stdout}")
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
            contents[channel.topic, number] = undated(message.log_time), message.data
    return contents


def undated(log_time_ns: int) -> int:
    """A log time since the start of virtual time, of a recording with a date or without."""
    return log_time_ns - VIRTUAL_EPOCH_NS if log_time_ns >= VIRTUAL_EPOCH_NS else log_time_ns


def _report(
    runs: list[tuple[str, ...]],
    old: list[Contents],
    new: list[Contents],
    folded: dict[str, list[str]],
    topics: bool,
) -> int:
    total = different = 0
    for run, before, after in zip(runs, old, new, strict=True):
        old_names, new_names = comparable(before, after, folded)
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


def comparable(
    old: Contents, new: Contents, folded: dict[str, list[str]]
) -> tuple[Contents, Contents]:
    """Both sides in the same words: the old one renamed, the new one without what the old one
    could not say."""
    rewritten = [
        (f'"phase":"{part}"'.encode(), f'"phase":"{whole}"'.encode())
        for whole, parts in folded.items()
        for part in parts
    ]
    for topic, fields in ADDED_FIELDS:
        said = b"".join(data for (name, _), (_, data) in old.items() if name == topic)
        if fields.partition(b":")[0] not in said:
            new = _replaced(new, [(fields, b"")], topic)
    for topic, pattern in ADDED_TIMES:
        if not any(
            name == topic and re.search(pattern, data) for (name, _), (_, data) in old.items()
        ):
            new = {key: (t_ns, re.sub(pattern, b"", data) if key[0] == topic else data)
                   for key, (t_ns, data) in new.items()}  # fmt: skip
    return _replaced(old, RENAMED), _replaced(new, rewritten)


def _replaced(contents: Contents, by: Sequence[tuple[bytes, bytes]], topic: str = "") -> Contents:
    """With one for the other, in the messages of a topic or in all."""
    changed = {}
    for key, (t_ns, data) in contents.items():
        pairs = by if topic in ("", key[0]) else ()
        changed[key] = t_ns, functools.reduce(lambda said, pair: said.replace(*pair), pairs, data)
    return changed


if __name__ == "__main__":
    sys.exit(main())
