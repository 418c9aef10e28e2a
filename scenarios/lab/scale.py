"""A fingertip over a scale: presses, readings that a person types, and the files made of them.

Here alone may a motor be told more than the limit of a run: up to what the operator allowed, never
more than the manual states, and with one fingertip over a scale, never with an object.
"""

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime

import msgspec
import numpy as np

from drivers.errors import DeviceFault, LinkLost, Refused, SuppressBugs, UsageError
from drivers.interfaces import (
    CODE_MAX,
    FINGER_NAMES,
    OPEN_COUNTS,
    PERIOD_NS,
    Counts3,
    Detection,
    FingerState,
    Gripper,
    GripperState,
)
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.protocol import check_closing
from grasp import signals
from grasp.clock import Clock, WallClock
from grasp.guard import GuardSettings
from scenarios.lab.fingertips import Touch
from scenarios.lab.fit import AGAIN, N_PER_G, Byte, Law, Line
from scenarios.lab.hand import Say
from scenarios.lab.steps import Steps, insist, lead_counts, walk
from scenarios.rigs.calibration import MANUAL
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.permission import MotionPermit, driving, gripper_of, require
from scenarios.rigs.rig import check_fault, mode_of, not_active
from scenarios.rigs.wired import open_gripper
from scenarios.trial.person import Operator

NEWTONS = {"n": 1.0, "g": N_PER_G, "kg": 1e3 * N_PER_G}
READING = re.compile(r"([0-9]+(?:[.,][0-9]+)?)\s*(n|g|kg)\Z", re.IGNORECASE)
PLACE = re.compile(r"(-?[0-9]+(?:[.,][0-9]+)?)\s*(?:mm)?\Z", re.IGNORECASE | re.ASCII)
LONGEST_MM = 2000.0  # of a ruler
PAUSE_NS = 20_000_000
BACK_COUNTS = 20  # off the scale; some 15 mm
SAMPLES = 100  # of the pad, a second, for one reading


def newtons(text: str) -> float:
    """Of a number with its unit, N, g or kg; raises UsageError for anything else."""
    found = READING.match(text.strip())
    if found is None:
        raise UsageError(f"{text.strip()!r} is no reading", "a number and its unit: N, g or kg")
    return float(found[1].replace(",", ".")) * NEWTONS[found[2].lower()]


def millimetres(text: str) -> float:
    """Of a place on a ruler, with `mm` or without; raises UsageError for anything else."""
    found = PLACE.match(text.strip())
    if found is None or abs(place_mm := float(found[1].replace(",", "."))) > LONGEST_MM:
        remedy = f"a number of millimetres, {LONGEST_MM:g} at most"
        raise UsageError(f"{text.strip()!r} is no place on a ruler", remedy)
    return place_mm


def ask(operator: Operator, question: str, idle: Callable[[], None]) -> str:
    """What a person types, the devices being looked after meanwhile; Ctrl-C raises."""
    operator.say(question)
    while (line := operator.poll()) is None:
        signals.check()
        idle()
    return line.strip()


def reading(operator: Operator, question: str, idle: Callable[[], None], most_n: float) -> float:
    """Newtons; asked again for what is none, for 0, and for more than ``most_n``."""
    while True:
        try:
            return typed(ask(operator, question, idle), most_n)
        except UsageError as error:
            operator.say(f"{error.message}: {error.remedy}")


def typed(line: str, most_n: float) -> float:
    """Newtons of a press; raises UsageError for what is none."""
    force_n = newtons(line)
    if not 0.0 < force_n <= most_n:
        why = f"is more than --up-to {most_n:g}" if force_n else "is no press"
        raise UsageError(f"{force_n:.2f} N {why}", "typed rightly?")
    return force_n


def check_force(up_to_n: float, bytes_: Iterable[int] = (0,), called: str = "--up-to") -> None:
    """Raises UsageError where the manual has the hand, or one of those bytes, press otherwise;
    ``called``: what says how much is allowed."""
    if up_to_n > MANUAL.most_force_n:
        raise UsageError(f"{up_to_n:g} N is more than the hand's", f"<= {MANUAL.most_force_n:g} N")
    for byte in bytes_:
        if (may_n := MANUAL.force_n(byte)) > up_to_n:
            remedy = f"--up-to {math.ceil(may_n * 10) / 10:g}"
            raise UsageError(
                f"byte {byte} may press with {may_n:.1f} N by the manual, and {called} is "
                f"{up_to_n:g} N", remedy if byte == 0 else f"{remedy}, or a lower byte",
            )  # fmt: skip


