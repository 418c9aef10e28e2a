"""The table of plausibility checks, and ``Monitors``, which makes all of them once a step.

Pure: fed the inputs of a step before the controller, time an argument. A check that fails is a
``Fault``; the controller answers it with the safe state. How soon each speaks, and
what a run without a fault leaves of margin: docs/faults.md.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from drivers.interfaces import FINGERS, ArmState
from grasp.commands import Command, GripperCommand, MoveArm, StopArm
from grasp.fault import ARM, DETECTOR, FINGERTIPS, GRIPPER, IMPLAUSIBLE, LOOP, Fault
from grasp.monitors import arm, fingertips, gripper
from grasp.monitors.settings import MonitorSettings
from grasp.observation import StepInput
from grasp.states import CONTACT_STATES, GRIPPED_STATES, OPEN_STATES, State

ALWAYS = frozenset(State)
TOUCHING = ALWAYS - OPEN_STATES  # somebody has to feel something
STARTED = ALWAYS - {State.START}
STOOD_STILL = "loop_stood_still"

LOOK_AT_ARM = "look at the arm and its pendant, then run `grasp doctor`"
LOOK_AT_HAND = "look at the hand, its power and who else commands it, then run `grasp doctor`"
LOOK_AT_PADS = "look at the fingertips, their cable and their board, then run `grasp doctor`"
KEEP_UP = (
    "this computer stood still: end what else it does, then start the run again (docs/real-time.md)"
)
Data = dict[str, float | str] | None  # of a check that failed
Condition = Callable[[Any, MonitorSettings], Data]


class Check(NamedTuple):
    """``fails`` is asked in ``states`` for the fields of ``message``; None: found elsewhere.

    ``vital``: stops a run in report mode too, for without it nothing can be controlled.
    """

    device: str
    fails: Condition | None
    message: str
    remedy: str
    states: frozenset[State] = ALWAYS
    vital: bool = False
    lies: bool = True  # nothing else that the device reports is believed


def stood_still(inputs: StepInput, s: MonitorSettings) -> Data:
    """This step began too late."""
    late_s = inputs.late_ns * 1e-9
    return {"seconds": round(late_s, 3)} if late_s > s.standstill_s else None


def took_long(inputs: StepInput, s: MonitorSettings) -> Data:
    """The step before this one took too long."""
    took_s = inputs.took_ns * 1e-9
    return {"seconds": round(took_s, 3)} if took_s > s.detector_s else None


CHECKS = {
    "detector_late": Check(DETECTOR, took_long, "a step took {seconds:g} s",
        "choose a faster detector, or end what else this computer does (docs/real-time.md)",
        CONTACT_STATES, vital=True),
    STOOD_STILL: Check(LOOP, stood_still, "for {seconds:g} s nobody was in control", KEEP_UP,
        STARTED, vital=True),
    "arm_position_nan": Check(ARM, arm.position_nan, "position or speed is not a number",
        LOOK_AT_ARM, vital=True),
    "arm_jump": Check(
        ARM, arm.jumped, "{mm:g} mm further than an arm can have gone since the last sample",
        LOOK_AT_ARM),
    "arm_wrong_way": Check(ARM, arm.off_line, "{mm:g} mm away from where it was commanded to be",
        LOOK_AT_ARM),
    "arm_goes_on": Check(ARM, arm.goes_on, "{mm:g} mm since it was commanded to stop",
        LOOK_AT_ARM),
    "arm_frozen": Check(ARM, arm.frozen,
        "{seconds:g} s at one place, though it has to move or reports that it does", LOOK_AT_ARM),
    "gripper_inactive": Check(GRIPPER, gripper.inactive,
        "the hand has lost its activation and obeys no motion", LOOK_AT_HAND, vital=True,
        lies=False),
    "gripper_impossible": Check(GRIPPER, gripper.impossible, "finger {finger} {how}",
        LOOK_AT_HAND),
    "gripper_silent": Check(GRIPPER, gripper.silent,
        "{seconds:g} s without an answer to a command", LOOK_AT_HAND),
    "gripper_stands": Check(GRIPPER, gripper.stands,
        "finger {finger} reports motion and does not move", LOOK_AT_HAND),
    "gripper_flickers": Check(
        GRIPPER, gripper.flickers,
        "finger {finger} reports one thing of its motion and then another", LOOK_AT_HAND),
    "fingertips_absent": Check(FINGERTIPS, fingertips.absent,
        "there is no frame: the board came back without its rest", LOOK_AT_PADS, CONTACT_STATES,
        vital=True),
    "fingertips_at_rail": Check(FINGERTIPS, fingertips.whole_at_rail,
        "finger {finger} reads 0 or 1023 at every taxel", LOOK_AT_PADS, TOUCHING),
    "fingertips_jump": Check(FINGERTIPS, fingertips.jumped,
        "every taxel changed by {counts:g} counts or more at once", LOOK_AT_PADS, TOUCHING),
    "fingertips_frozen": Check(FINGERTIPS, fingertips.frozen,
        "all codes have come {samples:g} times alike", LOOK_AT_PADS, TOUCHING),
    "fingertip_dead": Check(FINGERTIPS, fingertips.dead,
        "finger {finger} gives the same codes for ever", LOOK_AT_PADS, TOUCHING),
    "fingertip_few_taxels": Check(FINGERTIPS, fingertips.few_living,
        "more than half of the taxels of finger {finger} stand still", LOOK_AT_PADS,
        GRIPPED_STATES),
    "fingertips_slow": Check(FINGERTIPS, None,
        "too few samples for rest counts within {seconds:g} s", LOOK_AT_PADS, vital=True),
    "detector_failed": Check(DETECTOR, None, "{how}",
        "choose another detector (--detector), or correct this one", vital=True),
}  # fmt: skip


def failed(code: str, **data: float | str) -> Fault:
    """The fault of a check, with the numbers of its message."""
    check = CHECKS[code]
    text = check.message.format(**data)
    return Fault(code, check.device, text, check.remedy, data, IMPLAUSIBLE)


def not_believed(faults: Iterable[Fault], device: str) -> bool:
    """Whether what the device reports is not to be taken for true."""
    return any(
        fault.device == device and fault.kind == IMPLAUSIBLE and CHECKS[fault.code].lies
        for fault in faults
    )


class Monitors:
    """All checks of a run. ``check`` and ``sent`` once a step each, in this order.

    ``checks``: by their codes; none where stand-ins replace the devices: they are believed.
    """

    def __init__(self, settings: MonitorSettings, checks: dict[str, Check] = CHECKS) -> None:
        self._settings = settings
        self._checks = [(code, check, check.fails) for code, check in checks.items()]
        self.arm = arm.ArmHistory(settings)
        self.gripper = gripper.GripperHistory()
        self.fingertips = fingertips.FingertipHistory(settings)

    def check(self, state: State, inputs: StepInput) -> tuple[Fault, ...]:
        """What cannot be believed of this step's inputs."""
        if not self._checks:
            return ()
        s = self._settings
        if state in STARTED and stood_still(inputs, s):  # nobody saw what the devices did
            self.arm.restart(inputs.arm, inputs.late_ns)
            self.gripper.restart(inputs.gripper)
        self.arm.update(inputs.arm, inputs.pending)
        self.gripper.update(inputs.gripper)
        self.fingertips.update(inputs.frame)
        of = {ARM: self.arm, GRIPPER: self.gripper, FINGERTIPS: self.fingertips}
        found = []
        for code, check, fails in self._checks:
            if fails is not None and state in check.states:
                data = fails(of.get(check.device, inputs), s)
                if data is not None:
                    found.append(failed(code, **data))
        return tuple(found)

    def stops(self, fault: Fault) -> bool:
        """Whether a run goes on no further: in report mode not for what is only implausible."""
        implausible = fault.kind == IMPLAUSIBLE and not CHECKS[fault.code].vital
        return not (implausible and self._settings.mode == "report")

    def sent(self, commands: Sequence[Command], arm_state: ArmState) -> None:
        """These commands follow from the step; ``arm_state`` is as the arm was then."""
        for command in commands:
            if isinstance(command, MoveArm | StopArm):
                self.arm.command(command, arm_state)
            elif isinstance(command, GripperCommand):
                self.gripper.command()


def no_probabilities(answer: object) -> Fault | None:
    """What is wrong with a detector's answer; None for one probability a finger."""
    if not isinstance(answer, np.ndarray) or answer.shape != (FINGERS,):
        shape = getattr(answer, "shape", type(answer).__name__)
        return failed("detector_failed", how=f"its answer has shape {shape}, not ({FINGERS},)")
    if answer.dtype.kind not in "fiub":
        return failed("detector_failed", how=f"its answer is of type {answer.dtype}, no numbers")
    if not all(0.0 <= p <= 1.0 for p in answer.tolist()):
        return failed("detector_failed", how=f"{answer.tolist()} are no probabilities")
    return None
