"""The hand moved by itself, slowly, on real devices: what closes goes through the guard of a run.

One finger opposes two. So B and C close only while the thumb is open, and stop as soon as anything
is felt, for they may push an object against the thumb; the thumb closes last and alone, to the
least force (`guard.cap_mode` each_motor says otherwise, here as in a run).

A motion is a series of short steps, each sent once the last one is seen: a link that freezes leaves
the fingers no more than one step to go. A step is sent before the last one ends, so that fingers do
not stop in between: a hand may override its force whenever it starts (`hand.override_s`).
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, Refused, UsageError, on_failure
from drivers.interfaces import (
    FINGER_NAMES,
    OPEN_COUNTS,
    PERIOD_NS,
    Counts3,
    Detection,
    FingerState,
    Gripper,
    GripperState,
    Vector3,
)
from drivers.robotiq.exchange import RESET
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.protocol import BASIC, RTU, SCISSOR, TCP, check_not_scissor
from grasp import signals
from grasp.clock import Clock, WallClock
from grasp.commands import HoldFingers, MoveFingers
from grasp.contact_estimator import Stiffness
from grasp.guard import ForceGuard
from scenarios.lab.fingertips import Touch, open_touch
from scenarios.rigs.device_checks import read_gripper
from scenarios.rigs.permission import MotionPermit, driving, gripper_of, require
from scenarios.rigs.rig import (
    activate,
    calibration,
    check_fault,
    known_state,
    mode_of,
    not_active,
    to_open,
    until_active,
)
from scenarios.rigs.wired import open_gripper
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard

MOST_STEP_M = 0.005  # of `grasp gripper step`
LEAD_M = 0.004  # a finger is sent at most so far beyond where it is seen to be
STEP_S = 5.0  # within which a step is seen to end; assumed, at least speed it takes 0.2 s
STAND_S = 3.0  # within which fingers that were told to stop are seen to stand
SPREAD_S = 15.0  # within which B and C are apart; assumed: 9 s at least speed all the way
AT_REST = 2  # looks in a row
TRIES, TRY_FOR_NS = 3, 1_000_000_000
TOUCH_N = 1.0  # felt by any finger: B and C stop; above the drift of an unloaded pad
NOT_SEEN = "press the emergency stop, switch the gripper off if it still moves"

Say = Callable[[str], None]


class Moved(msgspec.Struct, frozen=True):
    """Where the fingers stand, what each met, and the force felt there, N; None: not felt."""

    positions_counts: Counts3
    met: str  # names of fingers that stopped on something
    force_n: Vector3 | None
    stopped_by: str = ""  # what ended it early
    fault: str = ""  # that the gripper reports

    def in_words(self) -> str:
        met = f"finger {' and '.join(self.met)} met something" if self.met else "nothing was met"
        newtons = "" if self.force_n is None else f", {max(self.force_n):.1f} N felt"
        early = f"; {self.stopped_by}" if self.stopped_by else ""
        fault = f"; the gripper reports a fault: {self.fault}" if self.fault else ""
        return f"fingers at {self.positions_counts} counts; {met}{newtons}{early}{fault}"


def guard_of(config: TrialConfig) -> ForceGuard:
    """The guard of a run for a hand around an unknown object: nothing is known to be free, and the
    contact is the stiffest. Raises ConfigError where a run would be refused."""
    make_guard(config)
    known = calibration(config)
    worst = Stiffness(config.guard.contact_stiffness_npm * known.m_per_count)
    return ForceGuard(config.guard, known.least_force_n, worst, known.least_speed_mps)


def step_counts(config: TrialConfig, step_m: float) -> int:
    """A step in whole counts, rounded down; raises UsageError for none, or one too long."""
    per_count_m = calibration(config).m_per_count
    counts = int(step_m / per_count_m + 1e-9)
    if counts <= 0 or step_m > MOST_STEP_M:
        raise UsageError(
            f"a step of {step_m * 1e3:g} mm: one count of this hand is {per_count_m * 1e3:g} mm",
            f"{per_count_m * 1e3:g} to {MOST_STEP_M * 1e3:g} mm",
        )
    return counts


def fingers_of(word: str) -> str:
    """Names of fingers: one, several, or all."""
    return "".join(FINGER_NAMES) if word == "all" else word


def step_targets(at: Counts3, fingers: str, counts: int) -> Counts3:
    """Those fingers further by so many counts (less than 0: opening), the others where they are."""
    named = zip(FINGER_NAMES, at, strict=True)
    a, b, c = (min(255, max(0, p + counts)) if name in fingers else p for name, p in named)
    return a, b, c


def targets_of(at: Counts3, fingers: str, to: int) -> Counts3:
    """Those fingers at ``to``, unless they are further closed."""
    named = zip(FINGER_NAMES, at, strict=True)
    a, b, c = (max(place, to) if name in fingers else place for name, place in named)
    return a, b, c


def lead_counts(m_per_count: float) -> int:
    """The longest step in whole counts, one at least."""
    return max(1, int(LEAD_M / m_per_count + 1e-9))


def retry(action: Callable[[], object], clock: Clock) -> bool:
    """Whether it was done within a few tries; raises nothing."""
    begun_ns = clock.now_ns
    for attempt in range(TRIES):
        with suppress(BaseException):  # Ctrl-C too
            if attempt:
                clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
            action()
            return True
        if clock.now_ns - begun_ns > TRY_FOR_NS:
            break
    return False


def check_thumb(state: GripperState, targets: Counts3, felt: bool) -> bool:
    """Whether B or C would close. Raises Refused where the thumb is in their way, or nothing is
    ``felt``."""
    a, *others = state.positions
    if not any(to > at for to, at in zip(targets[1:], others, strict=True)):
        return False
    if a > OPEN_COUNTS or targets[0] > a:
        raise Refused(
            f"the thumb stands at {a} counts: it would bear what B and C press together",
            "open it first (`grasp release`), and close it last and alone",
        )
    if not felt:
        raise Refused(
            "B and C close only where the fingertips can tell a touch, and their rest is known "
            "of an open hand alone",
            "`grasp release`, or set tactile.rest_reference (`grasp tactile watch --rest`)",
        )
    return True


class Hand:
    """An active hand, its fingertips where they are read, and the guard between."""

    def __init__(
        self, config: TrialConfig, gripper: Gripper, touch: Touch | None, clock: Clock, release: str
    ) -> None:
        """``release``: the command that opens it, printed where it is left closed."""
        self._release = release
        self._gripper, self._touch, self.clock = gripper, touch, clock
        self._guard = guard_of(config) if touch is not None else None
        known = calibration(config)
        self._speed_mps, self._force_n = known.least_speed_mps, known.least_force_n
        self._each_motor = config.guard.cap_mode == "each_motor"
        self._lead = lead_counts(known.m_per_count)
        self._sent: list[Counts3] = []  # steps of the motion so far

    @property
    def mode(self) -> int:
        """That it was taken over in."""
        return mode_of(self._gripper)

    @property
    def state(self) -> GripperState:
        return known_state(self._gripper)

    @property
    def _feels(self) -> bool:
        return self._touch is not None and self._touch.counts_sum is not None

    def move(self, targets: Counts3, say: Say, lightly: bool = False) -> Moved:
        """To those counts at least speed and force, by short steps, as far as the guard admits, or,
        ``lightly``, until anything is felt. Ctrl-C makes the fingers stand, which ``say`` is
        told."""
        self._sent.clear()
        with on_failure(lambda: self.stand(say) if self._sent else None):
            return self.go(targets, lightly)

    def go(self, targets: Counts3, lightly: bool = False) -> Moved:
        """As ``move``; where it raises, the caller stops the fingers."""
        early, touched = "", ""
        aim = self.state.positions

        def step() -> bool:
            nonlocal aim, early, touched
            before = aim
            if not (early or touched) and (ahead := self._ahead(aim, targets)) != aim:
                self._send(ahead)
                aim = ahead
            self.idle()
            felt_n = self._felt()
            if not early and self._guard and self._guard.overloaded(felt_n):
                early = f"stopped at {max(felt_n):.1f} N, above the limit"
                self._gripper.hold()
            elif lightly and not touched and max(felt_n) >= TOUCH_N:
                named = zip(FINGER_NAMES, felt_n, strict=True)
                touched = "".join(name for name, n in named if n >= TOUCH_N)
                self._gripper.hold()
            return aim != before

        self._until_rest(step, STEP_S)
        return self._moved(early, touched)

    def _ahead(self, sent: Counts3, targets: Counts3) -> Counts3:
        """How far to send the fingers now. A finger that has met something is sent no further."""
        if not self.state.fresh:  # it may still describe the step before
            return sent

        def ahead(finger: FingerState, sent: int, target: int) -> int:
            here, met = finger.position_counts, finger.detection
            if target > sent and met is not Detection.CONTACT_CLOSING:
                return max(sent, min(target, here + self._lead))
            if target < sent and met is not Detection.CONTACT_OPENING:
                return min(sent, max(target, here - self._lead))
            return sent

        a, b, c = map(ahead, self.state.fingers, sent, targets)
        return a, b, c

    def _until_rest(self, look: Callable[[], object], within_s: float) -> None:
        """Look until the fingers rest; ``look`` lets a moment pass and returns whether it has sent
        a step. Raises DeviceFault where a step is not seen to end in time, Interruption, and what
        ``look`` raises."""
        end_ns = self.clock.now_ns + round(within_s * 1e9)
        rested = 0
        while self.clock.now_ns < end_ns:
            signals.check()
            if look():
                rested, end_ns = 0, self.clock.now_ns + round(within_s * 1e9)
            rested = rested + 1 if self.state.at_rest else 0
            if rested >= AT_REST:
                return
        raise DeviceFault(
            f"the fingers did not come to rest within {within_s:g} s", "look at the hand"
        )

    def open(self, say: Say) -> Moved:
        """All fingers, as ``move``; in scissor mode then B and C apart too, for they may hold
        something between them. Raises DeviceFault where they do not open."""
        moved = self.move((0, 0, 0), say)
        if self.mode == SCISSOR:
            with on_failure(lambda: self.stand(say)):
                self._gripper.open(self._speed_mps)
                self._until_rest(self._watch, SPREAD_S)
            moved = self._moved("", "")
        if not self.state.is_open:
            raise DeviceFault(
                f"the fingers did not open: they stand at {moved.positions_counts} counts",
                "free them by hand, then switch the gripper off and on",
            )
        return moved

    def close(self, targets: Counts3, say: Say) -> Moved:
        """B and C first and lightly, the thumb open, then the thumb alone, as a run closes. Raises
        Refused where the thumb is in their way, or nothing is known to be felt."""
        if self._each_motor:
            return self.move(targets, say)
        a, b, c = self.state.positions
        if targets[1:] != (b, c):
            first = (a, *targets[1:])
            lightly = check_thumb(self.state, first, self._feels)
            moved = self.move(first, say, lightly)
            a, b, c = moved.positions_counts
            if targets[0] == a:
                return moved
        return self.move((targets[0], b, c), say)

    def idle(self) -> None:
        """Let a moment pass and read the devices."""
        self._watch()
        if self._touch is not None:
            self._touch.poll(self.clock.now_ns)

    def _watch(self) -> None:
        """Let a moment pass and read the gripper alone."""
        self.clock.sleep_until_ns(self.clock.now_ns + PERIOD_NS)
        self._gripper.poll(self.clock.now_ns)

    def feel(self, seconds: float, say: Say) -> NDArray[np.int16]:
        """Counts (n, 3, taxels) of the fingertips while nothing moves, at 100 Hz; a tick without a
        frame repeats the last one. Ctrl-C as in ``move``."""
        felt: list[NDArray[np.int16]] = []
        ticks, touch = round(seconds * 1e9 / PERIOD_NS), self._touch
        with on_failure(lambda: self.stand(say)):
            for _ in () if touch is None else touch.ticks(self.clock, ticks):
                self._gripper.poll(self.clock.now_ns)
                if touch is not None and (counts := touch.counts) is not None:
                    felt.append(counts)
        if not felt:
            raise Refused("the rest of the fingertips is not known", "begin with an open hand")
        return np.stack(felt)

    def stand(self, say: Say) -> None:
        """Stop the fingers and look until they stand; raises nothing."""

        def rest() -> None:
            self._gripper.hold()
            self._until_rest(self._watch, STAND_S)

        where: object = "unknown"
        with signals.deferred(sealed=True):
            seen = retry(rest, self.clock)
            with suppress(Exception):
                where = self.state.positions
        sent = f", told to go to {self._sent[-1]} counts and no further" if self._sent else ""
        say(
            f"the fingers stand, at {where} counts: the grip is kept; to let go, support what is "
            f"held and run `{self._release}`" if seen else f"NOT SEEN TO STAND{sent}: {NOT_SEEN}"
        )  # fmt: skip

    def _send(self, targets: Counts3) -> None:
        command = MoveFingers(targets, self._speed_mps, self._force_n)
        if self._guard is not None:
            admitted = self._guard.admit(command, self.state, self._felt())
            if isinstance(admitted, HoldFingers):
                raise Refused(
                    f"the fingertips feel {max(self._felt()):.1f} N, more than the limit: nothing "
                    "was moved", "open the hand",
                )  # fmt: skip
            assert isinstance(admitted, MoveFingers)  # noqa: S101  (a move stays one)
            command = admitted
        self._sent.append(command.targets_counts)  # from here on it may move, whatever is raised
        try:
            self._gripper.move_to(command.targets_counts, command.speed_mps, command.force_n)
        except (Refused, DeviceFault):
            self._sent.pop()
            raise

    def _felt(self) -> Vector3:
        none = (0.0, 0.0, 0.0)
        if self._touch is None or self._guard is None:
            return none
        return self._guard.measured_n(self._touch.counts_sum or none)

    def _moved(self, early: str, touched: str) -> Moved:
        state = self.state
        on = (Detection.CONTACT_CLOSING, Detection.CONTACT_OPENING)
        named = zip(FINGER_NAMES, state.fingers, strict=True)
        met = "".join(n for n, finger in named if finger.detection in on or n in touched)
        force_n = self._felt() if self._feels else None
        return Moved(state.positions, met, force_n, early, state.fault_text)


@contextmanager
def open_active_gripper(
    config: TrialConfig, clock: Clock, closing: bool, again: str = "", activating: bool = False
) -> Iterator[Gripper]:
    """The gripper of real devices, driven by this process alone. ``activating``: one that is not
    active is activated, whatever it holds; ``again``: the command that does that. Raises Refused
    and DeviceFault for one that cannot do what is asked, and the driver's errors."""
    with driving(gripper_of(config)), open_gripper(config, lambda: clock.now_ns) as gripper:
        with suppress(DeviceFault):  # checked below
            gripper.poll(clock.now_ns)
        state = known_state(gripper)
        if not state.active and activating:  # what it holds is supported, the operator has said
            activate(gripper, clock, dropping=True)
        elif not state.active:
            raise not_active(state, again)
        if closing:
            check_fault(state)
            check_not_scissor(mode_of(gripper))
        yield gripper


