"""What devices say is doubted: values that repeat, are impossible, or do not follow a command.

Pure: fed once a step before the controller, time an argument. A doubt is one line that begins
with a stable name (``fingertips_frozen: ...``); the controller answers it with the safe state of
the phase. Delays and false faults of every check: docs/faults.md.
"""

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.interfaces import (
    CODE_MAX,
    FINGER_NAMES,
    FINGERS,
    ArmState,
    Detection,
    FingerState,
    GripperState,
    TactileFrame,
    Vector3,
)
from grasp.commands import Command, MoveArm, StopArm
from grasp.phases import CONTACT_PHASES, OPEN_PHASES, Phase

NOWHERE: Vector3 = (0.0, 0.0, 0.0)
STOOD_STILL = "loop_stood_still"
STANDING_MPS = 0.001  # an arm that stands reports no more
SAME_LINE_M = 0.001  # a target that is no further from the present line lies on it


class DoubtSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """From when on a device is not believed. "measured": in docs/faults.md, with margins."""

    frozen_samples: Annotated[
        int,
        Meta(ge=2, le=1000, description="repeats in a row of all codes of all fingertips; measured "
             "on the simulated fingertip, which is quieter than the real recording"),
    ] = 8  # fmt: skip
    dead_samples: Annotated[
        int,
        Meta(ge=2, le=10000, description="repeats in a row of all codes of one fingertip that is "
             "loaded; measured likewise"),
    ] = 8  # fmt: skip
    dead_unloaded_samples: Annotated[
        int,
        Meta(ge=2, le=10000, description="of one that is not: quiet by itself; "
             "assumed, from the noise of the real one, 0.21 counts"),
    ] = 50  # fmt: skip
    loaded_counts: Annotated[
        int, Meta(ge=5, le=500, description="a fingertip with a taxel so far from its rest is "
                  "loaded; assumed, twice what warming up shifts it")
    ] = 30  # fmt: skip
    rail_samples: Annotated[
        int,
        Meta(ge=1, le=100, description="samples in a row with a whole fingertip at code 0 or 1023; "
             "assumed"),
    ] = 3  # fmt: skip
    jump_counts: Annotated[
        int,
        Meta(ge=5, le=1023, description="by which all taxels of all fingertips change one way from "
             "one sample to the next; measured: contact and taps leave some nearly as they were"),
    ] = 40  # fmt: skip
    detector_s: Annotated[
        float, Meta(ge=0.01, le=10.0, description="a step, its detector above all, may take; "
                    "assumed, five times the paper's 0.021 s")
    ] = 0.1  # fmt: skip
    standstill_s: Annotated[
        float, Meta(ge=0.02, le=10.0, description="a step may begin later than it should; assumed, "
                    "half of the shortest standstill that has been seen to lose an object")
    ] = 0.15  # fmt: skip
    echo_s: Annotated[
        float, Meta(ge=0.03, le=10.0, description="until the gripper's status speaks of a command; "
                    "assumed: two exchanges and two register refreshes are 0.04 s")
    ] = 0.15  # fmt: skip
    finger_start_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="a finger that reports motion may keep its count "
                    "after a request; assumed: latency up to 0.15 s, two refreshes, lag, a count")
    ] = 0.3  # fmt: skip
    stands_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="one that is under way may: a count at least "
                    "speed takes 0.035 s, from stall to contact 0.03 s, two refreshes; assumed")
    ] = 0.15  # fmt: skip
    target_counts: Annotated[
        int, Meta(ge=1, le=100, description="a finger 'at target' may be off it; a zero is off by "
                  "up to 5, manual p. 74")
    ] = 8  # fmt: skip
    soft_low_counts: Annotated[
        int, Meta(ge=0, le=100, description="targets below are cut by a software limit of opening")
    ] = 20
    soft_high_counts: Annotated[
        int, Meta(ge=100, le=255, description="targets above are cut by one of closing")
    ] = 200
    finger_counts_ps: Annotated[
        float, Meta(ge=50.0, le=5000.0, description="no finger is faster; twice full speed, "
                    "manual: 0.11 m/s, some 143 counts/s")
    ] = 300.0  # fmt: skip
    arm_start_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="from a command until the arm moves; assumed")
    ] = 0.25
    arm_frozen_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="an arm on its way may keep its place, beside the "
                    "time that it takes to turn round; assumed, seven controller cycles")
    ] = 0.06  # fmt: skip
    arm_moved_m: Annotated[
        float, Meta(ge=1e-6, le=0.01, description="less than this is no motion; assumed")
    ] = 0.0002
    arm_there_m: Annotated[
        float,
        Meta(ge=1e-4, le=0.01, description="so close to its target it need not move: not more "
             "than controller.at_height_m; assumed"),
    ] = 0.001  # fmt: skip
    arm_astray_m: Annotated[
        float, Meta(ge=5e-4, le=0.1, description="away from its target, beyond braking; assumed")
    ] = 0.002
    arm_fastest_mps: Annotated[
        float, Meta(ge=0.1, le=10.0, description="no arm of this kind is faster; UR manual: 1 m/s")
    ] = 1.0
    arm_jump_m: Annotated[
        float, Meta(ge=1e-3, le=0.5, description="beside that: samples come late; assumed")
    ] = 0.01


