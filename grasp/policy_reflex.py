"""Reflex: keeps the grip of somebody else's policy, which commands hand and arm.

It uses the application's detector, slip monitor, slip response and force guard, on these rules:

1. No command has more force than the limit, or than the least force of a stronger hand, and the
   fingers close at most at the speed of the application's grasp.
2. From the first contact on, only the thumb closes, because it carries the sum of B and C: by
   single counts, and once an object is held, to the bound that the guard has measured. Once the
   thumb and another finger touch, the arm stands still until the hand has rested for settle
   and baseline time (0.6 s). From then on the object is *held*.
3. While the object is held, the fingers open for ``OpenFingers`` alone, the explicit release.
4. When slip is registered, the hand closes to that bound and the policy's fingers wait. The arm
   stops until slip is over; it may only go straight down. The same holds for the arm while the
   fingers of a policy move, because slip is not monitored then.
5. If slip continues at the bound, the arm may only go down until the object is released.
6. The arm is no faster than its limit. A closed hand that has lifted nothing goes down only so fast
   that it stops within the force limit where it meets something.
7. After a fault, or if contact is lost, arm and hand stay in the application's safe state until
   ``OpenFingers`` or ``reset``.
"""

import math
from collections.abc import Callable
from operator import gt, lt
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import UsageError
from drivers.interfaces import (
    CODE_MAX,
    FINGERS,
    OPEN_COUNTS,
    Applied,
    Arm,
    ArmState,
    Counts3,
    Detection,
    FingerState,
    Gripper,
    GripperState,
    TactileFrame,
    Vector3,
)
from grasp.control.commands import GripperCommand, HoldFingers, MoveFingers, OpenFingers
from grasp.control.controller_settings import ControllerSettings
from grasp.control.fault import Fault
from grasp.control.guard import GuardSettings
from grasp.control.monitors.arm import ArmHistory
from grasp.control.monitors.settings import Failures
from grasp.control.observation import Observation
from grasp.control.reflex_controller import ReflexController
from grasp.control.slip_monitor import SlipStatus
from grasp.control.states import State
from grasp.control.step import GraspStep, StepResult
from grasp.run.loop import to_gripper

Nanoseconds = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
AT_REST: Vector3 = (0.0, 0.0, 0.0)
COUNTS = range(256)
MOST = 10**9  # integer of a command; a huge one is no float
SENSING_S = 0.1  # from contact until the arm brakes: fingertips 80 ms, a step, the arm; assumed
LIFTED_M = 0.01  # an object that has risen so far does not lie below the fingers; assumed


class PolicyCommand(msgspec.Struct, frozen=True, kw_only=True):
    """What a policy wants: a command to the hand, and the velocity of the tool in the base frame,
    x, y, z in m/s."""

    hand: MoveFingers | OpenFingers | HoldFingers
    arm_velocity_mps: Vector3 = AT_REST


class Admitted(msgspec.Struct, frozen=True, kw_only=True):
    """What hand and arm are to do instead.

    ``hand``: a new command; None: none is due, the last one stays in force. ``arm_velocity_mps``:
    reached with ``arm_acceleration_mps2``. ``slip``: registered, masked, and by which finger.
    ``held``: the object is held, so that only ``OpenFingers`` opens the hand. ``exhausted``: slip
    continued at the force limit, so the object must be set down. ``faults``: why the safe state
    was entered. ``refused``: what was refused or changed of the policy's command, in words.
    """

    hand: GripperCommand | None
    arm_velocity_mps: Vector3
    arm_acceleration_mps2: float
    state: State
    slip: SlipStatus
    held: bool
    exhausted: bool
    estimated_force_n: Vector3
    faults: tuple[Fault, ...] = ()
    refused: tuple[str, ...] = ()

    def send(self, gripper: Gripper, arm: Arm) -> Applied | None:
        """Send it; returns what the gripper applied. Raises the drivers' errors.

        The hand gets its command also where the arm refuses its own: the reflex closes once.
        """
        try:
            if self.arm_velocity_mps != AT_REST:
                arm.drive(self.arm_velocity_mps, 0.0, self.arm_acceleration_mps2)
            elif arm.state is None or arm.state.moving:
                arm.stop(self.arm_acceleration_mps2)
        finally:
            applied = None if self.hand is None else to_gripper(self.hand, gripper)
        return applied


class PolicyObservation(Observation, kw_only=True):
    """``below_limit``: the policy's last closing had less force than the limit, so that a finger
    stopped on contact can close further."""

    below_limit: bool = False

    @property
    def at_limit(self) -> bool:
        return not self.below_limit and super().at_limit


class PolicyArmHistory(ArmHistory):
    """Plausibility of an arm that follows commands which are not known here."""

    def update(self, arm: ArmState, pending: bool) -> Failures:
        failures = super().update(arm, pending)
        return {code: failures[code] for code in failures if code == "arm_position_nan"}