@contextmanager
def open_hand(
    config: TrialConfig, permit: MotionPermit | None, closing: bool, activating: bool = False
) -> Iterator[Hand]:
    """The hand of real devices, with its fingertips where it is to close. ``activating``: as
    ``open_active_gripper``. Raises UsageError without a permit, ConfigError where a run would be
    refused, and what the gripper and the board raise."""
    allowed = require(permit)
    clock, again = WallClock(WallClock().now_ns), ""
    if closing:
        guard_of(config)
    else:
        config, again = to_open(config), f"`{allowed.release} --activate`"
    with (
        open_active_gripper(config, clock, closing, again, activating) as gripper,
        ExitStack() as stack,
    ):
        is_open = known_state(gripper).is_open
        touch = stack.enter_context(open_touch(config, clock, is_open)) if closing else None
        yield Hand(config, gripper, touch, clock, allowed.release)


def activate_hand(config: TrialConfig, permit: MotionPermit | None, say: Say) -> Counts3 | None:
    """Activate it: it opens and closes fully, at a force that nobody sets, so it must be empty.
    None where it was active already, in basic mode; in another mode it is set to basic, for which
    it opens. Ctrl-C resets it, which stops the fingers."""
    require(permit)
    config = to_open(config)  # no force of ours is sent
    clock = WallClock(WallClock().now_ns)
    with (
        driving(gripper_of(config)),
        ExitStack() as undo,
        open_gripper(config, lambda: clock.now_ns) as gripper,
    ):
        with suppress(DeviceFault):  # which activation clears
            gripper.poll(clock.now_ns)
        state = known_state(gripper)
        if state.active and not state.fault and mode_of(gripper) == BASIC:
            return None
        gripper.activate()  # raises Refused where it would drop something
        undo.callback(_reset, config, say)  # once the link is closed: only one may be open
        state = until_active(gripper, clock)
        undo.pop_all()
        return state.positions


def _reset(config: TrialConfig, say: Say) -> None:
    """Take the activation back, and look until two looks in a row are alike; raises nothing."""
    seen = False
    if not config.devices.gripper:
        with signals.deferred(sealed=True), suppress(Exception):
            link = TCP if config.gripper.link == "tcp" else RTU
            with closing(ModbusTransport(config.modbus, config.gripper.link)) as transport:
                transport.write(link.command_register, RESET.to_registers(), time.monotonic_ns())
            end_s = time.monotonic() + STAND_S
            while not seen and time.monotonic() < end_s:
                before, now = read_gripper(config)
                seen = not now.active and now.fingers == before.fingers
    stands = "the fingers stand; the hand is not active any more"
    say(stands if seen else f"NOT SEEN TO STAND: {NOT_SEEN}")
