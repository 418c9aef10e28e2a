"""`grasp world`: how true the simulated world is, and what its parameters are."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, UsageError
from grasp.cli import exits, physics, yardstick
from grasp.cli.options import need, progress, seed, whole
from grasp.cli.pictures import picture
from grasp.cli.places import file_to_write, own_or_new
from grasp.files import write_whole

HELP = "fit and judge the simulated world, choose its physics"
SHOWN_OF_ABLATIONS = {
    "AUC of energy": "AUC", "increment rms static": "static", "increment rms slip": "slip",
    "increment ratio": "ratio", "correlation static": "corr st", "correlation slip": "corr sl",
    "25 Hz slip": "25 Hz", "highest excursion": "highest", "creep after a stop per s": "creep",
}  # fmt: skip


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("world", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _add_calibrate(actions)
    _add_strokes(actions)
    physics.add_plan(actions)
    physics.add_check(actions)
    yardstick.add_delay(actions)


def _add_calibrate(actions: Any) -> None:
    text = "fit the simulated fingertip to a real recording, and show both side by side"
    parser = actions.add_parser(
        "calibrate",
        help=text,
        description=text + ". The recording should be strokes with pauses, labelled. Fitted values "
        "are judged on simulated clips that the search has not seen. To use them, pass the file "
        "written by --out as --config to `grasp run`; the built-in values are those fitted "
        "to the clip of the paper's authors.",
    )
    parser.add_argument(
        "--recording", type=Path, required=True, metavar="PATH",
        help="one fingertip, columns t_s,p0,p1,...,slip",
    )  # fmt: skip
    parser.add_argument(
        "--check", action="store_true", help="judge the built-in values; search for no others"
    )
    parser.add_argument(
        "--data", type=Path, action="append", default=[], metavar="DIR",
        help="with --check: judge this data set beside the recording, instead of strokes like its "
        "own; may be given several times",
    )  # fmt: skip
    parser.add_argument(
        "--rounds",
        type=whole(1, 1000),
        metavar="N",
        help="of the closer half of the search (default: 8)",
    )
    parser.add_argument(
        "--seed", type=whole(0, 2**31 - 1), default=0, metavar="N",
        help="another search; how far two differ is what the recording does not tell",
    )  # fmt: skip
    parser.add_argument(
        "--clips", type=whole(2, 100_000), default=48, metavar="N",
        help="simulated clips that the result is judged on (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--ablate", action="store_true", help="show the figures with each ingredient left out"
    )
    parser.add_argument(
        "--recordings", type=whole(4, 100_000), default=30, metavar="N",
        help="with --data and --ablate: made anew without each term of the part `compliant` "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=file_to_write, metavar="FILE.toml", help="write the fitted values"
    )
    parser.add_argument(
        "--figure", type=picture, metavar="FILE", help="draw a simulated clip under the recording"
    )
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )
    parser.set_defaults(handler=calibrate)


def _add_strokes(actions: Any) -> None:
    text = "draw what the simulated fingertip reads while it is slid there and back"
    parser = actions.add_parser("strokes", help=text, description=text)
    parser.add_argument(
        "--out", type=picture, required=True, metavar="FILE", help=".svg, .png or .pdf"
    )
    parser.add_argument("--seed", type=seed, default=0, metavar="N")
    parser.set_defaults(handler=strokes)


def strokes(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from scenarios.report.run_figure import draw_clips, simulated
    from scenarios.studies.signal.calibrate import FitSetup
    from scenarios.studies.signal.strokes import simulate

    setup = FitSetup()
    clips = simulate(setup.fingertip, setup.strokes, 2, args.seed)
    draw_clips(args.out, simulated(clips))
    print(args.out)
    return exits.SUCCESS


def calibrate(args: argparse.Namespace) -> int:
    import msgspec

    from detector.recordings import read
    from scenarios.studies.signal import calibrate as fitting
    from scenarios.studies.signal.statistics import signal_statistics

    if args.figure:
        need("charts", "matplotlib")
    _check_wishes(args)
    recording = read(args.recording)
    if recording.fingers != 1 or recording.slip.all() or not recording.slip.any():
        remedy = "give strokes with pauses between them, labelled"
        raise BadFile(args.recording, "not one fingertip in slip and at rest", remedy)
    if args.out:
        own_or_new(args.out, fitting.WRITTEN)
    if args.data:
        return _judge_data(args, recording)
    counts = recording.counts[:, 0]
    real = signal_statistics(recording.t_s, counts, recording.slip)
    setup, fitted = (fitting.FitSetup(), {}) if args.check else _search(real, args)
    of = fitting.figures(setup, args.clips, fitting.JUDGE_SEED)
    rows, misfit = fitting.compare(real, of), fitting.misfit(real, fitting.mean(of))
    without = _ablate(setup, args) if args.ablate else {}
    if args.out:
        write_whole(args.out, fitting.as_toml(fitted, args.recording.name).encode())
    if args.figure:
        _draw(args.figure, setup, recording)
    if args.json:
        report = {
            "recording": args.recording.name, "misfit": misfit, "statistics": rows,
            "parameters": fitting.parameter_values(setup), "fitted": not args.check,
            "ablations": without, "data_set": fitting.data_set_levels(setup, args.clips // 2),
        }  # fmt: skip
        print(msgspec.json.encode(report, enc_hook=lambda array: array.tolist()).decode())
    else:
        _print(real, rows, misfit, setup, without)
        _print_levels(fitting.data_set_levels(setup, args.clips // 2))
    return exits.SUCCESS


def _check_wishes(args: argparse.Namespace) -> None:
    if args.data and not args.check:
        raise UsageError("--data judges, it does not search", "give --check with it")
    if args.check and args.out:
        raise UsageError("--out writes fitted values, and --check fits none", "leave one out")
    if args.data and args.figure:
        raise UsageError("--figure draws strokes like the recording's, not --data", "leave one out")


def _judge_data(args: argparse.Namespace, recording: Any) -> int:
    """What `--data` asks for."""
    import msgspec

    from grasp.cli import judge_view
    from scenarios.benchmark.data_sets import read_set
    from scenarios.studies.signal.judge.report import by_part, clip_of, judge

    if args.ablate:
        return _ablate_data(args, clip_of(recording))
    clip, found = clip_of(recording), []
    for folder in args.data:
        with progress(f"judging {folder}", hidden=args.json) as show:
            made = read_set(folder, tell=exits.say)
            _check_taxels(folder, made, recording)
            groups, parts = by_part(made), []
            for part, recordings in groups.items():
                parts.append(judge(clip, recordings, f"{folder} {part}".rstrip(), args.seed))
                show(len(parts), len(groups))
        if not any(parts):
            remedy = (
                "give a data set of strokes, such as config/datasets/paper.toml; a small --share "
                "of one has short recordings, 0.2 is enough"
            )
            raise BadFile(folder, "no strokes of one fingertip as long as the recording", remedy)
        found += [part for part in parts if part is not None]
    if args.json:
        print(msgspec.json.encode(found).decode())
    else:
        for judgement in found:
            judge_view.show(judgement)
    return exits.SUCCESS


def _check_taxels(folder: Path, made: Sequence[Any], recording: Any) -> None:
    wanted = recording.counts.shape[2]
    for r in made:
        if r.counts.shape[2] != wanted:
            problem = f"fingertips of {r.counts.shape[2]} taxels, the recording's of {wanted}"
            raise BadFile(folder, problem, "compare what has the same layout")


def _ablate_data(args: argparse.Namespace, clip: Any) -> int:
    """What `--data --ablate` asks for: the first data set's compliant part without each term."""
    import msgspec

    from grasp.cli import judge_view
    from scenarios.studies.signal.judge.report import without
    from scenarios.studies.signal.terms import TERMS, jobs_without, made, origin_of

    config, found = origin_of(args.data[0]), []
    with progress("leaving out", hidden=args.json) as show:
        for term, changes in {"": {}, **TERMS}.items():
            recordings = list(made(jobs_without(config, changes, args.recordings)))
            found.append(without(clip, recordings, term))
            show(len(found), 1 + len(TERMS), term)
    if args.json:
        print(msgspec.json.encode(found).decode())
    else:
        judge_view.show_without(found[0], found[1:])
    return exits.SUCCESS


