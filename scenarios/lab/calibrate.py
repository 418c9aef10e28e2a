"""Calibrations as a person goes through them: presses, readings of a scale that a person types, and
the files made of them.

Here alone may a motor be told more than the limit of a run: up to what the operator allowed, never
more than the manual states, and with one fingertip over a scale, never with an object.
"""

import math
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, Refused, UsageError, on_failure
from drivers.interfaces import (
    CODE_MAX,
    FINGER_NAMES,
    OPEN_COUNTS,
    PERIOD_NS,
    Counts3,
)
from drivers.robotiq.calibration import GripperCalibration
from grasp import signals
from grasp.clock import Clock, WallClock
from grasp.guard import GuardSettings
from scenarios.lab.fingertips import Touch, open_touch
from scenarios.lab.fit import (
    AGAIN,
    N_PER_G,
    Line,
    Point,
    Presses,
    fit_counts,
    odd_one,
    odd_press,
    of_presses,
)
from scenarios.lab.hand import Hand, Say, open_active_gripper, open_hand, retry, step_targets
from scenarios.rigs.calibration import FAR, MANUAL
from scenarios.rigs.permission import MotionPermit, require
from scenarios.rigs.rig import known_state
from scenarios.trial.config import TrialConfig
from scenarios.trial.person import Operator

NEWTONS = {"n": 1.0, "g": N_PER_G, "kg": 1e3 * N_PER_G}
READING = re.compile(r"([0-9]+(?:[.,][0-9]+)?)\s*(n|g|kg)", re.IGNORECASE)
UNIT = "with its unit (N, g, kg)"
CLOSED = 255
BACK_COUNTS = 20  # off the scale; some 15 mm
MOST_N, STEEPEST = 80.0, 0.3  # force of byte 255, curve: as strong as a calibration may state
SAMPLES = 100  # of the pad, a second, for one reading
UNLOADED_S = 2.0  # recorded after a hold


# What a person types


def newtons(text: str) -> float:
    """Of a number with its unit, N, g or kg; raises UsageError for anything else."""
    found = READING.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{text.strip()!r} is no reading", "a number and its unit: N, g or kg")
    return float(found[1].replace(",", ".")) * NEWTONS[found[2].lower()]


def ask(operator: Operator, question: str, idle: Callable[[], None]) -> str:
    """The line that a person types, the devices being read meanwhile; Ctrl-C raises."""
    operator.say(question)
    while (line := operator.poll()) is None:
        signals.check()
        idle()
    return line.strip()


def load_of(line: str, most_n: float) -> float:
    """Newtons of what was typed; raises UsageError for what is no reading of a load."""
    force_n = newtons(line)
    if force_n > most_n:
        raise UsageError(f"{force_n:.2f} N is more than --up-to {most_n:g}", "typed rightly?")
    if force_n <= 0.0:
        raise UsageError("0 N is no load", "load the pad, then type what the scale says")
    return force_n


# The finger that presses


def check_force(up_to_n: float) -> None:
    """Raises UsageError where byte 0 may press harder by the manual, or the hand never does."""
    if up_to_n > MANUAL.most_force_n:
        raise UsageError(f"{up_to_n:g} N is more than the hand's", f"<= {MANUAL.most_force_n:g} N")
    if MANUAL.least_force_n > up_to_n:
        raise UsageError(
            f"byte 0 may press with {MANUAL.least_force_n:.1f} N by the manual, and --up-to is "
            f"{up_to_n:g} N", f"--up-to {MANUAL.least_force_n:g}",
        )  # fmt: skip


class Presser:
    """One finger of an active hand, the others where they are."""

    def __init__(self, hand: Hand, finger: str) -> None:
        self._hand, self._finger = hand, finger
        self.idle = hand.idle

    @property
    def counts(self) -> int:
        return self._hand.state.positions[FINGER_NAMES.index(self._finger)]

    def to(self, counts: int) -> bool:
        """Slowly to there with byte 0, by short steps; whether it met something."""
        targets = step_targets(self._hand.state.positions, self._finger, counts - self.counts)
        return self._finger in self._hand.go(targets).met

    def back_off(self, say: Say, release: str) -> None:
        """Off the scale by the way it came, and stand there: safe at any time, for a calibration
        holds no object, and a motor that is left on a scale goes on pressing. Raises nothing."""
        there, off = False, 0

        def back() -> None:
            self.to(off)

        with signals.deferred(ignore_checks=True), suppress(Exception):
            off = max(0, self.counts - BACK_COUNTS)
            there = retry(back, self._hand.clock)
        say(
            f"the finger has backed off the scale and stands, at {self.counts} counts; to open "
            f"the hand: `{release}`" if there
            else "NOT SEEN TO BACK OFF: take the scale away, switch the gripper off if it moves"
        )  # fmt: skip


