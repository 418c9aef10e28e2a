"""`grasp world plan` and `grasp world check`: which contact model and step a scene needs."""

import argparse
import math
import re
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import OBJECT_HELP, add_workers, progress, seed, whole, workers
from grasp.cli.output import json_line
from grasp.cli.places import file_to_write
from grasp.files import write_whole

SCENES = ("lift", "tap", "hold")
MOST_QUANTITY = 1000.0  # m, rad or N
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "rad": 1.0,
         "deg": math.pi / 180, "N": 1.0, "mN": 1e-3}  # fmt: skip


def add_plan(actions: Any) -> None:
    """Add `grasp world plan` to the verbs of `grasp world`."""
    about = "choose the cheapest contact model and step that answer within a tolerance, and say why"
    parser = actions.add_parser("plan", help=about, description=about)
    parser.add_argument("scene", metavar="SCENARIO", type=_scene, help=", ".join(SCENES))
    parser.add_argument(
        "--object", default="can", metavar="NAME", help=f"{OBJECT_HELP} (default: %(default)s)"
    )
    parser.add_argument(
        "--direction", metavar="DIR", help="of a tap's blow: top, side or closing (default: top)"
    )
    parser.add_argument(
        "--tolerance", type=quantity("m", "mm", "um", "cm"), default=1e-3, metavar="LENGTH",
        help="on the slip distance read at the tape mark, with its unit: m, mm, um or cm "
        "(default: 1mm)",
    )  # fmt: skip
    parser.add_argument(
        "--rotation", type=quantity("rad", "deg"), metavar="ANGLE",
        help="tolerance on the rotation in the hand, such as 2deg (default: not asked)",
    )  # fmt: skip
    parser.add_argument(
        "--force", type=quantity("N", "mN"), metavar="FORCE",
        help="tolerance on the peak force of a finger, such as 0.1N (default: not asked)",
    )  # fmt: skip
    parser.add_argument(
        "--config", type=Path, action="append", metavar="FILE",
        help="a file as runs take it: its sections object and contact count here; several: later "
        "ones on top",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="override a setting of object, contact or scene, such as object.centre_aside_m=0.01",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="the plan as one JSON object")
    parser.set_defaults(handler=show_plan)


def add_check(actions: Any) -> None:
    """Add `grasp world check` to the verbs of `grasp world`."""
    about = "run random lifts and taps at the level that is chosen, always at L4 and always at L1"
    parser = actions.add_parser("check", help=about, description=about)
    parser.add_argument(
        "--draws", type=whole(1, 100_000), default=200, metavar="N",
        help="objects with a lift or a tap each (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of the first draw")
    parser.add_argument(
        "--objects", nargs="+", metavar="NAME", help=f"{OBJECT_HELP} (default: the paper's six)"
    )
    parser.add_argument("--detector", metavar="NAME", help="default: that of every run")
    parser.add_argument(
        "--tolerance", type=quantity("m", "mm", "um", "cm"), metavar="LENGTH",
        help="in place of world.tolerance, with its unit, such as 0.5mm",
    )  # fmt: skip
    parser.add_argument(
        "--control", action="store_true",
        help="always L4 once more, with shorter steps: how often a verdict hangs on that alone",
    )  # fmt: skip
    parser.add_argument("--keep", action="store_true", help="end in the air, where all is judged")
    add_workers(parser)
    parser.add_argument("--out", type=file_to_write, metavar="FILE.json", help="write every draw")
    parser.set_defaults(handler=check)


def check(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.campaign.config import load_config
    from scenarios.studies.physics import levels

    objects = args.objects or levels.OBJECTS
    configs = [load_config(name, "simulated", args.detector) for name in objects]
    detector = configs[0].detector_name
    seeds = range(args.seed, args.seed + args.draws)
    with progress("draws") as show:
        draws = list(
            levels.check(
                seeds, objects, detector, args.tolerance, args.control, args.keep, workers(args),
                lambda done, total: show(done, total, "draws"),
            )
        )  # fmt: skip
    if args.out:
        write_whole(args.out, msgspec.json.encode(draws))
    print(f"detector {detector}\n\n{levels.table(draws)}")
    return exits.SUCCESS


def _scene(name: str) -> str:
    if name == "side-tap":
        raise argparse.ArgumentTypeError("side-tap is called tap --direction side now")
    if name not in SCENES:
        raise argparse.ArgumentTypeError(f"{name!r}: one of {', '.join(SCENES)}")
    return name


def quantity(*units: str) -> Any:
    """Reads a number above zero with one of these units. A bare one is refused: whoever writes 1
    for a length means millimetres as often as metres."""

    def length(text: str) -> float:
        match = re.fullmatch(r"\s*([-+0-9.eE]+?)\s*([a-zA-Z]*)\s*", text)
        try:
            if match is None or match[2] not in units:
                raise ValueError
            value = float(match[1]) * UNITS[match[2]]
            if not 0.0 < value <= MOST_QUANTITY:
                raise ValueError
        except ValueError:
            given = f"not a number above zero with its unit ({', '.join(units)}): {text!r}"
            raise argparse.ArgumentTypeError(given) from None
        return value

    return length


def show_plan(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.settings import Layer, assignment_layer, load, read_toml, thing_layer
    from scenarios.world.ladder.experiments import SCENES as BUILD
    from scenarios.world.ladder.experiments import World
    from scenarios.world.ladder.planner import Tolerance, plan

    assignments = list(args.set)
    if args.direction is not None:
        if args.scene != "tap":
            raise UsageError(f"--direction is that of a tap, not of a {args.scene}", "leave it out")
        assignments.append(f"scene.direction={args.direction}")
    layers = [thing_layer("objects", "object", args.object)]
    for path in args.config or ():
        file = read_toml(path)
        known = {k: file.table[k] for k in World.__struct_fields__ if k in file.table}
        layers.append(Layer(file.source, known))
    world = load(World, [*layers, assignment_layer(assignments)])
    tolerance = Tolerance(
        slip_m=args.tolerance, rotation_rad=args.rotation, peak_force_n=args.force
    )
    found = plan(BUILD[args.scene](world), tolerance)
    if args.json:
        print(json_line({**msgspec.to_builtins(found), "explanation": found.lines()}))
    else:
        print("\n".join(found.lines()))
    return exits.SUCCESS
