"""ForceGuard: limits the force of every gripper command.

*Commanded* force, the calibrated static force of each command to the gripper, is never above the
limit, whatever the controller requests. *Estimated* force, from the fingertips and 20-80 ms late,
can only stop further closing: it cannot limit the force on a rigid object.

Finger A, the thumb, opposes B and C, so it carries their sum. With `every_finger` the thumb
therefore closes alone while B and C hold. With `each_motor` all three close and the limit applies
to each motor, so the thumb can bear twice the limit.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.errors import ConfigError
from drivers.interfaces import Counts3, GripperState, Vector3
from grasp.control.commands import CloseToLimit, GripperCommand, HoldFingers, MoveFingers
from grasp.control.contact_estimator import Stiffness
from grasp.control.grip_measure import GripMeasure
from grasp.control.observation import Observation

CLOSED = 255  # counts
TOUCHED_N = 0.3  # from here on a finger closes by single counts in a first grasp by touch; assumed
RISEN_M = 0.02  # of the arm, after which the object has left the table; assumed
THUMB_ALONE = (True, False, False)
# Margins of safe travel, both assumed: the contact may be this many times stiffer than stated, and
# the first grasp this much stronger than estimated
STIFFNESS_MARGIN = 1.3
FIRST_FORCE_MARGIN_N = 1.0

LimitMode = Literal["every_finger", "each_motor"]
PerNewton = Annotated[float, Meta(ge=1.0, le=5e3)]  # counts
# msgspec 0.22 misreads a tuple of fixed length in a union with a bounded number
EachPerNewton = Annotated[tuple[PerNewton, ...], Meta(min_length=3, max_length=3)]


def limit_in_words(limit_n: float, limit_mode: LimitMode) -> str:
    """State the force limit and its meaning: for every finger, or for each motor."""
    if limit_mode == "every_finger":
        return f"limit {limit_n:g} N on each finger"
    both = f"the thumb bears the sum of B and C, about {2 * limit_n:g} N"
    return f"limit {limit_n:g} N on each motor: {both}"


class GuardSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The force limit, and properties of hand and object on which it depends. Values without a
    source are assumed."""

    force_limit_n: Annotated[
        float, Meta(gt=0.0, le=60.0, description="force limit of every closing (paper, V-B)")
    ] = 10.0
    limit_mode: Annotated[
        LimitMode,
        Meta(description="every_finger: the limit holds for each finger, the thumb closes alone; "
             "each_motor: for each motor, all close and the thumb bears the sum of B and C"),
    ] = "every_finger"  # fmt: skip
    # the excess comes from the momentum of the fingers, so it limits the speed of closing
    overshoot_n: Annotated[
        float, Meta(ge=0.1, le=20.0, description="accepted excess of true force over the limit")
    ] = 1.0
    # typical stiffness: 600-10000 N/m
    contact_stiffness_npm: Annotated[
        float, Meta(ge=100.0, le=1e5, description="contact stiffness of objects that state none")
    ] = 2500.0
    tip_mass_kg: Annotated[
        float, Meta(ge=0.001, le=5.0, description="moving mass of finger and motor at the tip")
    ] = 0.1
    counts_per_newton: Annotated[
        PerNewton | EachPerNewton,
        Meta(description="summed taxel counts per newton, 1 to 5000; calibrate it: one number for "
             "all fingertips, or three, of A, B and C"),
    ] = 160.0  # fmt: skip
    # `estimate_margin_n` covers the error of the estimate
    estimate_margin_n: Annotated[
        float, Meta(ge=0.0, le=50.0, description="excess of estimated force that stops closing")
    ] = 5.0

    @property
    def full_grip_n(self) -> Vector3:
        """Static force of fingers A, B and C, N, once the hand has closed to the limit."""
        # thumb = B + C: with `every_finger` the thumb bears the limit, B and C half of it each
        share_n = self.force_limit_n * (0.5 if self.limit_mode == "every_finger" else 1.0)
        return 2 * share_n, share_n, share_n


