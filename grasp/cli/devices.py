"""`grasp status`, `gripper`, `arm` and `release`: read real devices, and move them slowly."""

from collections.abc import Callable

from drivers.checks import failures
from drivers.errors import UsageError
from drivers.interfaces import Counts3, Vector3
from drivers.robotiq import protocol
from drivers.robotiq.protocol import FAULTS, SCISSOR, SCISSOR_NOTE, SET_BASIC_MODE, mode_warning
from drivers.ur.link import preflight as arm_preflight
from grasp.cli import device_commands as commands
from grasp.cli import exits, lab
from grasp.cli.device_commands import ARM_SPEED
from grasp.cli.questions import confirm
from scenarios.campaign.config import RunConfig
from scenarios.lab import arm, hand, preflight
from scenarios.rigs.calibration import calibration, settings_to_open
from scenarios.rigs.device_checks import WRONG_DEVICE, arm_checks, other_devices, read_gripper
from scenarios.rigs.permission import MotionPermit, arm_address, gripper_address
from scenarios.rigs.rig import not_active_error
from scenarios.trial.run_folder import last_start

ALL = "open and close all fingers fully"
IDLE = "do nothing: the hand is active"
SET_BASIC = "open all fingers and set basic mode"
OPEN = (0, 0, 0)


def status(args: commands.StatusOptions) -> int:
    config = lab.hardware_config(args)
    return _arm_status(args, config) if args.device == "arm" else _gripper_status(args, config)


def _gripper_status(args: commands.StatusOptions, config: RunConfig) -> int:
    where = gripper_address(config)
    if config.devices.gripper:
        raise UsageError(f"{where} is driven by another package", "use that package's tools")
    before, now = read_gripper(config)
    strange, fault, lines = (
        protocol.implausible_values(now, before),
        FAULTS[now.fault],
        protocol.status_lines(now),
    )
    code = exits.DEVICE if strange or fault.code else exits.SUCCESS
    value = {"gripper": where, "registers": lines, "doubts": strange}
    lab.print_done(args, lab.Done(_listed(f"gripper at {where}", lines), value, code))
    if args.json:
        return code
    for each in strange:
        lab.say(f"{each} ({WRONG_DEVICE})")
    if fault.code:
        lab.say(f"{fault.text} ({fault.remedy})")
    if now.ready and (other := mode_warning(now.mode)):
        lab.say(f"the hand is {other} ({SET_BASIC_MODE})")
    return code


def _arm_status(args: commands.StatusOptions, config: RunConfig) -> int:
    host, checks = arm_address(config), arm_checks(config)
    state = (
        []
        if config.devices.arm
        else arm_preflight.status_lines(
            arm_preflight.read_status(host, config.ur.step_timeout_s)[1]
        )
    )
    failed = failures(checks)
    code = exits.DEVICE if failed else exits.SUCCESS
    value = {"arm": host, "state": state, "checks": [check._asdict() for check in checks]}
    lab.print_done(args, lab.Done(_listed(f"arm at {host}", state), value, code))
    if not args.json:
        for check in failed:
            lab.say(f"{check.detail} ({check.remedy})")
    return code


def _listed(title: str, lines: list[str]) -> str:
    return "\n".join((title, *(f"  {line}" for line in lines)))


def gripper_activate(args: commands.ActivateOptions) -> int:
    config = lab.hardware_config(args)

    def look() -> str:
        settings_to_open(config)  # raises without a calibration
        seen = preflight.check_activation(config)
        return IDLE if seen is None else SET_BASIC if seen.healthy else ALL

    def ask() -> None:
        confirm("activation opens and closes the hand fully, with a force that cannot be set. "
                "Is it empty, and is everybody clear of it?", "empty", args.empty)  # fmt: skip
        lab.say(f"will {ALL} if the hand is inactive; {SET_BASIC} if it is active in another mode")

    def act(permit: MotionPermit | None) -> lab.Done:
        positions = hand.activate_hand(config, permit, lab.say)
        if positions is None:
            return lab.Done("already active: nothing moved")
        return lab.Done(f"active, fingers at {positions} counts")

    return lab.perform(args, config, lambda: ALL, look, act, ask)


def gripper_close(args: commands.CloseOptions) -> int:
    fingers, config = hand.finger_names(args.finger), lab.hardware_config(args)
    plan = f"close finger {fingers} to {args.to} counts"
    return _move(args, config, plan, lambda at: hand.closing_targets(at, fingers, args.to), fingers)


def gripper_step(args: commands.StepOptions) -> int:
    fingers, config = hand.finger_names(args.finger), lab.hardware_config(args)
    counts = hand.step_counts(config, args.mm * 1e-3) * (-1 if args.open else 1)
    plan, closing = f"move finger {fingers} by {counts:+} counts", "" if args.open else fingers
    return _move(args, config, plan, lambda at: hand.step_targets(at, fingers, counts), closing)


