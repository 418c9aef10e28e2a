"""What may not be of an hour of lifts, and what came of it.

What is counted may not grow after the first ten minutes, nothing may be left behind, whoever looks
at the page must be told, and there must have been enough: lifts, struck ones, counts, periods of
the loop that does nothing. The loop may miss no more than is stated beside that one. Of each lift,
struck or not: no true force past limit and overshoot, no object lost in the air or sliding there,
nothing that moves after the end, nothing ended by a time-out. A struck one may end in a fault,
whose last line must be so; one that was not, in none, unless it was late while the loop that does
nothing missed a period.
"""

import re
from collections import Counter
from collections.abc import Sequence

import msgspec
import numpy as np

from grasp.doubt import STOOD_STILL
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.report.live.feed import EVERY
from scenarios.studies.faults.declared import CANNOT_BE_TOLD
from scenarios.studies.faults.last_line import STILL_MPS, TIMED_OUT, TOUCH_N, Known, misled
from scenarios.studies.faults.run import SLIDES_MPS
from scenarios.studies.faults.verdict import LET_GO_M, MOST_N, SAID, SLID_M
from scenarios.trial.execution import STALE

SETTLED_S = 600.0  # what is made once has been made by then
# Of resident memory: a float that each tick leaves behind, 32 bytes with its place in a list, makes
# 11.5 MB an hour at 100 Hz; a third of that is no longer what comes and goes.
MOST_GROWTH_MB_H = 4.0
MOST_SPREAD_MB = 12.0  # twice of what came and went in an hour in which nothing grew
# half of what an hour makes on a machine that has other work; a tenth of them struck, where a
# fourth is drawn; of the idle loop nearly all
LEAST_LIFTS_A_MINUTE, LEAST_STRUCK, LEAST_COUNTED = 2.0, 0.1, 0.5
BEATS_A_MINUTE, LEAST_SHARE = 6_000, 0.9
LEAST_SEEN = 0.5  # of the rows of all ticks that were watched
# of its periods that a loop may miss beyond the idle one's share: it is watched and counted, and
# one whose device was struck waits for it
MOST_MISSED, MOST_MISSED_STRUCK = 0.01, 0.1
LOADED = (
    "beside other work on the machine a lift, which computes, is late where a loop that does "
    "nothing is not (see uptime); alone on it, the lifts are too slow (docs/testing.md, An hour)"
)
LOST = frozenset({LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE})
NOT_OPENED = "not opened"
NEVER = frozenset({"", NOT_OPENED, LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED})
TAKE_THE_HAND = ("gripper_freeze", "gripper_disconnect", "gripper_fault")  # it obeys no more
NEAR_S = 6.0  # a fault's safe state, and what follows before it is told, last no longer
DEVICES = {
    "gripper": "gripper",
    "usb": "fingertips",
    "unplug": "fingertips",
    "arm": "arm",
    "protective": "arm",
}  # that a fault strikes, by its first word


class Count(msgspec.Struct, frozen=True):
    """What this process holds, `t_s` after the beginning; memory in MB. ``each_mb``: of each other
    process, by what it is; empty in files that were made before it was counted."""

    t_s: float
    resident_mb: float
    descriptors: int
    threads: int
    children: int
    children_mb: float
    each_mb: dict[str, float] = {}


class After(msgspec.Struct, frozen=True):
    """What the cell knows after a lift: the fastest that arm and fingers were in a moment then, and
    at last what the most loaded finger bears, whether the hand is open, and the object."""

    arm_mps: float
    fingers_mps: float
    pressed_n: float
    opened: bool
    height_m: float
    slip_mps: float


class Lift(msgspec.Struct, frozen=True):
    """One that was made. ``struck``: fault and phase, empty for none. ``peak_n``: true, of any
    finger, None where nothing was judged. ``let_go_m``: height at which the hand lost the object,
    0 for none; ``slid_m``: its way in the hand, in the air. ``told``, ``arm``: how hand and arm
    were left, by the last line. Times since the machine's clock began. None: nobody looked."""

    seed: int
    object: str
    struck: str
    outcome: str
    kind: str
    message: str
    told: str
    periods: int
    missed: int
    cell_stalls: int
    peak_n: float | None
    let_go_m: float
    begun_s: float
    ended_s: float
    arm: str | None = None
    slid_m: float | None = None
    after: After | None = None

    def __str__(self) -> str:
        struck = f", {self.struck}" if self.struck else ""
        return f"seed {self.seed}, {self.object}{struck}"


class Soak(msgspec.Struct, frozen=True):
    """All of it. ``idle``: periods of the loop that does nothing, and those it missed;
    ``idle_late_s``: when it did, by the clock of ``Lift.begun_s``."""

    minutes: float
    real_time: bool
    lifts: list[Lift]
    counts: list[Count]
    idle: tuple[int, int]
    idle_late_s: list[float]
    left: list[str]  # behind, at the end
    lost_rows: int  # that the page was not told
    seen_rows: int | None = None  # by who looked at it; None: he had ended before, or was not asked