class Reflex:
    """Call ``step`` once a tactile sample, every 10 ms. No method reads a clock or a device."""

    def __init__(
        self, settings: ControllerSettings, make_step: Callable[[], GraspStep[ReflexController]],
        guard: GuardSettings, most_arm_mps: float, least_force_n: float, taxels: int,
    ) -> None:  # fmt: skip
        """``make_step``: makes the parts of one grasp.
        ``most_arm_mps``: limit of the arm's speed, m/s. ``least_force_n``: of the hand, N.
        ``taxels``: of a fingertip."""
        self._settings = settings
        self._make_step = make_step
        self._limit_n, self._most_arm_mps = guard.force_limit_n, most_arm_mps
        self._least_n, self._taxels = least_force_n, taxels
        self._descent_mps = safe_descent_mps(guard, settings.slip_stop_mps2)
        self.reset()

    def reset(self) -> None:
        """Forget the present grasp, slip and faults. An object in the hand is held again once the
        hand has rested for 0.6 s."""
        self._step = self._make_step()
        self._controller = self._step.controller
        self._sent: GripperCommand | None = None  # the last command to the hand
        self._below_limit = False
        self._met = False  # a finger has touched since the hand last opened
        self._lifted = False  # the held object has risen
        self._last_ns: int | None = None
        self.last_step: StepResult | None = None  # observation and decision, for a recording

    def step(
        self,
        tactile: TactileFrame | NDArray[np.int16],
        gripper: GripperState,
        arm: ArmState,
        wanted: PolicyCommand,
        *,
        t_ns: int | None = None,
    ) -> Admitted:
        """What to send instead of the policy's command.

        Args:
            tactile: the present frame, or its integer counts (3, taxels): raw minus rest, pressing
                is negative. From counts alone, taxels at an end of their range are not noticed.
            gripper: the hand's state, read since the last command.
            arm: the arm's state.
            wanted: the policy's command, in every step the whole of it.
            t_ns: time of this sample on the clock of the states; None: that of the frame.

        Raises:
            UsageError: for counts of another type, shape or range, for counts without ``t_ns``, for
                a time that is no integer or goes back, and for a state with a value of another type
                than it declares. Nothing has changed then.
        """
        if isinstance(tactile, TactileFrame):
            counts, raw = (_codes(codes, self._taxels) for codes in (tactile.counts, tactile.raw))
            frame = msgspec.structs.replace(tactile, counts=counts, raw=raw)
        else:
            frame = _frame(_codes(tactile, self._taxels), t_ns)
        gripper, arm, now_ns = _checked(gripper, arm, frame.t_ns if t_ns is None else t_ns)
        if self._last_ns is not None and now_ns < self._last_ns:
            raise UsageError("the time went back", "give the times of one clock, or call reset()")
        self._last_ns = now_ns
        refused: list[str] = []
        if problem := _problem(wanted):
            wanted = PolicyCommand(hand=HoldFingers())
            refused.append(f"{problem}: hand and arm hold")
        opens = _opens(wanted.hand, gripper)
        state = self._controller.state
        releases = isinstance(wanted.hand, OpenFingers) and state is not State.CLOSE
        if releases or (opens and state is State.SETTLE):
            self.reset()
            self._last_ns = now_ns
        obs = PolicyObservation(
            t_ns=now_ns, frame=frame, rest_taken=True,
            gripper=gripper, arm=arm, below_limit=self._below_limit,
        )  # fmt: skip
        self.last_step = self._step.decide(obs)
        own = [c for c in self.last_step.admitted if isinstance(c, GripperCommand)]
        controller = self._controller
        velocity = self._within_speed(wanted.arm_velocity_mps, refused)
        ramp_mps2 = self._settings.lift_acceleration_mps2
        hand: GripperCommand | None = None
        if self._settings.reactions:
            velocity, ramp_mps2 = self._admit_arm(obs, velocity, refused)
            if own:
                hand, self._below_limit = own[-1], False
            elif not (controller.in_safe_state or controller.state is State.COMPENSATE):
                hand = self._admit_hand(obs, wanted.hand, opens, refused)
        else:
            hand = self._guarded(wanted.hand, gripper)
        self._sent = hand or self._sent
        return Admitted(
            hand=hand, arm_velocity_mps=velocity, arm_acceleration_mps2=ramp_mps2,
            state=controller.state, slip=controller.slip_monitor.status, held=controller.held,
            exhausted=controller.limit_reached, estimated_force_n=obs.estimated_n,
            faults=controller.faults, refused=tuple(refused),
        )  # fmt: skip

    def _admit_hand(
        self, obs: Observation, wanted: GripperCommand, opens: bool, refused: list[str]
    ) -> GripperCommand | None:
        gripper, held = obs.gripper, self._controller.held
        if isinstance(wanted, HoldFingers) and gripper.at_rest:
            return None
        if not isinstance(wanted, MoveFingers):
            return self._guarded(wanted, gripper)
        if opens and held:
            refused.append("opening: the object is held, and only OpenFingers releases it")
        if wanted.force_n > max(self._limit_n, self._least_n):
            refused.append(f"force {wanted.force_n:g} N: the limit is {self._limit_n:g} N")
        if wanted.force_n < self._least_n:
            refused.append(f"force {wanted.force_n:g} N: the hand's least is {self._least_n:g} N")
        targets, speed_mps = wanted.targets_counts, wanted.speed_mps
        force_n = max(wanted.force_n, self._least_n)
        self._met = held or self._controller.touches(obs) or (self._met and not opens)
        if self._met:
            targets = _in_contact(targets, gripper, held)
            if targets == gripper.requested:
                return None
        elif self._least_n > self._limit_n and any(map(gt, targets[1:], gripper.positions[1:])):
            # position alone bounds the force, so no two sides meet an object at twice the speed
            targets = (min(targets[0], gripper.positions[0]), *targets[1:])
        if any(map(gt, targets, gripper.positions)):
            speed_mps = min(speed_mps, self._settings.grip_speed_mps)
        hand = self._guarded(MoveFingers(targets, speed_mps, force_n), gripper)
        if isinstance(hand, HoldFingers):
            refused.append("closing: the estimated force is above the limit")
        elif isinstance(hand, MoveFingers):
            self._below_limit = hand.force_n < self._limit_n
        return hand

    def _guarded(self, command: GripperCommand, gripper: GripperState) -> GripperCommand | None:
        """What the guard admits. None if it was sent already, or if the hand has not confirmed the
        last command yet."""
        admitted = self._step.admit(command, gripper)
        new = gripper.fresh and admitted != self._sent
        return admitted if new and isinstance(admitted, GripperCommand) else None

    def _admit_arm(
        self, obs: Observation, wanted: Vector3, refused: list[str]
    ) -> tuple[Vector3, float]:
        """Velocity of the arm, and the acceleration towards it."""
        s, controller, admitted = self._settings, self._controller, wanted
        ramp_mps2 = s.lift_acceleration_mps2
        settles = not controller.held and controller.grips(obs)
        unmonitored = controller.slip_monitor.status.masked or not obs.hand_rests
        if controller.in_safe_state:
            admitted, ramp_mps2 = AT_REST, s.stop_deceleration_mps2
        elif settles or controller.state is State.SETTLE:
            admitted, ramp_mps2 = AT_REST, s.slip_stop_mps2
        elif controller.held and (
            controller.state is State.COMPENSATE or controller.limit_reached or unmonitored
        ):
            admitted = (0.0, 0.0, min(0.0, wanted[2]))
            ramp_mps2 = s.slip_stop_mps2 if admitted == AT_REST else ramp_mps2
        if admitted != wanted:
            refused.append(f"motion of the arm in the state {controller.state}")
        if admitted[2] < -(most_mps := self._most_descent_mps(obs)):
            refused.append(f"descent: at most {most_mps * 1e3:.0f} mm/s until an object is lifted")
            admitted = (*admitted[:2], -most_mps) if most_mps else AT_REST
            ramp_mps2 = ramp_mps2 if most_mps else s.slip_stop_mps2
        return admitted, ramp_mps2

    def _most_descent_mps(self, obs: Observation) -> float:
        """Fastest descent, m/s; 0 in contact with an object that has not been lifted."""
        controller = self._controller
        rise_m = obs.arm.position_m[2] - controller.home[2]
        self._lifted = controller.held and (self._lifted or rise_m >= LIFTED_M)
        if self._lifted or max(obs.gripper.positions) <= OPEN_COUNTS:
            return math.inf
        return 0.0 if controller.touches(obs) else self._descent_mps

    def _within_speed(self, wanted: Vector3, refused: list[str]) -> Vector3:
        """The policy's velocity, at most as fast as the arm's limit."""
        speed_mps, most_mps = math.hypot(*wanted), self._most_arm_mps
        if speed_mps > most_mps:
            refused.append(f"velocity of {speed_mps:g} m/s: the arm's limit is {most_mps:g} m/s")
        x, y, z = (v * (most_mps / max(speed_mps, most_mps)) for v in wanted)
        return x, y, z


