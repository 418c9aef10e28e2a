"""Hostile clients on every port of one cell, and a well-behaved one beside them.

    python -m tests.wire.fuzz.campaign --minutes 60 [--seed 1]     (make fuzz)

Kept cases (`kept.txt`) go first, then those that a campaign before met last (`FOUND`). Prints, a
line a port, the well-behaved client's median wait without and with the attack and their ratio, and
the cell's memory; ends with 1 when the cell died, grew, left somebody unanswered, does not end
within `PATIENCE_S` of SIGTERM, or had the client of some port wait more than `MOST_RATIO` times as
long. Then it says which cases it met last, and appends them to `FOUND`: most of them are innocent,
so which one goes into `kept.txt`, and is played by the tests too, is for a person to find out.

A line is a port, a seed and a mark of what the two say together: a seed says something else once
its grammar, or a list that it draws from, is another (`test_kept_cases_say_what_they_said`).
"""

import argparse
import contextlib
import hashlib
import json
import math
import os
import random
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

from scenarios.campaign.config import load_for_devices
from scenarios.rigs.cell_process import cell_process
from tests.wire.fuzz.grammars import GRAMMARS

HERE = Path(__file__).parent
KEPT = HERE / "kept.txt"
FOUND = HERE.parents[2] / "build" / "fuzz-found.txt"  # no part of the tree: suspects
ATTACKERS = 6
PAUSE_S = 0.02  # between two connections of one attacker: loops of requests are bounded
SAY_S = 0.5  # for one connection to say what it has to say
MOST_GROWTH_MB = 150.0
BLOCK_S = 20.0
QUIET_S = 8.0
MOST_RATIO = 2.0  # of a port's median waits, beside the attack and before and after it
LAST = 100  # cases that are met while a cell that one of them ended is not yet known to have ended
PATIENCE_S = 30.0  # from SIGTERM to the end of a cell; a busy machine may hold it up

Case = tuple[str, int]


def marked(case: Case) -> str:
    """The case as a line that tells whether it still says the same."""
    name, seed = case
    said = b"|".join(GRAMMARS[name](random.Random(seed)))
    return f"{name} {seed} {hashlib.sha256(said).hexdigest()[:8]}"


