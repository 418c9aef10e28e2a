"""Compare the messages of every run with those of another commit.

    python tests/tools/same_messages.py HEAD~1 [--objects can ball] [--seeds 0 1] [--within 1e-6]

Both trees run the same lifts, taps and acquisition on the simulated rig, each from its own
checkout with this interpreter. Then the recordings are compared message by message: channel, log
time and content, after ``RENAMED`` has been applied to the older messages. Metadata (settings,
versions) are left out. Exit code 1 if anything differs.
"""

import argparse
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

HOME = Path(__file__).resolve().parents[2]
OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
ACQUISITION = ("acquire", "--surface", "sphere", "--direction", "45", "--seconds", "20")

# Patterns in older messages (JSON text) and their present form
RENAMED = {
    # fields
    r'"asked":(?=\{"velocity_mps")': '"command":',
    r'"struck_s":': '"impact_s":',
    r'"asked":(?=\{"type")': '"requested":',
    r'"measured_n":': '"estimated_n":',
    r'"force_cap_n":': '"force_limit_n":',
    r'"CloseFast"': '"CloseToLimit"',
    r'"more":(true|false)': r'"first_stage":\1',
    r'"limits_counts":': '"ends_counts":',
    r'("sampled_ns":(?:\d+|null))\}': r'\1,"joints_rad":null}',  # as on the rig `simulated`
    # causes of transitions
    r"asked to set down": "set-down requested",
    r"contact lost on the way down": "contact lost while lowering",
    r"from here on the object may stand": "from here on the object may touch the table",
    r"the arm has stood for long enough": "the arm has rested long enough",
    r"the detector has listened": "the detector has its baseline",
    r"the force that was found has carried": "the force that ended slip has carried",
    r"has carried the object(?=\")": "has carried the object: margin added",
    r"grip is ([\d.]+) N tighter on the way down": r"grip tightened by \1 N while lowering",
    r"the hand closed and met nothing": "the hand closed and met no object",
    r"slip comes back and": "slip recurs and",
    r"slip goes on and": "slip continues and",
    r"the force can rise no more": "the force cannot rise further",
    r"slip goes on, and the hold ends by its clock": "slip continues; the hold ends after hold_s",
    r"a step down (changed the grip by \S+ N): it stands": r"the object stands: a step \1",
}  # fmt: skip

# Fields of the detector's outputs, which depend on the rounding of its arithmetic
OUTPUTS = ("probabilities", "speed_mps", "turning")

Run = tuple[str, ...]  # arguments of `grasp run`
Key = tuple[str, int]  # channel and its n-th message, or a recording's array
Contents = dict[Key, tuple[int, bytes]]  # log time in ns, bytes


def main() -> int:
    """Run both trees and print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("commit", help="to compare with")
    parser.add_argument("--objects", nargs="+", default=OBJECTS, choices=OBJECTS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--profile", help="of lifts and taps; leaves out the acquisition")
    parser.add_argument(
        "--within",
        type=float,
        default=0.0,
        help="allowed difference of the detector's outputs: " + ", ".join(OUTPUTS),
    )
    parser.add_argument("--topics", action="store_true", help="count differences by channel")
    args = parser.parse_args()
    different = total = 0
    with tempfile.TemporaryDirectory() as scratch:
        before = Path(scratch, "tree")
        _check_out(args.commit, before)
        for i, run in enumerate(_runs(args.objects, args.seeds, args.profile)):
            old = renamed(record(before, run, Path(scratch, "old", str(i))))
            new = record(HOME, run, Path(scratch, "new", str(i)))
            wrong = differences(old, new, args.within)
            total, different = total + len(old.keys() | new.keys()), different + len(wrong)
            print(f"{' '.join(run)}: {len(old.keys() | new.keys())} messages, {len(wrong)} differ")
            _show(wrong, old, new, args.topics)
    print(f"{total} messages, {different} differ")
    return int(different > 0)


def renamed(old: Contents) -> Contents:
    """Apply ``RENAMED`` to the messages; arrays are unchanged."""
    return {key: (t_ns, _renamed(data)) for key, (t_ns, data) in old.items()}


def _renamed(data: bytes) -> bytes:
    try:
        text = data.decode()
    except UnicodeDecodeError:  # an array
        return data
    for pattern, present in RENAMED.items():
        text = re.sub(pattern, present, text)
    return text.encode()


def differences(old: Contents, new: Contents, within: float = 0.0) -> list[Key]:
    """Keys of messages that one side lacks or that are not the same, sorted."""
    keys = sorted(key for key in old.keys() | new.keys() if old.get(key) != new.get(key))
    both = old.keys() & new.keys() if within else set()
    return [key for key in keys if key not in both or not _near(old[key], new[key], within)]


def _near(old: tuple[int, bytes], new: tuple[int, bytes], within: float) -> bool:
    """Whether two messages differ only in the detector's outputs, by at most ``within``."""
    pattern = rb'"(?:' + "|".join(OUTPUTS).encode() + rb')":\[([^]]*)\]'
    rest = [(t_ns, re.sub(pattern, b"", data)) for t_ns, data in (old, new)]
    a, b = (
        [float(n) for numbers in re.findall(pattern, data) for n in numbers.split(b",")]
        for _, data in (old, new)
    )
    return rest[0] == rest[1] and len(a) == len(b) and np.allclose(a, b, rtol=within, atol=within)


def _show(wrong: Sequence[Key], old: Contents, new: Contents, topics: bool) -> None:
    for topic in sorted({topic for topic, _ in wrong}) if topics else ():
        print(f"    {topic}: {sum(name == topic for name, _ in wrong)}")
    for key in wrong[:1]:
        print(f"    first: {key}\n      {old.get(key)}\n      {new.get(key)}"[:1200])


def _runs(objects: Sequence[str], seeds: Sequence[int], profile: str | None) -> Iterator[Run]:
    chosen = ("--profile", profile) if profile else ()
    for scenario in (("lift",), ("tap", "--trials", "1")):
        for name in objects:
            for seed in seeds:
                yield (*scenario, "--object", name, "--seed", str(seed), *chosen)
    if not profile:
        yield (*ACQUISITION, "--seed", "0")


def _check_out(commit: str, folder: Path) -> None:
    """Put the files of a commit into a folder, without touching this checkout."""
    folder.mkdir()
    archive = subprocess.run(
        ["git", "archive", commit], cwd=HOME, check=True, stdout=subprocess.PIPE
    ).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)


def record(tree: Path, run: Run, folder: Path) -> Contents:
    """Messages and outcome of one `grasp run` of a tree. Raises SystemExit if it left none."""
    start = "import sys; from grasp.cli.main import main; sys.exit(main())"
    command = (
        sys.executable, "-P", "-c", start,
        "run", *run, "--rig", "simulated", "--runs", str(folder), "--json",
    )  # fmt: skip
    env = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
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


def _messages(path: Path) -> Contents:
    contents: Contents = {}
    numbers: dict[str, int] = {}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            number = numbers[channel.topic] = numbers.get(channel.topic, -1) + 1
            contents[channel.topic, number] = message.log_time, message.data
    return contents


if __name__ == "__main__":
    sys.exit(main())