def _search(real: dict[str, float], args: argparse.Namespace) -> tuple[Any, dict[str, float]]:
    import msgspec

    from scenarios.studies.signal.calibrate import FitSetup, Search, fit

    search = Search(seed=args.seed)
    if args.rounds is not None:
        search = msgspec.structs.replace(search, close_rounds=args.rounds)
    with progress("fitting", hidden=args.json) as show:
        return fit(
            real, FitSetup(), search,
            lambda done, total, best: show(done, total, f"fitting, misfit {best:.2f}"),
        )  # fmt: skip


def _ablate(setup: Any, args: argparse.Namespace) -> dict[str, dict[str, float]]:
    from scenarios.studies.signal.calibrate import ablations

    with progress("leaving out", hidden=args.json) as show:
        return ablations(setup, args.clips, show)


def _draw(out: Path, setup: Any, recording: Any) -> None:
    from scenarios.report.run_figure import draw_clips, simulated
    from scenarios.studies.signal.calibrate import JUDGE_SEED
    from scenarios.studies.signal.strokes import simulate

    clips = simulate(setup.fingertip, setup.strokes, 4, JUDGE_SEED)
    draw_clips(
        out,
        [
            ("recorded", recording.t_s - recording.t_s[0], recording.counts[:, 0], recording.slip),
            *simulated(clips)[:2],
        ],
    )