def safe_descent_mps(guard: GuardSettings, stop_mps2: float) -> float:
    """Fastest descent of closed fingers, m/s, from which the arm stops within the force limit plus
    overshoot where they meet an object of the stated stiffness.

    v T + v^2 / (2 a) = (limit + overshoot) / (2 k): ``SENSING_S`` T, deceleration a of the stop,
    stiffness k, twice because thumb and opposing fingers are both pressed.
    """
    way_m = (guard.force_limit_n + guard.overshoot_n) / (2.0 * guard.contact_stiffness_npm)
    return stop_mps2 * (math.sqrt(SENSING_S**2 + 2.0 * way_m / stop_mps2) - SENSING_S)


def _problem(wanted: object) -> str:
    """What is wrong with a policy's command, which may be anything; empty for a valid one. The
    reflex must not raise while an object slips."""
    if not isinstance(wanted, PolicyCommand):
        return f"{wanted!r:.60} is not a PolicyCommand"
    hand: Any = wanted.hand
    if not isinstance(hand, MoveFingers | OpenFingers | HoldFingers):
        return f"hand: {hand!r:.60} is not MoveFingers, OpenFingers or HoldFingers"
    if isinstance(hand, MoveFingers):
        targets: Any = hand.targets_counts
        known = isinstance(targets, tuple) and len(targets) == FINGERS
        if not known or not all(_is_finite(target) and target in COUNTS for target in targets):
            return f"targets_counts: {targets!r:.60} is not a tuple of three counts from 0 to 255"
    for name in ("speed_mps", "force_n"):
        number: Any = getattr(hand, name, 1.0)
        if not _is_finite(number) or number <= 0.0:
            return f"{name}: {number!r:.60} is not a number above 0"
    velocity: Any = wanted.arm_velocity_mps
    known = isinstance(velocity, tuple) and len(velocity) == len(AT_REST)
    if not known or not all(map(_is_finite, velocity)):
        return f"arm_velocity_mps: {velocity!r:.60} is not a tuple of three finite numbers"
    return ""