def grown(counts: Sequence[Count]) -> dict[str, tuple[float, float, float]]:
    """Of each count, after the first ten minutes: least, most, and what a straight line through
    them says that it grows by in an hour. A process that is begun anew with each rig is counted as
    the one before it."""
    late = [c for c in counts if c.t_s > SETTLED_S]
    if len(late) < 3:
        return {}
    hours = np.array([c.t_s for c in late]) / 3600.0
    names = ("resident_mb", "descriptors", "threads", "children", "children_mb")
    counted = {name: [float(getattr(c, name)) for c in late] for name in names}
    for role in sorted({role for c in late for role in c.each_mb}):
        counted[f"{role}_mb"] = [c.each_mb.get(role, 0.0) for c in late]
    return {
        name: (min(values), max(values), float(np.polyfit(hours, np.array(values), 1)[0]))
        for name, values in counted.items()
    }


def wrong(told: Soak) -> list[str]:
    """What may not be."""
    found = [f"left behind: process {pid}" for pid in told.left]
    found += [*too_few(told), *growing(told)]
    if told.lost_rows:
        found.append(f"the page was not told {told.lost_rows} rows")
    least = LEAST_SEEN * sum(made.periods for made in told.lifts) / EVERY
    if told.seen_rows is None:
        found.append("who looked at the page had ended, or was not asked")
    elif told.seen_rows < least:
        found.append(f"who looked at the page saw {told.seen_rows} rows, at least {least:.0f} came")
    for struck, most in ((False, MOST_MISSED), (True, MOST_MISSED_STRUCK)):
        share, idle_share = missed_share(told, struck), told.idle[1] / max(1, sum(told.idle))
        if share > idle_share + most:
            which = "struck" if struck else "not struck"
            found.append(f"lifts that were {which} missed {share:.1%} of their periods, "
                         f"the idle loop {idle_share:.2%}: {LOADED}")  # fmt: skip
    return found + [f"{made}: {text}" for made in told.lifts for text in wrong_in(made, told)]


def too_few(told: Soak) -> list[str]:
    """What there was less of than can be judged by."""
    lifts, minutes = len(told.lifts), told.minutes
    struck = sum(bool(made.struck) for made in told.lifts)
    lasted_s = told.lifts[-1].ended_s - told.lifts[0].begun_s if told.lifts else 0.0
    opened = [made for made in told.lifts if made.outcome != NOT_OPENED]
    looked = [made for made in opened if made.after and made.slid_m is not None]
    had = {
        "lifts": (lifts, LEAST_LIFTS_A_MINUTE * minutes),
        "struck lifts": (struck, int(LEAST_STRUCK * LEAST_LIFTS_A_MINUTE * minutes)),
        "counts": (len(told.counts), LEAST_COUNTED * lifts),
        "periods of the idle loop": (sum(told.idle), LEAST_SHARE * BEATS_A_MINUTE * minutes),
        "seconds": (lasted_s, LEAST_SHARE * 60.0 * minutes),
        "lifts whose object and motion somebody looked at": (len(looked), len(opened)),
    }  # fmt: skip
    if minutes * 60.0 > 2 * SETTLED_S:
        late = sum(c.t_s > SETTLED_S for c in told.counts)
        had["counts after ten minutes"] = late, LEAST_COUNTED * len(told.counts)
    return [f"{n:.0f} {what}, {least:.0f} are the least" for what, (n, least) in had.items()
            if n < least]  # fmt: skip


def growing(told: Soak) -> list[str]:
    """What is not flat once all has been made."""
    found = []
    for name, (least, most, slope) in grown(told.counts).items():
        if not name.endswith("mb"):
            found += [f"{name}: {least:g} to {most:g}"] if most != least else []
            continue
        if slope > MOST_GROWTH_MB_H:
            found.append(f"{name} grows by {slope:.1f} MB an hour")
        if most - least > MOST_SPREAD_MB:
            found.append(f"{name}: {least:.0f} to {most:.0f} MB")
    return found


def missed_share(told: Soak, struck: bool) -> float:
    """Of all periods that were due in lifts that were struck, or in those that were not."""
    return missed_of([made for made in told.lifts if bool(made.struck) is struck])


def missed_of(lifts: Sequence[Lift]) -> float:
    """Of all their periods."""
    missed = sum(made.missed for made in lifts)
    return missed / max(1, missed + sum(made.periods for made in lifts))


def wrong_in(made: Lift, told: Soak) -> list[str]:
    """What may not be in one lift, struck or not."""
    found = [*_of_object(made), *_of_motion(made)]
    if made.outcome in NEVER | LOST:
        found.append(f"{made.outcome or 'no verdict'}: {made.message}")
    if made.outcome in SUCCESSES and (made.peak_n is None or not made.periods):
        found.append(f"{made.outcome}, and nobody saw it")
    if made.peak_n is not None and made.peak_n > MOST_N:
        found.append(f"a true force of {made.peak_n:.1f} N")
    if re.search(TIMED_OUT, made.message):
        found.append(f"ended by a time-out: {made.message}")
    if made.outcome == LiftOutcome.FAULT:
        if not made.struck and not excused(made, told):
            found.append(f"failed by itself: {made.message}")
        else:
            # a row that does not say how the arm was left is told of once, with all its like
            arm = "the arm stands" if made.arm is None else made.arm
            found += misled(made.message, arm, made.told, known(made, told))
            found += [f"no such {name}: {said!r}" for name, said in
                      (("arm", arm), ("hand", made.told))
                      if said and re.fullmatch(SAID[name], said) is None]  # fmt: skip
    return found