class Presser:
    """One finger of an active hand, the others where they are."""

    def __init__(self, gripper: Gripper, clock: Clock, finger: str, up_to_n: float) -> None:
        self._gripper, self._clock = gripper, clock
        self._i = FINGER_NAMES.index(finger)
        self._up_to_n = up_to_n
        self._speed_mps = MANUAL.least_speed_mps

    @property
    def counts(self) -> int:
        return self._places[self._i]

    @property
    def _places(self) -> Counts3:
        return self._state.positions

    @property
    def _finger(self) -> FingerState:
        return self._state.fingers[self._i]

    @property
    def _state(self) -> GripperState:
        if self._gripper.state is None:
            raise LinkLost("the gripper does not answer", "check its power, cable and address")
        return self._gripper.state

    def idle(self) -> None:
        """Let a moment pass."""
        self._clock.sleep_until_ns(self._clock.now_ns + PAUSE_NS)
        self.look()

    def look(self) -> None:
        """Ask how it is; raises what the gripper reports."""
        self._gripper.pump(self._clock.now_ns)

    def to(self, counts: int, byte: int = 0, touched: Callable[[], bool] = lambda: False) -> bool:
        """Slowly to there by short steps, or until it is ``touched``; whether it met something.

        Raises UsageError for a byte that may press with more than was allowed.
        """
        check_force(self._up_to_n, (byte,))
        a, b, c = (counts if i == self._i else at for i, at in enumerate(self._places))
        met = False

        def tell(targets: Counts3) -> None:
            self._gripper.move_to(targets, self._speed_mps, MANUAL.force_n(byte))

        def look() -> bool:
            nonlocal met
            self._clock.sleep_until_ns(self._clock.now_ns + PERIOD_NS)
            self.look()
            if not met and touched():
                met = True
                self._gripper.hold()
            return not met

        steps = Steps(self._places, (a, b, c), lead_counts(MANUAL.m_per_count))
        walk(steps, self._clock, lambda: self._state, tell, look)
        return met or self._finger.detection is Detection.CONTACT_CLOSING

    def back_off(self, say: Say, release: str) -> None:
        """Off the scale by the way it came, and stand there: safe at any time, for a calibration
        holds no object, and a motor that is left on a scale goes on pressing. Raises nothing."""
        there, off = False, 0

        def back() -> None:
            self.to(off)

        with signals.deferred(sealed=True), SuppressBugs():
            off = max(0, self.counts - BACK_COUNTS)
            there = insist(back, self._clock)
        say(
            f"the finger has backed off the scale and stands, at {self.counts} counts; to open "
            f"the hand: `{release}`" if there
            else "NOT SEEN TO BACK OFF: take the scale away, switch the gripper off if it moves"
        )  # fmt: skip


def check_open(state: GripperState) -> None:
    """Raises Refused for a hand whose fingers may hold something, or be on the scale already."""
    if max(state.positions) > OPEN_COUNTS:
        raise Refused(f"the hand is not open, at {state.positions}", "`grasp release`")


@contextmanager
def open_presser(
    config: GraspRigConfig, permit: MotionPermit | None, finger: str, up_to_n: float, say: Say
) -> Iterator[Presser]:
    """A finger of real devices; the hand must be active and open. Whatever ends this early, Ctrl-C
    among it, has the finger back off: told by ``say``. Raises as ``open_hand``, and UsageError for
    more than the manual's force."""
    allowed = require(permit)
    check_force(up_to_n)
    measuring = msgspec.structs.replace(config, calibration=MANUAL)
    clock = WallClock(WallClock().now_ns)
    with (
        driving(gripper_of(config)),
        open_gripper(measuring, lambda: clock.now_ns) as gripper,
    ):
        gripper.pump(clock.now_ns)
        state = gripper.state
        if state is None:
            raise LinkLost("the gripper does not answer", "check its power, cable and address")
        if not state.active:
            raise not_active(state)
        check_fault(state)
        check_closing(mode_of(gripper))
        check_open(state)
        presser = Presser(gripper, clock, finger, up_to_n)
        try:
            yield presser
        except BaseException:
            presser.back_off(say, allowed.release)
            raise


def pad_counts(touch: Touch, clock: Clock, finger: str) -> tuple[float, bool]:
    """Mean fall of a finger's codes over a second, summed over its taxels, and whether one was at
    the end of its codes."""
    i = FINGER_NAMES.index(finger)
    falls, rail = [], False
    tick_ns = clock.now_ns
    for _ in range(SAMPLES):
        signals.check()
        tick_ns += PERIOD_NS
        clock.sleep_until_ns(tick_ns)
        touch.pump(clock.now_ns)
        if touch.counts is not None and touch.rest is not None:
            counts = touch.counts[i]
            codes = counts + touch.rest[i]
            rail = rail or bool((codes <= 0).any() or (codes >= CODE_MAX).any())
            falls.append(-float(counts.sum()))
    if not falls:
        raise DeviceFault("the tactile board sends no frames", "unplug it, plug it in again")
    return float(np.mean(falls)), rail


