"""`grasp detector`: score a slip detector on recordings, tune the scalar's threshold."""

import argparse
import json
from pathlib import Path
from typing import Any

from grasp.cli import exits, train

HELP = "score and tune slip detectors"
TUNING_OBJECTS = ("can", "box", "cardboard", "ball", "football", "foam")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("detector", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _add_evaluate(actions)
    _add_tune(actions)
    train.add_parser(actions)


def _add_evaluate(actions: Any) -> None:
    text = "score a detector on a labelled fingertip recording"
    parser = actions.add_parser(
        "evaluate",
        help=text,
        description=text + ". Samples from the hundredth on are scored; a miss counts as a delay "
        "that lasts until the slip ends.",
    )
    parser.add_argument("detector", metavar="NAME", help="one of config/detectors")
    parser.add_argument(
        "--recording", type=Path, required=True, metavar="PATH.csv",
        help="columns t_s,p0..p5,slip[,slip_true], counts with the rest value removed",
    )  # fmt: skip
    _add_common(parser)
    parser.set_defaults(handler=evaluate)


def _add_tune(actions: Any) -> None:
    text = "find the least threshold of `energy` within a budget of false events"
    parser = actions.add_parser(
        "tune",
        help=text,
        description=text + ", on simulated lifts in which nothing slips (all objects), or on "
        "recordings of your own in which nothing slips.",
    )
    parser.add_argument(
        "--budget", type=float, default=1.0, metavar="N",
        help="false events a minute, all fingers together (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--lifts", type=int, default=60, metavar="N",
        help="simulated lifts an object (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--static", type=Path, nargs="+", metavar="PATH.csv",
        help="tune on these recordings instead; samples labelled slip are an error",
    )  # fmt: skip
    _add_common(parser)
    parser.set_defaults(handler=tune)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config", type=Path, metavar="FILE",
        help="TOML over the packaged settings (default: $GRASP_CONFIG)",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="one setting; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )


def evaluate(args: argparse.Namespace) -> int:
    import msgspec

    from detector.recordings import read_csv
    from scenarios.config import load_config

    config = load_config("can", "simulated", args.detector, args.config, args.set)
    scores = score(config, read_csv(args.recording))
    if args.json:
        print(msgspec.json.encode(scores).decode())
    else:
        print(scores_text(scores))
    return exits.SUCCESS


def score(config: Any, recording: Any) -> Any:
    """Evaluation of the configured detector and rule on a recording."""
    from detector.evaluation import evaluate_recording
    from detector.interface import load_detector
    from grasp.clock import stopwatch_ns

    detector = load_detector(config.detector_name, config.detector, recording.fingers)
    return evaluate_recording(detector, config.rule, recording, clock_ns=stopwatch_ns)


def scores_text(s: Any) -> str:
    """The score sheet as a person reads it."""
    low, high = s.auc_interval or (float("nan"), float("nan"))
    lines = [
        f"{s.detector} on {s.data}: {s.n_samples} samples",
        f"  AUC {_number(s.auc)} [{low:.3f}, {high:.3f}]  accuracy {s.accuracy:.3f} at the "
        f"deployed threshold ({_number(s.threshold_counts)} counts)  F1 slip {s.slip_f1:.3f}, "
        f"weighted {s.weighted_f1:.3f}",
        f"  slip events: {s.true_events - s.missed_events} of {s.true_events} caught, "
        f"{s.false_events} false ({_number(s.false_events_per_min)} a minute of rest)",
        f"  delay {_quantiles(s.delay_ms, 'ms')}  release {_quantiles(s.release_delay_ms, 'ms')}",
        f"  cost of one update {_quantiles(s.compute_us, 'us')}",
    ]
    edges = ", ".join(
        f"{b.from_ms:g}-{'' if b.to_ms is None else format(b.to_ms, 'g')} ms {_number(b.accuracy)}"
        for b in s.by_edge_distance
    )
    return "\n".join([*lines, f"  accuracy by distance to the label's edge: {edges}"])


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _quantiles(q: Any, unit: str) -> str:
    return "-" if q is None else f"p50 {q.p50:.0f} p90 {q.p90:.0f} p99 {q.p99:.0f} {unit}"


def tune(args: argparse.Namespace) -> int:
    if args.static:
        threshold, minutes = _tune_on_recordings(args)
    else:
        threshold, minutes = _tune_on_lifts(args)
    if args.json:
        print(json.dumps({"threshold_counts": threshold, "minutes": minutes}))
    else:
        print(f"threshold_counts = {threshold:.3g}  # {args.budget:g} false events a minute, "
              f"tuned on {minutes:.1f} minutes")  # fmt: skip
    return exits.SUCCESS


def _tune_on_lifts(args: argparse.Namespace) -> tuple[float, float]:
    from rich.console import Console
    from rich.progress import Progress

    from scenarios.config import load_config
    from scenarios.tune import tune as tune_on_lifts

    configs = [
        load_config(name, "simulated", "energy", args.config, args.set) for name in TUNING_OBJECTS
    ]
    with Progress(console=Console(stderr=True), transient=True, disable=args.json) as bar:
        task = bar.add_task("static lifts", total=None)
        return tune_on_lifts(
            configs, args.lifts, args.budget,
            lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip


def _tune_on_recordings(args: argparse.Namespace) -> tuple[float, float]:
    from detector.energy import tune_threshold
    from detector.recordings import BadRecording, read_csv
    from scenarios.config import load_config

    config = load_config("can", "simulated", "energy", args.config, args.set)
    recordings = [read_csv(path) for path in args.static]
    for recording in recordings:
        if recording.slip.any():
            raise BadRecording(
                recording.source, None, "holds samples labelled slip", "give recordings at rest"
            )
    threshold = tune_threshold(
        [r.counts for r in recordings], config.detector, config.rule, args.budget
    )
    return threshold, sum(len(r.t_s) for r in recordings) * config.loop.period_s / 60