def _of_object(made: Lift) -> list[str]:
    found, after = [], made.after
    if made.let_go_m > LET_GO_M:
        found.append(f"let go at {made.let_go_m * 1e3:.0f} mm")
    if made.slid_m is not None and made.slid_m > SLID_M:
        found.append(f"slid {made.slid_m * 1e3:.0f} mm in the air")
    if after is not None and after.height_m > LET_GO_M and after.slip_mps > SLIDES_MPS:
        found.append(f"goes on sliding at {after.slip_mps:.3f} m/s")
    return [] if could_not_hold(made) else found


def _of_motion(made: Lift) -> list[str]:
    moves = {} if made.after is None else {
        "the arm moves": made.after.arm_mps, "the fingers move": made.after.fingers_mps,
    }  # fmt: skip
    return [f"{what} at {mps:.4f} m/s after the end" for what, mps in moves.items()
            if mps > STILL_MPS]  # fmt: skip


def known(made: Lift, told: Soak) -> Known:
    """What the cell knows of one that failed."""
    wrong = {device_of(made)} - {""} | ({"loop"} if away(made, told) else set())
    if made.after is not None:
        return Known(wrong=frozenset(wrong), pressed_n=made.after.pressed_n,
                     opened=made.after.opened)  # fmt: skip
    # a hand that never touched anything does not do so after the end
    untouched = made.peak_n is not None and made.peak_n <= TOUCH_N
    return Known(wrong=frozenset(wrong), pressed_n=0.0 if untouched else None)


def could_not_hold(made: Lift) -> bool:
    """Whether the fault took the only thing that could have held, and the last line says so."""
    told = made.outcome == LiftOutcome.FAULT and re.search(CANNOT_BE_TOLD, made.told) is not None
    return made.struck.startswith(TAKE_THE_HAND) and told


def device_of(made: Lift) -> str:
    """That was struck; empty for none."""
    return DEVICES[re.split("[_ ]", made.struck)[0]] if made.struck else ""


def away(made: Lift, told: Soak) -> bool:
    """Whether the machine was not there for the idle loop either, shortly before the end."""
    since_s = max(made.begun_s, made.ended_s - NEAR_S)
    return any(since_s <= at_s <= made.ended_s for at_s in told.idle_late_s)


def excused(made: Lift, told: Soak) -> bool:
    """Whether it was late, and so was the idle loop."""
    late = (
        made.kind == STALE
        or re.search(rf"{STOOD_STILL}|detector_late", made.message) is not None
        or (made.kind == "link_lost" and made.cell_stalls > 0)
    )
    return made.outcome == LiftOutcome.FAULT and late and away(made, told)


def by_itself(told: Soak) -> list[Lift]:
    """Lifts that failed though nothing had struck them, for whatever reason."""
    failed = NEVER | {LiftOutcome.FAULT}
    return [made for made in told.lifts if made.outcome in failed and not made.struck]


def tell(told: Soak) -> int:
    """Exit code."""
    struck = [made for made in told.lifts if made.struck]
    faults = sum(made.outcome == "fault" for made in struck)
    print(f"{told.minutes:g} min, {len(told.lifts)} lifts; {len(struck)} were struck, of which "
          f"{faults} ended in a fault; by itself failed {len(by_itself(told))}")  # fmt: skip
    outcomes = Counter(f"{made.outcome}{' (struck)' * bool(made.struck)}" for made in told.lifts)
    print(", ".join(f"{number} {outcome}" for outcome, number in outcomes.most_common()))
    excuses = sum(excused(made, told) for made in told.lifts if not made.struck)
    peak_n = max((made.peak_n for made in told.lifts if made.peak_n is not None), default=0.0)
    print(f"highest true force {peak_n:.2f} N; late with the machine, and excused: {excuses}")
    periods, missed = (sum(getattr(m, name) for m in told.lifts) for name in ("periods", "missed"))
    print(f"periods {periods}, missed {missed} ({missed_share(told, False):.2%} where not struck, "
          f"{missed_share(told, True):.2%} where struck); "
          f"idle {told.idle[0]}, missed {told.idle[1]}; "
          f"priority {'granted' if told.real_time else 'not granted'}; "
          f"rows that the page missed {told.lost_rows}, "
          f"that were looked at {told.seen_rows}")  # fmt: skip
    if not struck:
        print("none was struck, so this tells nothing of faults: every fourth is, on average")
    if told.minutes * 60.0 <= 2 * SETTLED_S:
        print("too short to tell what grows")
    for name, (least, most, slope) in grown(told.counts).items():
        print(f"{name}: {least:.1f} to {most:.1f} after ten minutes, {slope:+.2f} an hour")
    for text in (found := wrong(told)):
        print(f"WRONG {text}")
    return 1 if found else 0
