"""`grasp calibrate fingertip`: fit the simulated fingertip to a real recording."""

import argparse
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, UsageError
from grasp.cli import exits
from grasp.cli.options import need, progress, whole
from grasp.cli.parser import verb
from grasp.cli.places import file_to_write, own_or_new, picture
from grasp.files import write_whole


def add_parser(kinds: Any) -> None:
    parser = verb(kinds, "fingertip", calibrate, "fit the simulated fingertip to a real recording, "
        "and show both side by side", ". The recording needs labelled strokes with pauses. "
        "Simulated recordings that the search did not use judge the fitted values. To use them, "
        "pass the --out file as --config to `grasp run`. The built-in values are fitted to the "
        "recording of the paper's authors.")  # fmt: skip
    parser.option("--recording PATH", "one fingertip, columns t_s,p0,p1,...,slip", Path,
        required=True)  # fmt: skip
    parser.flag("--check", "judge the built-in values without a search")
    parser.option("--rounds N", "rounds of the local search (default: 8)", whole(1, 1000))
    parser.option("--seed N", "random seed of the search; results of two seeds differ in what the "
        "recording does not determine", whole(0, 2**31 - 1), default=0)  # fmt: skip
    parser.option("--clips N", "number of simulated recordings that judge the "
        "result", whole(2, 100_000),
        default=48)  # fmt: skip
    parser.option("--out FILE.toml", "write the fitted values", file_to_write)
    parser.option("--figure FILE", "plot a simulated recording under the real one", picture)
    parser.flag("--json", "one JSON object on standard output, nothing else")


def calibrate(args: argparse.Namespace) -> int:
    import msgspec

    from detector.recordings import read
    from scenarios.acquire import fingertip_fit as fitting
    from scenarios.acquire.signal_statistics import signal_statistics

    if args.figure:
        need("charts", "matplotlib")
    if args.check and args.out:
        raise UsageError(
            "--out writes fitted values, but --check fits none", "leave out --out or --check"
        )
    recording = read(args.recording)
    if recording.fingers != 1 or recording.slip.all() or not recording.slip.any():
        remedy = "give one fingertip's labelled strokes with pauses between them"
        raise BadFile(
            args.recording, "needs one fingertip with samples of slip and of rest", remedy
        )
    if args.out:
        own_or_new(args.out, fitting.WRITTEN)
    real = signal_statistics(recording.t_s, recording.counts[:, 0], recording.slip)
    setup, fitted = (fitting.FitSetup(), {}) if args.check else _search(real, args)
    of = fitting.figures(setup, args.clips, fitting.JUDGE_SEED)
    rows, misfit = fitting.compare(real, of), fitting.misfit(real, fitting.mean(of))
    if args.out:
        write_whole(args.out, fitting.as_toml(fitted, args.recording.name).encode())
    if args.figure:
        _draw(args.figure, setup, recording)
    if args.json:
        report = {
            "recording": args.recording.name, "misfit": misfit, "statistics": rows,
            "parameters": fitting.parameter_values(setup), "fitted": not args.check,
        }  # fmt: skip
        print(msgspec.json.encode(report, enc_hook=float).decode())
    else:
        _print(rows, misfit, fitting.parameter_values(setup))
    return exits.SUCCESS


def _search(real: dict[str, float], args: argparse.Namespace) -> tuple[Any, dict[str, float]]:
    import msgspec

    from scenarios.acquire.fingertip_fit import FitSetup, Search, fit

    search = Search(seed=args.seed)
    if args.rounds is not None:
        search = msgspec.structs.replace(search, close_rounds=args.rounds)
    with progress("fitting", hidden=args.json) as show:
        return fit(
            real, FitSetup(), search,
            lambda done, total, best: show(done, total, f"fitting, misfit {best:.2f}"),
        )  # fmt: skip


def _draw(out: Path, setup: Any, recording: Any) -> None:
    from scenarios.acquire.fingertip_fit import JUDGE_SEED
    from scenarios.acquire.strokes import simulate
    from scenarios.report.export import draw_clips, simulated

    clips = simulate(setup.fingertip, setup.strokes, 4, JUDGE_SEED)
    real = ("recorded", recording.t_s - recording.t_s[0], recording.counts[:, 0], recording.slip)
    draw_clips(out, [real, *simulated(clips)[:2]])


def _print(rows: list[Any], misfit: float, parameters: list[Any]) -> None:
    print(f"{'statistic':28}{'real':>9}{'simulated':>11}{'10-90 % of clips':>20}{'ratio':>8}")
    for r in rows:
        ratio = f"{r.simulated / r.real:8.2f}" if r.real else " " * 8
        print(
            f"{r.name:28}{r.real:9.3g}{r.simulated:11.3g}{r.low:10.3g}{r.high:10.3g}{ratio}"
            f"{'' if r.within_aim else '  beyond the aim'}"
        )
    print(f"misfit {misfit:.2f} (1: on average just within the aims)\n")
    print(f"{'parameter':34}{'value':>9}  range searched")
    for name, value, low, high in parameters:
        print(f"{name:34}{value:9.3g}  {low:g} to {high:g}")
