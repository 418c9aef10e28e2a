"""Policies that grasp badly, with the reflex and without it.

Each policy lifts an object in `grasp/Lift-v0`. Without the reflex only the force guard acts.

- frozen: closes to the weak grip of ``object.grip_counts``, lifts after 2 s, and never reacts;
- early: as frozen, but lifts after 1 s, before the grip is complete;
- opens: as frozen, and opens all fingers after 4 s;
- random: as frozen; from the lift on all actions are random, those of the arm upwards;
- noise: all actions are random and last 0.3 s; the fingers close more often than they open.
"""

import argparse
import time
from collections.abc import Sequence
from typing import Any, cast

import msgspec
import numpy as np

from grasp.cli.options import whole
from grasp.cli.parser import Parser
from grasp.policy_reflex import Admitted, Reflex
from studies.runner import Study, add_trials, markdown, seeds_of

STEPS = {"frozen": 600, "early": 600, "opens": 600, "random": 1200, "noise": 300}  # of an episode
LIFT, EARLY, OPEN, NOISE_LASTS = 200, 100, 400, 30  # steps
SLID_OUT = "slid out"
SPAN_COUNTS = 5  # of the environment's action


class Task(msgspec.Struct, frozen=True):
    """One episode."""

    policy: str
    reflex: bool
    object: str
    seed: int


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one episode. ``above``: commands above the force limit. ``step_us``: processor time
    of a step of the reflex, median and 99th percentile."""

    policy: str
    reflex: bool
    object: str
    seed: int
    outcome: str  # held, dropped (from the air), slid out (on the table), or on the table
    above: int
    commanded_n: float
    peak_n: float
    step_us: tuple[float, float]


class Timed:
    """The reflex, with the processor time of each step in µs."""

    def __init__(self, reflex: Reflex) -> None:
        self._reflex = reflex
        self.spent_us: list[float] = []

    def step(self, *states: Any, t_ns: int) -> Admitted:
        start_ns = time.thread_time_ns()
        admitted = self._reflex.step(*states, t_ns=t_ns)
        self.spent_us.append((time.thread_time_ns() - start_ns) * 1e-3)
        return admitted


def action(task: Task, obs: dict[str, Any], step: int, grip: tuple[int, ...]) -> list[float]:
    """The policy's action in that step."""
    name, lifts = task.policy, step >= (EARLY if task.policy == "early" else LIFT)
    if name == "noise":
        return _uniform((-0.5, -0.5, -0.5, -1.0), task.seed, step // NOISE_LASTS)
    if name == "random" and lifts:
        return _uniform((-1.0, -1.0, -1.0, 0.0), task.seed, step)
    if name == "opens" and step >= OPEN:
        return [-1.0, -1.0, -1.0, 1.0]
    fingers = np.clip((np.array(grip) - obs["fingers"]) / SPAN_COUNTS, -1.0, 1.0)
    return [*fingers.tolist(), float(lifts)]


def _uniform(least: tuple[float, ...], *seed: int) -> list[float]:
    drawn: list[float] = np.random.default_rng(seed).uniform(least, 1.0).tolist()
    return drawn


def trial(task: Task) -> Row:
    from scenarios.campaign.config import load_config
    from scenarios.library.lift_environment import LiftEnvironment

    env = LiftEnvironment(task.object, reflex=task.reflex)
    config = load_config(task.object, "simulated")
    grip = config.object.grip_counts
    obs, info = env.reset(seed=task.seed)
    timed = Timed(env.reflex)
    env.reflex = cast(Reflex, timed)
    above, commanded_n = 0, 0.0
    for step in range(STEPS[task.policy]):
        obs, _, dropped, _, info = env.step(np.array(action(task, obs, step, grip), np.float32))
        above += info["commanded_force_n"] > config.guard.force_limit_n
        commanded_n = max(commanded_n, info["commanded_force_n"])
        if dropped:
            break
    slid = not info["touched"] and task.policy != "noise"  # noise may never have gripped it
    outcome = "dropped" if info["dropped"] else "held" if info["held"] else "on the table"
    outcome = SLID_OUT if slid and not info["dropped"] else outcome
    spent, n = sorted(timed.spent_us), len(timed.spent_us)
    return Row(
        policy=task.policy, reflex=task.reflex, object=task.object, seed=task.seed,
        outcome=outcome, above=above, commanded_n=commanded_n,
        peak_n=info["peak_force_n"], step_us=(spent[n // 2], spent[n * 99 // 100]),
    )  # fmt: skip


def options(parser: Parser) -> None:
    add_trials(parser, 10)
    parser.add_argument("--noise-seeds", type=whole(0, 100_000), default=10, metavar="N",
                        help="of `noise` with the reflex, each object (default: 10)")  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    first, few = args.first_seed, seeds_of(args)
    many = range(first, first + args.noise_seeds)
    return [
        Task(policy, reflex, name, seed)
        for policy in STEPS for reflex in (False, True) for name in args.objects
        for seed in (many if reflex and policy == "noise" else few)
    ]  # fmt: skip


def groups(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """The episodes of each policy without the reflex and with it."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(f"{row.policy}, {'with' if row.reflex else 'without'}", []).append(row)
    return found


def table(rows: Sequence[Row]) -> str:
    """Outcomes, forces and cost of each policy, without the reflex and with it."""
    lines = [
        (name, len(own), *(sum(r.outcome == o for r in own) for o in ("held", "dropped", SLID_OUT)),
         sum(r.above for r in own), max(r.commanded_n for r in own), max(r.peak_n for r in own),
         float(np.median([r.step_us[0] for r in own])),
         float(np.median([r.step_us[1] for r in own])))
        for name, own in groups(rows).items()
    ]  # fmt: skip
    names = ("policy, reflex", "episodes", "held", "dropped", SLID_OUT, "commands above the limit",
             "commanded, N", "true, N", "step, µs", "p99, µs")  # fmt: skip
    return markdown(dict(zip(names, zip(*lines, strict=True), strict=True)))


STUDY = Study("drops and forces of careless policies, with the reflex and without it",
              grid, trial, Row, table, None, options, counted="episodes")  # fmt: skip
