"""`grasp world plan`: the contact model that a scene needs, and why."""

import argparse
import json
import math
import re
from typing import Any

from grasp.cli import exits

SCENES = ("lift", "tap", "side-tap", "hold")
UNITS = {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "rad": 1.0,
         "deg": math.pi / 180, "N": 1.0, "mN": 1e-3}  # fmt: skip


def add_parser(actions: Any) -> None:
    about = "choose the cheapest contact model and step that answer within a tolerance, and say why"
    parser = actions.add_parser("plan", help=about, description=about)
    parser.add_argument("scene", metavar="SCENARIO", choices=SCENES, help=", ".join(SCENES))
    parser.add_argument("--object", default="can", metavar="NAME", help="default: %(default)s")
    parser.add_argument(
        "--tolerance", type=quantity("m", "um", "mm", "cm"), default=1e-3, metavar="LENGTH",
        help="on the slip distance read at the tape mark, such as 1mm (default)",
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
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="override a setting of object, contact or scene, such as scene.aside_m=0.01",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="the plan as one JSON object")
    parser.set_defaults(handler=show)


def quantity(*units: str) -> Any:
    """Type of an argument: a number with one of these units, or bare in the first."""

    def length(text: str) -> float:
        match = re.fullmatch(r"\s*([-+0-9.eE]+?)\s*([a-zA-Z]*)\s*", text)
        try:
            if match is None or (match[2] and match[2] not in units):
                raise ValueError
            value = float(match[1]) * UNITS[match[2]]
        except ValueError:
            given = f"not a number with one of the units {', '.join(units)}: {text!r}"
            raise argparse.ArgumentTypeError(given) from None
        return value

    return length


def show(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.settings import assignment_layer, load, named_layer
    from scenarios.world.ladder.experiments import SCENES as BUILD
    from scenarios.world.ladder.experiments import World
    from scenarios.world.ladder.planner import Tolerance, plan

    world = load(World, [named_layer("objects", args.object), assignment_layer(args.set)])
    asked = (args.tolerance, args.rotation, args.force)
    if any(value is not None and value <= 0.0 for value in asked):
        return exits.report("usage", "a tolerance is above zero", "--tolerance 1mm", args.json)
    tolerance = Tolerance(
        slip_m=args.tolerance, rotation_rad=args.rotation, peak_force_n=args.force
    )
    found = plan(BUILD[args.scene](world), tolerance)
    if args.json:
        print(json.dumps({**msgspec.to_builtins(found), "explanation": found.lines()}))
    else:
        print("\n".join(found.lines()))
    return exits.SUCCESS
