"""`grasp calibrate`: measure counts, force bytes and noise on real devices and write them into
files. `grasp tactile`: show fingertip measurements and the wiring of their board."""

import math
import tomllib
from collections.abc import Callable
from contextlib import suppress

import msgspec

from detector.decision import RuleSettings
from detector.scores.label_free import CalibratedRule, find_hold
from drivers.errors import ConfigError, UsageError
from drivers.takktile.emulator.bus import EmulatedBus, backend
from drivers.takktile.identify import TaxelPress, watch
from drivers.takktile.link import UsbLink
from grasp.cli import device_commands as commands
from grasp.cli import exits, lab
from grasp.cli.detector import rule_lines
from grasp.cli.options import check_new
from grasp.cli.output import print_status, show
from grasp.cli.questions import TerminalOperator, confirm
from grasp.files import write_whole
from scenarios.campaign.config import RunConfig, load_config, load_for_devices
from scenarios.lab import calibrate, fingertips, preflight
from scenarios.lab.hand import hand_guard
from scenarios.rigs.calibration import MANUAL
from scenarios.rigs.config import HARDWARE
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.wired import ANY_BOARD
from scenarios.trial.operator_prompts import Operator

ON_SCALE = (
    "One finger presses on a scale, harder than the force limit of a run. Is only that fingertip "
    "over the scale, and no object in the hand?"
)
CLOSED = (255, 255, 255)
WATCH_S, REST_S = 3600.0, 5.0
LEAST_FALL_COUNTS = 20  # of a press: half a newton; an unloaded taxel varies by one or two
PRESSES = 10  # with force byte 0

Act = Callable[[MotionPermit | None, Operator], str]


def calibrate_force(args: commands.ForceOptions) -> int:
    config = lab.hardware_config(args)
    check_new(args.out)
    up_to_n = config.guard.force_limit_n if args.up_to is None else args.up_to

    def look() -> str:
        preflight.check_rest(config)
        return "move nothing"

    def act(permit: MotionPermit | None, operator: Operator) -> str:
        fingers = "ABC" if args.finger == "all" else args.finger
        return calibrate.calibrate_force(
            config, fingers, up_to_n, operator, print_status, args.note
        )

    return _measure(args, config, look, look, act, moves=False)


def calibrate_hand(args: commands.HandOptions) -> int:
    config = lab.hardware_config(args)
    check_new(args.out)
    calibrate.check_force(args.up_to)

    def plan() -> str:
        return (
            f"move finger {args.finger} {PRESSES} times onto the scale, with force byte 0 "
            f"({MANUAL.least_force_n:g} N by the manual, at most --up-to {args.up_to:g} N)"
        )

    def look() -> str:
        preflight.check_pressing(config)
        lab.warn_of_mode(config)
        return plan()

    def act(permit: MotionPermit | None, operator: Operator) -> str:
        return calibrate.calibrate_hand(
            config, permit, args.finger, PRESSES, args.up_to, operator, print_status, args.note
        )

    def how_to_use(text: str) -> str:
        limit_n = config.guard.force_limit_n
        least_n = math.ceil(tomllib.loads(text)["calibration"]["least_force_n"])
        lines = "\nfor your settings file, with each section once:\n\n"
        lines += f'[gripper]\ncalibration = "{args.out}"'
        if least_n > limit_n:
            lines += (f"\n[guard]\nforce_limit_n = {least_n}  # this hand cannot keep {limit_n:g}\n"
                      f"[controller]\ngrip_force_n = {least_n}")  # fmt: skip
        return lines

    return _measure(
        args, config, plan, look, act, lambda: confirm(ON_SCALE, "scale", args.scale), how_to_use
    )


def calibrate_noise(args: commands.NoiseOptions) -> int:
    from scenarios.benchmark.label_free import tune_without_labels

    config = lab.hardware_config(args)
    detector_config = load_config("can", args.rig, args.detector, args.config, args.set)
    check_new(args.out)
    hand_guard(config)  # raises where a run would be refused

    def plan() -> str:
        hold = f"close on an object for {args.seconds:g} s, then open"
        return f"move the fingers: {hold}; the arm does not move"

    def look() -> str:
        preflight.check_close(config, preflight.read_active_hand(config), CLOSED)
        lab.warn_of_mode(config)
        return plan()

    def act(permit: MotionPermit | None, operator: Operator) -> str:
        counts = calibrate.record_still_object(config, permit, args.seconds, operator, print_status)
        found = tune_without_labels(detector_config, [(counts, *find_hold(counts))], args.budget)
        return _rule_file(args, found, detector_config.rule)

    return _measure(args, config, plan, look, act)


