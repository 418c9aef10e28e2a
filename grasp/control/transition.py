"""Transition: what the handler of a state decides. Decision: the result of a controller's step."""

from typing import Protocol

import msgspec

from grasp.control.commands import Command, StopArm
from grasp.control.fault import LOST, TRIAL, Fault, lines
from grasp.control.observation import Observation
from grasp.control.slip_monitor import SlipStatus
from grasp.control.state_timer import StateTimer
from grasp.control.states import State, Trigger


class Transition(msgspec.Struct, frozen=True):
    """A change of state with its cause, and the commands whose effect the next state waits for.

    ``trigger``: None if the state stays and only commands are due. ``faults``: why a safe state is
    entered.
    """

    trigger: Trigger | None
    cause: str
    commands: tuple[Command, ...] = ()
    faults: tuple[Fault, ...] = ()


class Decision(msgspec.Struct, frozen=True):
    """Result of one step of a controller."""

    state: State
    slip: SlipStatus
    commands: tuple[Command, ...]
    reset_detector: bool = False
    first_grasp: bool = False  # complete in this step: the guard measures safe travel from it
    finished: bool = False


class Controller(Protocol):
    """Decides what hand and arm do; called once a tactile sample."""

    @property
    def state(self) -> State: ...

    @property
    def in_safe_state(self) -> bool: ...

    def step(self, obs: Observation) -> Decision: ...


def stay(*commands: Command) -> Transition | None:
    """Send commands and stay in this state; None without any."""
    return Transition(None, "", commands) if commands else None


def lose(cause: str) -> Transition:
    """The object is lost: stop the arm and lower nothing."""
    return Transition(Trigger.LOSE, cause, faults=(Fault(LOST, TRIAL, cause, kind=LOST),))


def fail(cause: str, remedy: str = "") -> Transition:
    """End the run because the grasp failed, although no device did."""
    return end(Trigger.FAIL, (Fault("grasp_failed", TRIAL, cause, remedy),))


def end(trigger: Trigger, faults: tuple[Fault, ...]) -> Transition:
    """End the run early because of faults."""
    return Transition(trigger, lines(faults), faults=faults)


def repeated_stop(obs: Observation, timer: StateTimer, stop: StopArm | None) -> tuple[Command, ...]:
    """The arm stop with which this state began, again while the arm still moves: the command may
    have been lost."""
    if stop and obs.arm.moving and not obs.pending and timer.repeat_due(obs.t_ns):
        return (stop,)
    return ()
