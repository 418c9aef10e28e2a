"""What devices say is doubted: values that repeat, are impossible, or do not follow a command.

Pure: fed once a step before the controller, time an argument. A doubt is one line that begins
with a stable name (``fingertips_frozen: ...``); the controller answers it with the safe state of
the phase. Delays and false faults of every check: docs/faults.md.
"""

from collections.abc import Sequence

import numpy as np
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
)
from grasp.arm_doubt import ArmDoubt
from grasp.commands import Command, MoveArm, StopArm
from grasp.doubt_settings import DoubtSettings
from grasp.phases import CONTACT_PHASES, OPEN_PHASES, Phase

STOOD_STILL = "loop_stood_still"


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
        """What cannot be believed; empty when all can.

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
        return "; ".join(filter(None, found))

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
        # the last sample's codes, and which of them stood at an end of their range
        self._before: tuple[NDArray[np.int16], NDArray[np.bool_]] | None = None
        self._repeats = [0] * FINGERS
        self._all_repeats = 0
        self._live = [0] * FINGERS  # taxels that are loaded and can tell
        self._at_rail = [0] * FINGERS
        self._jumped = False
        self.believable = True

    def see(self, frame: TactileFrame | None, phase: Phase) -> str:
        """What is wrong with them, where somebody has to feel something."""
        if frame is None:
            self._before = None
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
        rails = at_rail(raw)
        railed = [all(finger) for finger in rails.tolist()]
        live = ~rails & (np.abs(counts) >= self._settings.loaded_counts)
        self._live = [sum(finger) for finger in live.tolist()]
        self.believable = not any(railed)
        self._at_rail = _counted(self._at_rail, railed)
        before, self._before = self._before, (raw, rails)
        if before is None:
            self._repeats, self._all_repeats, self._jumped = [0] * FINGERS, 0, False
            return
        moved = raw - before[0]
        still = [not any(finger) for finger in moved.tolist()]
        self._repeats = _counted(self._repeats, still)
        self._all_repeats = self._all_repeats + 1 if all(still) else 0
        self._jumped = self._leapt(moved, before[1] | rails)
        self.believable = self.believable and not self._jumped

    def _leapt(self, moved: NDArray[np.int16], rails: NDArray[np.bool_]) -> bool:
        """All at once and one way, where a contact presses some taxels and lifts others. A taxel at
        the end of its range, now or before, cannot tell; most must be able to."""
        free = moved[~rails].tolist()
        least = self._settings.jump_counts
        return 2 * len(free) > moved.size and (min(free) >= least or max(free) <= -least)

    def _patience(self, live: int) -> int:
        """Repeats of a fingertip that so many loaded taxels could end."""
        s = self._settings
        if live >= s.live_taxels:
            return s.dead_samples
        return 2 * s.dead_samples if live else s.dead_unloaded_samples

    def wrong(self) -> str:
        """What the samples up to now say against the fingertips."""
        s = self._settings
        if railed := _names(self._at_rail, [s.rail_samples] * FINGERS):
            return f"fingertips_at_rail: finger {railed} reads 0 or {CODE_MAX} at every taxel"
        if self._jumped:
            return f"fingertips_jump: every taxel changed by {s.jump_counts} counts or more at once"
        if self._all_repeats >= s.frozen_samples:
            return f"fingertips_frozen: all codes have come {self._all_repeats + 1} times alike"
        if dead := _names(self._repeats, [self._patience(live) for live in self._live]):
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
        # both: a hand that has lost power may say nonsense of where it is, too
        found = "; ".join(filter(None, (self._inactive(state), self._impossible(before, state))))
        return found or self._idle(state)

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
    """Fingers whose count has reached so much, which is above 0."""
    if not any(counts):  # most often
        return ""
    reached = zip(FINGER_NAMES, counts, least, strict=True)
    return ", ".join([name for name, count, enough in reached if count >= enough])
