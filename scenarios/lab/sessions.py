"""Calibrations as a person goes through them: questions, presses, readings, and what comes out."""

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import Refused, UsageError
from drivers.interfaces import FINGER_NAMES, PERIOD_NS
from grasp import signals
from grasp.clock import WallClock
from scenarios.lab.fingertips import Touch, open_touch
from scenarios.lab.fit import (
    Byte,
    Line,
    Point,
    fit_counts,
    fit_travel,
    law_of,
    odd_one,
    odd_press,
    of_byte,
)
from scenarios.lab.hand import TOUCH_N, Say, open_hand
from scenarios.lab.scale import (
    BACK_COUNTS,
    Presser,
    ask,
    check_force,
    force_file,
    hand_file,
    millimetres,
    newtons,
    open_presser,
    pad_counts,
    reading,
    typed,
)
from scenarios.rigs.calibration import FAR, LEAST_REASON, MANUAL
from scenarios.rigs.permission import MotionPermit
from scenarios.trial.config import TrialConfig
from scenarios.trial.person import Operator

CLOSED = 255
LEAVE_OUT = "x"
ALMOST = "At how many counts does the finger almost touch the scale?"
SHORT_OF = 5  # counts before a touch: what is felt was there some counts before
ROUNDS = 3
SETTLES_S = 1.0  # of a press, before it is read: what is pressed gives way, and presses back less
UNLOADED_S = 2.0  # listened to after a hold
UNIT = "with its unit (N, g, kg)"


class Weighing:
    """Readings of one fingertip so far; an odd one is asked about at once."""

    def __init__(
        self, touch: Touch, clock: WallClock, finger: str, up_to_n: float, operator: Operator,
        say: Say, beside: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """``beside``: what else is looked after while a person types."""
        self._beside = beside
        self._touch, self._clock, self._finger = touch, clock, finger
        self._up_to_n, self._operator, self._say = up_to_n, operator, say
        self.points: list[Point] = []
        self.railed = False
        self.round = 0  # of presses; 0: each reading is loaded anew

    def idle(self) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns + PERIOD_NS)
        self._touch.pump(self._clock.now_ns)
        self._beside()

    def settle(self) -> None:
        """Let what is pressed give way: a scale that is read at once says more than the pad feels
        in the second after it."""
        until_ns = self._clock.now_ns + round(SETTLES_S * 1e9)
        while self._clock.now_ns < until_ns:
            signals.check()
            self.idle()

    def ask(self, question: str) -> bool:
        """One reading; False where a person has no more, or none of this load."""
        while line := ask(self._operator, question, self.idle):
            try:
                self._take(line)
            except UsageError as error:
                self._operator.say(f"{error.message}: {error.remedy}")
                if self.railed:
                    return False
            else:
                return True
        return False

    def fit(self) -> Line:
        return fit_counts(self.points)

    @property
    def room_n(self) -> float:
        """How much more may be pressed, after as large a step again as the largest so far of this
        round."""
        steps = self._steps
        return self._up_to_n - sum(steps) - max(steps, default=0.0)

    @property
    def _steps(self) -> list[float]:
        """From reading to reading of this round, N."""
        forces = [point.force_n for point in self.points if point.round == self.round]
        return [high - low for low, high in zip([0.0, *forces], forces, strict=False)]

    def _take(self, line: str) -> None:
        force_n = self._load(line)
        counts, rail = pad_counts(self._touch, self._clock, self._finger)
        if rail:
            self.railed = True
            raise UsageError(
                f"at {force_n:.2f} N a taxel is at the end of its codes", "it is left out: less"
            )
        if counts <= 0.0:
            raise UsageError(
                f"fingertip {self._finger} feels nothing of {force_n:.2f} N", "load its pad"
            )
        self.points.append(Point(force_n, counts, self.round))
        self._say(f"{force_n:.2f} N: {counts:.0f} counts")
        while (odd := odd_one(self.points)) is not None:
            if not self._correct(odd, "contradicts the others"):
                return  # asked again after the next; of a contradiction no file is made

    def _load(self, line: str) -> float:
        """What was typed, N; raises UsageError for what is no reading of a load."""
        force_n = newtons(line)
        if force_n > self._up_to_n:
            raise UsageError(f"{force_n:.2f} N is more than --up-to {self._up_to_n:g}", "less")
        if force_n <= 0.0:
            raise UsageError("0 N is no load", "Enter alone, if that is what the scale says")
        return force_n

    def _correct(self, odd: int, why: str) -> bool:
        """Whether that changed anything: not where it was typed rightly."""
        before = self.points[odd]
        told = f"reading {odd + 1}, {before.force_n:.2f} N, {why}"
        question = f"{told}: type it again {UNIT}, or {LEAVE_OUT} to leave it out"
        while (line := ask(self._operator, question, self.idle)).lower() != LEAVE_OUT:
            try:
                again = msgspec.structs.replace(before, force_n=self._load(line))
            except UsageError as error:
                self._operator.say(f"{error.message}: {error.remedy}")
            else:
                self.points[odd] = again
                return again != before
        del self.points[odd]
        return True