# Files


def force_file(finger: str, line: Line, note: str = "") -> str:
    """Settings for `--config`; raises UsageError for what no settings may say."""
    low, high = line.interval
    source = noted(
        f"scale under finger {finger}, {now()}: {line.points} readings, {line.least:.2f} to "
        f"{line.most:.2f} N, {low:.1f} to {high:.1f} (95 %)", note,
    )  # fmt: skip
    text = (
        f"# Counts of fingertip {finger}, {now()}: {line.points} readings of a scale, "
        f"{line.least:.2f} to {line.most:.2f} N.\n"
        f"# {line.slope:.1f} counts a newton [{low:.1f}, {high:.1f}] (95 %; {line.groups} groups "
        "of readings, the scale taken as right).\n"
        f"# Their line misses zero by {line.offset:+.2f} N (rest of the pad, tare of the scale), "
        "which is left out.\n"
        f"# A reading is at most {line.worst:.2f} N from one through zero.\n"
        "# A scale that is wrong by a factor makes these counts wrong by it, and no reading here "
        "tells.\n"
        f"# Beyond {line.most:.2f} N nothing was measured, nor the other fingertips.\n"
        "# For `grasp run acquire` it is control.counts_per_newton.\n"
        f"[source]\ncounts_per_newton = {source}\n"
        f"[guard]\ncounts_per_newton = {line.slope:.1f}\n"
    )
    return _usable(text, "guard", GuardSettings)


def hand_file(
    finger: str, known: list[Byte], law: Law, travel: Line | None,
    reasons: dict[int, str], note: str = "",
) -> str:  # fmt: skip
    """A calibration, for `gripper.calibration`; raises UsageError for what none may say.
    ``reasons``: why a byte is far from what the manual says of it."""
    told = "; ".join(
        f"byte {b.byte}: {b.presses} presses, {b.mean_n:.2f} N, spread {_spread(b)}, 95 % "
        f"below {b.bound_n:.2f}"
        for b in known
    )
    lines = [
        f"# What finger {finger} presses with on a scale, {now()}. Each force is an upper bound: "
        "95 % of presses stay below, by a rule that is right of 95 % of such files.",
        f"# {told}",
        "# A byte that was not pressed counts as strong as its neighbours allow.",
    ]
    if travel is not None:
        low, high = (1e3 * mm for mm in travel.interval)
        lines.append(
            f"# Travel: {travel.points} places, {travel.slope * 1e3:.0f} um a count "
            f"[{low:.0f}, {high:.0f}] (95 % and its bend: {travel.worst:.2f} mm from a line)."
        )
    source = f"scale under finger {finger}, {now()}: {known[0].presses} presses of byte 0"
    reason = "; ".join(
        f"byte {byte} is far from the manual's: {why}" for byte, why in reasons.items()
    )
    source += f"; {reason}" if reason else ""
    lines += [
        "[calibration]",
        f"source = {noted(source, note)}",
        f"least_force_n = {law.least_force_n:g}",
        f"most_force_n = {law.most_force_n:g}",
        f"force_exponent = {law.force_exponent:g}",
        f"pressed_bytes = {[b.byte for b in known]}",
        f"presses = {min(b.presses for b in known)}",
    ]
    if reason:
        lines.append(f"reason = {noted(reason, '')}")
    if travel is not None:
        lines.append(f"m_per_count = {travel.slope * 1e-3:.6f}")
    return _usable("\n".join(lines) + "\n", "calibration", GripperCalibration, name="measured")


def _spread(b: Byte) -> str:
    """What was seen, and what was taken where that is too good to be believed."""
    seen = f"{b.seen_n:.2f}"
    return seen if b.seen_n >= b.spread_n else f"{seen}, taken as {b.spread_n:.2f}"


def _usable(text: str, section: str, settings: type, **more: str) -> str:
    """The file, if a run would take it."""
    try:
        msgspec.convert({**more, **tomllib.loads(text)[section]}, settings)
    except msgspec.ValidationError as error:
        raise UsageError(f"no hand is like that: {error}", AGAIN) from None
    return text


def noted(source: str, note: str) -> str:
    """With what a person has to say of it, as a TOML string."""
    return msgspec.json.encode(f"{source}; {note}" if note else source).decode()


def now() -> str:
    return f"{datetime.now():%Y-%m-%d %H:%M}"  # noqa: DTZ005  (a person's local time)
