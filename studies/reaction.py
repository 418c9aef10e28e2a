"""Success and slip distance over reaction latency and closing speed.

The full path (fingertips, detector, controller) runs only up to the start of the lift. There the
study copies the world for each reaction: contact law, hand and arm, and one command to close at the
set time. So success and slip depend on the reaction alone. Some seeds also run in full: a copy with
the same command at the same time must give the same result.
"""

import argparse
import copy
import itertools
import math
from collections.abc import Sequence
from typing import Any, cast

import msgspec

from detector.scores.quantiles import Quantiles, quantiles
from drivers.interfaces import PERIOD_NS
from grasp.cli.options import decimal, whole
from grasp.cli.parser import Parser
from grasp.commands import CloseFast
from grasp.controller import GraspController
from grasp.guard import THUMB_ALONE
from grasp.loop import Tick
from grasp.slip_response.close import CLOSED_COUNTS
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftFacts, outcome
from scenarios.rigs.opening import open_rig
from scenarios.rigs.simulated import cell_settings
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.trial.execution import make_guard, run_trial
from scenarios.world.truth import Truth
from studies.lift_start import LiftStart, at_lift
from studies.runner import Study, add_trials, markdown, seeds_of

LATENCIES_MS = (0.0, 25.0, 50.0, 75.0, 100.0, 134.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)
SPEEDS_MPS = (0.022, 0.044, 0.066, 0.11)
FASTER = (2.0, 4.0)  # times as fast as the detector
SEARCH_S = 3.0  # no gross slip starts after this time: the arm is at the top
SETTLE_S = 0.5  # at the top, before the verdict
ALL_FINGERS = (True, True, True)
CLIFF = 0.3  # the table lists a drop of success of at least this between neighbouring latencies
HUMAN_MS, HUMAN_SPREAD_MS = 74.0, 9.0  # reflex to slip: Johansson and Westling 1984
PAPER_MS = 134.0  # paper, section IV-D: slip to decision, without the hand
SLIP_TOP_MM = 60.0


class Task(msgspec.Struct, frozen=True):
    """An object and a seed."""

    config: LiftConfig
    seed: int
    latencies_ms: tuple[float, ...]  # true onset of slip to the first motion of the fingers
    speeds_mps: tuple[float, ...]
    check: bool  # True: run in full too


class Reaction(msgspec.Struct, frozen=True):
    """Result of one reaction. Slip None: object lost. Rise None: the grip force never rose."""

    slip_mm: float | None
    rise_ms: float | None  # true onset of slip to the first rise of grip force

    @property
    def held(self) -> bool:
        return self.slip_mm is not None


class Check(msgspec.Struct, frozen=True):
    """The full run, its copy, and the copy with the commands of the detectors of FASTER."""

    full: Reaction
    reduced: Reaction
    faster: list[Reaction]


class Row(msgspec.Struct, frozen=True):
    """All reactions of one task. Without slip there is no grid."""

    object: str
    seed: int
    slipped: bool
    grid: list[tuple[float, float, Reaction]] = []  # latency, ms; closing speed, m/s
    check: Check | None = None


def options(parser: Parser) -> None:
    add_trials(parser, seeds=20)
    add = parser.add_argument
    add("--profile", default=DEFAULT_PROFILE, metavar="NAME")
    add("--latencies", nargs="+", type=decimal(0, 10_000), default=LATENCIES_MS, metavar="MS")
    add("--speeds", nargs="+", type=decimal(0.001, 1), default=SPEEDS_MPS, metavar="M/S")
    add("--check", type=whole(0, 100_000), default=10, metavar="N",
        help="number of seeds that also run in full (default: %(default)s)")  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    tasks = []
    for name in args.objects:
        rest = args.detector, args.config, args.set, args.profile
        config = load_config(name, "simulated", *rest).for_lift()
        grid_values = tuple(sorted(args.latencies)), tuple(args.speeds)
        tasks += [
            Task(config, seed, *grid_values, i < args.check)
            for i, seed in enumerate(seeds_of(args))
        ]
    return tasks


def trial(task: Task) -> Row:
    config, seed = task.config, task.seed
    start = at_lift(config, seed)
    onset_ns = find_onset(start)
    if onset_ns is None:
        return Row(config.object.name, seed, slipped=False)
    hand = cell_settings(config, seed)[0].hand
    path_ns = round((0.5 / hand.refresh_hz + hand.command_latency_s) * 1e9)  # command to motion
    fingers = THUMB_ALONE if config.guard.cap_mode == "every_finger" else ALL_FINGERS
    points = []
    for latency_ms, speed in itertools.product(task.latencies_ms, task.speeds_mps):
        at_ns = onset_ns + round(latency_ms * 1e6) - path_ns
        command = CloseFast(config.guard.force_limit_n, fingers, CLOSED_COUNTS, speed)
        points.append((latency_ms, speed, react(config, start, at_ns, command)))
    check = _check(config, seed, start) if task.check else None
    return Row(config.object.name, seed, True, points, check)


