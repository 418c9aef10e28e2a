"""Writes a trial's control steps to a pipe as JSON lines, for the process that started this one.

A write never waits: a line that the pipe cannot take whole is lost. When nobody reads the pipe any
more, the process that requested the trial has ended, and the trial is stopped as by a signal.
"""

import os
import signal

import msgspec

from drivers.interfaces import GripperState
from grasp.control.controller import GraspController
from grasp.run.clock import Clock
from grasp.run.loop import Tick
from grasp.run.messages import (
    ArmMessage,
    ControlMessage,
    TactileMessage,
    arm_message,
    control_message,
    tactile_message,
)
from scenarios.world.truth import Truth

LINE_BYTES = 4096  # up to here a pipe takes a line whole or not at all


class Begin(msgspec.Struct, frozen=True, tag=True):
    """First line of a trial: Unix time at which its clock was 0."""

    unix_ns: int


class Step(msgspec.Struct, frozen=True, tag=True):
    """One control step: messages of the recording, without commands."""

    t_ns: int
    tactile: TactileMessage | None
    gripper: GripperState
    arm: ArmMessage
    control: ControlMessage


class StepFeed:
    """Feeds a pipe with the steps of trials; ``descriptor`` is its writing end."""

    def __init__(self, descriptor: int) -> None:
        os.set_inheritable(descriptor, False)
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._begin: Begin | None = None  # not sent yet
        self._read = True

    def begin(self, clock: Clock) -> None:
        """Begin a trial on an open rig with this clock."""
        self._begin = Begin(clock.unix_ns)

    def watch(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Send one step."""
        if self._begin is not None and self._send(self._begin):
            self._begin = None
        tactile = None if tick.frame is None else tactile_message(tick.frame)
        control = control_message(tick.observation, tick.decision)
        control = msgspec.structs.replace(control, commands=[])
        self._send(Step(tick.t_ns, tactile, tick.gripper, arm_message(tick.arm), control))

    def _send(self, message: msgspec.Struct) -> bool:
        """Send a line; returns whether it was sent."""
        line = msgspec.json.encode(message) + b"\n"
        if not self._read or len(line) > LINE_BYTES:
            return False
        try:
            os.write(self._descriptor, line)
        except BlockingIOError:
            return False
        except OSError:
            self._read = False
            signal.raise_signal(signal.SIGTERM)
            return False
        return True