def _print(
    real: dict[str, float], rows: list[Any], misfit: float, setup: Any, without: Any
) -> None:
    from scenarios.studies.signal.calibrate import misfit as misfit_of
    from scenarios.studies.signal.calibrate import parameter_values

    print(f"{'statistic':28}{'real':>9}{'simulated':>11}{'10-90 % of clips':>20}{'ratio':>8}")
    for r in rows:
        ratio = f"{r.simulated / r.real:8.2f}" if r.real else " " * 8
        print(
            f"{r.name:28}{r.real:9.3g}{r.simulated:11.3g}{r.low:10.3g}{r.high:10.3g}{ratio}"
            f"{'' if r.within_aim else '  beyond the aim'}"
        )
    print(f"misfit {misfit:.2f} (1: on average just within the aims)\n")
    print(f"{'parameter':34}{'value':>9}  range searched")
    for name, value, low, high in parameter_values(setup):
        print(f"{name:34}{value:9.3g}  {low:g} to {high:g}")
    if without:
        shown = SHOWN_OF_ABLATIONS
        print(
            f"\n{'left out':34}{'misfit':>8}" + "".join(f"{short:>10}" for short in shown.values())
        )
        for name, figures in without.items():
            cells = "".join(f"{figures[key]:10.3g}" for key in shown)
            print(f"{name:34}{misfit_of(real, figures):8.2f}{cells}")


def _print_levels(levels: Any) -> None:
    from scenarios.studies.signal.calibrate import AUTHORS_DATA_SET

    print("\nlevels a taxel, strokes of all forces and zero loads | the authors' data set")
    simulated = (levels.mean, levels.std, levels.least, levels.most)
    names = ("mean", "deviation", "least", "most")
    for name, mine, theirs in zip(names, simulated, AUTHORS_DATA_SET, strict=True):
        cells = [" ".join(f"{x:5.0f}" for x in values) for values in (mine, theirs)]
        print(f"{name:10}{cells[0]} | {cells[1]}")
