"""What a millisecond of reaction is worth: the lift again from where it begins, the answer given.

The full path (fingertips, detector, controller) runs up to the lift only. From there the world is
copied for every reaction that is tried: contact law, hand and arm as they are, one command to
close at the time asked for, nobody listening. So success and slip distance depend on the reaction
alone. ``CopyCheck`` compares a copy with the full path, given the same command at the same time.
"""

import copy
import math
from collections.abc import Iterator, Sequence
from typing import cast

import msgspec

from drivers.interfaces import PERIOD_NS, Gripper
from grasp.closing import CLOSED_COUNTS
from grasp.commands import CloseFast
from grasp.controller import GraspController
from grasp.guard import THUMB_ALONE
from grasp.loop import Tick
from grasp.phases import Phase
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftFacts, LiftOutcome, ScoringSettings, outcome
from scenarios.rigs.opening import open_rig
from scenarios.rigs.workers import Workers, results
from scenarios.rigs.world_of_seed import cell_settings
from scenarios.trial.execution import make_controller, make_guard, make_loop, run_trial
from scenarios.world.cell import SimulatedCell
from scenarios.world.objects import GraspObject
from scenarios.world.truth import Truth

SEARCH_S = 3.0  # gross slip that has not set in by then never does: the arm is at the top
SETTLE_S = 0.5  # at the top, before it is judged
ALL = (True, True, True)
Copy = tuple[SimulatedCell, Gripper]


class Reaction(msgspec.Struct, frozen=True):
    """What became of one answer."""

    outcome: LiftOutcome
    slip_distance_m: float | None  # None: lost
    rise_ms: float | None  # true onset of slip to the first rise of grip force

    @property
    def success(self) -> bool:
        return self.outcome in SUCCESSES


class GridPoint(msgspec.Struct, frozen=True):
    """One trial answered at one latency and closing speed."""

    latency_ms: float  # true onset of slip to the first motion of the fingers
    speed_mps: float
    reaction: Reaction


class CopyCheck(msgspec.Struct, frozen=True):
    """The full path beside its copy, and what faster detectors would have made of it."""

    full: Reaction
    reduced: Reaction
    detection_latency_ms: float
    faster: dict[str, Reaction]  # by factor of the detector's speed


class SeedStudy(msgspec.Struct, frozen=True):
    """One object on one seed; without an onset nothing slipped and there is nothing to answer."""

    object: str
    seed: int
    slipped: bool
    grid: list[GridPoint] = []
    check: CopyCheck | None = None


class Grid(msgspec.Struct, frozen=True):
    """Which reactions are tried."""

    latencies_ms: Sequence[float]
    speeds_mps: Sequence[float]
    detector_factors: Sequence[float] = (2.0, 4.0)


def study(config: LiftConfig, seed: int, grid: Grid, check: bool) -> SeedStudy:
    """Everything of one object and seed. Raises RuntimeError when the lift never begins."""
    begun = at_lift(config, seed)
    onset_ns = find_onset(begun)
    if onset_ns is None:
        return SeedStudy(config.object.name, seed, slipped=False)
    path_ns = _command_path_ns(config, seed)
    closing = THUMB_ALONE if config.guard.cap_mode == "every_finger" else ALL
    points = []
    for latency_ms in grid.latencies_ms:
        at_ns = onset_ns + round(latency_ms * 1e6) - path_ns
        for speed in grid.speeds_mps:
            command = CloseFast(config.guard.force_limit_n, closing, CLOSED_COUNTS, speed)
            points.append(GridPoint(latency_ms, speed, react(config, begun, at_ns, command)))
    checked = _check(config, seed, begun, grid.detector_factors) if check else None
    return SeedStudy(config.object.name, seed, True, points, checked)


def _command_path_ns(config: LiftConfig, seed: int) -> int:
    """Verb to motion in this trial's hand: half a refresh period on average, then its latency."""
    hand = cell_settings(config, seed)[0].hand
    return round((0.5 / hand.refresh_hz + hand.command_latency_s) * 1e9)


def at_lift(config: LiftConfig, seed: int) -> Copy:
    """World and gripper driver of a trial at the instant at which its arm begins to rise."""
    controller_settings = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    unanswered = msgspec.structs.replace(config, controller=controller_settings)
    with open_rig(unanswered.built_for(seed), seed, paced=False) as rig:
        controller = make_controller(unanswered)
        loop = make_loop(unanswered, rig, controller, make_guard(unanswered), lambda tick: None)
        while not controller.finished:
            tick = loop.tick()
            if controller.phase is Phase.LIFT and tick.arm.moving:
                begun = copy.deepcopy((cast(SimulatedCell, rig.cell), rig.devices.gripper))
                begun[0].arm.brake_unread(None)  # nobody listens in a copy
                return begun
    raise RuntimeError(f"seed {seed}: the lift never began: {controller.fault_cause}")