class ForceGuard:
    """Admits gripper commands, changed where a limit requires it. No method raises an error."""

    def __init__(
        self,
        settings: GuardSettings,
        least_force_n: float,
        stiffness: Stiffness,
        least_speed_mps: float = 0.0,
        free_counts: Counts3 = (0, 0, 0),
        touch: bool = False,
        travel_bound: bool = False,
    ) -> None:
        """``stiffness``: of the object's contact, or the worst case. ``free_counts``: positions up
        to which the fingers touch nothing, so that closing may be fast. ``touch``: the first grasp
        is closed by touch, and the stiffness measured in it bounds every closing by position.
        ``travel_bound``: closing ends where force of the first grasp + stiffness x travel is the
        limit; only with `every_finger`.

        Raises ConfigError if the gripper's least force is above the limit, unless ``touch``, or if
        its least speed already causes more overshoot than allowed."""
        self._settings = s = settings
        limit_n = s.force_limit_n
        self._least_n = least_force_n if touch else 0.0
        self._least_speed_mps = least_speed_mps
        guess_n, alone = stiffness.newtons_per_count, least_force_n > limit_n
        self.grip = GripMeasure(guess_n, limit_n, s.overshoot_n, alone) if touch else None
        if least_force_n > limit_n and not touch:
            raise ConfigError(
                "guard", "force_limit_n",
                f"by its calibration the hand cannot close with less than {least_force_n:g} N; the "
                f"limit is {limit_n:g} N",
                f"a gripper.calibration by `grasp calibrate hand` with {limit_n:g} N or less, or "
                f"guard.force_limit_n and controller.grip_force_n >= {least_force_n:g}",
            )  # fmt: skip
        if self.closing_speed_mps < least_speed_mps:
            least_n = least_speed_mps * math.sqrt(s.contact_stiffness_npm * s.tip_mass_kg)
            raise ConfigError(
                "guard", "overshoot_n",
                f"{s.overshoot_n:g} N cannot be kept: at the gripper's least speed, "
                f"{least_speed_mps:g} m/s, a tip of {s.tip_mass_kg:g} kg overshoots more",
                f"guard.overshoot_n >= {least_n:.2f}",
            )  # fmt: skip
        counts = s.counts_per_newton
        self._counts_per_newton = counts if isinstance(counts, tuple) else (counts,) * 3
        self._stiffness = stiffness
        self._travel_bound = travel_bound
        self._free_counts = free_counts
        self._grasped = False  # the first grasp is complete
        self._first_grasp: tuple[Counts3, Vector3] | None = None
        # With ``travel_bound``, from the first grasp on: positions at which the fingers' force
        # reaches the limit at the stated stiffness, rounded down to motor counts
        self._travel_ends: Counts3 | None = None
        # the thumb's, beyond which it may not close
        self.thumb_end_counts: int | None = None
        self._grasp_m = 0.0  # height of the arm at the first grasp
        self.stalled_n = 0.0  # greatest estimated force at which the thumb stopped by force

    @property
    def closing_speed_mps(self) -> float:
        """Fastest closing whose kinetic energy keeps the force within limit plus overshoot, m/s.

        A tip of mass m that reaches the force limit at speed v against stiffness k overshoots by
        v sqrt(k m): work equals kinetic energy while the motor pushes at the limit.
        """
        s = self._settings
        return s.overshoot_n / math.sqrt(s.contact_stiffness_npm * s.tip_mass_kg)

    def observe(self, obs: Observation, estimated_n: Vector3, responsive: bool) -> None:
        """Measure the grip, once a sample. ``responsive``: no taxel is saturated or stuck."""
        if self.grip is not None:
            closure, height_m = obs.gripper.min_closure_counts, obs.arm.position_m[2]
            if self.grip.first is None:
                self._grasp_m = height_m
            risen = height_m >= self._grasp_m + RISEN_M
            self.grip.update(obs.t_ns, obs.hand_rests, closure, estimated_n, responsive, risen)
            self.thumb_end_counts = self.grip.end_counts
            if self.grip.now is not None and obs.gripper.thumb_latched:
                self.stalled_n = max(self.stalled_n, self.grip.now.force_n)

    def set_first_grasp(self, positions: Counts3, estimated_n: Vector3) -> None:
        """Take the first grasp as the reference of safe travel. From now on, with `every_finger`, B
        and C close no further."""
        self._grasped = True
        if self.grip is not None:
            self.grip.begin()
            self.thumb_end_counts = self.grip.end_counts
            return
        estimated_n = _balanced(estimated_n)
        self._first_grasp = (positions, estimated_n)
        if self._travel_bound:
            a, b, c = (
                position + self._stiffness.counts_within(self._settings.force_limit_n - force_n)
                for position, force_n in zip(positions, estimated_n, strict=True)
            )
            self._travel_ends = a, b, c
            self.thumb_end_counts = a

    def safe_travel(self, state: GripperState, estimated_n: Vector3) -> Counts3 | None:
        """Safe travel: the position of each finger, motor counts, up to which closing may be fast.

        It is the smaller of two positions: where the force reaches the limit at the stated
        stiffness; and where it reaches limit plus overshoot at 1.3 times that stiffness after a
        first grasp stronger by 1 N. None before the first grasp, and with `each_motor`.

        The estimated force, less what closing since the first grasp explains, replaces the first
        grasp's force if it is larger.
        """
        s, per_count_n = self._settings, self._stiffness.newtons_per_count
        if self._first_grasp is None or s.limit_mode == "each_motor":
            return None
        travel = []
        fingers = zip(*self._first_grasp, state.fingers, _balanced(estimated_n), strict=True)
        for position, first_n, finger, finger_n in fingers:
            closed = max(0, finger.requested_counts - position)
            unexplained_n = finger_n - per_count_n * closed
            worst_n = max(first_n + FIRST_FORCE_MARGIN_N, unexplained_n)
            expected_n = max(first_n, unexplained_n)
            counts = min(
                (s.force_limit_n - expected_n) / per_count_n,
                (s.force_limit_n + s.overshoot_n - worst_n) / (STIFFNESS_MARGIN * per_count_n),
            )
            travel.append(position + max(0, math.floor(counts)))
        a, b, c = travel
        return a, b, c

    def admit(
        self, command: GripperCommand, state: GripperState, estimated_n: Vector3
    ) -> GripperCommand:
        """The command to send to the gripper in place of ``command``; the same if it is allowed."""
        if isinstance(command, MoveFingers):
            return self._admit_move(command, state, estimated_n)
        if isinstance(command, CloseToLimit):
            return self._admit_close(command, state, estimated_n)
        return command

    def overloaded(self, estimated_n: Vector3) -> bool:
        """Whether estimated force exceeds the limit by more than ``estimate_margin_n`` on both
        sides of the object: the thumb bears B + C, so a single high reading is no force."""
        s = self._settings
        # with `each_motor` the thumb carries the sum of two motors
        thumb_limit_n = s.force_limit_n * (1 if s.limit_mode == "every_finger" else 2)
        thumb_n, b_n, c_n = estimated_n
        both_n, finger_n = min(thumb_n, b_n + c_n), min(thumb_n, max(b_n, c_n))
        margin_n = s.estimate_margin_n
        return both_n > thumb_limit_n + margin_n or finger_n > s.force_limit_n + margin_n

    def _admit_move(
        self, command: MoveFingers, state: GripperState, estimated_n: Vector3
    ) -> GripperCommand:
        closes = any(t > p for t, p in zip(command.targets_counts, state.positions, strict=True))
        if closes and self.overloaded(estimated_n):
            return HoldFingers()
        targets = self._within_travel(command.targets_counts, state, estimated_n)
        if self._grasped and self._settings.limit_mode == "every_finger":
            (a, b, c), (_, at_b, at_c) = targets, state.requested
            targets = a, min(b, at_b), min(c, at_c)  # the thumb would bear the sum
        return MoveFingers(
            targets_counts=targets,
            speed_mps=self._limited_speed(command.speed_mps, targets, state, estimated_n),
            force_n=self._limited_force(command.force_n),
        )

    def _admit_close(
        self, command: CloseToLimit, state: GripperState, estimated_n: Vector3
    ) -> GripperCommand:
        s = self._settings
        if self.overloaded(estimated_n) or (self._travel_bound and self._first_grasp is None):
            return HoldFingers()
        limits = self._within_travel(command.ends_counts, state, estimated_n)
        closing = THUMB_ALONE if s.limit_mode == "every_finger" else command.closing
        # a finger that holds does not limit the speed
        moved = tuple(n if closes else 0 for n, closes in zip(limits, closing, strict=True))
        return CloseToLimit(
            force_limit_n=self._limited_force(command.force_limit_n),
            closing=closing,
            ends_counts=limits,
            speed_mps=self._limited_speed(command.speed_mps, moved, state, estimated_n),
            first_stage=command.first_stage,
        )

    def _limited_speed(
        self,
        requested_mps: float,
        targets: Sequence[int],
        state: GripperState,
        estimated_n: Vector3,
    ) -> float:
        """The requested speed within the safe travel; beyond, at most ``closing_speed_mps``. While
        there is no safe travel, the positions without contact (``free_counts``) take its place."""
        if self.grip is None:
            free = self.safe_travel(state, estimated_n) or self._free_counts
            slow_mps = self.closing_speed_mps
        else:
            end = self.grip.end_counts
            free = (state.positions[0] if end is None else end, *state.positions[1:])
            slow_mps = self._least_speed_mps
        within = all(target <= most for target, most in zip(targets, free, strict=True))
        return requested_mps if within else min(requested_mps, slow_mps)

    def _limited_force(self, requested_n: float) -> float:
        """The requested force within the limit; by touch at least the least force of the hand, as
        position bounds it."""
        return max(self._least_n, min(requested_n, self._settings.force_limit_n))

    def _within_travel(
        self, targets: Counts3, state: GripperState, estimated_n: Vector3
    ) -> Counts3:
        ends = self._travel_ends
        if self.grip is not None:
            ends = self._touched_ends(state, estimated_n)
        if ends is None:
            return targets
        a, b, c = (min(target, end) for target, end in zip(targets, ends, strict=True))
        return a, b, c

    def _touched_ends(self, state: GripperState, estimated_n: Vector3) -> Counts3:
        """Last counts of a closing by touch. Before the first grasp, a finger that touches closes
        by single counts, while one more cannot exceed the limit."""
        grip = self.grip
        assert grip is not None  # noqa: S101
        if grip.end_counts is not None:
            a, b, c = state.requested  # no limit makes a finger open
            return max(a, grip.end_counts), b + 1, c + 1
        now, most_n = grip.now, self._settings.force_limit_n - grip.rise_n
        more = now is not None and now.force_n <= most_n
        fingers = zip(state.positions, state.requested, estimated_n, strict=True)
        a, b, c = (
            CLOSED if n < TOUCHED_N else at + 1 if more else min(at + 1, asked)
            for at, asked, n in fingers
        )
        return a, b, c

    def estimated_n(self, counts_sum: Vector3) -> Vector3:
        """Estimate each finger's force, N, from its summed taxel counts (pressing is negative)."""
        a, b, c = counts_sum
        per_a, per_b, per_c = self._counts_per_newton
        return max(0.0, -a / per_a), max(0.0, -b / per_b), max(0.0, -c / per_c)


def _balanced(estimated_n: Vector3) -> Vector3:
    """The estimate, with no finger far above what the other side of the object bears."""
    a_n, b_n, c_n = estimated_n
    most_n = a_n + FIRST_FORCE_MARGIN_N
    return min(a_n, b_n + c_n + FIRST_FORCE_MARGIN_N), min(b_n, most_n), min(c_n, most_n)