def _measure(
    args: commands.CalibrateOptions, config: RunConfig, plan: Callable[[], str],
    look: Callable[[], str], act: Act, ask_more: Callable[[], None] = lambda: None,
    afterwards: Callable[[str], str] = lambda text: "", moves: bool = True,
) -> int:  # fmt: skip
    """Run a measurement with an operator. ``act`` returns the text of the file, which is written
    and shown. ``ask_more`` asks more before a motion; ``afterwards``: how to use the file."""
    operator = TerminalOperator()

    def ask() -> None:
        if moves:
            lab.warn_of_mode(config)
            ask_more()
        operator.expect()
        if moves:
            lab.say(f"will {plan()}")

    def run(permit: MotionPermit | None) -> lab.Done:
        text = act(permit, operator)
        write_whole(args.out, text.encode())
        if usage := afterwards(text):
            print_status(usage)
        return lab.Done(f"{text}{args.out}", {"file": str(args.out), "text": text})

    return lab.perform(args, config, plan, look, run, ask, moves)


def _rule_file(args: commands.NoiseOptions, found: CalibratedRule, configured: RuleSettings) -> str:
    """Text of the file. The threshold is never below the ``configured`` one, because a hand at rest
    gives no data on closing, lifting or taps."""
    name = "threshold"
    levels: tuple[float, ...] = found.level, *found.interval
    if configured.kind == "cusum":
        name = "limit"
    else:  # of a probability; the levels are log-odds
        levels = tuple(1.0 / (1.0 + math.exp(-level)) for level in levels)
    allowed, low, high = (f"{level:.4f}" for level in levels)
    before, used = getattr(configured, name), getattr(found.rule, name)
    how = "higher and is used" if used == before else f"lower, so {allowed} is used"
    source = (
        f"a hold of {found.minutes:.1f} minutes, {calibrate.now()}, {args.detector}: for "
        f"{args.budget:g} false alarms a minute this noise allows a {name} of {allowed} ({low} to "
        f"{high}, 95 %), at {found.load_counts:.0f} counts of load; the configured {name}, "
        f"{before:.4f}, is {how}"
    )
    lines = [
        "[source]",
        f"rule = {calibrate.quoted_source(source, args.note)}",
        *rule_lines(found.rule),
    ]
    return "\n".join(lines) + "\n"


def tactile_watch(args: commands.WatchOptions) -> int:
    if args.rest:
        return _measure_rest(args)
    if args.out is not None:
        raise UsageError("--out writes the rest codes and needs --rest", "add --rest")
    report, seconds, most = None, 0, args.seconds or WATCH_S
    with suppress(KeyboardInterrupt):  # what was measured before is reported
        for report in fingertips.watch(lab.hardware_config(args), most):
            seconds += 1
            if not args.json and seconds <= most:
                print(report.summary(), flush=True)
    if report is None:
        return exits.report("interrupted", "interrupted", "", args.json)
    return show(args, {**msgspec.to_builtins(report), "exit_code": 0}, report.table())


def _measure_rest(args: commands.WatchOptions) -> int:
    check_new(args.out)
    report, text = fingertips.rest_file(lab.hardware_config(args), args.seconds or REST_S)
    if args.out is not None:
        write_whole(args.out, text.encode())
    if not args.json:
        print_status(report.summary())
    value = {"rest": report.codes, "samples": report.samples, "noise_counts": report.noise_counts}
    return show(args, {**value, "file": text, "exit_code": 0}, text.rstrip("\n"))


def tactile_identify(args: commands.IdentifyOptions) -> int:
    config = load_for_devices("can", HARDWARE, args.config, args.set)
    named = "" if config.usb.serial == ANY_BOARD else config.usb.serial
    strongest: dict[tuple[int, int], TaxelPress] = {}
    last, whole = None, False
    link = UsbLink.find(named or None, _bus(args.url or config.usb.url))
    watched = watch(link, config.tactile, args.seconds, lambda: print_status(
        f"press one pad after the other, for {args.seconds:g} s"), LEAST_FALL_COUNTS)  # fmt: skip
    try:
        with suppress(KeyboardInterrupt):  # what was pressed before is reported
            for press in watched:
                cell = press.row, press.column
                if cell not in strongest or press.fall_counts > strongest[cell].fall_counts:
                    strongest[cell] = press
                if not args.json and cell != last:
                    print(_taxel(press), flush=True)
                last = cell
            whole = True
    finally:
        watched.close()  # stops the board
        link.close()
    if not (whole or strongest):
        return exits.report("interrupted", "interrupted", "", args.json)
    presses = sorted(strongest.values(), key=lambda press: -press.fall_counts)
    code, text = exits.TRIAL_FAILED, "no pad was pressed"
    if presses:
        text = f"strongest: {_taxel(presses[0])}, {presses[0].fall_counts} counts below its rest"
        code = exits.SUCCESS
    return show(args, {"presses": presses, "exit_code": code}, text, code)


def _bus(url: str) -> EmulatedBus | None:
    """pyusb back end of an emulated board, or None for this machine's USB."""
    if not url:
        return None
    try:
        return backend(url)
    except ValueError as error:
        raise ConfigError("--url", url, str(error), "tcp://HOST:PORT") from error


def _taxel(press: TaxelPress) -> str:
    cell = f"row {press.row}, column {press.column}"
    if press.finger is None:
        return f"cell of no finger (not in `cells`): {cell}"
    return f"finger {press.finger} taxel {press.taxel} ({cell})"
