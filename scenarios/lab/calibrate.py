"""Calibrations by an operator: presses, readings of a scale typed by the operator, and the
resulting files.

Only here a motor may be commanded more than the force limit of a run: at most the force allowed by
the operator, never more than the manual's, with one fingertip on a scale, never with an object.
"""

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
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
from grasp.control.guard import GuardSettings
from grasp.control.monitors.fingertips import PRESSED_COUNTS
from grasp.run import signals
from grasp.run.clock import Clock, WallClock
from scenarios.lab.fingertips import TactileReader, open_fingertips
from scenarios.lab.fit import (
    CHECK_READINGS,
    N_PER_G,
    CountsFit,
    PressStatistics,
    Reading,
    fit_counts,
    outlier_press,
    outlier_reading,
    press_statistics,
)
from scenarios.lab.hand import Hand, Say, open_active_gripper, open_hand, retry, step_targets
from scenarios.rigs.calibration import MANUAL, MANUAL_FACTOR
from scenarios.rigs.permission import MotionPermit, require
from scenarios.rigs.rig import known_state
from scenarios.trial.config import TrialConfig
from scenarios.trial.operator_prompts import Operator

NEWTONS = {"n": 1.0, "g": N_PER_G, "kg": 1e3 * N_PER_G}
READING = re.compile(r"([0-9]+(?:[.,][0-9]+)?)\s*(n|g|kg)", re.IGNORECASE)
UNIT = "with its unit (N, g, kg)"
CLOSED = 255
BACK_COUNTS = 20  # distance from the scale after a press; about 15 mm
MOST_N, STEEPEST = 80.0, 0.3  # force of byte 255 and curve: the strongest that a file may state
SAMPLES = 100  # of the pad, one second, per reading
UNLOADED_S = 2.0  # recorded after the release


# Input of the operator


def parse_newtons(text: str) -> float:
    """Force of a number with its unit, N, g or kg; raises UsageError for any other text."""
    found = READING.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{text.strip()!r} is not a reading", "a number and its unit: N, g or kg")
    return float(found[1].replace(",", ".")) * NEWTONS[found[2].lower()]


def ask(operator: Operator, question: str, wait_and_poll: Callable[[], None]) -> str:
    """The line that the operator types; ``wait_and_poll`` polls the devices until then. Ctrl-C
    raises."""
    operator.say(question)
    while (line := operator.poll()) is None:
        signals.check()
        wait_and_poll()
    return line.strip()


def parse_load(line: str, most_n: float) -> float:
    """Typed load in newtons; raises UsageError for anything but a load up to most_n."""
    force_n = parse_newtons(line)
    if force_n > most_n:
        raise UsageError(f"{force_n:.2f} N is above --up-to {most_n:g} N", "check number and unit")
    if force_n <= 0.0:
        raise UsageError("0 N is not a load", "load the pad, then type the scale's reading")
    return force_n


# The pressing finger


def check_force(up_to_n: float) -> None:
    """Raises UsageError if byte 0 may exceed up_to_n by the manual, or up_to_n exceeds the hand's
    force."""
    if up_to_n > MANUAL.most_force_n:
        problem = f"--up-to {up_to_n:g} N is above the hand's largest force"
        raise UsageError(problem, f"<= {MANUAL.most_force_n:g} N")
    if MANUAL.least_force_n > up_to_n:
        raise UsageError(
            f"--up-to {up_to_n:g} N is below the force of byte 0 by the manual, "
            f"{MANUAL.least_force_n:.1f} N", f"--up-to {MANUAL.least_force_n:g}",
        )  # fmt: skip