class Doubts:
    """All doubts of a run. ``of`` and ``sent`` once a step each, in this order.

    ``stand_ins``: there are no devices, only what obeys in their place; it is believed.
    """

    def __init__(self, settings: DoubtSettings, stand_ins: bool = False) -> None:
        self._settings = settings
        self._stand_ins = stand_ins
        self._fingertips = FingertipDoubt(settings)
        self._gripper = GripperDoubt(settings)
        self._arm = ArmDoubt(settings)

    @property
    def believes_force(self) -> bool:
        """Whether the fingertips' codes can be taken for a force."""
        return self._fingertips.believable

    def of(
        self,
        phase: Phase,
        frame: TactileFrame | None,
        gripper: GripperState,
        arm: ArmState,
        pending: bool = False,
        late_ns: int = 0,
        took_ns: int = 0,
    ) -> str:
        """What cannot be believed; empty when all can, and in the safe state.

        ``late_ns``: how much later than it should this step began; ``took_ns``: how long the one
        before took. ``pending`` as in ``observation.StepInput``.
        """
        if self._stand_ins:
            return ""
        found = (
            self._loop(phase, late_ns, took_ns),
            self._arm.see(arm, pending),
            self._gripper.see(gripper),
            self._fingertips.see(frame, phase),
        )
        return "" if phase is Phase.FAULT else "; ".join(filter(None, found))

    def sent(self, commands: Sequence[Command], arm: ArmState) -> None:
        """These commands follow from the step; ``arm`` is how it stood then."""
        for command in commands:
            if isinstance(command, MoveArm | StopArm):
                self._arm.told(command, arm)

    def _loop(self, phase: Phase, late_ns: int, took_ns: int) -> str:
        s = self._settings
        if phase in CONTACT_PHASES and took_ns > s.detector_s * 1e9:
            return f"detector_late: a step took {took_ns * 1e-9:.3f} s"
        if phase is not Phase.IDLE and late_ns > s.standstill_s * 1e9:
            return f"{STOOD_STILL}: for {late_ns * 1e-9:.3f} s nobody was in control"
        return ""


