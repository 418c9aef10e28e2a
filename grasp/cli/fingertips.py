"""`grasp tactile`: what the fingertips measure, and how their board is wired; `grasp calibrate
fingertip`: fit the simulated fingertip to a real recording."""

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, ConfigError, UsageError
from grasp.cli import exits
from grasp.cli.lab import add_command, lab_config
from grasp.cli.options import (
    check_new,
    check_writable,
    decimal,
    file_to_write,
    need,
    picture,
    share,
    whole,
)
from grasp.cli.output import aside, progress, show
from grasp.cli.parser import Parser
from grasp.files import write_whole

WATCH_S, REST_S = 3600.0, 5.0


def add_commands(parser: Parser) -> None:
    which = parser.command("identify", "press a pad and see which finger and taxel responds")
    which.runs(identify)
    which.option("--url URL", "an emulated board, tcp://HOST:PORT (default: usb.url, else the "
        "board on the USB bus)")  # fmt: skip
    which.option("--serial", "the board with this number (default: usb.serial, else the first)")
    which.option("--seconds N", "watch for N seconds", decimal(0.01, 86_400), default=10.0)
    which.option("--least-fall COUNTS", "a code this far below its rest code is a press (default: "
        "%(default)d, about half a newton; an untouched taxel varies by one or two)",
        whole(2, 1023), default=20)  # fmt: skip
    share(which, "config set json")
    watched = add_command(parser, "watch", "counts, noise and lost frames of each second, then of "
        "every taxel; begin unloaded", watch, moves=False)  # fmt: skip
    watched.option("--seconds N", "watch for N seconds (default: 3600, with --rest 5)",
        decimal(1, 86_400))  # fmt: skip
    watched.flag("--rest", "measure the rest codes of the unloaded hand and print them as "
        "tactile.rest_reference for your file")  # fmt: skip
    watched.option("--out FILE", "with --rest: write that file (a new one)", file_to_write)


