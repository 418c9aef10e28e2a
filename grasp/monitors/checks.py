"""The table of plausibility checks, and ``Monitors``, which evaluates all of them once a step.

The checks are pure functions of the inputs of a step, made before the controller's step. A check
that fails gives a ``Fault``, on which the controller enters the safe state. Delays and margins of
the checks: docs/force-limit.md.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from drivers.interfaces import FINGERS, ArmState
from grasp.commands import Command, MoveArm, StopArm
from grasp.fault import ARM, DETECTOR, FINGERTIPS, GRIPPER, IMPLAUSIBLE, LOOP, Fault
from grasp.monitors import arm, fingertips, gripper
from grasp.monitors.fingertips import RAIL_SAMPLES
from grasp.monitors.settings import Data, MonitorSettings, finger_names
from grasp.observation import StepInput
from grasp.states import CONTACT_STATES, GRIPPED_STATES, OPEN_STATES, State

ALWAYS = frozenset(State)
TOUCHING = ALWAYS - OPEN_STATES  # contact of some fingertip is possible
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
TRUTHFUL_CODES = frozenset({"gripper_inactive"})  # faults of devices whose data are still correct
Fails = Callable[[Any, MonitorSettings], Data]


class Check(NamedTuple):
    """One check. In ``states``, ``fails`` returns the fields of ``message`` when it fails; None:
    the check is made elsewhere.

    ``vital``: ends a run in report mode too, because control is impossible otherwise.
    """

    device: str
    fails: Fails | None
    message: str
    states: frozenset[State] = ALWAYS
    vital: bool = False


def data_if(fails: bool, **data: float | str) -> Data:
    """The fields of a message if the check fails, else None."""
    return data if fails else None


CHECKS = {
    "detector_late": Check(DETECTOR,
        lambda i, s: data_if(i.took_ns > s.detector_s * 1e9, seconds=round(i.took_ns * 1e-9, 3)),
        "a step took {seconds:g} s", CONTACT_STATES, vital=True),
    STOOD_STILL: Check(LOOP,
        lambda i, s: data_if(i.late_ns > s.standstill_s * 1e9, seconds=round(i.late_ns * 1e-9, 3)),
        "the control step began {seconds:g} s late", STARTED, vital=True),
    "arm_position_nan": Check(ARM, lambda h, s: data_if(h.state is None),
        "position, speed or speed slider is not a number", vital=True),
    "arm_wrong_way": Check(ARM, lambda h, s: data_if(h.deviates, mm=round(h.deviation_m * 1e3, 1)),
        "{mm:g} mm away from where it was commanded to be"),
    "arm_flickers": Check(ARM, lambda h, s: data_if(h.flickers),
        "alternately reports motion and standstill"),
    "arm_frozen": Check(ARM, arm.frozen, "no motion for {seconds:g} s, although it must move"),
    "gripper_inactive": Check(GRIPPER,
        lambda h, s: data_if(not h.state.active and not h.state.fault),  # a fault has its own text
        "the hand has lost its activation and executes no motion", vital=True),
    "gripper_impossible": Check(GRIPPER, gripper.impossible, "finger {finger} {how}"),
    "gripper_silent": Check(GRIPPER, gripper.silent, "no response to a command for {seconds:g} s"),
    "gripper_stands": Check(GRIPPER, gripper.stands,
        "finger {finger} reports motion but does not move"),
    "gripper_flickers": Check(GRIPPER, lambda h, s: finger_names(h.flickers),
        "finger {finger} alternately reports motion and standstill"),
    "fingertips_absent": Check(FINGERTIPS, lambda h, s: data_if(h.codes is None),
        "no frame: the board restarted and lost its rest counts", CONTACT_STATES, vital=True),
    "fingertips_at_rail": Check(FINGERTIPS, lambda h, s: finger_names(h.at_rail >= RAIL_SAMPLES),
        "finger {finger} reads 0 or 1023 at every taxel", TOUCHING),
    "fingertips_jump": Check(FINGERTIPS, lambda h, s: data_if(h.jumped, counts=s.jump_counts),
        "every taxel changed by {counts:g} counts or more at once", TOUCHING),
    "fingertips_frozen": Check(FINGERTIPS, fingertips.frozen,
        "all codes were equal in {samples:g} samples in a row", TOUCHING),
    "fingertip_dead": Check(FINGERTIPS, fingertips.dead,
        "the codes of finger {finger} no longer change", TOUCHING),
    "fingertip_few_taxels": Check(FINGERTIPS, fingertips.few_responsive,
        "more than half of the taxels of finger {finger} no longer change", GRIPPED_STATES),
    "fingertips_slow": Check(FINGERTIPS, None,
        "too few samples for rest counts within {seconds:g} s", vital=True),
    "detector_failed": Check(DETECTOR, None, "{how}", vital=True),
}  # fmt: skip


def failed(code: str, **data: float | str) -> Fault:
    """Make the fault of a failed check; ``data``: the fields of its message."""
    device, text = CHECKS[code].device, CHECKS[code].message.format(**data)
    return Fault(code, device, text, REMEDIES[device], data, IMPLAUSIBLE)


def implausible(faults: Iterable[Fault], device: str) -> bool:
    """Whether, by these faults, the device's data cannot be trusted."""
    wrong = (f for f in faults if f.kind == IMPLAUSIBLE and f.code not in TRUTHFUL_CODES)
    return any(fault.device == device for fault in wrong)