class FingertipDoubt:
    """Raw codes that no living fingertip gives. A frame that was missed proves nothing."""

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        self._raw: NDArray[np.int16] | None = None
        self._repeats = [0] * FINGERS
        self._all_repeats = 0
        self._loaded = [False] * FINGERS
        self._at_rail = [0] * FINGERS
        self._jumped = False
        self.believable = True

    def see(self, frame: TactileFrame | None, phase: Phase) -> str:
        """What is wrong with them, where somebody has to feel something."""
        if frame is None:
            self._raw = None
            return self._absent(phase)
        if not frame.missed:
            self.take(frame.raw, frame.counts)
        return "" if phase in OPEN_PHASES else self.wrong()

    def _absent(self, phase: Phase) -> str:
        if phase in CONTACT_PHASES:
            return "fingertips_absent: there is no frame: the board came back without its rest"
        return ""

    def take(self, raw: NDArray[np.int16], counts: NDArray[np.int16]) -> None:
        """A sample that is new: raw codes (fingers, 6), and the same without their rest."""
        at_rail = whole_rails(raw)
        self._loaded = (np.abs(counts).max(axis=1) >= self._settings.loaded_counts).tolist()
        self.believable = not any(at_rail)
        self._at_rail = _counted(self._at_rail, at_rail)
        before, self._raw = self._raw, raw
        if before is None:
            self._repeats, self._all_repeats, self._jumped = [0] * FINGERS, 0, False
            return
        moved = raw - before
        still = [not any(finger) for finger in moved.tolist()]
        self._repeats = _counted(self._repeats, still)
        self._all_repeats = self._all_repeats + 1 if all(still) else 0
        self._jumped = self._leapt(before, raw, moved)
        self.believable = self.believable and not self._jumped

    def _leapt(
        self, before: NDArray[np.int16], raw: NDArray[np.int16], moved: NDArray[np.int16]
    ) -> bool:
        """All at once and one way, where a contact presses some taxels and lifts others. A taxel at
        the end of its range cannot tell; most must be able to."""
        free = ~(at_rail(before) | at_rail(raw))
        enough = 2 * int(free.sum()) > free.size
        least = self._settings.jump_counts
        return enough and (int(moved[free].min()) >= least or int(moved[free].max()) <= -least)

    def wrong(self) -> str:
        """What the samples up to now say against the fingertips."""
        s = self._settings
        if railed := _names(self._at_rail, [s.rail_samples] * FINGERS):
            return f"fingertips_at_rail: finger {railed} reads 0 or {CODE_MAX} at every taxel"
        if self._jumped:
            return f"fingertips_jump: every taxel changed by {s.jump_counts} counts or more at once"
        if self._all_repeats >= s.frozen_samples:
            return f"fingertips_frozen: all codes have come {self._all_repeats + 1} times alike"
        patience = [s.dead_samples if on else s.dead_unloaded_samples for on in self._loaded]
        if dead := _names(self._repeats, patience):
            return f"fingertip_dead: finger {dead} gives the same codes for ever"
        return ""


class GripperDoubt:
    """Status that does not follow a command, or that no hand can have."""

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        self._before: GripperState | None = None
        self._fresh_ns = 0
        self._moved_ns = [0] * FINGERS  # since when each finger reports motion without moving
        self._under_way = [False] * FINGERS  # it has moved since it was told to

    def see(self, state: GripperState) -> str:
        """What is wrong with it."""
        before, self._before = self._before or state, state
        if state.fresh or before is state:
            self._fresh_ns = state.t_ns
        for i, (was, now) in enumerate(zip(before.fingers, state.fingers, strict=True)):
            if not state.fresh or not _stands(was, now):
                self._moved_ns[i] = state.t_ns
                self._under_way[i] = state.fresh and _goes_on(was, now)
        return self._inactive(state) or self._impossible(before, state) or self._idle(state)

    def _inactive(self, state: GripperState) -> str:
        if state.active or state.fault:
            return ""  # a fault has a text of its own
        return "gripper_inactive: the hand has lost its activation and obeys no motion"

    def _impossible(self, before: GripperState, state: GripperState) -> str:
        s = self._settings
        reach = s.target_counts + s.finger_counts_ps * (state.t_ns - before.t_ns) * 1e-9
        for name, was, now in zip(FINGER_NAMES, before.fingers, state.fingers, strict=True):
            here = now.position_counts
            if not 0 <= here <= 255:
                return f"gripper_impossible: finger {name} at {here} counts"
            if abs(here - was.position_counts) > reach:
                return f"gripper_impossible: finger {name} leapt {was.position_counts} to {here}"
            if state.fresh and self._contradicts(now):
                return (
                    f"gripper_impossible: finger {name} says 'at target' at {here} counts, "
                    f"asked for {now.requested_counts}"
                )
        return ""

    def _contradicts(self, finger: FingerState) -> bool:
        s, asked = self._settings, finger.requested_counts
        return (
            finger.detection is Detection.AT_TARGET
            and s.soft_low_counts <= asked <= s.soft_high_counts
            and abs(finger.position_counts - asked) > s.target_counts
        )

    def _idle(self, state: GripperState) -> str:
        s = self._settings
        silent_s = (state.t_ns - self._fresh_ns) * 1e-9
        if silent_s > s.echo_s:
            return f"gripper_silent: {silent_s:.2f} s without an answer to a command"
        standing = [state.t_ns - since_ns for since_ns in self._moved_ns]
        patience = [(s.stands_s if on else s.finger_start_s) * 1e9 for on in self._under_way]
        if stands := _names(standing, patience):
            return f"gripper_stands: finger {stands} reports motion and does not move"
        return ""