def watch(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.lab.fingertips import listen

    if args.rest:
        return _measure_rest(args)
    if args.out is not None:
        raise UsageError("--out writes the rest codes", "give --rest with it")
    report, seconds, most = None, 0, args.seconds or WATCH_S
    with suppress(KeyboardInterrupt):  # the seconds until then are reported
        for report in listen(lab_config(args), most):
            seconds += 1
            if not args.json and seconds <= most:
                print(report.in_words(), flush=True)
    if report is None:
        return exits.report("interrupted", "interrupted", "", args.json)
    return show(args, {**msgspec.to_builtins(report), "exit_code": 0}, report.table())


def _measure_rest(args: argparse.Namespace) -> int:
    from scenarios.lab.fingertips import rest_file

    check_new(args.out)
    report, text = rest_file(lab_config(args), args.seconds or REST_S)
    if args.out is not None:
        write_whole(args.out, text.encode())
    if not args.json:
        aside(report.in_words())
    value = {"rest": report.codes, "samples": report.samples, "noise_counts": report.noise_counts}
    return show(args, {**value, "file": text, "exit_code": 0}, text.rstrip("\n"))


def identify(args: argparse.Namespace) -> int:
    from drivers.takktile.identify import watch
    from drivers.takktile.link.usb import UsbLink
    from scenarios.campaign.config import load_for_devices
    from scenarios.rigs.permission import HARDWARE
    from scenarios.rigs.wired import ANY_BOARD

    config = load_for_devices("can", HARDWARE, args.config, args.set)
    named = "" if config.usb.serial == ANY_BOARD else config.usb.serial
    strongest: dict[tuple[int, int], Any] = {}
    last, whole = None, False
    link = UsbLink.find(args.serial or named or None, _bus(args.url or config.usb.url))
    watched = watch(link, config.tactile, args.seconds, lambda: aside(
        f"press one pad after the other, for {args.seconds:g} s"), args.least_fall)  # fmt: skip
    try:
        with suppress(KeyboardInterrupt):  # what was pressed until then is reported
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


def _bus(url: str) -> Any:
    """pyusb back end: of an emulated board, or None for the machine's own USB."""
    if not url:
        return None
    from drivers.takktile.emulator.bus import backend

    try:
        return backend(url)
    except ValueError as error:
        raise ConfigError("--url", url, str(error), "tcp://HOST:PORT") from error


def _taxel(press: Any) -> str:
    cell = f"row {press.row}, column {press.column}"
    if press.finger is None:
        return f"no finger has this cell in `cells`: {cell}"
    return f"finger {press.finger} taxel {press.taxel} ({cell})"


def add_fit(parser: Parser) -> None:
    """`grasp calibrate fingertip`."""
    parser.runs(fit_fingertip, ". The recording needs labelled strokes with pauses. Simulated "
        "recordings that the search did not use judge the fitted values. To use them, pass the "
        "--out file as --config to `grasp run`. The built-in values are fitted to the recording of "
        "the paper's authors.")  # fmt: skip
    parser.option("--recording PATH", "one fingertip, columns t_s,p0,p1,...,slip", Path,
        required=True)  # fmt: skip
    parser.flag("--check", "judge the built-in values without a search")
    parser.option("--rounds N", "rounds of the local search (default: 8)", whole(1, 1000))
    parser.option("--seed N", "random seed of the search; results of two seeds differ in what the "
        "recording does not determine", whole(0, 2**31 - 1), default=0)  # fmt: skip
    parser.option("--clips N", "number of simulated recordings that judge the result",
        whole(2, 100_000), default=48)  # fmt: skip
    parser.option("--out FILE.toml", "write the fitted values", file_to_write)
    parser.option("--figure FILE", "plot a simulated recording under the real one", picture)
    share(parser, "json")


def fit_fingertip(args: argparse.Namespace) -> int:
    from detector.recordings import read
    from scenarios.acquire import fingertip_fit as fitting
    from scenarios.acquire.signal_statistics import signal_statistics

    if args.figure:
        need("charts", "matplotlib")
    if args.check and args.out:
        raise UsageError("--out writes fitted values, but --check fits none",
                         "leave out --out or --check")  # fmt: skip
    recording = read(args.recording)
    if recording.fingers != 1 or recording.slip.all() or not recording.slip.any():
        raise BadFile(args.recording, "needs one fingertip with samples of slip and of rest",
                      "give one fingertip's labelled strokes with pauses between them")  # fmt: skip
    if args.out:
        check_writable(args.out, fitting.WRITTEN)
    real = signal_statistics(recording.t_s, recording.counts[:, 0], recording.slip)
    setup, fitted = (fitting.FitSetup(), {}) if args.check else _search(real, args)
    simulated = fitting.figures(setup, args.clips, fitting.JUDGE_SEED)
    rows = fitting.compare(real, simulated)
    misfit = fitting.misfit(real, fitting.mean(simulated))
    if args.out:
        write_whole(args.out, fitting.as_toml(fitted, args.recording.name).encode())
    if args.figure:
        _draw(args.figure, setup, recording)
    parameters = fitting.parameter_values(setup)
    value = {"recording": args.recording.name, "misfit": misfit, "statistics": rows,
             "parameters": parameters, "fitted": not args.check}  # fmt: skip
    return show(args, value, _comparison(rows, misfit, parameters))


def _search(real: dict[str, float], args: argparse.Namespace) -> tuple[Any, dict[str, float]]:
    import msgspec

    from scenarios.acquire.fingertip_fit import FitSetup, Search, fit

    search = Search(seed=args.seed)
    if args.rounds is not None:
        search = msgspec.structs.replace(search, close_rounds=args.rounds)
    with progress("fitting", hidden=args.json) as bar:

        def tell(done: int, total: int, best: float) -> None:
            bar(done, total, f"fitting, misfit {best:.2f}")

        return fit(real, FitSetup(), search, tell)


def _draw(out: Path, setup: Any, recording: Any) -> None:
    from scenarios.acquire.fingertip_fit import JUDGE_SEED
    from scenarios.acquire.strokes import simulate
    from scenarios.report.run_figure import draw_clips, simulated

    clips = simulate(setup.fingertip, setup.strokes, 4, JUDGE_SEED)
    real = ("recorded", recording.t_s - recording.t_s[0], recording.counts[:, 0], recording.slip)
    draw_clips(out, [real, *simulated(clips)[:2]])


def _comparison(rows: list[Any], misfit: float, parameters: list[Any]) -> str:
    lines = [f"{'statistic':28}{'real':>9}{'simulated':>11}{'10-90 % of clips':>20}{'ratio':>8}"]
    for r in rows:
        ratio = f"{r.simulated / r.real:8.2f}" if r.real else " " * 8
        lines.append(
            f"{r.name:28}{r.real:9.3g}{r.simulated:11.3g}{r.low:10.3g}{r.high:10.3g}{ratio}"
            f"{'' if r.within_aim else '  beyond the aim'}"
        )
    lines.append(f"misfit {misfit:.2f} (1: on average just within the aims)\n")
    lines.append(f"{'parameter':34}{'value':>9}  range searched")
    lines += [
        f"{name:34}{value:9.3g}  {low:g} to {high:g}" for name, value, low, high in parameters
    ]
    return "\n".join(lines)
