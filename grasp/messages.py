"""What a run records, one message type a topic, and the way back for a replay.

Everything that a control step consumed is here, so that a replay needs nothing else; nothing that
depends on the wall clock is, so that equal runs are equal byte for byte.
"""

from collections.abc import Callable

import msgspec
import numpy as np

from drivers.interfaces import FINGERS, TAXELS, Applied, ArmState, GripperState, Vector3
from grasp.commands import Command
from grasp.controller import Observation
from grasp.loop import Issued, Tick
from grasp.phases import PhaseChange

SHAPE = (FINGERS, TAXELS)


class TactileMessage(msgspec.Struct, frozen=True):
    """One frame; counts and raw are row-major (finger, taxel), 18 numbers each."""

    seq: int
    sampled_ns: int
    counts: list[int]
    raw: list[int]
    temperature: list[int]
    missed: int
    stale: bool


class ControlMessage(msgspec.Struct, frozen=True):
    """One control step: what it was told beside the device states, and what it concluded."""

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
    trouble: str
    gripper_lost: bool
    commands: list[Command]
    set_down: bool = False


class CommandMessage(msgspec.Struct, frozen=True):
    """One command: asked by the controller, admitted by the guard, applied by the device."""

    decided_ns: int
    asked: Command
    admitted: Command
    applied: Applied | None
    refused: str


TACTILE, GRIPPER, ARM, CONTROL, COMMANDS, PHASES, TRUTH = (
    "/tactile", "/gripper", "/arm", "/control", "/commands", "/phases", "/truth",
)  # fmt: skip

CHANNELS: dict[str, type[msgspec.Struct]] = {
    TACTILE: TactileMessage,
    GRIPPER: GripperState,
    ARM: ArmState,
    CONTROL: ControlMessage,
    COMMANDS: CommandMessage,
    PHASES: PhaseChange,
}

Write = Callable[[str, int, msgspec.Struct], None]


def write_tick(write: Write, tick: Tick) -> None:
    """All messages of one tick but the phase changes."""
    t_ns, frame = tick.t_ns, tick.frame
    for issued in tick.issued:
        write(COMMANDS, issued.sent_ns, command_message(issued))
    if frame is not None:
        write(
            TACTILE,
            t_ns,
            TactileMessage(
                frame.seq, frame.sampled_ns, frame.counts.ravel().tolist(),
                frame.raw.ravel().tolist(), frame.temperature.ravel().tolist(),
                frame.missed, frame.stale,
            ),
        )  # fmt: skip
    write(GRIPPER, t_ns, tick.gripper)
    write(ARM, t_ns, tick.arm)
    write(CONTROL, t_ns, control_message(tick))


def control_message(tick: Tick) -> ControlMessage:
    seen, slip = tick.observation, tick.decision.slip
    return ControlMessage(
        tick.decision.phase.value, seen.probabilities.tolist(), slip.armed, slip.masked,
        slip.registered, slip.event, slip.finger, tick.measured_n, seen.rest_taken, seen.pending,
        seen.trouble, seen.gripper_lost, list(tick.decision.commands), seen.set_down,
    )  # fmt: skip


def command_message(issued: Issued) -> CommandMessage:
    return CommandMessage(
        issued.decided_ns, issued.asked, issued.admitted, issued.applied, issued.refused
    )


def observation(
    t_ns: int,
    tactile: TactileMessage | None,
    control: ControlMessage,
    gripper: GripperState,
    arm: ArmState,
    probabilities: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> Observation:
    """The observation of a recorded step, with probabilities computed anew."""
    return Observation(
        t_ns=t_ns,
        probabilities=probabilities,
        tactile_stale=tactile is not None and tactile.stale,
        rest_taken=control.rest_taken,
        gripper=gripper,
        arm=arm,
        pending=control.pending,
        trouble=control.trouble,
        gripper_lost=control.gripper_lost,
        set_down=control.set_down,
    )
