"""`grasp gripper`: activate the hand, and move it slowly in finite steps. `grasp release`: open a
closed hand in the same way."""

import argparse
from collections.abc import Callable
from typing import Any

from drivers.errors import UsageError
from grasp import interruption
from grasp.cli import exits
from grasp.cli.lab import (
    FINGERS,
    add_verb,
    confirm,
    lab_config,
    leave_to_move,
    say,
    tell,
    tell_mode,
    tell_weak,
    will,
)
from grasp.cli.options import decimal, whole
from grasp.cli.output import json_line
from grasp.cli.parser import Parser, group

HELP = "activate a lab's gripper, move it slowly"
SLOW = "slowly, at its least force"
ALL = "open and close all fingers fully"
IDLE = "do nothing: it is active"
SET_BASIC = "open all fingers and set basic mode"
FULLY = "activation opens and closes the hand fully, with a force that nobody sets."
OPEN = (0, 0, 0)


def add_parser(verbs: Any) -> None:
    actions = group(verbs, "gripper", HELP)
    active = add_verb(
        actions, "activate", activate,
        "make the hand ready, which opens and closes it fully; one that is active in another mode "
        "is set to the basic one, for which it opens",
    )  # fmt: skip
    active.flag("--empty", "the hand is empty: do not ask whether it is")
    close = add_verb(
        actions, "close", close_fingers,
        f"close fingers {SLOW}: B and C until anything is felt, then the thumb alone, under the "
        "force guard of a run, and refused where a run would be",
    )  # fmt: skip
    _add_finger(close, "all")
    close.option("--to COUNTS", "no further than this (default: %(default)s, closed)",
        whole(0, 255), default=255)  # fmt: skip
    step = add_verb(actions, "step", step_fingers, f"move a finger by a few millimetres {SLOW}")
    _add_finger(step, "A")
    step.option("--mm MM", "travel of the fingertip, at most 5", decimal(0.01, 5), default=2.0)
    step.flag("--open", "open by that instead of closing")


def add_release(verbs: Any) -> None:
    parser = add_verb(verbs, "release", release, f"open all fingers of a hand {SLOW}")
    parser.description = (
        f"{parser.description}. Support the object first: it falls when the fingers open. Needs "
        "only the gripper. The state of arm and fingertips is printed and prevents nothing."
    )
    parser.flag("--activate", "activate an inactive hand, which opens and closes it fully; it must "
        "be empty, or its object supported")  # fmt: skip


def _add_finger(parser: Parser, default: str) -> None:
    parser.option("--finger", "A is the thumb", choices=(*FINGERS, "all"), default=default)


def status(args: argparse.Namespace) -> int:
    """`grasp status gripper`."""
    from drivers.robotiq.protocol import FAULTS, TO_BASIC, doubts, lines, other_than_basic
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

        to_open(config)  # raises without a calibration
        seen = check_activation(config)
        does = IDLE if seen is None else SET_BASIC if seen.well else ALL
        return tell(args, {"would": does})
    permit = leave_to_move(config, args, lambda: ALL)
    confirm(f"{FULLY} Is it empty, and everybody's hands away?", "empty", args.empty)
    will(f"{ALL}, if it is not active; {SET_BASIC}, if it is active in another")
    with interruption.held():
        positions = activate_hand(config, permit, say)
    if positions is None:
        return tell(args, {"done": "already active: nothing moved"})
    return tell(args, {"done": f"active, fingers at {positions} counts"})