def check_open(positions: Counts3) -> None:
    """Raises Refused for a hand whose fingers may hold something, or be on the scale already."""
    if max(positions) > OPEN_COUNTS:
        raise Refused(f"the hand is not open, at {positions}", "`grasp release`")


@contextmanager
def open_presser(
    config: TrialConfig, permit: MotionPermit | None, finger: str, up_to_n: float, say: Say
) -> Iterator[Presser]:
    """A finger of real devices; the hand must be active and open. Whatever ends this early, Ctrl-C
    among it, has the finger back off, which ``say`` is told. Raises as ``open_hand``, and
    UsageError for more than the manual's force."""
    allowed = require(permit)
    check_force(up_to_n)
    measuring = msgspec.structs.replace(config, calibration=MANUAL)
    clock = WallClock(WallClock().now_ns)
    with open_active_gripper(measuring, clock, closing=True) as gripper:
        check_open(known_state(gripper).positions)
        hand = Hand(measuring, gripper, None, clock, allowed.release)
        presser = Presser(hand, finger)
        with on_failure(lambda: presser.back_off(say, allowed.release)):
            yield presser


# Counts of a fingertip


def pad_counts(touch: Touch, clock: Clock, finger: str) -> tuple[float, bool]:
    """Mean fall of a finger's codes over a second, summed over its taxels, and whether one was at
    the end of its codes."""
    i = FINGER_NAMES.index(finger)
    falls, rail = [], False
    for _ in touch.ticks(clock, SAMPLES):
        if touch.counts is not None and touch.rest is not None:
            counts = touch.counts[i]
            codes = counts + touch.rest[i]
            rail = rail or bool((codes <= 0).any() or (codes >= CODE_MAX).any())
            falls.append(-float(counts.sum()))
    if not falls:
        raise DeviceFault("the tactile board sends no frames", "unplug it, plug it in again")
    return float(np.mean(falls)), rail


def weigh(
    touch: Touch, clock: Clock, finger: str, up_to_n: float, operator: Operator, say: Say
) -> list[Point]:
    """Readings of loads on one fingertip, until a person has no more. One that the others
    contradict is left out, which is said at once."""
    points: list[Point] = []

    def idle() -> None:
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        touch.poll(clock.now_ns)

    question = f"Load fingertip {finger} again, by a weight or a scale, and type its reading {UNIT}"
    while line := ask(operator, f"{question}; Enter alone: no more", idle):
        try:
            force_n = load_of(line, up_to_n)
            counts, rail = pad_counts(touch, clock, finger)
            if rail or counts <= 0.0:
                why = "a taxel is at the end of its codes" if rail else "the pad feels nothing"
                raise UsageError(f"at {force_n:.2f} N {why}", "less, on that pad: it is left out")
        except UsageError as error:
            operator.say(f"{error.message}: {error.remedy}")
            continue
        points.append(Point(force_n, counts))
        say(f"{force_n:.2f} N: {counts:.0f} counts")
        if (odd := odd_one(points)) is not None:
            operator.say(f"{points.pop(odd).force_n:.2f} N contradicts the others: it is left out")
    return points


def calibrate_force(
    config: TrialConfig, finger: str, up_to_n: float, operator: Operator, say: Say, note: str = ""
) -> str:
    """The file of a fingertip's counts under weights; nothing is moved. Raises UsageError for data
    that do not support it."""
    clock = WallClock(WallClock().now_ns)
    with open_touch(config, clock, unloaded=True) as touch:
        points = weigh(touch, clock, finger, up_to_n, operator, say)
        return force_file(finger, fit_counts(points), note)


# Force of a hand


def calibrate_hand(
    config: TrialConfig, permit: MotionPermit | None, finger: str, presses: int, up_to_n: float,
    operator: Operator, say: Say, note: str = "",
) -> str:  # fmt: skip
    """The file of what force byte 0 presses with on a scale. Raises UsageError for data that do not
    support it, and before anything moves where ``up_to_n`` is less than it may press with."""
    with open_presser(config, permit, finger, up_to_n, say) as presser:
        known = of_presses(pressed(presser, presses, up_to_n, operator))
        say(f"byte 0: {known.mean_n:.2f} N, 95 % below {known.bound_n:.2f} N")
        presser.to(0)
    return hand_file(finger, known, note)


