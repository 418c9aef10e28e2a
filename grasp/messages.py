"""What a run records, one message type a topic, and the way back for a replay.

Everything that a control step consumed is here, so that a replay needs nothing else; nothing that
depends on the wall clock is, so that equal runs are equal byte for byte.
"""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from detector.auxiliary_outputs import Motion
from drivers.interfaces import FINGERS, Applied, ArmState, GripperState, TactileFrame, Vector3
from grasp.commands import Command
from grasp.controller import Decision
from grasp.fault import Fault
from grasp.loop import Issued, Tick
from grasp.observation import Observation, StepInput
from grasp.states import PhaseChange


class TactileMessage(msgspec.Struct, frozen=True):
    """One frame; counts and raw are row-major (finger, taxel), 18 numbers each."""

    seq: int
    sampled_ns: int
    counts: list[int]
    raw: list[int]
    temperature: list[int]
    missed: int
    stale: bool


Number = float | None  # null: not a number, which JSON cannot say


class ArmMessage(msgspec.Struct, frozen=True):
    """``ArmState``, with nulls where the arm said what is no number."""

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


class ControlMessage(msgspec.Struct, frozen=True):
    """One control step: its inputs beside the device states, and what it concluded."""

    phase: str
    probabilities: list[float]
    armed: bool
    masked: bool
    registered: bool
    event: bool
    finger: int
    measured_n: Vector3
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


# fields that it shares with the inputs of a step
INPUTS = [name for name in ControlMessage.__struct_fields__ if hasattr(StepInput, name)]


class CommandMessage(msgspec.Struct, frozen=True):
    """One command: asked by the controller, admitted by the guard, applied by the device."""

    decided_ns: int
    asked: Command
    admitted: Command
    applied: Applied | None
    refused: str


TACTILE, GRIPPER, ARM, CONTROL, MOTION, COMMANDS, PHASES, TRUTH = (
    "/tactile", "/gripper", "/arm", "/control", "/motion", "/commands", "/phases", "/truth",
)  # fmt: skip

CHANNELS: dict[str, type[msgspec.Struct]] = {
    TACTILE: TactileMessage,
    GRIPPER: GripperState,
    ARM: ArmMessage,
    CONTROL: ControlMessage,
    MOTION: Motion,
    COMMANDS: CommandMessage,
    PHASES: PhaseChange,
}

Write = Callable[[str, int, msgspec.Struct], None]


def write_tick(write: Write, tick: Tick) -> None:
    """All messages of one tick but the phase changes."""
    t_ns = tick.t_ns
    for issued in tick.issued:
        write(COMMANDS, issued.sent_ns, command_message(issued))
    if tick.frame is not None:
        write(TACTILE, t_ns, tactile_message(tick.frame))
    write(GRIPPER, t_ns, tick.gripper)
    write(ARM, t_ns, arm_message(tick.arm))
    write(CONTROL, t_ns, control_message(tick.observation, tick.decision))
    if tick.observation.motion is not None:
        write(MOTION, t_ns, tick.observation.motion)


def tactile_message(frame: TactileFrame) -> TactileMessage:
    return TactileMessage(
        seq=frame.seq,
        sampled_ns=frame.sampled_ns,
        counts=frame.counts.ravel().tolist(),
        raw=frame.raw.ravel().tolist(),
        temperature=frame.temperature.ravel().tolist(),
        missed=frame.missed,
        stale=frame.stale,
    )


def arm_message(arm: ArmState) -> ArmMessage:
    return ArmMessage(*msgspec.structs.astuple(arm))


def control_message(obs: Observation, decision: Decision) -> ControlMessage:
    return ControlMessage(
        phase=decision.state.value,
        probabilities=obs.probabilities.tolist(),
        **msgspec.structs.asdict(decision.slip),
        **{name: getattr(obs.inputs, name) for name in INPUTS},
        measured_n=obs.measured_n,
        commands=list(decision.commands),
        faults=obs.faults,
        reported=obs.reported,
    )


def command_message(issued: Issued) -> CommandMessage:
    return CommandMessage(
        issued.decided_ns, issued.asked, issued.admitted, issued.applied, issued.refused
    )


def recorded_frame(t_ns: int, message: TactileMessage) -> TactileFrame:
    """The frame of a recorded step; rest counts follow from raw and counts."""
    counts, raw, temperature = (
        np.array(values, np.int16).reshape(FINGERS, -1)
        for values in (message.counts, message.raw, message.temperature)
    )
    return TactileFrame(
        t_ns=t_ns,
        sampled_ns=message.sampled_ns,
        seq=message.seq,
        counts=counts,
        raw=raw,
        rest=raw - counts,
        temperature=temperature,
        missed=message.missed,
        stale=message.stale,
    )


def recorded_arm(message: ArmMessage) -> ArmState:
    """The arm's state of a recorded step."""
    x, y, z = map(_number, message.position_m)
    u, v, w = map(_number, message.velocity_mps)
    return ArmState(
        message.t_ns, message.seq, (x, y, z), (u, v, w), message.moving, message.stopped_by_safety,
        _number(message.angle_rad), _number(message.spin_radps), _number(message.speed_fraction),
        message.sampled_ns,
    )  # fmt: skip


def _number(value: Number) -> float:
    return math.nan if value is None else value


def recorded_input(
    t_ns: int,
    frame: TactileFrame | None,
    control: ControlMessage,
    gripper: GripperState,
    arm: ArmState,
) -> StepInput:
    """The inputs of a recorded step."""
    others = {name: getattr(control, name) for name in INPUTS}
    return StepInput(t_ns=t_ns, frame=frame, gripper=gripper, arm=arm, **others)
