"""Limit cycles of the control loop (hunting between hold and compensate), on a reduced model.

The hand latches and holds, so its force only rises and cannot oscillate. The slip status can:
closing shakes the pads, a detector reports that as slip, and each false slip adds a force step.
The study also maps two policies that the controller does not have. One loosens the grip slowly, the
other regrasps at the force limit. The model has time and force but no contact: the object slips
below a needed force.
"""

import argparse
import math
from collections.abc import Sequence
from typing import Any

import msgspec
from numba import njit

from scenarios.campaign.config import load_config
from scenarios.trial.config import TrialConfig
from studies.runner import Study, markdown

RATCHET, LOOSENING, REGRASP = POLICIES = ("tightening only", "loosening", "regrasp")
STEPS_N = (0.5, 2.0, 8.0)
HOLDS_S = (0.03, 0.1)
LATENCIES_S = tuple(0.01 * k for k in range(21))
REFRACTORIES_S = tuple(0.01 * k for k in range(41))
# of the default controller; a star in the chart
CLOSING_S = 0.05  # first grasp to the limit on a rigid object, measured on the simulated rig
TRANSIENT_S = 0.1  # a closing is detected as slip this long; assumed, 30-100 ms
DARKEST = 20  # compensations
TICK_S, REGRASP_S = 0.005, 0.05


