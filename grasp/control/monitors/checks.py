"""The table of plausibility checks, and ``Monitors``, which makes all of them once a step.

They are made before the controller's step: those of a device in ``update`` of its history. A check
that fails gives a ``Fault``, on which the controller enters the safe state. Delays and margins of
the checks: docs/troubleshooting.md, "Stops during a run".
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from drivers.interfaces import FINGERS, ArmState
from grasp.control.commands import Command, GripperCommand, MoveArm, StopArm
from grasp.control.fault import ARM, DETECTOR, FINGERTIPS, GRIPPER, IMPLAUSIBLE, LOOP, Fault
from grasp.control.monitors.arm import ArmHistory
from grasp.control.monitors.fingertips import FingertipHistory, PressHistory
from grasp.control.monitors.gripper import GripperHistory
from grasp.control.monitors.settings import Failures, MonitorSettings
from grasp.control.observation import StepInput
from grasp.control.states import CONTACT_STATES, GRIPPED_STATES, OPEN_STATES, State

ALWAYS = frozenset(State)
TOUCHING = ALWAYS - OPEN_STATES  # contact of some fingertip is possible
STARTED = ALWAYS - {State.START}
STOOD_STILL, DETECTOR_FAILED = "loop_stood_still", "detector_failed"
SWAPPED = "fingertips_swapped"

REMEDIES = {
    ARM: "look at the arm and its pendant, then run `grasp doctor`",
    GRIPPER: "look at the hand, its power and who else commands it, then run `grasp doctor`",
    FINGERTIPS: "look at the fingertips, their cable and their board, then run `grasp doctor`",
    DETECTOR: "choose another detector (--detector), or end what else this computer does",
    DETECTOR_FAILED: "correct the detector (docs/extending.md), or choose another (--detector)",
    SWAPPED: "press each pad in `grasp tactile identify`, then exchange cables or tactile.cells",
    LOOP: "this computer stood still: end what else it does, then start the run again "
    "(docs/first-day.md)",
}
TRUTHFUL_CODES = frozenset({"gripper_inactive"})  # faults of devices whose data are still correct


class Check(NamedTuple):
    """One check: the device whose fault it is, and the message of the fault.

    ``states``: where a failure counts. ``vital``: ends a run in report mode too, because control is
    impossible otherwise. ``ends``: False: it is reported in every mode.
    """

    device: str
    message: str
    states: frozenset[State] = ALWAYS
    vital: bool = False
    ends: bool = True


CHECKS = {
    "detector_late": Check(DETECTOR, "a step took {seconds:g} s", CONTACT_STATES, vital=True),
    STOOD_STILL: Check(LOOP, "the control step began {seconds:g} s late", STARTED, vital=True),
    "arm_position_nan": Check(ARM,
        "position, speed or speed slider is not a number", vital=True),
    "arm_wrong_way": Check(ARM, "{mm:g} mm away from where it was commanded to be"),
    "arm_flickers": Check(ARM, "alternately reports motion and standstill"),
    "arm_frozen": Check(ARM, "no motion for {seconds:g} s, although it must move"),
    "gripper_inactive": Check(GRIPPER,
        "the hand is not active: it lost power, or another client cleared rACT",
        vital=True),
    "gripper_impossible": Check(GRIPPER, "finger {finger} {how}"),
    "gripper_unconfirmed": Check(GRIPPER,
        "another client changed the gripper's registers, or the gripper ignores commands: {how}, "
        "for {seconds:g} s"),
    "gripper_stands": Check(GRIPPER, "finger {finger} reports motion but does not move"),
    "gripper_flickers": Check(GRIPPER,
        "finger {finger} alternately reports motion and standstill"),
    "fingertips_absent": Check(FINGERTIPS,
        "no frame: the board restarted and lost its rest counts", CONTACT_STATES, vital=True),
    "fingertips_at_rail": Check(FINGERTIPS,
        "finger {finger} reads 0 or 1023 at every taxel", TOUCHING),
    "fingertips_jump": Check(FINGERTIPS,
        "every taxel changed by {counts:g} counts or more at once", TOUCHING),
    "fingertips_frozen": Check(FINGERTIPS,
        "all codes were equal in {samples:g} samples in a row", TOUCHING),
    "fingertip_dead": Check(FINGERTIPS,
        "the codes of finger {finger} no longer change", TOUCHING),
    "fingertip_few_taxels": Check(FINGERTIPS,
        "more than half of the taxels of finger {finger} no longer change", GRIPPED_STATES),
    "fingertips_unpressed": Check(FINGERTIPS,
        "contact, but no fingertip is pressed: pressing must be negative", CONTACT_STATES),
    SWAPPED: Check(FINGERTIPS, "fingertip {finger} reads more than the thumb's: are they swapped?",
        GRIPPED_STATES | {State.LIFT, State.COMPENSATE, State.HOLD}, ends=False),
    "fingertips_slow": Check(FINGERTIPS,  # found by the run monitor
        "too few samples for rest counts within {seconds:g} s", vital=True),
    DETECTOR_FAILED: Check(DETECTOR, "{how}", vital=True),  # found by the step
}  # fmt: skip


def failed(code: str, **data: float | str) -> Fault:
    """Make the fault of a failed check; ``data``: the fields of its message."""
    device, text = CHECKS[code].device, CHECKS[code].message.format(**data)
    return Fault(code, device, text, REMEDIES.get(code, REMEDIES[device]), data, IMPLAUSIBLE)


def implausible(faults: Iterable[Fault], device: str) -> bool:
    """Whether, by these faults, the device's data cannot be trusted."""
    wrong = (f for f in faults if f.kind == IMPLAUSIBLE and f.code not in TRUTHFUL_CODES)
    return any(fault.device == device for fault in wrong)


