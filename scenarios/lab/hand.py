"""Slow motion of a real hand without a run. Closing goes through the force guard of a run.

The thumb opposes two fingers. So B and C close only with an open thumb, and stop at first contact,
because they may push an object against it. The thumb closes last and alone with the least force
(unless `guard.limit_mode` is each_motor, as in a run).

A motion is a series of short steps, each sent shortly before the previous one ends. So a frozen
link leaves at most one step, and the fingers do not stop between steps: a hand may ignore its
force setting at each start (`hand.override_s`).
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
from drivers.robotiq.echo_watch import RESET
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.protocol import BASIC, RTU, SCISSOR, TCP, check_not_scissor
from grasp.control.commands import HoldFingers, MoveFingers
from grasp.control.contact_estimator import Stiffness
from grasp.control.guard import ForceGuard
from grasp.run import signals
from grasp.run.clock import Clock, WallClock
from scenarios.lab.fingertips import TactileReader, open_fingertips
from scenarios.rigs.calibration import calibration, settings_to_open
from scenarios.rigs.device_checks import read_gripper
from scenarios.rigs.permission import MotionPermit, driving, gripper_of, require
from scenarios.rigs.rig import (
    activate,
    check_fault,
    known_state,
    mode_of,
    not_active_error,
    wait_until_active,
)
from scenarios.rigs.wired import open_gripper
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard

MOST_STEP_M = 0.005  # of `grasp gripper step`
LEAD_M = 0.004  # largest distance of a finger's target from its reported position
STEP_S = 5.0  # timeout of a step; assumed: at least speed it takes 0.2 s
STOP_S = 3.0  # timeout of a stop
SPREAD_S = 15.0  # timeout for moving B and C apart; assumed: at least speed it takes 9 s
AT_REST = 2  # consecutive states at rest
TRIES, TRY_FOR_NS = 3, 1_000_000_000
CONTACT_N = 1.0  # estimated force that counts as contact; above the drift of an unloaded pad
SWAPPED = "press each pad in `grasp tactile identify`"
EMERGENCY_STOP = "press the emergency stop, switch the gripper off if it still moves"

Say = Callable[[str], None]


class MotionResult(msgspec.Struct, frozen=True):
    """Positions of the fingers after a motion, contacts, and the estimated force of each, N (None:
    unknown)."""

    positions_counts: Counts3
    contacts: str  # names of fingers in contact
    force_n: Vector3 | None
    stopped_by: str = ""  # cause of an early end
    fault: str = ""  # reported by the gripper

    def summary(self) -> str:
        contact = (
            f"contact of finger {' and '.join(self.contacts)}" if self.contacts else "no contact"
        )
        force = "" if self.force_n is None else f", estimated force {max(self.force_n):.1f} N"
        early = f"; {self.stopped_by}" if self.stopped_by else ""
        fault = f"; the gripper reports a fault: {self.fault}" if self.fault else ""
        return f"fingers at {self.positions_counts} counts; {contact}{force}{early}{fault}"


def hand_guard(config: TrialConfig) -> ForceGuard:
    """The force guard of a run for an unknown object: any position may be in contact, with the
    stiffest contact. Raises ConfigError where a run would be refused."""
    make_guard(config)
    known = calibration(config)
    worst = Stiffness(config.guard.contact_stiffness_npm * known.m_per_count)
    return ForceGuard(config.guard, known.least_force_n, worst, known.least_speed_mps)


def step_counts(config: TrialConfig, step_m: float) -> int:
    """A step in whole counts, rounded down; raises UsageError for less than one count or a too long
    step."""
    per_count_m = calibration(config).m_per_count
    counts = int(step_m / per_count_m + 1e-9)
    if counts <= 0 or step_m > MOST_STEP_M:
        raise UsageError(
            f"a step of {step_m * 1e3:g} mm: one count of this hand is {per_count_m * 1e3:g} mm",
            f"{per_count_m * 1e3:g} to {MOST_STEP_M * 1e3:g} mm",
        )
    return counts


def finger_names(word: str) -> str:
    """Names of one finger, several, or all."""
    return "".join(FINGER_NAMES) if word == "all" else word


def step_targets(at: Counts3, fingers: str, counts: int) -> Counts3:
    """Targets of a step of ``counts`` (negative: opening) of the named fingers; the others keep
    their position."""
    named = zip(FINGER_NAMES, at, strict=True)
    a, b, c = (min(255, max(0, p + counts)) if name in fingers else p for name, p in named)
    return a, b, c


def closing_targets(at: Counts3, fingers: str, to: int) -> Counts3:
    """Target ``to`` for the named fingers that are less closed; the others keep their position."""
    named = zip(FINGER_NAMES, at, strict=True)
    a, b, c = (max(p, to) if name in fingers else p for name, p in named)
    return a, b, c


def lead_counts(m_per_count: float) -> int:
    """Longest step in whole counts, at least one."""
    return max(1, int(LEAD_M / m_per_count + 1e-9))


def retry(action: Callable[[], object], clock: Clock) -> bool:
    """Whether the action succeeded within a few tries; raises nothing."""
    start_ns = clock.now_ns
    for attempt in range(TRIES):
        with suppress(BaseException):  # Ctrl-C too
            if attempt:
                clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
            action()
            return True
        if clock.now_ns - start_ns > TRY_FOR_NS:
            break
    return False


def check_thumb(state: GripperState, targets: Counts3, force_known: bool) -> bool:
    """Whether B or C would close. Raises Refused if the thumb is closed, or if ``force_known`` is
    false."""
    a, *others = state.positions
    if not any(to > at for to, at in zip(targets[1:], others, strict=True)):
        return False
    if a > OPEN_COUNTS or targets[0] > a:
        raise Refused(
            f"the thumb is at {a} counts: it would bear the forces of B and C together",
            "open it first (`grasp release`), and close it last and alone",
        )
    if not force_known:
        raise Refused(
            "B and C close only if the fingertips detect contact, with rest codes of an open hand",
            "`grasp release`, or set tactile.rest_reference (`grasp tactile watch --rest`)",
        )
    return True


class Hand:
    """An active hand with its fingertips, if they are read, and the force guard."""

    def __init__(
        self, config: TrialConfig, gripper: Gripper, fingertips: TactileReader | None,
        clock: Clock, release: str,
    ) -> None:  # fmt: skip
        """``release``: the command that opens the hand, printed if it is left closed."""
        self._release = release
        self._gripper, self._fingertips, self.clock = gripper, fingertips, clock
        self._guard = hand_guard(config) if fingertips is not None else None
        known = calibration(config)
        self._speed_mps, self._force_n = known.least_speed_mps, known.least_force_n
        self._each_motor = config.guard.limit_mode == "each_motor"
        self._lead = lead_counts(known.m_per_count)
        self._sent: list[Counts3] = []  # steps of the motion so far

    @property
    def mode(self) -> int:
        """Mode in which the hand was taken over."""
        return mode_of(self._gripper)

    @property
    def state(self) -> GripperState:
        return known_state(self._gripper)

    @property
    def _measures_force(self) -> bool:
        return self._fingertips is not None and self._fingertips.counts_sum is not None

    def move(self, targets: Counts3, say: Say, until_contact: bool = False) -> MotionResult:
        """Move to the targets in short steps at least speed and force, as far as the guard allows
        or, with ``until_contact``, until contact. Ctrl-C stops the fingers; ``say`` then gets the
        observed result."""
        self._sent.clear()
        with on_failure(lambda: self.stop(say) if self._sent else None):
            return self.move_steps(targets, until_contact)

    def move_steps(self, targets: Counts3, until_contact: bool = False) -> MotionResult:
        """As ``move``, but after an error the caller must stop the fingers."""
        early, touched = "", ""
        sent = self.state.positions
        named = zip(FINGER_NAMES, targets, sent, strict=True)
        closing = "".join(name for name, to, at in named if to > at)

        def step() -> bool:
            nonlocal sent, early, touched
            before = sent
            if not (early or touched) and (following := self._next_targets(sent, targets)) != sent:
                self._send(following)
                sent = following
            self.wait_and_poll()
            estimated_n = self._estimated_n()
            if not early and self._guard and self._guard.overloaded(estimated_n):
                early = f"stopped at {max(estimated_n):.1f} N, above the limit"
                self._gripper.hold()
            elif until_contact and not touched and max(estimated_n) >= CONTACT_N:
                named = zip(FINGER_NAMES, estimated_n, strict=True)
                touched = "".join(name for name, n in named if n >= CONTACT_N)
                if not set(touched) & set(closing):
                    early = f"fingertip {touched} responds, but {closing} closes: {SWAPPED}"
                self._gripper.hold()
            return sent != before

        self._wait_until_at_rest(step, STEP_S)
        return self._result(early, touched)

    def _next_targets(self, sent: Counts3, targets: Counts3) -> Counts3:
        """Targets of the next step. A finger in contact gets no new one."""
        if not self.state.fresh:  # it may still describe the previous step
            return sent

        def next_target(finger: FingerState, sent: int, target: int) -> int:
            position, detection = finger.position_counts, finger.detection
            if target > sent and detection is not Detection.CONTACT_CLOSING:
                return max(sent, min(target, position + self._lead))
            if target < sent and detection is not Detection.CONTACT_OPENING:
                return min(sent, max(target, position - self._lead))
            return sent

        a, b, c = map(next_target, self.state.fingers, sent, targets)
        return a, b, c

    def _wait_until_at_rest(self, look: Callable[[], object], within_s: float) -> None:
        """Call ``look``, which waits, polls and returns whether it sent a step, until the fingers
        are at rest. Raises DeviceFault after within_s without a step, Interruption, and the errors
        of ``look``."""
        end_ns = self.clock.now_ns + round(within_s * 1e9)
        rested = 0
        while self.clock.now_ns < end_ns:
            signals.check()
            if look():
                rested, end_ns = 0, self.clock.now_ns + round(within_s * 1e9)
            rested = rested + 1 if self.state.at_rest else 0
            if rested >= AT_REST:
                return
        problem = f"the fingers did not come to rest within {within_s:g} s"
        if self._sent and not self.state.fresh:
            problem = (
                "another client changed the gripper's registers, or the gripper ignores commands: "
                f"targets {self.state.requested}, expected {self._sent[-1]}"
            )
        raise DeviceFault(problem, "look at the hand, its power and who else commands it")

    def open(self, say: Say) -> MotionResult:
        """Open all fingers, as ``move``; in scissor mode then also move B and C apart, because they
        may hold something. Raises DeviceFault if the hand is not open then."""
        moved = self.move((0, 0, 0), say)
        if self.mode == SCISSOR:
            with on_failure(lambda: self.stop(say)):
                self._gripper.open(self._speed_mps)
                self._wait_until_at_rest(self._wait_and_poll_gripper, SPREAD_S)
            moved = self._result("", "")
        if not self.state.is_open:
            raise DeviceFault(
                f"the fingers did not open: they are at {moved.positions_counts} counts",
                "free them by hand, then switch the gripper off and on",
            )
        return moved

    def close(self, targets: Counts3, say: Say) -> MotionResult:
        """Close as in a run: B and C first, until contact and with an open thumb, then the thumb
        alone. Raises Refused if the thumb is closed or no force can be estimated."""
        if self._each_motor:
            return self.move(targets, say)
        a, b, c = self.state.positions
        if targets[1:] != (b, c):
            first = (a, *targets[1:])
            until_contact = check_thumb(self.state, first, self._measures_force)
            moved = self.move(first, say, until_contact)
            a, b, c = moved.positions_counts
            if targets[0] == a:
                return moved
        return self.move((targets[0], b, c), say)

    def wait_and_poll(self) -> None:
        """Wait one period and poll the devices."""
        self._wait_and_poll_gripper()
        if self._fingertips is not None:
            self._fingertips.poll(self.clock.now_ns)

    def _wait_and_poll_gripper(self) -> None:
        """Wait one period and poll only the gripper."""
        self.clock.sleep_until_ns(self.clock.now_ns + PERIOD_NS)
        self._gripper.poll(self.clock.now_ns)

    def record_counts(self, seconds: float, say: Say) -> NDArray[np.int16]:
        """Counts (n, 3, taxels) of the fingertips at rest, at 100 Hz; a tick without a frame
        repeats the previous one. Ctrl-C as in ``move``."""
        samples: list[NDArray[np.int16]] = []
        ticks, fingertips = round(seconds * 1e9 / PERIOD_NS), self._fingertips
        with on_failure(lambda: self.stop(say)):
            for _ in () if fingertips is None else fingertips.ticks(self.clock, ticks):
                self._gripper.poll(self.clock.now_ns)
                if fingertips is not None and (counts := fingertips.counts) is not None:
                    samples.append(counts)
        if not samples:
            raise Refused("the rest codes of the fingertips are unknown", "start with an open hand")
        return np.stack(samples)

    def stop(self, say: Say) -> None:
        """Stop the fingers and confirm it by their state; raises nothing."""

        def hold() -> None:
            self._gripper.hold()
            self._wait_until_at_rest(self._wait_and_poll_gripper, STOP_S)

        positions: object = "unknown"
        with signals.deferred(ignore_checks=True):
            stopped = retry(hold, self.clock)
            with suppress(Exception):
                positions = self.state.positions
        sent = f", last commanded to {self._sent[-1]} counts" if self._sent else ""
        say(
            f"the fingers have stopped at {positions} counts and keep their grip; to let go, "
            f"support the object and run `{self._release}`" if stopped
            else f"STOP OF THE FINGERS NOT CONFIRMED{sent}: {EMERGENCY_STOP}"
        )  # fmt: skip

    def _send(self, targets: Counts3) -> None:
        command = MoveFingers(targets, self._speed_mps, self._force_n)
        if self._guard is not None:
            admitted = self._guard.admit(command, self.state, self._estimated_n())
            if isinstance(admitted, HoldFingers):
                raise Refused(
                    f"estimated force {max(self._estimated_n()):.1f} N, above the limit: nothing "
                    "was moved", "open the hand",
                )  # fmt: skip
            assert isinstance(admitted, MoveFingers)  # noqa: S101  (a move stays one)
            command = admitted
        self._sent.append(command.targets_counts)  # the hand may move even if this raises
        try:
            self._gripper.move_to(command.targets_counts, command.speed_mps, command.force_n)
        except (Refused, DeviceFault):
            self._sent.pop()
            raise

    def _estimated_n(self) -> Vector3:
        none = (0.0, 0.0, 0.0)
        if self._fingertips is None or self._guard is None:
            return none
        return self._guard.estimated_n(self._fingertips.counts_sum or none)

    def _result(self, early: str, touched: str) -> MotionResult:
        state = self.state
        contact = (Detection.CONTACT_CLOSING, Detection.CONTACT_OPENING)
        named = zip(FINGER_NAMES, state.fingers, strict=True)
        contacts = "".join(n for n, finger in named if finger.detection in contact or n in touched)
        force_n = self._estimated_n() if self._measures_force else None
        return MotionResult(state.positions, contacts, force_n, early, state.fault_text)


@contextmanager
def open_active_gripper(
    config: TrialConfig, clock: Clock, closing: bool, release_command: str = "",
    activating: bool = False,
) -> Iterator[Gripper]:  # fmt: skip
    """The gripper of real devices, locked for this process. ``activating``: activate an inactive
    one, whatever it holds; ``release_command``: the command that does so. Raises Refused and
    DeviceFault for a hand in a wrong state, and the driver's errors."""
    with driving(gripper_of(config)), open_gripper(config, lambda: clock.now_ns) as gripper:
        with suppress(DeviceFault):  # checked below
            gripper.poll(clock.now_ns)
        state = known_state(gripper)
        if not state.active and activating:  # the operator supports what it holds
            activate(gripper, clock, dropping=True)
        elif not state.active:
            raise not_active_error(state, release_command)
        if closing:
            check_fault(state)
            check_not_scissor(mode_of(gripper))
        yield gripper