class Loop(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the reduced loop."""

    latency_s: float  # command to rise of force
    refractory_s: float  # from one command to the next
    hold_s: float  # a nominal status this long ends a compensation
    step_n: float  # force added by a command
    detector_s: float = 0.06  # slip to registered slip; assumed, 20-300 ms
    transient_s: float = TRANSIENT_S
    loosening_nps: float = 0.0  # loss of force while holding
    regrasp: bool = False  # open and close at the limit
    first_n: float = 2.0
    needed_n: float = 6.0  # the object slips below this force
    limit_n: float = 10.0
    horizon_s: float = 6.0


class Task(msgspec.Struct, frozen=True):
    """A panel of the map."""

    policy: str
    step_n: float
    hold_s: float
    latencies_s: tuple[float, ...] = LATENCIES_S
    refractories_s: tuple[float, ...] = REFRACTORIES_S


class Row(msgspec.Struct, frozen=True):
    """Compensations over latency (rows) and refractory time (columns)."""

    task: Task
    compensations: list[list[int]]
    bound: int | None  # None: the policy reduces force, so no bound exists

    @property
    def most(self) -> int:
        return max(map(max, self.compensations))


def bound(loop: Loop) -> int:
    """Upper bound for a hand that only tightens: the steps from first force to limit, and one more
    at the limit, without motion."""
    return math.ceil((loop.limit_n - loop.first_n) / loop.step_n) + 1


def hunt(loop: Loop) -> int:
    """Number of compensations of the loop; a slip needs one."""
    return int(_hunt(*msgspec.structs.astuple(loop)))


@njit(cache=True)
def _hunt(
    latency: float, refractory: float, hold: float, step: float, detector: float, transient: float,
    loosening: float, regrasp: bool, first: float, needed: float, limit: float, horizon: float,
) -> int:  # fmt: skip
    ticks = round(horizon / TICK_S)
    delay = round(detector / TICK_S)
    slipping = [False] * (ticks + 1)
    force, target = first, first
    rise_at, shaken_until, open_until = -1.0, -1.0, -1.0
    last_command, last_slip = -1e9, -1e9
    compensating, compensations = False, 0
    for i in range(ticks):
        t = i * TICK_S
        if rise_at >= 0.0 and t >= rise_at:
            if regrasp and force >= limit:
                open_until = t + REGRASP_S
                shaken_until = open_until + transient
            elif target > force:
                shaken_until = t + transient
                force = target
            rise_at = -1.0
        slipping[i] = force < needed or t < open_until or t < shaken_until
        detected = i >= delay and slipping[i - delay]
        if detected:
            last_slip = t
        if detected and t - last_command >= refractory:
            if not compensating:
                compensations += 1
                compensating = True
            last_command = t
            target = min(limit, force + step)
            rise_at = t + latency
        elif compensating and t - max(last_slip, last_command) >= hold:
            compensating = False
        if not compensating and loosening > 0.0 and compensations > 0:
            force = max(0.0, force - loosening * TICK_S)
    return compensations


def default_loop(config: TrialConfig, closing_s: float, transient_s: float) -> Loop:
    """The reduced loop of a configuration. Commands are masked from one closing to
    ``mask_after_closing_s`` after its end, and the limit is commanded at once."""
    hand, limit_n = config.hand, config.guard.force_limit_n
    latency_s = config.loop.decision_delay_s + 0.5 / hand.refresh_hz + hand.command_latency_s
    return Loop(
        latency_s=latency_s, step_n=limit_n, transient_s=transient_s, limit_n=limit_n,
        refractory_s=latency_s + closing_s + config.slip.mask_after_closing_s,
        hold_s=config.rule.release * config.loop.period_s,
    )  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    return [Task(p, step, hold) for p in POLICIES for step in STEPS_N for hold in HOLDS_S]


def trial(task: Task) -> Row:
    loops = [
        [
            Loop(
                latency_s=latency, refractory_s=refractory, hold_s=task.hold_s, step_n=task.step_n,
                loosening_nps=2.0 if task.policy == LOOSENING else 0.0,
                regrasp=task.policy == REGRASP,
            )
            for refractory in task.refractories_s
        ]
        for latency in task.latencies_s
    ]  # fmt: skip
    most = bound(loops[0][0]) if task.policy == RATCHET else None
    return Row(task, [[hunt(loop) for loop in line] for line in loops], most)


def _packaged() -> Loop:
    return default_loop(load_config("can", "simulated"), CLOSING_S, TRANSIENT_S)


def table(rows: Sequence[Row]) -> str:
    counts = [[n for line in row.compensations for n in line] for row in rows]
    maps = markdown({
        "policy": [row.task.policy for row in rows],
        "step, N": [row.task.step_n for row in rows],
        "hold, ms": [f"{row.task.hold_s * 1e3:.0f}" for row in rows],
        "most compensations": [row.most for row in rows],
        "bound": [row.bound for row in rows],
        "one compensation, % of the map": [100 * n.count(1) / len(n) for n in counts],
    })  # fmt: skip
    loop = _packaged()
    return (f"{maps}\n\nDefault controller: latency {loop.latency_s * 1e3:.0f} ms, refractory "
            f"time {loop.refractory_s * 1e3:.0f} ms: compensations {hunt(loop)}.")  # fmt: skip


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Panels by policy (rows) and pair of step and hold time (columns); a star: the default."""
    policies = list(dict.fromkeys(row.task.policy for row in rows))
    columns = list(dict.fromkeys((row.task.step_n, row.task.hold_s) for row in rows))
    axes = figure.subplots(len(policies), len(columns), sharex=True, sharey=True, squeeze=False)
    default, image = _packaged(), None
    for row in rows:
        t = row.task
        panel = axes[policies.index(t.policy), columns.index((t.step_n, t.hold_s))]
        image = panel.pcolormesh(
            [1e3 * r for r in t.refractories_s], [1e3 * x for x in t.latencies_s],
            row.compensations, cmap="OrRd", vmin=1, vmax=DARKEST, shading="nearest",
            rasterized=True,
        )  # fmt: skip
        panel.plot(1e3 * default.refractory_s, 1e3 * default.latency_s, "*", color="#153f6b", ms=11)
        panel.set_title(f"step {t.step_n:g} N, hold {t.hold_s * 1e3:.0f} ms", fontsize=8)
    for panel, policy in zip(axes[:, 0], policies, strict=True):
        panel.set_ylabel(f"{policy}\nlatency, ms")
    for panel in axes[-1]:
        panel.set_xlabel("refractory time, ms")
    figure.colorbar(image, ax=axes, label=f"compensations in 6 s ({DARKEST} and more: dark)")


STUDY = Study("parameters at which closing would trigger the next compensation", grid, trial,
               Row, table, chart, figure_size=(16.6, 8.1))  # fmt: skip