def pressed(presser: Presser, presses: int, up_to_n: float, operator: Operator) -> list[float]:
    """What a person read of so many presses, N. A press that the others contradict is repeated.
    Raises Refused without a scale."""
    forces: list[float] = []
    while len(forces) < presses:
        if not presser.to(CLOSED):
            presser.to(0)
            raise Refused("the finger met no scale", "put it within reach of that finger alone")
        question = f"Press {len(forces) + 1} of {presses}: what does the scale say, {UNIT}?"
        forces.append(_press_reading(presser, question, up_to_n, operator))
        if (odd := odd_press(forces)) is not None:
            operator.say(f"{forces.pop(odd):.2f} N contradicts the others: it is pressed again")
        presser.to(max(0, presser.counts - BACK_COUNTS))
    return forces


def _press_reading(presser: Presser, question: str, up_to_n: float, operator: Operator) -> float:
    """One reading; asked again where it is none, or so far from the manual's force that its unit
    must be wrong: readings that all have the wrong unit would not contradict one another."""
    low_n, high_n = MANUAL.least_force_n / FAR, MANUAL.least_force_n * FAR
    while True:
        try:
            force_n = load_of(ask(operator, question, presser.idle), up_to_n)
            if low_n <= force_n <= high_n:
                return force_n
            raise UsageError(
                f"{force_n:.3g} N is far from the {MANUAL.least_force_n:.3g} N that the manual "
                "says of byte 0", f"{low_n:.3g} to {high_n:.3g} N; is the unit right?",
            )  # fmt: skip
        except UsageError as error:
            operator.say(f"{error.message}: {error.remedy}")


def held_still(
    config: TrialConfig, permit: MotionPermit | None, seconds: float, operator: Operator, say: Say
) -> NDArray[np.int16]:
    """Counts (n, 3, taxels) at 100 Hz of an object held still by the hand alone, then let go."""
    with open_hand(config, permit, closing=True) as hand:
        ask(operator, "Put something light and firm on the table between the fingers: Enter",
            hand.idle)  # fmt: skip
        moved = hand.close((CLOSED, CLOSED, CLOSED), say)
        if not moved.met:
            hand.move((0, 0, 0), say)
            raise Refused("the hand closed and met nothing", "put the object between the pads")
        say(f"held; keep away from it for {seconds:.0f} s")
        counts = hand.feel(seconds, say)
        hand.move((0, 0, 0), say)
        return np.concatenate([counts, hand.feel(UNLOADED_S, say)])


# Files


def force_file(finger: str, line: Line, note: str = "") -> str:
    """Settings for `--config`; raises UsageError for what no settings may say."""
    low, high = line.interval
    measured = (
        f"{now()}: {line.points} readings of a scale under finger {finger}, {line.least_n:.2f} to "
        f"{line.most_n:.2f} N"
    )
    source = noted(f"{measured}, {low:.1f} to {high:.1f} (95 %)", note)
    text = f"""\
# Counts of a fingertip, {measured}.
# {line.slope:.1f} counts a newton [{low:.1f}, {high:.1f}] (95 %, the scale taken as right).
# Their line misses zero by {line.offset_n:+.2f} N (rest of the pad, tare of the scale), which is left out.
# A reading is at most {line.worst_n:.2f} N from one through zero. Nothing was measured beyond, nor of the other fingertips.
# For `grasp run acquire` it is control.counts_per_newton.
[source]
counts_per_newton = {source}
[guard]
counts_per_newton = {line.slope:.1f}
"""  # noqa: E501
    return _usable(text, "guard", GuardSettings)


def hand_file(finger: str, known: Presses, note: str = "") -> str:
    """A calibration, for `gripper.calibration`; raises UsageError for what none may say."""
    spread, taken = known.measured_spread_n, known.spread_n
    told = f"{spread:.2f}" + (f", taken as {taken:.2f}" if spread < taken else "")
    day = now()
    source = noted(f"scale under finger {finger}, {day}: {known.count} presses of byte 0", note)
    text = f"""\
# What finger {finger} presses with on a scale, {day}: an upper bound. 95 % of presses stay below, by a rule that is right of 95 % of such files.
# {known.count} presses of byte 0: {known.mean_n:.2f} N, spread {told}, 95 % below {known.bound_n:.2f} N. Other bytes count as strong as can be.
[calibration]
source = {source}
least_force_n = {math.ceil(known.bound_n * 100) / 100:g}
most_force_n = {MOST_N:g}
force_exponent = {STEEPEST:g}
pressed_bytes = [0]
presses = {known.count}
"""  # noqa: E501
    return _usable(text, "calibration", GripperCalibration, name="measured")


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