@contextmanager
def open_hand(
    config: TrialConfig, permit: MotionPermit | None, closing: bool, activating: bool = False
) -> Iterator[Hand]:
    """The hand of real devices, with its fingertips if it is to close. ``activating``: as in
    ``open_active_gripper``. Raises UsageError without a permit, ConfigError where a run would be
    refused, and the errors of gripper and board."""
    allowed = require(permit)
    clock, release_command = WallClock(WallClock().now_ns), ""
    if closing:
        hand_guard(config)
    else:
        config, release_command = settings_to_open(config), f"`{allowed.release} --activate`"
    with (
        open_active_gripper(config, clock, closing, release_command, activating) as gripper,
        ExitStack() as stack,
    ):
        reader = open_fingertips(config, clock, known_state(gripper).is_open) if closing else None
        fingertips = None if reader is None else stack.enter_context(reader)
        yield Hand(config, gripper, fingertips, clock, allowed.release)


def activate_hand(config: TrialConfig, permit: MotionPermit | None, say: Say) -> Counts3 | None:
    """Activate the hand, which opens and closes fully with a force that cannot be set, so it must
    be empty. A hand active in another mode opens and is set to basic mode. Returns the positions;
    None if it was active in basic mode. Ctrl-C resets the hand, which stops the fingers."""
    require(permit)
    config = settings_to_open(config)  # no force is commanded
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
        gripper.activate()  # raises Refused if it would drop something
        undo.callback(_reset, config, say)  # runs after the link is closed: only one may be open
        state = wait_until_active(gripper, clock)
        undo.pop_all()
        return state.positions


def _reset(config: TrialConfig, say: Say) -> None:
    """Reset the activation and wait until two readings are equal; raises nothing."""
    stopped = False
    if not config.devices.gripper:
        with signals.deferred(ignore_checks=True), suppress(Exception):
            link = TCP if config.gripper.link == "tcp" else RTU
            with closing(ModbusTransport(config.modbus, config.gripper.link)) as transport:
                transport.write(link.command_register, RESET.to_registers(), time.monotonic_ns())
            end_s = time.monotonic() + STOP_S
            while not stopped and time.monotonic() < end_s:
                before, now = read_gripper(config)
                stopped = not now.active and now.fingers == before.fingers
    confirmed = "the fingers have stopped; the hand is not active any more"
    say(confirmed if stopped else f"STOP OF THE FINGERS NOT CONFIRMED: {EMERGENCY_STOP}")