def _is_finite(number: object) -> bool:
    if isinstance(number, int):
        return abs(number) < MOST
    return isinstance(number, float | np.integer | np.floating) and math.isfinite(number)


def _opens(hand: GripperCommand, gripper: GripperState) -> bool:
    """Whether a command moves a finger back from where it is."""
    if not isinstance(hand, MoveFingers):
        return isinstance(hand, OpenFingers)
    return any(map(lt, hand.targets_counts, gripper.min_closure_counts))


def _in_contact(wanted: Counts3, gripper: GripperState, held: bool) -> Counts3:
    """Targets with which the thumb alone closes, and no finger opens a held object."""
    a, b, c = map(_present_target, gripper.fingers)
    if held:
        return max(wanted[0], a), b, c
    return wanted[0], min(wanted[1], b), min(wanted[2], c)


def _present_target(finger: FingerState) -> int:
    moves = finger.detection is Detection.MOVING
    return finger.min_closure_counts if moves else finger.requested_counts


def _checked(*states_and_time: object) -> tuple[GripperState, ArmState, int]:
    """The states and the time with values of their declared types. Raises UsageError for others."""
    try:
        plain = msgspec.msgpack.encode(states_and_time, enc_hook=lambda value: value.tolist())
        return msgspec.msgpack.decode(plain, type=tuple[GripperState, ArmState, Nanoseconds])
    except Exception as error:  # a foreign value may raise anything
        text = str(error).replace("$[0]", "gripper").replace("$[1]", "arm").replace("$[2]", "time")
        raise UsageError(text, "give a GripperState, an ArmState, integer nanoseconds") from None


def _codes(given: object, taxels: int) -> NDArray[np.int16]:
    """Codes of all fingertips. Raises UsageError for what cannot be raw minus rest."""
    try:
        counts = np.asarray(given)
    except ValueError:  # rows of unequal length
        counts = np.empty(FINGERS, object)
    fits = counts.dtype.kind in "iu" and counts.shape == (FINGERS, taxels)
    if not fits or counts.min() < -CODE_MAX or counts.max() > CODE_MAX:
        span = f", from {counts.min()} to {counts.max()}" if fits else ""
        wrong = f"counts of type {counts.dtype} and shape {counts.shape}{span}"
        allowed = f"integers of shape (3, {taxels}) from -{CODE_MAX} to {CODE_MAX}"
        raise UsageError(wrong, f"give raw codes minus rest codes: {allowed}")
    return counts.astype(np.int16)


def _frame(counts: NDArray[np.int16], t_ns: int | None) -> TactileFrame:
    """A frame of counts, with raw codes in the middle of the range."""
    if t_ns is None:
        raise UsageError("counts have no time", "give t_ns, or a TactileFrame")
    rest = np.full_like(counts, CODE_MAX // 2)
    raw = np.clip(counts + rest, 1, CODE_MAX - 1)
    return TactileFrame(t_ns, t_ns, 0, counts, raw, rest, np.zeros_like(counts))