def find_onset(begun: Copy) -> int | None:
    """Time of gross slip if nobody answers, ns; None if there is none."""
    cell, _ = copy.deepcopy(begun)
    start_ns = cell.truth().t_ns
    for tick in range(1, round(SEARCH_S * 1e9) // PERIOD_NS):
        cell.advance(start_ns + tick * PERIOD_NS)
        onset_s = cell.truth().slip_onset_s
        if onset_s is not None:
            return round(onset_s * 1e9)
    return None


def react(config: LiftConfig, begun: Copy, at_ns: int, command: CloseFast) -> Reaction:
    """The lift with that command given at that time and judged at the top."""
    cell, gripper = copy.deepcopy(begun)
    start_ns = cell.truth().t_ns
    now_ns = max(start_ns, at_ns)
    cell.advance(now_ns)
    gripper.pump(now_ns)
    gripper.close_fast(
        command.force_cap_n, command.closing, command.limits_counts, command.speed_mps
    )
    resting = 0
    while resting < 3:  # two reads may still show the state before the command
        gripper.pump(now_ns)
        now_ns += PERIOD_NS
        cell.advance(now_ns)
        state = gripper.state
        resting = resting + 1 if state is not None and state.at_rest and not _busy(cell) else 0
    cell.advance(max(now_ns, start_ns + round(_lift_s(config) * 1e9)))
    return _judged(cell.truth(), config.object, config.scoring)


def _busy(cell: SimulatedCell) -> bool:
    return cell.gripper.moving


def _lift_s(config: LiftConfig) -> float:
    c = config.controller
    ramp_s = c.lift_speed_mps / c.lift_acceleration_mps2
    return c.lift_height_m / c.lift_speed_mps + ramp_s + SETTLE_S


def _judged(end: Truth, body: GraspObject, scoring: ScoringSettings) -> Reaction:
    """By the lift's own rules, the answer taken as given: no detector, no limit of force."""
    facts = LiftFacts(
        end=end, felt_n=0.0, had_compensated=True, registered_s=end.slip_onset_s or 0.0,
        onset_s=end.slip_onset_s or 0.0, twin_onset_s=None, peak_force_n=None,
        force_bound_n=math.inf, cap_reached=False, alarm_stayed=False, fault="",
    )  # fmt: skip
    verdict = outcome(facts, body, scoring)
    rise_ms = None
    if end.force_rise_s is not None and end.slip_onset_s is not None:
        rise_ms = (end.force_rise_s - end.slip_onset_s) * 1e3
    held = verdict in SUCCESSES
    return Reaction(verdict, end.slip_distance_m if held else None, rise_ms)


def answered(config: LiftConfig, seed: int) -> tuple[int, CloseFast, int] | None:
    """When the full path gave its command to close, the command, and when slip was registered."""
    answer = _answer(config, seed)
    return None if answer is None else answer[:3]


def _answer(config: LiftConfig, seed: int) -> tuple[int, CloseFast, int, Truth] | None:
    """In one closing; None where the full path never answered, or nothing had slipped."""
    controller_settings = msgspec.structs.replace(config.controller, closing="constant")
    config = msgspec.structs.replace(config, controller=controller_settings)
    sent: list[tuple[int, CloseFast]] = []
    on = msgspec.structs.replace(config.controller, answer="jump")  # the hand alone answers
    config = msgspec.structs.replace(config, controller=on)

    def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        for issued in tick.issued:
            if isinstance(issued.admitted, CloseFast):
                sent.append((issued.sent_ns, issued.admitted))

    with open_rig(config.built_for(seed), seed, paced=False) as rig:
        trial = run_trial(config, rig, make_guard(config), watch)
    end, registered_ns = trial.trace.end, trial.trace.registered_ns
    if end is None or registered_ns is None or end.slip_onset_s is None or not sent:
        return None
    return *sent[0], registered_ns, end


def _check(
    config: LiftConfig, seed: int, begun: Copy, factors: Sequence[float]
) -> CopyCheck | None:
    answer = _answer(config, seed)
    if answer is None or answer[3].slip_onset_s is None:
        return None
    sent_ns, command, registered_ns, end = answer
    late_ns = registered_ns - round(answer[3].slip_onset_s * 1e9)
    return CopyCheck(
        full=_judged(end, config.object, config.scoring),
        reduced=react(config, begun, sent_ns, command),
        detection_latency_ms=late_ns * 1e-6,
        faster={
            f"{factor:g}": react(config, begun, sent_ns - _saved_ns(late_ns, factor), command)
            for factor in factors
        },
    )


def _saved_ns(late_ns: int, factor: float) -> int:
    return round(max(0, late_ns) * (1 - 1 / factor))


class _Task(msgspec.Struct, frozen=True):
    """One study to be made."""

    config: LiftConfig
    seed: int
    grid: Grid
    check: bool


def _study(task: _Task) -> SeedStudy:
    return study(task.config, task.seed, task.grid, task.check)


def studies(
    configs: Sequence[LiftConfig], seeds: Sequence[int], checked: int, grid: Grid, workers: Workers
) -> Iterator[SeedStudy]:
    """All of them as they finish; the first ``checked`` seeds are checked."""
    tasks = [
        _Task(config, seed, grid, i < checked) for i, seed in enumerate(seeds) for config in configs
    ]
    yield from results(_study, tasks, workers)