class ArmDoubt:
    """Positions that cannot be, or do not follow what the arm was told. Times are those at which
    the controller's own clock was seen to run."""

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        self._before: ArmState | None = None
        self._start_m: Vector3 = NOWHERE  # of the line that it was told to move along
        self._target_m: Vector3 = NOWHERE  # its end; where it stood at first until it is told
        self._told = False
        self._turning = False  # on its old way still, which it has to brake on first
        self._spare_s = self._spare_m = 0.0  # what braking and turning round take
        self._least_m = self._most_m = 0.0  # nearest to the target so far, and farthest from it
        self._anchor: tuple[int, Vector3] = (0, NOWHERE)  # last motion seen
        self._started = False

    def told(self, command: MoveArm | StopArm, arm: ArmState) -> None:
        """A command goes out while the arm is like this."""
        if isinstance(command, StopArm):
            self._told = False
            return
        s, ramp = self._settings, command.acceleration_mps2
        speed = math.hypot(*arm.velocity_mps)
        self._told, self._started = True, False
        self._start_m, self._target_m = arm.position_m, command.position_m
        self._turning = not _lies_ahead(arm, command)
        self._spare_s = 2.0 * math.sqrt(2.0 * s.arm_moved_m / ramp)
        self._spare_m = speed**2 / (2.0 * ramp) + speed * s.arm_start_s if self._turning else 0.0
        self._least_m = self._most_m = math.dist(arm.position_m, command.position_m)
        self._anchor = (arm.t_ns, arm.position_m)

    def see(self, arm: ArmState, pending: bool) -> str:
        """What is wrong with it. ``pending``: what it was told is still on its way."""
        if not all(map(math.isfinite, (*arm.position_m, *arm.velocity_mps, arm.angle_rad))):
            return "arm_position_nan: position or speed of the arm is not a number"
        before, self._before = self._before, arm
        if before is None:
            self._start_m = self._target_m = arm.position_m
            self._anchor = (arm.t_ns, arm.position_m)
            return ""
        if pending and not self._started:
            self._anchor = (arm.t_ns, arm.position_m)
        return self._jumped(before, arm) or self._strayed(arm) or self._froze(arm)

    def _jumped(self, before: ArmState, arm: ArmState) -> str:
        s = self._settings
        way_m = math.dist(before.position_m, arm.position_m)
        if way_m > s.arm_jump_m + s.arm_fastest_mps * (arm.t_ns - before.t_ns) * 1e-9:
            return f"arm_jump: {way_m:.3f} m from one sample to the next"
        return ""

    def _strayed(self, arm: ArmState) -> str:
        away_m = math.dist(arm.position_m, self._target_m)
        self._least_m, self._most_m = min(self._least_m, away_m), max(self._most_m, away_m)
        if self._turning and away_m < self._most_m - self._settings.arm_moved_m:
            self._turning, self._spare_m = False, 0.0
            self._start_m, self._least_m = arm.position_m, away_m
        aside_m = _off_line(arm.position_m, self._start_m, self._target_m)
        beyond_m = max(aside_m, away_m - self._least_m) - self._spare_m
        if beyond_m > self._settings.arm_astray_m:
            return f"arm_wrong_way: {beyond_m * 1e3:.0f} mm away from where it was told to be"
        return ""

    def _froze(self, arm: ArmState) -> str:
        s, (since_ns, there_m) = self._settings, self._anchor
        if math.dist(arm.position_m, there_m) > s.arm_moved_m:
            self._anchor, self._started = (arm.t_ns, arm.position_m), self._told
            return ""
        if not self._told or math.dist(arm.position_m, self._target_m) <= s.arm_there_m:
            return ""
        limit_s = s.arm_frozen_s if self._started else s.arm_start_s
        if self._turning or not self._started:
            limit_s += self._spare_s
        still_s = (arm.t_ns - since_ns) * 1e-9
        if still_s > limit_s:
            return f"arm_frozen: {still_s:.2f} s at one place while told to move"
        return ""


