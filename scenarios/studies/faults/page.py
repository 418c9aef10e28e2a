"""The generated part of docs/faults.md: what the campaign's runs gave."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import median

from scenarios.studies.faults.cases import STRETCHES, plan
from scenarios.studies.faults.declared import DECLARED, Declared
from scenarios.studies.faults.last_line import TOUCH_N
from scenarios.studies.faults.run import OFF_TABLE_M, Ended
from scenarios.studies.faults.verdict import CHECKS, declared, fell, gripped, problems

COMMAND = "make faults"
CODE = (
    "@trial,scenarios/lift,scenarios/studies/faults,-scenarios/studies/faults/page.py,"
    "-scenarios/studies/faults/wired.py"
)
LONGEST = 90  # characters of a message
ONE = re.compile(r"taxel [ABC]\d")
NOT_ON_THE_WAY = re.compile(r"\d+(\.\d+)?")


def generated(ended: Sequence[Ended], codes: Sequence[str], detector: str) -> str:
    """In Markdown; ``codes``: what the runs were made with, the oldest first."""
    alone = [e for e in ended if e.case.fault is not None and e.case.then is None]
    parts = [
        _head(ended, codes),
        _entry(codes, detector, 3),
        *_summary(ended), *_by_phase(alone), *_by_fault(alone, [e for e in ended if e.case.safe]),
        "## Named cases\n",
        "What may happen is named in `scenarios/studies/faults/declared.py`: four cases were "
        "committed before any run\nwas looked at, the others are marked. A run in which something "
        "else happens, or in which the user is not told, fell.\n",
        _entry(codes, detector, 1),
        *_named(ended),
        *_fallen(ended),
    ]  # fmt: skip
    return "\n".join(parts)


def _head(ended: Sequence[Ended], codes: Sequence[str]) -> str:
    fallen = sum(bool(fell(e)) for e in ended)
    named = [
        case.foretold(found)
        for e in ended if (found := problems(e)) and (case := declared(e, found))
    ]  # fmt: skip
    before = sum(named)
    unstruck = sum(not e.struck and e.case.fault is not None for e in ended)
    sent = [e for e in ended if e.case.fault is not None and e.case.fault.part == "command"]
    sent = [e for e in sent if e.case.then is None]
    safe = [e for e in ended if e.case.safe]
    return (
        f"{len(ended)} of {len(plan())} planned runs, {fallen} fell, {before} did what had been "
        f"named before any run was looked at, {len(named) - before} what was named after it had "
        f"been seen; made at {', '.join(codes)}.\n"
        f"{unstruck} were never struck: their lift did not come to the step. A command of its own "
        f"was taken in {sum(e.taken > 0 for e in sent)} of {len(sent)} runs,\nand one of the safe "
        f"state in {sum(e.taken_safe for e in safe)} of {len(safe)}.\n"
    )


def _entry(codes: Sequence[str], detector: str, tables: int) -> str:
    name = "fault-campaign" if tables > 1 else "faults-named"
    commit = codes[0].removesuffix("-dirty") if codes else "0000000"
    return (
        f'<!-- figure: id={name} command="{COMMAND}" detector={detector} commit={commit} '
        f"code={CODE} tables={tables} -->"
    )


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in (head, *rows)]
    return [lines[0], "|" + "---|" * len(head), *lines[1:], ""]


def _seconds(values: Iterable[float | None]) -> str:
    known = sorted(value for value in values if value is not None)
    return f"{median(known):.2f}, {known[-1]:.2f}" if known else ""


def _figures(runs: Sequence[Ended]) -> list[object]:
    safe = [e for e in runs if e.noticed_s is not None]
    stood = sum(e.later_arm_mps == 0.0 and e.later_fingers_mps == 0.0 for e in runs)
    return [
        len(runs), len(safe), _seconds(e.noticed_s for e in safe), _seconds(e.arm_s for e in safe),
        _seconds(e.hand_s for e in safe), _holds(runs), stood,
        f"{max(e.peak_n for e in runs):.1f}",
    ]  # fmt: skip


def _holds(runs: Sequence[Ended]) -> str:
    """Of those that pressed on something when the safe state began: how many did so throughout,
    and the least of it."""
    least = [e.least_n for e in runs if gripped(e) and e.least_n is not None]
    kept = [n for n in least if n > TOUCH_N]
    with_n = f", {min(kept):.1f} N" if kept else ""
    return f"{len(kept)} of {len(least)}{with_n}" if least else ""


FIGURES = (
    "runs", "safe state", "after, s", "arm stands, s", "hand stands, s", "hand holds",
    "nothing moves", "peak, N",
)  # fmt: skip
TWO = "two of all"
PARTS = {"state": ": a field of its state", "command": ": a command", "link": ": its link",
         "registers": ": another client's writes"}  # fmt: skip


def _summary(ended: Sequence[Ended]) -> list[str]:
    groups: dict[str, list[Ended]] = {}
    for e in ended:
        first = e.case.fault
        name = "nothing" if first is None else f"{first.device}{PARTS.get(first.part, '')}"
        if e.case.then is not None:
            name = f"{e.case.then.device}: a command of a safe state" if e.case.safe else TWO
        groups.setdefault(name, []).append(e)
    rows = (
        [name, *_figures(runs), sum(not fell(e) and bool(problems(e)) for e in runs),
         sum(bool(fell(e)) for e in runs)]
        for name, runs in groups.items()
    )  # fmt: skip
    return table(("what fails", *FIGURES, "named beforehand", "fell"), rows)


def _by_phase(alone: Sequence[Ended]) -> list[str]:
    def row(name: str, runs: Sequence[Ended]) -> list[object]:
        return [name, *_figures(runs), _objects(runs)]

    groups: dict[str, list[Ended]] = {}
    for phase, visit in STRETCHES:
        where = f"{phase}{f', time {visit}' if visit > 1 else ''}"
        runs = [e for e in alone if (e.case.phase, e.case.visit) == (phase, visit)]
        if runs:
            groups[where] = runs
    return table(
        ("phase", *FIGURES, "the object, long after"),
        (row(name, runs) for name, runs in groups.items()),
    )


def _by_fault(alone: Sequence[Ended], safe: Sequence[Ended]) -> list[str]:
    """A command that a safe state sends has a row of its own."""
    groups: dict[str, list[Ended]] = {}
    for e in sorted((*alone, *safe), key=lambda e: e.case.number):
        name = str(e.case.then if e.case.safe else e.case.fault)
        name = f"{name}, in a safe state" if e.case.safe else ONE.sub("one taxel", name)
        groups.setdefault(name, []).append(e)
    rows = (
        [name, *_figures(runs), _taken(runs), _slid(runs), _objects(runs), _told(runs)]
        for name, runs in groups.items()
    )  # fmt: skip
    head = ("fault", *FIGURES, "took", "slid, mm", "the object, long after", "told most often")
    return table(head, rows)


def _taken(runs: Sequence[Ended]) -> str:
    """Of a fault of commands: in how many runs it took one, in a safe state one of its own."""
    faults = {(e.case.then if e.case.safe else e.case.fault) for e in runs}
    if any(fault is None or fault.part != "command" for fault in faults):
        return ""
    took = sum(e.taken_safe if e.case.safe else e.taken > 0 for e in runs)
    return f"{took} of {len(runs)}"


def _objects(runs: Sequence[Ended]) -> str:
    return ", ".join(f"{n} {name}" for name, n in Counter(map(object_of, runs)).most_common())


def object_of(end: Ended) -> str:
    if end.let_go_m > OFF_TABLE_M:
        return "fell"
    if end.height_m > OFF_TABLE_M:
        return "held in the air"
    return "in the hand, on the table" if end.later_pressed_n > TOUCH_N else "on the table"


def _slid(runs: Sequence[Ended]) -> str:
    most = max(e.slid_m for e in runs) * 1e3
    return f"{most:.0f}" if most >= 1.0 else ""


def _told(runs: Sequence[Ended]) -> str:
    """What the last line begins with, figures left out."""
    said = Counter(NOT_ON_THE_WAY.sub("N", e.message.partition("; then ")[0]) for e in runs)
    said.pop("", None)
    if not said:
        return ""
    text, times = said.most_common(1)[0]
    cut = text if len(text) <= LONGEST else text[:LONGEST] + " ..."
    return f"{cut.replace('|', ' ')} ({times})"


def _named(ended: Sequence[Ended]) -> list[str]:
    used = Counter(
        case.name for e in ended if (found := problems(e)) and (case := declared(e, found))
    )

    def pattern(text: str) -> str:
        return f"`{text}`".replace("|", "\\|")

    rows = (
        [d.name, _when(d), pattern(d.faults), ", ".join(sorted(d.may)), d.why,
         pattern(d.told), used[d.name]]
        for d in DECLARED
    )  # fmt: skip
    return table(
        ("case", "named", "faults", "what may be", "why", "the user is told", "runs"), rows
    )


def _when(case: Declared) -> str:
    """It was named, as against runs that were looked at."""
    if not case.beforehand:
        return "**after it was seen**"
    more = f"; {', '.join(sorted(case.since))} **after it was seen**" if case.since else ""
    return f"before any run{more}"


def _fallen(ended: Sequence[Ended]) -> list[str]:
    fallen = [e for e in ended if fell(e)]
    if not fallen:
        return ["Nothing fell: no run showed anything else of " + ", ".join(CHECKS) + ".\n"]
    lines = ["## What fell\n"]
    for e in fallen:
        found = "; ".join(f"{name}: {text}" for name, text in fell(e).items())
        lines.append(f"- {e.case.number} ({e.case}): {found}")
    return [*lines, ""]