def find_onset(start: LiftStart) -> int | None:
    """Time of gross slip without any reaction, ns; None if there is none."""
    cell, _ = copy.deepcopy(start)
    start_ns = cell.truth().t_ns
    for tick in range(1, round(SEARCH_S * 1e9) // PERIOD_NS):
        cell.advance(start_ns + tick * PERIOD_NS)
        if (onset_s := cell.truth().slip_onset_s) is not None:
            return round(onset_s * 1e9)
    return None


def react(config: LiftConfig, start: LiftStart, at_ns: int, command: CloseFast) -> Reaction:
    """Simulate the lift with one command at one time. The rules of a lift score it at the top,
    without their conditions on detector and force."""
    cell, gripper = copy.deepcopy(start)
    start_ns = cell.truth().t_ns
    now_ns = max(start_ns, at_ns)
    cell.advance(now_ns)
    gripper.poll(now_ns)
    gripper.close_fast(
        command.force_cap_n, command.closing, command.limits_counts, command.speed_mps
    )
    resting = 0
    while resting < 3:  # two reads may still show the state before the command
        gripper.poll(now_ns)
        now_ns += PERIOD_NS
        cell.advance(now_ns)
        state = gripper.state
        at_rest = state is not None and state.at_rest and not cell.gripper.moving
        resting = resting + 1 if at_rest else 0
    c = config.controller
    ramp_s = c.lift_speed_mps / c.lift_acceleration_mps2
    lift_s = c.lift_height_m / c.lift_speed_mps + ramp_s + SETTLE_S
    cell.advance(max(now_ns, start_ns + round(lift_s * 1e9)))
    return _scored(cell.truth(), config)


def _scored(end: Truth, config: LiftConfig) -> Reaction:
    onset_s = end.slip_onset_s
    facts = LiftFacts(
        end=end, estimated_n=0.0, had_compensated=True, registered_s=onset_s or 0.0,
        onset_s=onset_s or 0.0, open_loop_onset_s=None, peak_force_n=None,
        force_bound_n=math.inf, cap_reached=False, alarm_stayed=False, fault="",
    )  # fmt: skip
    verdict = outcome(facts, config.object)
    slip_mm = end.slip_distance_m * 1e3 if verdict in SUCCESSES else None
    if end.force_rise_s is None or onset_s is None:
        return Reaction(slip_mm, None)
    return Reaction(slip_mm, (end.force_rise_s - onset_s) * 1e3)


def _check(config: LiftConfig, seed: int, start: LiftStart) -> Check | None:
    """Compare the full run, which closes once, with its copy; None without slip or closing."""
    controller_settings = msgspec.structs.replace(
        config.controller, closing="constant", slip_response="close"
    )
    config = msgspec.structs.replace(config, controller=controller_settings)
    sent: list[tuple[int, CloseFast]] = []

    def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        found = ((issued.sent_ns, issued.admitted) for issued in tick.issued)
        sent.extend((ns, command) for ns, command in found if isinstance(command, CloseFast))

    with open_rig(config.built_for(seed), seed, paced=False) as rig:
        trace = run_trial(config, rig, make_guard(config), watch).trace
    end, registered_ns = trace.end, trace.registered_ns
    if end is None or registered_ns is None or end.slip_onset_s is None or not sent:
        return None
    sent_ns, command = sent[0]
    late_ns = registered_ns - round(end.slip_onset_s * 1e9)
    earlier = [sent_ns - round(max(0, late_ns) * (1 - 1 / factor)) for factor in FASTER]
    return Check(
        _scored(end, config), react(config, start, sent_ns, command),
        [react(config, start, at_ns, command) for at_ns in earlier],
    )  # fmt: skip


def _cells(rows: Sequence[Row]) -> dict[tuple[str, float], dict[float, list[Reaction]]]:
    """Reactions by object and speed, then by latency."""
    cells: dict[tuple[str, float], dict[float, list[Reaction]]] = {}
    for row in rows:
        for latency_ms, speed, reaction in row.grid:
            by_latency = cells.setdefault((row.object, speed), {})
            by_latency.setdefault(latency_ms, []).append(reaction)
    return cells


def _rate(reactions: Sequence[Reaction]) -> float:
    return sum(r.held for r in reactions) / len(reactions)


def _slips(reactions: Sequence[Reaction]) -> Quantiles:
    """A lost object counts as infinity."""
    return cast(Quantiles, quantiles(r.slip_mm for r in reactions))  # there is always one


def cliff(by_latency: dict[float, list[Reaction]]) -> str | None:
    """The steepest drop of success between neighbouring latencies, if at least CLIFF."""
    pairs = itertools.pairwise((latency, _rate(r)) for latency, r in sorted(by_latency.items()))
    (a, before), (b, after) = max(pairs, key=lambda p: p[0][1] - p[1][1], default=((0, 0),) * 2)
    if before - after < CLIFF:
        return None
    return f"{before:.0%} at {a:g} ms, {after:.0%} at {b:g} ms"


def _faster(rows: Sequence[Row]) -> list[tuple[str, float, list[Reaction]]]:
    """Object, factor of the detector's speed, reactions of the checked lifts."""
    found = []
    for name in dict.fromkeys(row.object for row in rows):
        checks = [row.check for row in rows if row.object == name and row.check is not None]
        if checks:
            found.append((name, 1.0, [c.reduced for c in checks]))
            found += [(name, f, [c.faster[i] for c in checks]) for i, f in enumerate(FASTER)]
    return found


def table(rows: Sequence[Row]) -> str:
    parts, cells = [], _cells(rows)
    if cells:
        columns: dict[str, list[object]] = {
            "object": [name for name, _ in cells],
            "closing speed, mm/s": [f"{speed * 1e3:.0f}" for _, speed in cells],
        }
        for ms in next(iter(cells.values())):
            columns[f"held at {ms:g} ms, %"] = [100 * _rate(cell[ms]) for cell in cells.values()]
        columns["cliff"] = [cliff(cell) for cell in cells.values()]
        parts.append(markdown(columns))
    faster = _faster(rows)
    if faster:
        slips = [_slips(reactions) for *_, reactions in faster]
        parts.append(markdown({
            "object": [name for name, *_ in faster],
            "detector's speed, times": [factor for _, factor, _ in faster],
            "held of n": [f"{_rate(r):.0%} of {len(r)}" for *_, r in faster],
            "slip p50, mm": [q.p50 for q in slips],
            "p90": [q.p90 for q in slips],
            "p99": [q.p99 for q in slips],
        }))  # fmt: skip
    checks = [row.check for row in rows if row.check is not None]
    same = sum(c.full.held == c.reduced.held for c in checks)
    pairs = [(c.full.slip_mm, c.reduced.slip_mm) for c in checks]
    most = max((abs(a - b) for a, b in pairs if a is not None and b is not None), default=0.0)
    parts.append(f"{len(rows)} lifts, {sum(not row.slipped for row in rows)} of them without slip. "
                 f"{same} of {len(checks)} copies have the full run's verdict; their slip differs "
                 f"by {most:.3f} mm at most.")  # fmt: skip
    return "\n\n".join(parts)


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Success and slip over latency, one column per closing speed."""
    cells = _cells(rows)
    names = list(dict.fromkeys(name for name, _ in cells))
    speeds = sorted({speed for _, speed in cells})
    axes = figure.subplots(2, max(1, len(speeds)), sharex=True, sharey="row", squeeze=False)
    for (name, speed), by_latency in cells.items():
        success, slip = axes[:, speeds.index(speed)]
        success.set(title=f"fingers close at {speed * 1e3:.0f} mm/s", ylim=(-0.03, 1.05))
        slip.set(xlabel="slip onset to the fingers' first motion, ms", ylim=(0, SLIP_TOP_MM))
        colour, t = f"C{names.index(name)}", list(by_latency)
        success.plot(t, [_rate(r) for r in by_latency.values()], color=colour, marker=".")
        slips = [_slips(r) for r in by_latency.values()]
        low, middle, high = ([min(getattr(q, p), 2 * SLIP_TOP_MM) for q in slips]
                             for p in ("p10", "p50", "p90"))  # fmt: skip
        slip.fill_between(t, low, high, color=colour, alpha=0.12, lw=0)
        slip.plot(t, middle, color=colour, marker=".", label=name)
    for panel in axes.flat:
        panel.axvspan(HUMAN_MS - HUMAN_SPREAD_MS, HUMAN_MS + HUMAN_SPREAD_MS, color="#00000018")
        panel.axvline(PAPER_MS, color="#b00020", lw=0.9, ls="--")
    axes[0, 0].set_ylabel("held (band: human reflex;\ndashed: paper, to the decision)")
    axes[1, 0].set_ylabel("slip, mm: median, 10-90 %;\nlost = above the top")
    axes[1, -1].legend(fontsize=7, loc="upper left")


STUDY = Study("success and slip distance over reaction latency and closing speed", grid, trial,
              Row, table, chart, options, (14.0, 6.5))  # fmt: skip