def calibrate_force(
    config: TrialConfig, finger: str, up_to_n: float, operator: Operator, say: Say, note: str = ""
) -> str:
    """Counts of a fingertip under weights; nothing is moved. The file that says what came of it;
    raises UsageError for data that do not support it."""
    clock = WallClock(WallClock().now_ns)
    with open_touch(config, clock, unloaded=True) as touch:
        weighing = Weighing(touch, clock, finger, up_to_n, operator, say)
        question = f"Load fingertip {finger} anew, by a weight or a scale, and type its reading"
        while weighing.ask(f"{question} {UNIT}; Enter alone: no more") or weighing.railed:
            weighing.railed = False
        return force_file(finger, weighing.fit(), note)


def press_force(
    config: TrialConfig, permit: MotionPermit | None, finger: str, up_to_n: float,
    operator: Operator, say: Say, note: str = "",
) -> str:  # fmt: skip
    """As ``calibrate_force``, the finger pressing on a scale by steps of one count, several times
    over."""
    clock = WallClock(WallClock().now_ns)
    with (
        open_touch(config, clock, unloaded=True) as touch,
        open_presser(config, permit, finger, up_to_n, say) as presser,
    ):
        weighing = Weighing(touch, clock, finger, up_to_n, operator, say, presser.look)
        touch_counts = TOUCH_N * config.guard.counts_per_newton

        def touched() -> bool:
            touch.pump(clock.now_ns)
            counts = touch.counts_sum
            return counts is not None and -counts[FINGER_NAMES.index(finger)] >= touch_counts

        near = _near(presser, operator, weighing.idle, touched)
        for weighing.round in range(1, ROUNDS + 1):
            presser.to(near)
            weighing.railed = False
            _press_by_counts(presser, near, weighing)
        presser.to(0)
        return force_file(finger, weighing.fit(), note)


def _press_by_counts(presser: Presser, near: int, weighing: Weighing) -> None:
    """Once up, until a taxel, the motor, --up-to or a person says that it is enough."""
    begun = len(weighing.points)
    for counts in range(near + 1, CLOSED):
        met = presser.to(counts)
        weighing.settle()
        pressed = len(weighing.points) > begun
        more = "no more" if pressed else "nothing yet"
        question = f"At {counts} counts: type what the scale says {UNIT}; Enter alone: {more}"
        typed = weighing.ask(question)
        if weighing.railed or met or weighing.room_n <= 0.0 or (pressed and not typed):
            return


def _near(
    presser: Presser, operator: Operator, idle: Callable[[], None], touched: Callable[[], bool]
) -> int:
    """Counts just before the scale, which a person knows from `grasp gripper step`; asked again for
    what is none, or lies behind the scale: there the finger stops where it touches it, and backs
    off."""
    question = ALMOST
    while True:
        line = ask(operator, question, idle)
        if not (line.isdecimal() and int(line) < CLOSED):
            question = f"{line!r} is no whole number from 0 to {CLOSED - 1}. {ALMOST}"
            continue
        met = presser.to(int(line), touched=touched)
        if not met:
            return int(line)
        at = presser.counts
        presser.to(max(0, at - BACK_COUNTS))
        question = (
            f"The finger touched something at {at} counts, on its way to {line}, and has backed "
            f"off: type less, {max(0, at - SHORT_OF)} if that was the scale. {ALMOST}"
        )