def _move(
    args: commands.MotionOptions,
    config: RunConfig,
    plan: str,
    targets: Callable[[Counts3], Counts3],
    closing: str,
) -> int:
    """Move fingers to their ``targets``. ``closing``: the fingers that close."""
    order = ""  # order of the fingers, in words
    if closing:
        hand.hand_guard(config)  # raises what a run would, before anything moves
        if config.guard.limit_mode != "each_motor" and set("BC") & set(closing):
            thumb = ", then the thumb alone" if "A" in closing else ""
            order = f"; B and C until contact at most{thumb}"

    def look() -> str:
        seen = preflight.read_active_hand(config)
        to = targets(seen.state.positions)
        if closing:
            preflight.check_close(config, seen, to)
        lab.warn_of_mode(config, opened=not closing)
        moving = config if closing else settings_to_open(config)
        return _motion(moving, seen.state.positions, to) + order

    def act(permit: MotionPermit | None) -> lab.Done:
        with hand.open_hand(config, permit, closing=bool(closing)) as opened:
            to = targets(opened.state.positions)
            lab.say(f"will {_motion(config, opened.state.positions, to)}{order}")
            moved = opened.close(to, lab.say) if closing else opened.move(to, lab.say)
        code = exits.DEVICE if moved.fault else exits.SUCCESS
        return lab.Done(moved.summary(), code=exits.SAFETY_STOP if moved.stopped_by else code)

    return lab.perform(args, config, lambda: f"{plan} at {_speed(config)}{order}", look, act,
                   lambda: lab.warn_of_mode(config))  # fmt: skip


def release(args: commands.ReleaseOptions) -> int:
    config = lab.hardware_config(args)

    def look() -> str:
        settings_to_open(config)  # raises without a calibration
        seen = preflight.read_hand(config)
        if not seen.state.active:
            if not args.activate:
                raise not_active_error(seen.state, "the same command with --activate")
            return f"activate the hand: {ALL}, then open it"
        lab.warn_of_mode(config, opened=True)
        return _motion(settings_to_open(config), seen.state.positions, OPEN) + _spread(seen.mode)

    def act(permit: MotionPermit | None) -> lab.Done:
        with hand.open_hand(config, permit, False, args.activate) as opened:
            will = _motion(settings_to_open(config), opened.state.positions, OPEN)
            lab.say(f"will {will}{_spread(opened.mode)}")
            moved = opened.open(lab.say)
        which, others = f"gripper at {gripper_address(config)}", other_devices(config)
        text = _listed(f"released on rig {args.rig}: {which}, {moved.summary()}",
                       [f"{device}: {state}" for device, state in others.items()])  # fmt: skip
        lab.warn_of_mode(config, opened=True)
        value = {"rig": args.rig, "gripper": which, "positions_counts": moved.positions_counts}
        return lab.Done(text, {**value, **others})

    return lab.perform(
        args, config, lambda: f"open all fingers at {_speed(settings_to_open(config))}", look, act
    )


def _motion(config: RunConfig, at: Counts3, to: Counts3) -> str:
    return f"move fingers from {at} to {to} counts at {_speed(config)}"


def _speed(config: RunConfig) -> str:
    """Speed and force, in words. Raises ConfigError without a calibration."""
    known = calibration(config)
    return f"{known.least_speed_mps * 1e3:g} mm/s, at most {known.least_force_n:g} N a motor"


def _spread(mode: int) -> str:
    """Additional motion of a hand that is commanded to open fully, in words."""
    return SCISSOR_NOTE if mode == SCISSOR else ""


def arm_step(args: commands.ArmStepOptions) -> int:
    config = lab.hardware_config(args)
    by_m = (args.x * 1e-3, args.y * 1e-3, args.z * 1e-3)
    arm.check_step(config, by_m)
    step = f"x {args.x:+g}, y {args.y:+g}, z {args.z:+g} mm"

    def plan() -> str:
        return f"move the arm at {arm_address(config)} by {step} at {ARM_SPEED}"

    def act(permit: MotionPermit | None) -> lab.Done:
        at_m = arm.step_arm(config, permit, by_m, lab.say)
        return lab.Done(f"the arm is at {_position(at_m)}, after {step}")

    return _perform_motion(args, config, plan, act)


def arm_back(args: commands.ArmBackOptions) -> int:
    config = lab.hardware_config(args)
    if config.devices.arm:
        raise UsageError("an arm of another package has no position here", "use `grasp arm step`")
    run, start_m = last_start(arm_address(config), args.run)

    def plan() -> str:
        up_m = arm.way_back(config, start_m)[2]
        return (f"move the arm at {arm_address(config)} by z {up_m * 1e3:+.1f} mm, "
                f"to where {run} began, at {ARM_SPEED}; nothing may be in its way, "
                "or in that of a held object")  # fmt: skip

    def act(permit: MotionPermit | None) -> lab.Done:
        at_m = arm.move_back(config, permit, start_m, lab.say)
        return lab.Done(f"the arm is at {_position(at_m)}, where {run} began")

    return _perform_motion(args, config, plan, act)


def _perform_motion(
    args: commands.MotionOptions,
    config: RunConfig,
    plan: Callable[[], str],
    act: Callable[[MotionPermit | None], lab.Done],
) -> int:
    """Run a command that moves the arm, or its dry run; arguments as of ``lab.perform``."""

    def look() -> str:
        preflight.check_arm(config)
        return plan()

    def warn() -> None:
        lab.say(f"will {plan()}")
        lab.warn_of_slow_arm(config)

    return lab.perform(args, config, plan, look, act, warn)


def arm_stop(args: commands.ArmStopOptions) -> int:
    config = lab.hardware_config(args)
    if args.dry_run:
        would = f"end any program that runs on the arm at {arm_address(config)}"
        return lab.print_done(args, lab.Done(would), "would")
    return lab.print_done(
        args,
        lab.Done(f"the arm is at {_position(arm.stop_arm(config))}, no program runs on it"),
    )


def _position(at_m: Vector3) -> str:
    return ", ".join(f"{axis} {m * 1e3:.1f}" for axis, m in zip("xyz", at_m, strict=True)) + " mm"