def kept_lines(path: Path = KEPT) -> list[str]:
    """Without comments; none where there is no file."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [line for line in (each.partition("#")[0].strip() for each in lines) if line]


def kept_cases(path: Path = KEPT) -> list[Case]:
    return [(name, int(seed)) for name, seed, _ in map(str.split, kept_lines(path))]


def keep(cases: list[Case], trouble: str, path: Path) -> None:
    """Append those that are not in it yet, under what was wrong."""
    path.parent.mkdir(parents=True, exist_ok=True)
    known = kept_lines(path)
    new = [line for line in dict.fromkeys(map(marked, cases)) if line not in known]
    with path.open("a") as file:
        file.writelines(f"{line}\n" for line in (f"# {' '.join(trouble.split())}", *new))


class Attack:
    """Threads that play cases until they are stopped."""

    def __init__(self, at: dict[str, Any], seed: int, first: list[Case]) -> None:
        self.played = 0
        self.last: deque[Case] = deque(maxlen=LAST)
        self._ports = ports(at)
        self._first = deque(first)
        self._random = random.Random(seed)
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._threads = [threading.Thread(target=self._play) for _ in range(ATTACKERS)]

    def __enter__(self) -> "Attack":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        for thread in self._threads:
            thread.join()

    def _next(self) -> Case:
        with self._lock:
            self.played += 1
            if self._first:
                case = self._first.popleft()
            else:
                case = self._random.choice(sorted(GRAMMARS)), self._random.randrange(2**31)
            return case

    def _play(self) -> None:
        while not self._end.wait(PAUSE_S):
            case = self._next()
            if play(self._ports, case):
                self.last.append(case)


def ports(at: dict[str, Any]) -> dict[str, list[tuple[str, int]]]:
    host, arm = at["host"], at["arm"]
    url = at["tactile"]["url"].removeprefix("tcp://").rpartition(":")
    found = {
        "urscript": [(host, 30001), (host, 30002), (host, arm["script"])],
        "rtde": [(host, arm["rtde"])],
        "modbus": [(at["gripper"]["host"], at["gripper"]["port"])],
        "hop": [(url[0], int(url[2]))],
        "dashboard": [(host, arm["dashboard"])],
        "control": [(at["control"]["host"], at["control"]["port"])],
        "faults": [(host, arm["faults"])],
    }
    return {**found, "silence": [one for those in found.values() for one in those]}


def play(where: dict[str, list[tuple[str, int]]], case: Case) -> bool:
    """One connection: says its pieces, reads what it likes, leaves in one way or another. Whether
    there was one: a cell that has ended meets hundreds a second, none of which ended it."""
    connected = False
    name, seed = case
    r = random.Random(seed)
    said = GRAMMARS[name](r)
    address, reads, waits = r.choice(where[name]), r.random() < 0.7, r.choice((0.0, 0.0, 0.3))
    with contextlib.suppress(OSError), socket.create_connection(address, 5.0) as sock:
        connected = True
        until = time.monotonic() + SAY_S
        sock.settimeout(SAY_S)
        for piece in said:
            sock.sendall(piece)
            if reads:
                sock.settimeout(0.01)
                with contextlib.suppress(TimeoutError):
                    sock.recv(1 << 16)
                sock.settimeout(max(0.01, until - time.monotonic()))
        time.sleep(waits)
        if r.random() < 0.3:  # reset instead of closed
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    return connected


def memory_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


def polite(endpoints: Path, seconds: float) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tests.wire.fuzz.polite", str(endpoints), str(seconds)],
        capture_output=True, text=True, timeout=seconds + 300, check=False,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[2])},
    )  # fmt: skip
    if done.returncode:
        return {"median_ms": {}, "most_ms": {}, "errors": {"all": done.stderr[-300:]}}
    found: dict[str, Any] = json.loads(done.stdout)
    return found


class Outcome:
    """What a campaign found."""

    def __init__(self) -> None:
        self.quiet: list[dict[str, Any]] = []
        self.loud: list[dict[str, Any]] = []
        self.played = 0
        self.memory_mb: list[float] = []
        self.trouble = ""
        self.last: list[Case] = []

    def ratios(self) -> dict[str, tuple[float, float, float]]:
        """By port: median without, with, and their ratio: the median of the blocks' ratios, each
        to the quiet before and after it, for the machine may have been another in another block."""
        found = {}
        for name in self.quiet[0]["median_ms"]:
            quiet, loud = (
                [one["median_ms"].get(name, math.nan) for one in those]
                for those in (self.quiet, self.loud)
            )
            pairs = zip(quiet, quiet[1:], loud, strict=False)
            ratios = [2.0 * beside / (before + after) for before, after, beside in pairs]
            found[name] = _median(quiet), _median(loud), _median(ratios)
        return found

    def starved(self, most_ratio: float) -> str:
        """Whose client waited longer than it may, or ""."""
        slow = {name: ratio for name, (_, _, ratio) in self.ratios().items() if ratio > most_ratio}
        told = ", ".join(f"{name} {ratio:.2f}" for name, ratio in slow.items())
        return told and f"waited more than {most_ratio:g} times as long: {told}"

    def show(self) -> None:
        least, most = self.memory_mb[0], max(self.memory_mb)
        print(f"{self.played} connections; memory {least:.0f} to {most:.0f} MB")
        print("port        median ms, quiet   attacked   ratio   longest")
        for name, (quiet, loud, ratio) in self.ratios().items():
            longest = max(one["most_ms"].get(name, 0.0) for one in self.loud)
            print(f"{name:10} {quiet:18.2f} {loud:10.2f} {ratio:7.2f} {longest:9.0f}")
        if self.trouble:
            print(f"TROUBLE: {self.trouble}")


def _median(values: list[float]) -> float:
    """Of those that there are."""
    return statistics.median([value for value in values if not math.isnan(value)] or [math.nan])


def campaign(
    seed: int, seconds: float, first: list[Case], most_ratio: float = MOST_RATIO
) -> Outcome:
    """Attack a cell of its own in blocks, quiet in between."""
    config = load_for_devices("can", "emulated", [], [])
    outcome = Outcome()
    with tempfile.TemporaryDirectory() as folder, cell_process(config, 0) as cell:
        endpoints = Path(folder) / "endpoints.json"
        endpoints.write_text(json.dumps(cell.endpoints))
        pid = cell.endpoints["pid"]
        outcome.quiet.append(polite(endpoints, QUIET_S))
        outcome.memory_mb.append(memory_mb(pid))
        until = time.monotonic() + seconds
        block = 0
        while time.monotonic() < until and not outcome.trouble:
            with Attack(cell.endpoints, seed * 1000 + block, first if not block else []) as attack:
                outcome.loud.append(polite(endpoints, min(BLOCK_S, seconds)))
            outcome.played += attack.played
            outcome.last = list(attack.last)
            block += 1
            outcome.memory_mb.append(memory_mb(pid))
            outcome.quiet.append(polite(endpoints, QUIET_S / 2))
            outcome.trouble = _trouble(outcome)
            print(
                f"block {block}: {attack.played} cases, {outcome.memory_mb[-1]:.0f} MB", flush=True
            )
        outcome.trouble = outcome.trouble or ended_badly(pid, PATIENCE_S)
    outcome.trouble = outcome.trouble or outcome.starved(most_ratio)
    return outcome


def ended_badly(pid: int, patience_s: float) -> str:
    """Ask a child of this process to end; what is wrong with the way in which it does, or "". Its
    status stays to be waited for by whoever started it."""
    os.kill(pid, signal.SIGTERM)
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        end = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if end is not None:
            well = (end.si_code, end.si_status) == (os.CLD_EXITED, 0)
            return "" if well else f"ended by SIGTERM with {end.si_status}"
        time.sleep(0.05)
    return f"not ended {patience_s:g} s after SIGTERM"


def _trouble(outcome: Outcome) -> str:
    for one in (outcome.loud[-1], outcome.quiet[-1]):
        if one["errors"]:
            return f"unanswered: {one['errors']}"
    if max(outcome.memory_mb) - outcome.memory_mb[0] > MOST_GROWTH_MB:
        return "the cell has grown"
    return ""


def main(given: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--found", type=Path, default=FOUND, help="the last cases before trouble")
    options = parser.parse_args(given)
    first = [*kept_cases(), *kept_cases(options.found)]
    outcome = campaign(options.seed, options.minutes * 60.0, first)
    outcome.show()
    if outcome.trouble:
        keep(outcome.last, outcome.trouble, options.found)
        print(f"last cases: appended to {options.found}, and played first the next time")
    return 1 if outcome.trouble else 0


if __name__ == "__main__":
    sys.exit(main())