def calibrate_hand(
    config: TrialConfig, permit: MotionPermit | None, finger: str, bytes_: Sequence[int],
    presses: int, up_to_n: float, places: Sequence[int], operator: Operator, say: Say,
    note: str = "",
) -> str:  # fmt: skip
    """What bytes press with on a scale, and how far a count goes by a ruler; the file that says
    what came of it. Raises UsageError for data that do not support it, and before anything moves
    for a byte that may press with more than ``up_to_n``."""
    check_force(up_to_n, bytes_)
    with open_presser(config, permit, finger, up_to_n, say) as presser:
        known: list[Byte] = []
        reasons: dict[int, str] = {}
        for byte in sorted(set(bytes_) | {0}):
            forces = pressed(presser, byte, presses, up_to_n, operator, reasons)
            known.append(of_byte(byte, forces))
            say(f"byte {byte}: {known[-1].mean_n:.2f} N, 95 % below {known[-1].bound_n:.2f} N")
        travel = travelled(presser, places, operator) if places else None
        presser.to(0)
    return hand_file(finger, known, law_of(known), travel, reasons, note)


def pressed(
    presser: Presser, byte: int, presses: int, up_to_n: float, operator: Operator,
    reasons: dict[int, str],
) -> list[float]:  # fmt: skip
    """What a person read of so many presses of a byte, N. ``reasons``: why a byte is far from the
    manual's, which is asked of the first such press. Raises Refused without a scale, UsageError for
    one that the others contradict to the end."""
    forces: list[float] = []

    def read(title: str) -> float:
        force_n = reading(operator, title, presser.idle, up_to_n)
        while byte not in reasons and (doubt := _far(byte, force_n)):
            line = ask(operator, f"{doubt}: type it again {UNIT}; or, if it is so, type why",
                       presser.idle)  # fmt: skip
            try:
                force_n = typed(line, up_to_n)
            except UsageError as error:
                if len(line.split()) < LEAST_REASON or line[0].isdecimal():
                    operator.say(f"{error.message}, and no reason either")
                else:
                    reasons[byte] = line
        return force_n

    for number in range(1, presses + 1):
        if not presser.to(CLOSED, byte):
            presser.to(0)
            raise Refused("the finger met no scale", "put it within reach of that finger alone")
        title = f"Byte {byte}, press {number} of {presses}: what does the scale say, {UNIT}?"
        forces.append(read(title))
        while (odd := odd_press(forces)) is not None:
            typed_n = forces[odd]
            told = f"press {odd + 1}, {typed_n:.2f} N, contradicts the others of this byte"
            forces[odd] = read(f"{told}: type it again {UNIT}")
            if forces[odd] == typed_n:
                raise UsageError(f"{told}, twice", "see that the scale lies firm, then begin anew")
        presser.to(max(0, presser.counts - BACK_COUNTS))
    return forces


def _far(byte: int, force_n: float) -> str:
    """Why a reading may have the wrong unit, as all of them may: none would contradict another."""
    manual_n = MANUAL.force_n(byte)
    if manual_n / FAR <= force_n <= manual_n * FAR:
        return ""
    return (
        f"{force_n:.3g} N is far from the {manual_n:.3g} N that the manual says of byte {byte} "
        f"({manual_n / FAR:.3g} to {manual_n * FAR:.3g} would be believed)"
    )


def travelled(presser: Presser, places: Sequence[int], operator: Operator) -> Line:
    """Millimetres a count, by places that a person reads."""
    ask(operator, "Take the scale away, lay a ruler beside the fingertip: Enter", presser.idle)
    stood, found_mm = [], []
    for counts in places:
        met = presser.to(counts)
        if met:
            raise Refused(f"the finger met something before {counts} counts", "clear its way")
        found_mm.append(_place(presser, operator))
        stood.append(presser.counts)
    return fit_travel(stood, found_mm)


def _place(presser: Presser, operator: Operator) -> float:
    """Where the fingertip is, mm; asked again at once for what is no place on a ruler."""
    while True:
        question = f"At {presser.counts} counts: where is the fingertip, in mm?"
        try:
            return millimetres(ask(operator, question, presser.idle))
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
