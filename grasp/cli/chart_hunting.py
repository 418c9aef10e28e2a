"""`grasp chart hunting`: where compensate and hold would take turns."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits

CLOSING_S = 0.05  # first grasp to the cap on a rigid object, measured on the simulated rig
TRANSIENT_S = 0.1
STEPS_N = (0.5, 2.0, 8.0)
HOLDS_S = (0.03, 0.1)
MOST_LATENCY_MS, MOST_REFRACTORY_MS, STEP_MS = 200, 400, 10


def add_parser(charts: Any) -> None:
    parser = charts.add_parser(
        "hunting",
        help="where the controller's own closing would set off the next compensation",
        description="Counts compensations of a reduced loop over latency, refractory time, hold "
        "time and force step, for three policies. The star is the default controller.",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("hunting.svg"), metavar="FILE",
        help="picture to write, .svg, .png or .pdf (default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(handler=draw)


def draw(args: argparse.Namespace) -> int:
    from grasp.cli.chart_physics import matplotlib_is_missing
    from scenarios.campaign.settings import load_config
    from scenarios.studies.reaction.hunting import POLICIES, default_loop, hunt, hunting_map
    from scenarios.studies.reaction.hunting_figure import draw_hunting

    if matplotlib_is_missing():
        return exits.USAGE
    latencies = [ms * 1e-3 for ms in range(0, MOST_LATENCY_MS + 1, STEP_MS)]
    refractories = [ms * 1e-3 for ms in range(0, MOST_REFRACTORY_MS + 1, STEP_MS)]
    maps = [
        hunting_map(policy, step, hold, latencies, refractories)
        for policy in range(len(POLICIES))
        for step in STEPS_N
        for hold in HOLDS_S
    ]
    default = default_loop(load_config("can", "simulated"), CLOSING_S, TRANSIENT_S)
    draw_hunting(maps, default, args.out)
    for m in maps:
        bounded = "" if m.bound is None else f", bound {m.bound}"
        clean = (m.compensations == 1).mean()
        print(f"{m.policy:<15} step {m.step_n:3g} N, hold {m.hold_s * 1e3:3.0f} ms: at most "
              f"{m.compensations.max():3d} compensations{bounded}, {clean:4.0%} clean")  # fmt: skip
    latency_ms, refractory_ms = default.latency_s * 1e3, default.refractory_s * 1e3
    print(f"default: latency {latency_ms:.0f} ms, refractory time {refractory_ms:.0f} ms: "
          f"{hunt(default).compensations} compensation")  # fmt: skip
    print(args.out)
    return exits.SUCCESS