class Monitors:
    """All checks of a run. Call ``check`` and then ``sent``, once a step each.

    ``enabled``: False where substitutes replace the devices, which need no check.
    """

    def __init__(self, settings: MonitorSettings, enabled: bool = True) -> None:
        self._settings = settings
        self._enabled = enabled
        self._stood_still = False  # device states were missed: only vital checks continue
        self.arm = ArmHistory(settings)
        self.gripper = GripperHistory(settings)
        self.fingertips = FingertipHistory(settings)
        self._presses = PressHistory()

    def check(self, state: State, inputs: StepInput) -> tuple[Fault, ...]:
        """Faults of all checks that this step's inputs fail."""
        if not self._enabled:
            return ()
        s = self._settings
        failures: Failures = {}
        if inputs.took_ns > s.detector_s * 1e9:
            failures["detector_late"] = {"seconds": round(inputs.took_ns * 1e-9, 3)}
        if inputs.late_ns > s.standstill_s * 1e9:
            failures[STOOD_STILL] = {"seconds": round(inputs.late_ns * 1e-9, 3)}
        failures |= self.arm.update(inputs.arm, inputs.pending)
        failures |= self.gripper.update(inputs.gripper)
        failures |= self.fingertips.update(inputs.frame)
        failures |= self._presses.update(inputs)
        return self._faults(state, failures) if failures else ()

    def _faults(self, state: State, failures: Failures) -> tuple[Fault, ...]:
        """Faults of the failures that count in this state."""
        found = []
        for code, fields in failures.items():
            check = CHECKS[code]
            if state in check.states and (check.vital or not self._stood_still):
                found.append(failed(code, **fields))
                self._stood_still = self._stood_still or code == STOOD_STILL
        return tuple(found)

    def stops(self, fault: Fault) -> bool:
        """Whether the fault ends the run: in report mode, implausible data do not."""
        implausible = fault.kind == IMPLAUSIBLE and not CHECKS[fault.code].vital
        report = self._settings.mode == "report"
        return not (implausible and (report or not CHECKS[fault.code].ends))

    @property
    def force_plausible(self) -> bool:
        """Whether the latest frame gives a force estimate; always in report mode."""
        return self.fingertips.plausible or self._settings.mode == "report"

    def sent(self, commands: Sequence[Command], arm_state: ArmState) -> None:
        """Take the commands of this step; ``arm_state``: the arm's state in it."""
        for command in commands:
            if isinstance(command, MoveArm | StopArm):
                self.arm.sent(command, arm_state)
            elif isinstance(command, GripperCommand):
                self.gripper.sent(command)


def invalid_probabilities(output: object) -> Fault | None:
    """The fault of a detector's output; None if it is one probability a finger."""
    shape = getattr(output, "shape", type(output).__name__)
    if not isinstance(output, np.ndarray) or shape != (FINGERS,):
        return failed(DETECTOR_FAILED, how=f"its output has shape {shape}, not ({FINGERS},)")
    if output.dtype.kind in "fiub":
        a, b, c = output.tolist()
        if 0.0 <= a <= 1.0 and 0.0 <= b <= 1.0 and 0.0 <= c <= 1.0:
            return None
    return failed(DETECTOR_FAILED, how=f"{output.tolist()} are no probabilities")