class Presser:
    """One finger of an active hand; the others do not move."""

    def __init__(self, hand: Hand, finger: str) -> None:
        self._hand, self._finger = hand, finger
        self.wait_and_poll = hand.wait_and_poll

    @property
    def counts(self) -> int:
        return self._hand.state.positions[FINGER_NAMES.index(self._finger)]

    def move_to(self, counts: int) -> bool:
        """Move slowly in short steps with force byte 0; returns whether the finger made contact."""
        targets = step_targets(self._hand.state.positions, self._finger, counts - self.counts)
        return self._finger in self._hand.move_steps(targets).contacts

    def back_off(self, say: Say, release: str) -> None:
        """Move the finger back off the scale and stop it; raises nothing. This is always safe,
        because a calibration holds no object. A motor left on the scale would continue to press."""
        confirmed, target = False, 0

        def move_back() -> None:
            self.move_to(target)

        with signals.deferred(ignore_checks=True), suppress(Exception):
            target = max(0, self.counts - BACK_COUNTS)
            confirmed = retry(move_back, self._hand.clock)
        say(
            f"the finger has backed off the scale and stopped at {self.counts} counts; to open "
            f"the hand: `{release}`" if confirmed
            else "BACK-OFF NOT CONFIRMED: take the scale away, switch the gripper off if it moves"
        )  # fmt: skip


def check_open(positions: Counts3) -> None:
    """Raises Refused for a hand that is not open: it may hold something, or be on the scale
    already."""
    if max(positions) > OPEN_COUNTS:
        raise Refused(f"the hand is not open, at {positions} counts", "`grasp release`")


@contextmanager
def open_presser(
    config: TrialConfig, permit: MotionPermit | None, finger: str, up_to_n: float, say: Say
) -> Iterator[Presser]:
    """A finger of real devices; the hand must be active and open. If this ends early, by Ctrl-C or
    an error, the finger backs off and ``say`` gets the result. Raises the errors of ``open_hand``,
    and UsageError for more than the manual's force."""
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


def pad_counts(fingertips: TactileReader, clock: Clock, finger: str) -> tuple[float, bool]:
    """Mean fall of a finger's codes over a second, summed over its taxels, and whether a taxel was
    at the end of its range. Raises UsageError where another fingertip is pressed instead."""
    i = FINGER_NAMES.index(finger)
    falls, rail = [], False
    for _ in fingertips.ticks(clock, SAMPLES):
        if fingertips.counts is not None and fingertips.rest is not None:
            codes = fingertips.counts[i] + fingertips.rest[i]
            rail = rail or bool((codes <= 0).any() or (codes >= CODE_MAX).any())
            falls.append(-fingertips.counts.sum(axis=1, dtype=np.int64))
    if not falls:
        raise DeviceFault("the tactile board sends no frames", "unplug it, plug it in again")
    means = np.mean(falls, axis=0).tolist()
    if means[i] < max(means) >= PRESSED_COUNTS * codes.size:
        problem = f"fingertip {FINGER_NAMES[means.index(max(means))]} is pressed, not {finger}"
        raise UsageError(problem, "load the named one, and see `grasp tactile identify`")
    return means[i], rail


def weight_readings(
    fingertips: TactileReader, clock: Clock, finger: str, up_to_n: float, operator: Operator,
    say: Say,
) -> list[Reading]:  # fmt: skip
    """Readings of loads on one fingertip until the operator ends. A reading that contradicts the
    others is dropped and reported at once."""
    readings: list[Reading] = []

    def wait_and_poll() -> None:
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        fingertips.poll(clock.now_ns)

    question = f"Load fingertip {finger} with a weight or a scale and type the reading {UNIT}"
    while line := ask(operator, f"{question}; Enter alone: no more", wait_and_poll):
        try:
            force_n = parse_load(line, up_to_n)
            counts, rail = pad_counts(fingertips, clock, finger)
            if rail or counts <= 0.0:
                problem = "a taxel is at the end of its range" if rail else "the pad has no counts"
                raise UsageError(f"at {force_n:.2f} N {problem}", "use less force; dropped")
        except UsageError as error:
            operator.say(f"{error.message}: {error.remedy}")
            continue
        readings.append(Reading(force_n, counts))
        say(f"{force_n:.2f} N: {counts:.0f} counts")
        if (outlier := outlier_reading(readings)) is not None:
            operator.say(f"{readings.pop(outlier).force_n:.2f} N contradicts the others: dropped")
    return readings