class Monitors:
    """All checks of a run. Call ``check`` and then ``sent``, once a step each.

    ``checks``: by their codes; none where substitutes replace the devices, which need no check.
    """

    def __init__(self, settings: MonitorSettings, checks: dict[str, Check] = CHECKS) -> None:
        self._settings = settings
        self._checks = checks
        self._stood_still = False  # device states were missed: only vital checks continue
        self.arm = arm.ArmHistory(settings)
        self.gripper = gripper.GripperHistory()
        self.fingertips = fingertips.FingertipHistory(settings)

    def check(self, state: State, inputs: StepInput) -> tuple[Fault, ...]:
        """Faults of all checks that this step's inputs fail."""
        if not self._checks:
            return ()
        self.arm.update(inputs.arm, inputs.pending)
        self.gripper.update(inputs.gripper)
        self.fingertips.update(inputs.frame)
        histories = {ARM: self.arm, GRIPPER: self.gripper, FINGERTIPS: self.fingertips}
        found = []
        for code, check in self._checks.items():
            if check.fails is None or state not in check.states:
                continue
            if self._stood_still and not check.vital:
                continue
            data = check.fails(histories.get(check.device, inputs), self._settings)
            if data is not None:
                found.append(failed(code, **data))
                self._stood_still = self._stood_still or code == STOOD_STILL
        return tuple(found)

    def stops(self, fault: Fault) -> bool:
        """Whether the fault ends the run: in report mode, implausible data do not."""
        implausible = fault.kind == IMPLAUSIBLE and not CHECKS[fault.code].vital
        return not (implausible and self._settings.mode == "report")

    @property
    def force_plausible(self) -> bool:
        """Whether the latest frame gives a force estimate; always in report mode."""
        return self.fingertips.plausible or self._settings.mode == "report"

    def sent(self, commands: Sequence[Command], arm_state: ArmState) -> None:
        """Take the commands of this step; ``arm_state``: the arm's state in it."""
        for command in commands:
            if isinstance(command, MoveArm | StopArm):
                self.arm.sent(command, arm_state)


def invalid_probabilities(output: object) -> Fault | None:
    """The fault of a detector's output; None if it is one probability a finger."""
    shape = getattr(output, "shape", type(output).__name__)
    if not isinstance(output, np.ndarray) or shape != (FINGERS,):
        return failed("detector_failed", how=f"its output has shape {shape}, not ({FINGERS},)")
    if output.dtype.kind in "fiub" and all(0.0 <= p <= 1.0 for p in output.tolist()):
        return None
    return failed("detector_failed", how=f"{output.tolist()} are no probabilities")
