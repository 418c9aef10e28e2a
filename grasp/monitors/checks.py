"""The table of plausibility checks, and ``Monitors``, which makes all of them once a step.

Pure: fed the inputs of a step before the controller, time an argument. A check that fails is a
``Fault``; the controller answers it with the safe state. How soon each speaks, and
what a run without a fault leaves of margin: docs/force-limit.md.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from drivers.interfaces import FINGERS, ArmState
from grasp.commands import Command, MoveArm, StopArm
from grasp.fault import ARM, DETECTOR, FINGERTIPS, GRIPPER, IMPLAUSIBLE, LOOP, Fault
from grasp.monitors import arm, fingertips, gripper
from grasp.monitors.fingertips import RAIL_SAMPLES
from grasp.monitors.settings import Data, MonitorSettings, named
from grasp.observation import StepInput
from grasp.states import CONTACT_STATES, GRIPPED_STATES, OPEN_STATES, State

ALWAYS = frozenset(State)
TOUCHING = ALWAYS - OPEN_STATES  # somebody has to feel something
STARTED = ALWAYS - {State.START}
STOOD_STILL = "loop_stood_still"

REMEDIES = {
    ARM: "look at the arm and its pendant, then run `grasp doctor`",
    GRIPPER: "look at the hand, its power and who else commands it, then run `grasp doctor`",
    FINGERTIPS: "look at the fingertips, their cable and their board, then run `grasp doctor`",
    DETECTOR: "choose another detector (--detector), or end what else this computer does",
    LOOP: "this computer stood still: end what else it does, then start the run again "
    "(docs/first-day.md)",
}
BELIEVED = frozenset({"gripper_inactive"})  # such a device reports the truth
Fails = Callable[[Any, MonitorSettings], Data]


class Check(NamedTuple):
    """``fails`` is asked in ``states`` for the fields of ``message``; None: found elsewhere.

    ``vital``: stops a run in report mode too, for without it nothing can be controlled.
    """

    device: str
    fails: Fails | None
    message: str
    states: frozenset[State] = ALWAYS
    vital: bool = False


def given(fails: bool, **data: float | str) -> Data:
    """The fields of a message where a check fails."""
    return data if fails else None


CHECKS = {
    "detector_late": Check(DETECTOR,
        lambda i, s: given(i.took_ns > s.detector_s * 1e9, seconds=round(i.took_ns * 1e-9, 3)),
        "a step took {seconds:g} s", CONTACT_STATES, vital=True),
    STOOD_STILL: Check(LOOP,
        lambda i, s: given(i.late_ns > s.standstill_s * 1e9, seconds=round(i.late_ns * 1e-9, 3)),
        "the control step began {seconds:g} s late", STARTED, vital=True),
    "arm_position_nan": Check(ARM, lambda h, s: given(h.state is None),
        "position, speed or speed slider is not a number", vital=True),
    "arm_wrong_way": Check(ARM, lambda h, s: given(h.strays, mm=round(h.stray_m * 1e3, 1)),
        "{mm:g} mm away from where it was commanded to be"),
    "arm_flickers": Check(ARM, lambda h, s: given(h.flickers),
        "reports by turns that it moves and that it stands"),
    "arm_frozen": Check(ARM, arm.frozen, "{seconds:g} s at one place, though it has to move"),
    "gripper_inactive": Check(GRIPPER,
        lambda h, s: given(not h.state.active and not h.state.fault),  # a fault has its own text
        "the hand has lost its activation and obeys no motion", vital=True),
    "gripper_impossible": Check(GRIPPER, gripper.impossible, "finger {finger} {how}"),
    "gripper_silent": Check(GRIPPER, gripper.silent, "{seconds:g} s without an answer"),
    "gripper_stands": Check(GRIPPER, gripper.stands,
        "finger {finger} reports motion and does not move"),
    "gripper_flickers": Check(GRIPPER, lambda h, s: named(h.flickers),
        "finger {finger} reports one thing of its motion and then another"),
    "fingertips_absent": Check(FINGERTIPS, lambda h, s: given(h.codes is None),
        "there is no frame: the board came back without its rest", CONTACT_STATES, vital=True),
    "fingertips_at_rail": Check(FINGERTIPS, lambda h, s: named(h.at_rail >= RAIL_SAMPLES),
        "finger {finger} reads 0 or 1023 at every taxel", TOUCHING),
    "fingertips_jump": Check(FINGERTIPS, lambda h, s: given(h.jumped, counts=s.jump_counts),
        "every taxel changed by {counts:g} counts or more at once", TOUCHING),
    "fingertips_frozen": Check(FINGERTIPS, fingertips.frozen,
        "all codes have come {samples:g} times alike", TOUCHING),
    "fingertip_dead": Check(FINGERTIPS, fingertips.dead,
        "finger {finger} gives the same codes for ever", TOUCHING),
    "fingertip_few_taxels": Check(FINGERTIPS, fingertips.few_living,
        "more than half of the taxels of finger {finger} stand still", GRIPPED_STATES),
    "fingertips_slow": Check(FINGERTIPS, None,
        "too few samples for rest counts within {seconds:g} s", vital=True),
    "detector_failed": Check(DETECTOR, None, "{how}", vital=True),
}  # fmt: skip


def failed(code: str, **data: float | str) -> Fault:
    """The fault of a check, with the numbers of its message."""
    device, text = CHECKS[code].device, CHECKS[code].message.format(**data)
    return Fault(code, device, text, REMEDIES[device], data, IMPLAUSIBLE)


def implausible(faults: Iterable[Fault], device: str) -> bool:
    """Whether what the device reports is not to be taken for true."""
    lies = (f for f in faults if f.kind == IMPLAUSIBLE and f.code not in BELIEVED)
    return any(fault.device == device for fault in lies)


class Monitors:
    """All checks of a run. ``check`` and ``sent`` once a step each, in this order.

    ``checks``: by their codes; none where stand-ins replace the devices: they are believed.
    """

    def __init__(self, settings: MonitorSettings, checks: dict[str, Check] = CHECKS) -> None:
        self._settings = settings
        self._checks = checks
        self._stood_still = False  # nobody saw what the devices did: only vital checks go on
        self.arm = arm.ArmHistory(settings)
        self.gripper = gripper.GripperHistory()
        self.fingertips = fingertips.FingertipHistory(settings)

    def check(self, state: State, inputs: StepInput) -> tuple[Fault, ...]:
        """What cannot be believed of this step's inputs."""
        if not self._checks:
            return ()
        self.arm.update(inputs.arm, inputs.pending)
        self.gripper.update(inputs.gripper)
        self.fingertips.update(inputs.frame)
        of = {ARM: self.arm, GRIPPER: self.gripper, FINGERTIPS: self.fingertips}
        found = []
        for code, check in self._checks.items():
            if check.fails is None or state not in check.states:
                continue
            if self._stood_still and not check.vital:
                continue
            data = check.fails(of.get(check.device, inputs), self._settings)
            if data is not None:
                found.append(failed(code, **data))
                self._stood_still = self._stood_still or code == STOOD_STILL
        return tuple(found)

    def stops(self, fault: Fault) -> bool:
        """Whether a run goes on no further: in report mode not for what is only implausible."""
        implausible = fault.kind == IMPLAUSIBLE and not CHECKS[fault.code].vital
        return not (implausible and self._settings.mode == "report")

    @property
    def trusts_force(self) -> bool:
        """Whether the latest frame is taken for a force; in report mode no check changes that."""
        return self.fingertips.believable or self._settings.mode == "report"

    def sent(self, commands: Sequence[Command], arm_state: ArmState) -> None:
        """These commands follow from the step; ``arm_state`` is as the arm was then."""
        for command in commands:
            if isinstance(command, MoveArm | StopArm):
                self.arm.sent(command, arm_state)


def no_probabilities(answer: object) -> Fault | None:
    """What is wrong with a detector's answer; None for one probability a finger."""
    shape = getattr(answer, "shape", type(answer).__name__)
    if not isinstance(answer, np.ndarray) or shape != (FINGERS,):
        return failed("detector_failed", how=f"its answer has shape {shape}, not ({FINGERS},)")
    if answer.dtype.kind in "fiub" and all(0.0 <= p <= 1.0 for p in answer.tolist()):
        return None
    return failed("detector_failed", how=f"{answer.tolist()} are no probabilities")