def counts_of_finger(
    fingertips: TactileReader, clock: Clock, finger: str, up_to_n: float, operator: Operator,
    say: Say,
) -> CountsFit:  # fmt: skip
    """Counts per newton of one fingertip. Insufficient readings are taken again, so that those of
    the fingers before are not lost."""
    while True:
        readings = weight_readings(fingertips, clock, finger, up_to_n, operator, say)
        try:
            fit = fit_counts(readings)
        except UsageError as error:
            operator.say(f"{error.message}: {error.remedy}. Finger {finger} starts again")
            continue
        say(f"finger {finger}: {fit.slope:.1f} counts/N")
        return fit


def calibrate_force(
    config: TrialConfig, fingers: str, up_to_n: float, operator: Operator, say: Say, note: str = ""
) -> str:
    """File text with the counts of these fingertips under weights, one after the other; nothing
    moves. Raises UsageError for implausible counts."""
    clock = WallClock(WallClock().now_ns)
    with open_fingertips(config, clock, unloaded=True) as fingertips:
        return force_file({
            finger: counts_of_finger(fingertips, clock, finger, up_to_n, operator, say)
            for finger in fingers
        }, note)  # fmt: skip


# Force of a hand


def calibrate_hand(
    config: TrialConfig, permit: MotionPermit | None, finger: str, presses: int, up_to_n: float,
    operator: Operator, say: Say, note: str = "",
) -> str:  # fmt: skip
    """File text with the force of byte 0 on a scale. Raises UsageError for insufficient data and,
    before any motion, if byte 0 may exceed ``up_to_n``."""
    with open_presser(config, permit, finger, up_to_n, say) as presser:
        statistics = press_statistics(press_readings(presser, presses, up_to_n, operator))
        say(f"byte 0: {statistics.mean_n:.2f} N, 95 % below {statistics.bound_n:.2f} N")
        presser.move_to(0)
    return hand_file(finger, statistics, note)


def press_readings(presser: Presser, count: int, up_to_n: float, operator: Operator) -> list[float]:
    """Operator's readings of that many presses, N. A press that contradicts the others is repeated.
    Raises Refused without a scale."""
    forces: list[float] = []
    while len(forces) < count:
        if not presser.move_to(CLOSED):
            presser.move_to(0)
            raise Refused("the finger found no scale", "put it within reach of that finger only")
        question = f"Press {len(forces) + 1} of {count}: reading of the scale {UNIT}?"
        forces.append(_press_reading(presser, question, up_to_n, operator))
        if (outlier := outlier_press(forces)) is not None:
            operator.say(f"{forces.pop(outlier):.2f} N contradicts the others: press repeated")
        presser.move_to(max(0, presser.counts - BACK_COUNTS))
    return forces


def _press_reading(presser: Presser, question: str, up_to_n: float, operator: Operator) -> float:
    """One reading. It is asked for again if invalid or far from the manual's force: readings that
    all have the same wrong unit do not contradict one another."""
    low_n, high_n = MANUAL.least_force_n / MANUAL_FACTOR, MANUAL.least_force_n * MANUAL_FACTOR
    while True:
        try:
            force_n = parse_load(ask(operator, question, presser.wait_and_poll), up_to_n)
            if low_n <= force_n <= high_n:
                return force_n
            raise UsageError(
                f"{force_n:.3g} N is far from the manual's {MANUAL.least_force_n:.3g} N of byte 0",
                f"{low_n:.3g} to {high_n:.3g} N; check the unit",
            )  # fmt: skip
        except UsageError as error:
            operator.say(f"{error.message}: {error.remedy}")


