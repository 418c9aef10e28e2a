"""Policies that grasp badly, with the reflex and without it.

Each policy lifts in `grasp/Lift-v0`: it closes to the weak grip of ``object.grip_counts``, then
lifts. Without the reflex only the force guard acts. Policies:

- frozen: rests for 0.7 s, lifts at full speed and never reacts;
- early: as frozen, but lifts as soon as the thumb is in contact;
- opens: as frozen, and opens all fingers one second after the lift began;
- random: as frozen; from the lift on, all actions are random, the arm's upwards;
- noise: every action is random from the start and lasts 0.3 s; the fingers close more often than
  they open.
"""

import argparse
import time
from collections.abc import Sequence
from typing import Any, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from grasp.cli.options import whole
from grasp.cli.parser import Parser
from grasp.policy_reflex import Admitted, Reflex
from studies.runner import Study, add_trials, markdown, seeds_of

STEPS, NOISE_STEPS = 600, 300  # of an episode
REST_STEPS, OPENS_AFTER, NOISE_LASTS = 70, 100, 30
CONTACT_N, SPAN_COUNTS = 0.3, 5
POLICIES = ("frozen", "early", "opens", "random")
NOISE = "noise"


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
    outcome: str  # held, dropped, or on the table
    steps: int
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


class Policy:
    """One of the policies; call it once a step."""

    def __init__(self, name: str, grip: Sequence[int], seed: int) -> None:
        self._name, self._grip = name, np.array(grip)
        self._rng = np.random.default_rng(seed)
        self._noise = np.zeros(4)
        self._steps = 0
        self._rested = self._lifted = 0  # steps since the grip was complete, since the lift began

    def __call__(self, obs: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        away = self._grip - obs["fingers"]
        self._rested += self._rested > 0 or bool(np.abs(away).max() <= 1)
        touches = self._name == "early" and obs["force_n"][0] >= CONTACT_N
        self._lifted += self._lifted > 0 or touches or self._rested > REST_STEPS
        action = np.append(np.clip(away / SPAN_COUNTS, -1.0, 1.0), float(self._lifted > 0))
        if self._name == "random" and self._lifted:
            action = self._rng.uniform((-1.0, -1.0, -1.0, 0.0), 1.0)
        if self._name == NOISE:
            if self._steps % NOISE_LASTS == 0:
                self._noise = self._rng.uniform((-0.5, -0.5, -0.5, -1.0), 1.0)
            action = self._noise
        self._steps += 1
        if self._name == "opens" and self._lifted > OPENS_AFTER:
            action[:3] = -1.0
        return action.astype(np.float32)


def trial(task: Task) -> Row:
    from scenarios.campaign.config import load_config
    from scenarios.library.lift_environment import LiftEnvironment

    env = LiftEnvironment(task.object, reflex=task.reflex)
    config = load_config(task.object, "simulated")
    policy = Policy(task.policy, config.object.grip_counts, task.seed)
    obs, info = env.reset(seed=task.seed)
    timed = Timed(env.reflex)
    env.reflex = cast(Reflex, timed)
    above, commanded_n = 0, 0.0
    for _ in range(NOISE_STEPS if task.policy == NOISE else STEPS):
        obs, _, dropped, _, info = env.step(policy(obs))
        above += info["commanded_force_n"] > config.guard.force_limit_n
        commanded_n = max(commanded_n, info["commanded_force_n"])
        if dropped:
            break
    outcome = "dropped" if info["dropped"] else "held" if info["held"] else "on the table"
    spent, n = np.sort(timed.spent_us), len(timed.spent_us)
    return Row(
        policy=task.policy, reflex=task.reflex, object=task.object, seed=task.seed,
        outcome=outcome, steps=n, above=above, commanded_n=commanded_n,
        peak_n=info["peak_force_n"], step_us=(spent[n // 2], spent[n * 99 // 100]),
    )  # fmt: skip


def options(parser: Parser) -> None:
    add_trials(parser, 10)
    parser.add_argument("--noise-seeds", type=whole(0, 100_000), default=10, metavar="N",
                        help="episodes of `noise` with each object (default: 10)")  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    noise = range(args.first_seed, args.first_seed + args.noise_seeds)
    seeds = {**dict.fromkeys(POLICIES, seeds_of(args)), NOISE: noise}
    return [
        Task(policy, reflex, name, seed)
        for policy in seeds for reflex in (False, True) for name in args.objects
        for seed in seeds[policy]
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
        (name, len(own), *(sum(r.outcome == o for r in own) for o in ("held", "dropped")),
         sum(r.above for r in own), max(r.commanded_n for r in own), max(r.peak_n for r in own),
         float(np.median([r.step_us[0] for r in own])),
         float(np.median([r.step_us[1] for r in own])))
        for name, own in groups(rows).items()
    ]  # fmt: skip
    names = ("policy, reflex", "episodes", "held", "dropped", "commands above the limit",
             "commanded, N", "true, N", "step, µs", "p99, µs")  # fmt: skip
    return markdown(dict(zip(names, zip(*lines, strict=True), strict=True)))


STUDY = Study("drops and forces of careless policies, with the reflex and without it",
              grid, trial, Row, table, None, options, counted="episodes")  # fmt: skip
