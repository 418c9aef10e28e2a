"""Messages of a recording, one type a topic, and their conversion back to a step's inputs.

They contain all inputs of a control step, so that a replay needs nothing else. They contain nothing
that depends on the wall clock, so that equal runs give equal bytes.
"""

import math
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import numpy as np

from detector.interface import Motion
from drivers.interfaces import FINGERS, Applied, ArmState, GripperState, TactileFrame, Vector3
from grasp.control.commands import Command
from grasp.control.fault import Fault
from grasp.control.observation import Observation, StepInput
from grasp.control.states import PhaseChange
from grasp.control.transition import Decision
from grasp.run.loop import Tick

Int16 = Annotated[int, msgspec.Meta(ge=-(2**15), lt=2**15)]


class TactileMessage(msgspec.Struct, frozen=True):
    """Tactile frame. counts, raw and temperature are row-major (finger, taxel), 18 values each."""

    seq: int
    sampled_ns: int
    counts: list[Int16]
    raw: list[Int16]
    temperature: list[Int16]
    missed: int
    stale: bool

    def __post_init__(self) -> None:
        values = len(self.counts)
        if not values or values % FINGERS or {len(self.raw), len(self.temperature)} != {values}:
            raise ValueError("counts, raw and temperature are not of equal fingertips")


Number = float | None  # null in place of NaN, which JSON does not have


class ArmMessage(msgspec.Struct, frozen=True):
    """The fields of ``ArmState``, with null where a value is not a number."""

    t_ns: int
    seq: int
    position_m: tuple[Number, Number, Number]
    velocity_mps: tuple[Number, Number, Number]
    moving: bool
    stopped_by_safety: bool = False
    angle_rad: Number = 0.0
    spin_radps: Number = 0.0
    speed_fraction: Number = 1.0
    sampled_ns: int | None = None
    joints_rad: tuple[Number, Number, Number, Number, Number, Number] | None = None


class ControlMessage(msgspec.Struct, frozen=True):
    """Control step: its inputs except the device states, and its result."""

    phase: str
    probabilities: list[float]
    armed: bool
    masked: bool
    registered: bool
    event: bool
    finger: int
    estimated_n: Vector3
    rest_taken: bool
    pending: bool
    errors: tuple[Fault, ...]
    gripper_lost: bool
    commands: list[Command]
    set_down: bool = False
    stop: Fault | None = None
    late_ns: int = 0
    took_ns: int = 0
    faults: tuple[Fault, ...] = ()
    reported: tuple[Fault, ...] = ()  # checks that failed in report mode


# fields of ``StepInput`` in ``ControlMessage``
INPUTS = [name for name in ControlMessage.__struct_fields__ if hasattr(StepInput, name)]


class CommandMessage(msgspec.Struct, frozen=True):
    """Command as requested by the controller, admitted by the guard, applied by the device."""

    decided_ns: int
    requested: Command
    admitted: Command
    applied: Applied | None
    refused: str


TACTILE, GRIPPER, ARM, CONTROL, MOTION, COMMANDS, PHASES, TRUTH = (
    "/tactile", "/gripper", "/arm", "/control", "/motion", "/commands", "/phases", "/truth",
)  # fmt: skip

CHANNELS: dict[str, type[msgspec.Struct]] = {
    TACTILE: TactileMessage, GRIPPER: GripperState, ARM: ArmMessage, CONTROL: ControlMessage,
    MOTION: Motion, COMMANDS: CommandMessage, PHASES: PhaseChange,
}  # fmt: skip

Write = Callable[[str, int, msgspec.Struct], None]


def write_tick(write: Write, tick: Tick) -> None:
    """Write all messages of one tick except phase changes."""
    t_ns = tick.t_ns
    for sent in tick.issued:
        message = CommandMessage(
            sent.decided_ns, sent.requested, sent.admitted, sent.applied, sent.refused
        )
        write(COMMANDS, sent.sent_ns, message)
    if tick.frame is not None:
        write(TACTILE, t_ns, tactile_message(tick.frame))
    write(GRIPPER, t_ns, tick.gripper)
    write(ARM, t_ns, arm_message(tick.arm))
    write(CONTROL, t_ns, control_message(tick.observation, tick.decision))
    motion = tick.observation.motion()
    if motion is not None:
        write(MOTION, t_ns, motion)


def tactile_message(frame: TactileFrame) -> TactileMessage:
    return TactileMessage(
        frame.seq, frame.sampled_ns, frame.counts.ravel().tolist(), frame.raw.ravel().tolist(),
        frame.temperature.ravel().tolist(), frame.missed, frame.stale,
    )  # fmt: skip


def recorded_frame(t_ns: int, message: TactileMessage) -> TactileFrame:
    """The frame of a recorded step. Rest counts are raw minus counts."""
    counts, raw, temperature = (
        np.array(codes, np.int16).reshape(FINGERS, -1)
        for codes in (message.counts, message.raw, message.temperature)
    )
    return TactileFrame(
        t_ns=t_ns, sampled_ns=message.sampled_ns, seq=message.seq, counts=counts, raw=raw,
        rest=raw - counts, temperature=temperature, missed=message.missed, stale=message.stale,
    )  # fmt: skip


def arm_message(arm: ArmState) -> ArmMessage:
    return ArmMessage(*msgspec.structs.astuple(arm))


def recorded_arm(message: ArmMessage) -> ArmState:
    """The arm's state of a recorded step."""
    *numbers, sampled_ns, joints_rad = msgspec.structs.astuple(message)
    joints_rad = joints_rad and _nan_for_null(joints_rad)
    return ArmState(*[*map(_nan_for_null, numbers), sampled_ns, joints_rad])


def _nan_for_null(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_nan_for_null, value))
    return math.nan if value is None else value


def control_message(obs: Observation, decision: Decision) -> ControlMessage:
    slip = decision.slip
    return ControlMessage(
        phase=decision.state.value,
        probabilities=obs.probabilities.tolist(),
        armed=slip.armed,
        masked=slip.masked,
        registered=slip.registered,
        event=slip.event,
        finger=slip.finger,
        estimated_n=obs.estimated_n,
        rest_taken=obs.rest_taken,
        pending=obs.pending,
        errors=obs.errors,
        gripper_lost=obs.gripper_lost,
        commands=list(decision.commands),
        set_down=obs.set_down,
        stop=obs.stop,
        late_ns=obs.late_ns,
        took_ns=obs.took_ns,
        faults=obs.faults,
        reported=obs.reported,
    )


def recorded_input(
    t_ns: int,
    frame: TactileFrame | None,
    control: ControlMessage,
    gripper: GripperState,
    arm: ArmState,
) -> Observation:
    """The inputs of a recorded step."""
    others = {name: getattr(control, name) for name in INPUTS}
    return Observation(t_ns=t_ns, frame=frame, gripper=gripper, arm=arm, **others)