def record_still_object(
    config: TrialConfig, permit: MotionPermit | None, seconds: float, operator: Operator, say: Say
) -> NDArray[np.int16]:
    """Counts (n, 3, taxels) at 100 Hz of an object held at rest by the hand alone, and after its
    release."""
    with open_hand(config, permit, closing=True) as hand:
        ask(operator, "Put a light, firm object on the table between the fingers: Enter",
            hand.wait_and_poll)  # fmt: skip
        moved = hand.close((CLOSED, CLOSED, CLOSED), say)
        if not moved.contacts:
            hand.move((0, 0, 0), say)
            raise Refused("the hand closed without contact", "put the object between the pads")
        say(f"object held; do not touch it for {seconds:.0f} s")
        counts = hand.record_counts(seconds, say)
        hand.move((0, 0, 0), say)
        return np.concatenate([counts, hand.record_counts(UNLOADED_S, say)])


# Files


def force_file(fits: Mapping[str, CountsFit], note: str = "") -> str:
    """Settings for `--config` from the fits of all three fingers or of one; raises UsageError for
    values out of range."""
    day, lines, sources = now(), [], []
    for finger, fit in fits.items():
        low, high = fit.interval
        lines.append(f"""\
# Finger {finger}: {fit.slope:.1f} counts/N [{low:.1f}, {high:.1f}] (95 %, for an exact scale), {fit.readings} readings of {fit.least_n:.2f} to {fit.most_n:.2f} N.
#   The fitted line has an offset of {fit.offset_n:+.2f} N (rest codes of the pad, tare of the scale), which is not used.
#   Readings differ by at most {fit.worst_n:.2f} N from a line through zero.
""")  # noqa: E501
        sources.append(
            f"finger {finger}, {fit.readings} readings of {fit.least_n:.2f} to {fit.most_n:.2f} N, "
            f"{low:.1f} to {high:.1f} (95 %)"
        )
    numbers = [f"{fit.slope:.1f}" for fit in fits.values()]
    text = f"""\
# Counts of the fingertips under a scale, {day}. Other forces and fingertips were not measured.
{"".join(lines)}\
# `grasp run acquire` reads another setting, control.counts_per_newton: the number of its `finger`.
[source]
counts_per_newton = {quoted_source(f"scale, {day}: {'; '.join(sources)}", note)}
[guard]
counts_per_newton = {f"[{', '.join(numbers)}]" if len(numbers) > 1 else numbers[0]}
"""
    return _checked(text, "guard", GuardSettings)


def hand_file(finger: str, statistics: PressStatistics, note: str = "") -> str:
    """Calibration for `gripper.calibration`; raises UsageError for values out of range."""
    measured, used = statistics.measured_spread_n, statistics.spread_n
    spread = f"{measured:.2f} N" + (f" (used: {used:.2f} N)" if measured < used else "")
    day, count = now(), statistics.count
    source = quoted_source(f"scale under finger {finger}, {day}: {count} presses of byte 0", note)
    text = f"""\
# Force of finger {finger} on a scale, {day}: upper bound of 95 % of presses, with 95 % confidence.
# {count} presses of byte 0: mean {statistics.mean_n:.2f} N, standard deviation {spread}, bound {statistics.bound_n:.2f} N. Other bytes are assumed as strong as possible.
[calibration]
source = {source}
least_force_n = {math.ceil(statistics.bound_n * 100) / 100:g}
most_force_n = {MOST_N:g}
force_exponent = {STEEPEST:g}
pressed_bytes = [0]
presses = {count}
"""  # noqa: E501
    return _checked(text, "calibration", GripperCalibration, name="measured")


def _checked(text: str, section: str, settings: type, **more: str) -> str:
    """The file's text, if its settings are valid."""
    try:
        msgspec.convert({**more, **tomllib.loads(text)[section]}, settings)
    except msgspec.ValidationError as error:
        raise UsageError(f"implausible result: {error}", CHECK_READINGS) from None
    return text


def quoted_source(source: str, note: str) -> str:
    """Source with the operator's note, as a TOML string."""
    return msgspec.json.encode(f"{source}; {note}" if note else source).decode()


def now() -> str:
    return f"{datetime.now():%Y-%m-%d %H:%M}"  # noqa: DTZ005  (the operator's local time)
