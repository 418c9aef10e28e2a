"""What devices say is doubted: values that repeat, are impossible, or do not follow a command.

Pure: fed once a step before the controller, time an argument. A doubt is one line that begins
with a stable name (``fingertips_frozen: ...``); the controller answers it with the safe state of
the state. Delays and false faults of every check: docs/faults.md.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGERS, ArmState, GripperState, TactileFrame
from grasp.arm_doubt import ArmDoubt
from grasp.commands import Command, GripperCommand, MoveArm, StopArm
from grasp.doubt_settings import DoubtSettings
from grasp.fingertip_doubt import FingertipDoubt
from grasp.gripper_doubt import GripperDoubt
from grasp.states import CONTACT_STATES, State

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

    @property
    def can_tell(self) -> NDArray[np.bool_]:
        """Which taxels would feel a change, as broad as a frame's codes or broadcast to them."""
        return self._fingertips.can_tell

    @property
    def all_tell(self) -> bool:
        """Whether every taxel would."""
        return self._fingertips.all_tell

    def of(
        self,
        state: State,
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
        if self._slept(state, late_ns):  # in that time nobody saw what the devices did
            self._arm.begin_anew(arm, late_ns)
            self._gripper.begin_anew(gripper)
        found = (
            self._loop(state, late_ns, took_ns),
            self._arm.see(arm, pending),
            self._gripper.see(gripper),
            self._fingertips.see(frame, state),
        )
        return "; ".join(filter(None, found))

    def sent(self, commands: Sequence[Command], arm: ArmState) -> None:
        """These commands follow from the step; ``arm`` is how it stood then."""
        for command in commands:
            if isinstance(command, MoveArm | StopArm):
                self._arm.told(command, arm)
            elif isinstance(command, GripperCommand):
                self._gripper.told()

    def _slept(self, state: State, late_ns: int) -> bool:
        return state is not State.START and late_ns > self._settings.standstill_s * 1e9

    def _loop(self, state: State, late_ns: int, took_ns: int) -> str:
        s = self._settings
        if state in CONTACT_STATES and took_ns > s.detector_s * 1e9:
            return f"detector_late: a step took {took_ns * 1e-9:.3f} s"
        if self._slept(state, late_ns):
            return f"{STOOD_STILL}: for {late_ns * 1e-9:.3f} s nobody was in control"
        return ""


def wrong_probabilities(answer: object) -> str:
    """Why a detector's answer is none; empty for one probability a finger."""
    if not isinstance(answer, np.ndarray) or answer.shape != (FINGERS,):
        shape = getattr(answer, "shape", type(answer).__name__)
        return f"detector_failed: its answer has shape {shape}, not ({FINGERS},)"
    if answer.dtype.kind not in "fiub":
        return f"detector_failed: its answer is of type {answer.dtype}, no numbers"
    if not all(0.0 <= p <= 1.0 for p in answer.tolist()):
        return f"detector_failed: {answer.tolist()} are no probabilities"
    return ""
