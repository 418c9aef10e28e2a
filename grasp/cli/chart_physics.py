"""`grasp chart physics` and `grasp chart stability`; the numbers go beside the picture."""

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from grasp.cli import exits


def add_parsers(charts: Any) -> None:
    _add_computed(
        charts, "physics", draw_physics,
        "error against processor time of every contact model, integrator and step (1-2 minutes)",
    )  # fmt: skip
    _add_computed(
        charts, "stability", draw_stability,
        "at which step and stiffness each integrator holds a lift together (half a minute)",
    )  # fmt: skip


def _add_computed(charts: Any, name: str, handler: Any, text: str) -> None:
    parser = charts.add_parser(name, help=text, description=text)
    parser.add_argument(
        "--out", type=Path, default=Path(f"{name}.svg"), metavar="FILE",
        help="picture to write, .svg, .png or .pdf; its numbers go beside it, as .json "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(handler=handler)


def matplotlib_is_missing() -> bool:
    """True, and said with its remedy, where the extra `charts` is not installed."""
    if find_spec("matplotlib") is not None:
        return False
    exits.report("usage", "charts need matplotlib", "pip install 'grasp-controller[charts]'", False)
    return True


def draw_physics(args: argparse.Namespace) -> int:
    if matplotlib_is_missing():
        return exits.USAGE
    from scenarios.studies.physics import chart as physics_chart

    args.out.touch()  # fails before the work rather than after it
    chart = _with_progress(physics_chart.compute)
    physics_chart.draw(chart, args.out)
    _write_numbers(args.out, chart)
    print(physics_chart.table(chart))
    print(args.out)
    return exits.SUCCESS


def draw_stability(args: argparse.Namespace) -> int:
    if matplotlib_is_missing():
        return exits.USAGE
    from scenarios.studies.physics import stability

    args.out.touch()
    found = _with_progress(stability.compute)
    stability.draw(found, args.out)
    _write_numbers(args.out, found)
    for name, share in found.broken().items():
        print(f"{name:40} broken on {share:4.0%} of the map")
    print(args.out)
    return exits.SUCCESS


def _with_progress(compute: Any) -> Any:
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reference", total=None)
        return compute(
            lambda text, done, total: bar.update(
                task, description=text, completed=done, total=total
            )
        )


def _write_numbers(out: Path, numbers: Any) -> None:
    import msgspec

    out.with_suffix(".json").write_bytes(msgspec.json.encode(numbers) + b"\n")