def release(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import open_hand
    from scenarios.rigs.permission import gripper_address
    from scenarios.rigs.release import make_ready, other_devices
    from scenarios.rigs.rig import to_open

    config = _lab_config(args)
    if args.dry_run:
        return _would_release(args, config)
    permit = leave_to_move(config, args, lambda: f"open all fingers at {_how(to_open(config))}")
    with interruption.held():
        make_ready(config, permit, args.activate)
        with open_hand(config, permit, closing=False) as hand:
            will(_move(to_open(config), hand.state.positions, OPEN) + _spreads(hand.mode))
            moved = hand.open(say)
    which = f"gripper at {gripper_address(config)}"
    if not args.json:
        print(f"released on rig {args.rig}: {which}, {moved.in_words()}")
    others = other_devices(config)
    if args.json:
        told = {"rig": args.rig, "gripper": which, "positions_counts": moved.positions_counts}
        print(json_line({**told, **others}))
    else:
        for device, state in others.items():
            print(f"  {device}: {state}")
    tell_mode(config, opened=True)
    return exits.SUCCESS


def _would_release(args: argparse.Namespace, config: Any) -> int:
    """Raises the errors of the release: exits 0 only if the fingers would open."""
    from scenarios.lab.ready import hand_seen
    from scenarios.rigs.release import not_active
    from scenarios.rigs.rig import to_open

    to_open(config)  # raises without a calibration
    seen = hand_seen(config)
    if not seen.state.active:
        if not args.activate:
            raise not_active(seen.state, "the same with --activate")
        return tell(args, {"would": f"activate the hand: {ALL}, then open it"})
    tell_mode(config, opened=True)
    would = _move(to_open(config), seen.state.positions, OPEN) + _spreads(seen.mode)
    return tell(args, {"would": would})


def close_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import fingers_of, targets_of

    fingers, config = fingers_of(args.finger), _lab_config(args)
    plan = f"close finger {fingers} to {args.to} counts"
    return _moved(args, config, plan, lambda at: targets_of(at, fingers, args.to), fingers)


def step_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import fingers_of, step_counts, step_targets

    fingers, config = fingers_of(args.finger), _lab_config(args)
    counts = step_counts(config, args.mm * 1e-3) * (-1 if args.open else 1)
    plan, closing = f"move finger {fingers} by {counts:+} counts", "" if args.open else fingers
    return _moved(args, config, plan, lambda at: step_targets(at, fingers, counts), closing)


def _moved(
    args: argparse.Namespace, config: Any, plan: str, targets: Callable[[Any], Any], closing: str
) -> int:
    """Move fingers to their ``targets``. ``closing``: the fingers that close."""
    from scenarios.lab.hand import guard_of, open_hand

    if args.dry_run:
        return _would(args, config, targets, closing)
    order = ""
    if closing:
        guard_of(config)  # reports a refusal instead of a motion
        order = _order(config, closing)
    permit = leave_to_move(config, args, lambda: f"{plan} at {_how(config)}{order}")
    tell_mode(config)
    with interruption.held(), open_hand(config, permit, closing=bool(closing)) as hand:
        to = targets(hand.state.positions)
        will(_move(config, hand.state.positions, to) + order)
        moved = hand.close(to, say) if closing else hand.move(to, say)
    code = exits.SAFETY_STOP if moved.stopped_by else exits.DEVICE if moved.fault else exits.SUCCESS
    return tell(args, {"done": moved.in_words()}, code)


def _lab_config(args: argparse.Namespace) -> Any:
    """What its calibration claims is told before anything else, of a dry run too."""
    config = lab_config(args)
    tell_weak(config.calibration)
    return config


def _would(
    args: argparse.Namespace, config: Any, targets: Callable[[Any], Any], closing: str
) -> int:
    """Of a dry run: where the fingers would go from where they are, and how hard at most. Raises
    what the motion would."""
    from scenarios.lab.ready import active_hand, check_close
    from scenarios.rigs.rig import to_open

    seen = active_hand(config)
    at = seen.state.positions
    to = targets(at)
    if closing:
        check_close(config, seen, to)
    tell_mode(config, opened=not closing)
    told = config if closing else to_open(config)
    return tell(args, {"would": _move(told, at, to) + _order(config, closing)})


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
    """Speed and force. Raises ConfigError without a calibration."""
    from scenarios.rigs.rig import calibration

    known = calibration(config)
    return f"{known.least_speed_mps * 1e3:g} mm/s, at most {known.least_force_n:g} N a motor"