def _lies_ahead(arm: ArmState, command: MoveArm) -> bool:
    """Whether the arm stands, or goes towards there and can brake in time."""
    way = [b - a for a, b in zip(arm.position_m, command.position_m, strict=True)]
    speed_mps, way_m = math.hypot(*arm.velocity_mps), math.hypot(*way)
    if speed_mps < STANDING_MPS:
        return True
    along_m = sum(v * x for v, x in zip(arm.velocity_mps, way, strict=True)) / speed_mps
    aside_m = math.sqrt(max(0.0, way_m**2 - along_m**2))
    return aside_m < SAME_LINE_M and along_m >= speed_mps**2 / (2.0 * command.acceleration_mps2)


def _off_line(at_m: Vector3, start_m: Vector3, end_m: Vector3) -> float:
    """Distance from the straight line between two points, its ends included."""
    way = [b - a for a, b in zip(start_m, end_m, strict=True)]
    gone = [b - a for a, b in zip(start_m, at_m, strict=True)]
    square = sum(x * x for x in way)
    share = sum(x * y for x, y in zip(way, gone, strict=True)) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist(gone, [share * x for x in way])


def whole_rails(raw: NDArray[np.int16]) -> list[bool]:
    """Of codes (fingers, 6): which fingertips have every taxel at an end of the range."""
    return [all(finger) for finger in at_rail(raw).tolist()]


def at_rail(raw: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Which codes stand at an end of the range, where they no longer tell of pressure."""
    out: NDArray[np.bool_] = (raw <= 0) | (raw >= CODE_MAX)
    return out


def wrong_probabilities(answer: object) -> str:
    """Why a detector's answer is none; empty for one probability a finger."""
    if not isinstance(answer, np.ndarray) or answer.shape != (FINGERS,):
        shape = getattr(answer, "shape", type(answer).__name__)
        return f"detector_failed: its answer has shape {shape}, not ({FINGERS},)"
    if not all(0.0 <= p <= 1.0 for p in answer.tolist()):
        return f"detector_failed: {answer.tolist()} are no probabilities"
    return ""


def _stands(was: FingerState, now: FingerState) -> bool:
    moving = now.detection is Detection.MOVING
    return moving and was.position_counts == now.position_counts


def _goes_on(was: FingerState, now: FingerState) -> bool:
    """Told the same as before, it is seen to move."""
    moving = now.detection is Detection.MOVING
    return moving and was.requested_counts == now.requested_counts


def _counted(counts: Sequence[int], seen: Sequence[bool]) -> list[int]:
    """How often in a row each has been seen."""
    return [n + 1 if again else 0 for n, again in zip(counts, seen, strict=True)]


def _names(counts: Sequence[float], least: Sequence[float]) -> str:
    """Fingers whose count has reached so much."""
    reached = zip(FINGER_NAMES, counts, least, strict=True)
    return ", ".join(name for name, count, enough in reached if count >= enough)
