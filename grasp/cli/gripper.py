"""`grasp gripper`: the hand alone, looked at, activated, and moved slowly in finite steps."""

import argparse
from collections.abc import Callable
from typing import Any

from drivers.errors import UsageError
from grasp import interruption
from grasp.cli import exits
from grasp.cli.lab import (
    FINGERS,
    add_lab,
    confirm,
    lab_config,
    leave_to_move,
    say,
    tell_mode,
    tell_weak,
    will,
)
from grasp.cli.options import decimal, whole
from grasp.cli.output import json_line

HELP = "look at a lab's gripper, activate it, move it slowly"
SLOW = "slowly, at its least force"
ALL = "open and close all fingers fully"
IDLE = "do nothing: it is active"
SET_BASIC = "open all fingers and set basic mode"
FULLY = "activation opens and closes the hand fully, with a force that nobody sets."


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("gripper", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _action(actions, "status", status, "every register in words; moves nothing", moves=False)
    active = _action(
        actions, "activate", activate,
        "make the hand ready, which opens and closes it fully; one that is active in another mode "
        "is set to the basic one, for which it opens",
    )  # fmt: skip
    active.add_argument(
        "--empty", action="store_true", help="the hand is empty: do not ask whether it is"
    )
    _action(actions, "open", open_fingers, f"open all fingers {SLOW}: what they hold falls")
    close = _action(
        actions, "close", close_fingers,
        f"close fingers {SLOW}: B and C until anything is felt, then the thumb alone, under the "
        "force guard of a run, and refused where a run would be",
    )  # fmt: skip
    _add_finger(close, "all")
    close.add_argument(
        "--to", type=whole(0, 255), default=255, metavar="COUNTS",
        help="no further than this (default: %(default)s, closed)",
    )  # fmt: skip
    step = _action(actions, "step", step_fingers, f"move a finger by a few millimetres {SLOW}")
    _add_finger(step, "A")
    step.add_argument(
        "--mm", type=decimal(0.01, 5), default=2.0, metavar="MM",
        help="travel of the fingertip, at most 5 (default: %(default)g)",
    )  # fmt: skip
    step.add_argument("--open", action="store_true", help="open by that instead of closing")


def _action(
    actions: Any, name: str, handler: Any, text: str, moves: bool = True
) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(name, help=text, description=text)
    add_lab(parser, moves)
    parser.set_defaults(handler=handler)
    return parser


def _add_finger(parser: argparse.ArgumentParser, default: str) -> None:
    parser.add_argument(
        "--finger", choices=(*FINGERS, "all"), default=default,
        help="A is the thumb (default: %(default)s)",
    )  # fmt: skip


def status(args: argparse.Namespace) -> int:
    from drivers.robotiq.protocol import FAULTS, TO_BASIC, other_than_basic
    from drivers.robotiq.words import doubts, lines
    from scenarios.rigs.device_checks import STRANGE

    where, before, now = _looked(args)
    strange = doubts(now, before)
    fault = FAULTS[now.fault]
    code = exits.DEVICE if strange or fault.code else exits.SUCCESS
    if args.json:
        told = {"gripper": where, "registers": lines(now), "doubts": strange, "exit_code": code}
        print(json_line(told))
        return code
    print("\n".join((f"gripper at {where}", *(f"  {line}" for line in lines(now)))))
    for doubt in strange:
        exits.report_line(f"{doubt} ({STRANGE})")
    if fault.code:
        exits.report_line(f"{fault.text} ({fault.remedy})")
    if now.ready and (other := other_than_basic(now.mode)):
        exits.report_line(f"the hand is {other} ({TO_BASIC})")
    return code


def _looked(args: argparse.Namespace) -> tuple[str, Any, Any]:
    """Its address, and two looks at its registers."""
    from scenarios.rigs.device_checks import read_gripper
    from scenarios.rigs.permission import gripper_address

    config = lab_config(args)
    where = gripper_address(config)
    if config.devices.gripper:
        raise UsageError(f"{where} is of another package", "look at it by that")
    return (where, *read_gripper(config))


def activate(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import activate_hand

    config = lab_config(args)
    if args.dry_run:
        from scenarios.lab.ready import check_activation
        from scenarios.rigs.rig import to_open

        to_open(config)  # raises where nobody has said which hand this is
        seen = check_activation(config)
        does = IDLE if seen is None else SET_BASIC if seen.well else ALL
        return _tell(args, {"would": does})
    permit = leave_to_move(config, args, lambda: ALL)
    confirm(f"{FULLY} Is it empty, and everybody's hands away?", "empty", args.empty)
    will(f"{ALL}, if it is not active; {SET_BASIC}, if it is active in another")
    with interruption.held():
        positions = activate_hand(config, permit, say)
    if positions is None:
        return _tell(args, {"done": "it was active already: nothing was moved"})
    return _tell(args, {"done": f"active, fingers at {positions} counts"})


def open_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import open_hand
    from scenarios.rigs.rig import to_open

    config = _lab_config(args)
    if args.dry_run:
        return _would(args, config, lambda at: (0, 0, 0), closing="", spreads=True)
    permit = leave_to_move(config, args, lambda: f"open all fingers at {_how(to_open(config))}")
    with interruption.held(), open_hand(config, permit, closing=False) as hand:
        will(_move(to_open(config), hand.state.positions, (0, 0, 0)) + _spreads(hand.mode))
        moved = hand.open(say)
    tell_mode(config, opened=True)
    return _tell(args, {"done": moved.in_words()}, _ended(moved))


def close_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import fingers_of, guard_of, open_hand, targets_of

    fingers, config = fingers_of(args.finger), _lab_config(args)
    if args.dry_run:
        return _would(args, config, lambda at: targets_of(at, fingers, args.to), closing=fingers)
    guard_of(config)  # what would be refused anyhow is told instead of what would move
    order = _order(config, fingers)
    permit = leave_to_move(
        config, args,
        lambda: f"close finger {fingers} to {args.to} counts at {_how(config)}{order}",
    )  # fmt: skip
    tell_mode(config)
    with interruption.held(), open_hand(config, permit, closing=True) as hand:
        targets = targets_of(hand.state.positions, fingers, args.to)
        will(_move(config, hand.state.positions, targets) + order)
        moved = hand.close(targets, say)
    return _tell(args, {"done": moved.in_words()}, _ended(moved))


def step_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import fingers_of, guard_of, open_hand, step_counts, step_targets

    fingers, config = fingers_of(args.finger), _lab_config(args)
    counts = step_counts(config, args.mm * 1e-3) * (-1 if args.open else 1)
    if args.dry_run:
        closing = "" if args.open else fingers
        return _would(args, config, lambda at: step_targets(at, fingers, counts), closing)
    order = ""
    if not args.open:
        guard_of(config)  # as above
        order = _order(config, fingers)
    permit = leave_to_move(
        config, args,
        lambda: f"move finger {fingers} by {counts:+} counts at {_how(config)}{order}",
    )  # fmt: skip
    tell_mode(config)
    with interruption.held(), open_hand(config, permit, closing=not args.open) as hand:
        targets = step_targets(hand.state.positions, fingers, counts)
        will(_move(config, hand.state.positions, targets) + order)
        moved = hand.move(targets, say) if args.open else hand.close(targets, say)
    return _tell(args, {"done": moved.in_words()}, _ended(moved))


def _lab_config(args: argparse.Namespace) -> Any:
    """What its calibration claims is told before anything else, of a dry run too."""
    config = lab_config(args)
    tell_weak(config.calibration)
    return config


def _would(
    args: argparse.Namespace, config: Any, targets: Callable[[Any], Any], closing: str,
    spreads: bool = False,
) -> int:  # fmt: skip
    """Of a dry run: where the fingers would go from where they are, and how hard at most. Raises
    what the motion would. ``closing``: the fingers that close; ``spreads``: in scissor mode B and C
    are moved apart."""
    from scenarios.lab.ready import active_hand, check_close
    from scenarios.rigs.rig import to_open

    seen = active_hand(config)
    at = seen.state.positions
    to = targets(at)
    if closing:
        check_close(config, seen, to)
    tell_mode(config, opened=not closing)
    told = config if closing else to_open(config)
    more = _spreads(seen.mode) if spreads else _order(config, closing)
    return _tell(args, {"would": _move(told, at, to) + more})


def _move(config: Any, at: Any, to: Any) -> str:
    return f"move fingers from {at} to {to} counts at {_how(config)}"


def _spreads(mode: int) -> str:
    """What else a hand does that is told to open fully."""
    from drivers.robotiq.protocol import SCISSOR, SPREADS

    return SPREADS if mode == SCISSOR else ""


def _order(config: Any, closing: str) -> str:
    """In what order those fingers close, and where B and C stand."""
    if config.guard.cap_mode == "each_motor" or not set("BC") & set(closing):
        return ""
    thumb = ", then the thumb alone" if "A" in closing else ""
    return f"; B and C no further than where anything is felt{thumb}"


def _how(config: Any) -> str:
    """Speed and force. Raises ConfigError where nobody has said which hand this is."""
    from scenarios.rigs.rig import calibration

    known = calibration(config)
    return f"{known.least_speed_mps * 1e3:g} mm/s, at most {known.least_force_n:g} N a motor"


def _ended(moved: Any) -> int:
    """Exit code of a motion."""
    if moved.stopped_by:
        return exits.SAFETY_STOP
    return exits.DEVICE if moved.fault else exits.SUCCESS


def _tell(args: argparse.Namespace, told: dict[str, str], code: int = exits.SUCCESS) -> int:
    if args.json:
        print(json_line({**told, "exit_code": code}))
    else:
        for key, text in told.items():
            print(f"would {text}" if key == "would" else text)
    return code
