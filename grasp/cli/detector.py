"""`grasp detector`: score, tune and train slip detectors."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import card, exits, train
from grasp.cli.options import add_settings, decimal, one_by_one
from grasp.cli.output import json_line
from grasp.cli.parser import group, verb
from grasp.cli.places import file_to_write, own_or_new
from grasp.cli.rules import check_named, tell_untuned
from grasp.files import write_whole

HELP = "score, tune and train slip detectors"
FEW_SLIPS = 50  # to tune on: 14 points either way of a recall of a half
FEW_EVENTS = 5  # that the minutes tuned on may have
MOST_BUDGET = 6000
SHORT_MINUTES = 2.0


def add_parser(verbs: Any) -> None:
    actions = group(verbs, "detector", HELP)
    _add_evaluate(actions)
    _add_tune(actions)
    card.add_parser(actions)
    train.add_parser(actions)


def _add_evaluate(actions: Any) -> None:
    parser = verb(actions, "evaluate", evaluate, "score detectors on labelled fingertip recordings",
        ". Scores the samples from the hundredth of a recording on; a miss counts as an infinite "
        "delay.")  # fmt: skip
    parser.option("detector NAME", "one or more of config/detectors", nargs="+")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "--recording", type=Path, metavar="RUN|FILE",
        help="folder of `grasp run acquire`, .npz, or CSV with t_s,p0,p1,...,slip[,slip_true], "
        "counts with the rest value removed",
    )  # fmt: skip
    source.add_argument(
        "--data",
        type=Path,
        nargs="+",
        metavar="DIR",
        help="folders of `grasp dataset build`, or `collect`",
    )
    parser.option("--split", "with --data: the split to score; `all` is fair only on a set built "
        "from another seed",
        choices=("train", "validation", "test", "all"), default="test")  # fmt: skip
    parser.option("--label", "slip: by the fingertip's speed, as in the paper; slip_true: the "
        "contact itself slides; moved: 1 mm from where it last rested",
        choices=("slip", "slip_true", "moved"), default="slip")  # fmt: skip
    parser.option("--out FILE.json", "write the scores, those of each rule in the sweep of "
        "`tune`, and the worst misses; `grasp report FILE.json` makes a page of it",
        file_to_write)  # fmt: skip
    add_settings(parser)
    parser.flag("--json", "JSON on standard output, one object a detector, nothing else")


def _add_tune(actions: Any) -> None:
    parser = verb(actions, "tune", tune, "find the quickest decision within a budget of false "
        "events", ". With --data: kind, threshold and length of the decision rule, on the split "
        "`validation`; with --unlabelled its threshold, on holds in which nothing "
        "slips.")  # fmt: skip
    parser.option("detector NAME", "one of config/detectors, or your own")
    parser.option("--budget N", "false events a minute of all three fingers; too little rest for "
        "one event is refused; 0: none in the rest that the data have", decimal(0, MOST_BUDGET),
        default=1.0)  # fmt: skip
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "--data", type=Path, nargs="+", metavar="DIR",
        help="folders of `grasp dataset build`, or `collect`",
    )  # fmt: skip
    source.add_argument(
        "--unlabelled", type=Path, nargs="+", metavar="RUN|FILE",
        help="minutes of hold in which nothing slips, each ended by opening the hand: folders of "
        "lifts with a long controller.hold_s, .npz or .csv",
    )  # fmt: skip
    add_settings(parser)
    parser.flag("--json", "JSON on standard output, one object a detector, nothing else")


def evaluate(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.benchmark.evaluation_file import BEGINS, evaluated

    if args.out is not None:
        own_or_new(args.out, BEGINS)
    check_named(args.detector, args.config, args.set)
    kept = []
    for made in _contenders(args):
        sheet = made.evaluation()
        if args.json:
            print(msgspec.json.encode(sheet).decode(), flush=True)
        else:
            print(scores_text(sheet, made.config.rule), flush=True)
        if args.out is not None:
            kept.append(evaluated(made, sheet))
    if args.out is not None:
        _keep(args, kept)
    return exits.SUCCESS


def _keep(args: argparse.Namespace, kept: list[Any]) -> None:
    """The file of an evaluation, and where it is."""
    import shlex

    import msgspec

    from scenarios.benchmark.evaluation_file import EvaluationFile
    from scenarios.trial.result import versions

    source = ["--data", *map(str, args.data)] if args.data else ["--recording", str(args.recording)]
    words = ["grasp", "detector", "evaluate", *args.detector, *source, "--label", args.label]
    words += ["--split", args.split] if args.data else []
    for option, values in (("--set", args.set), ("--config", args.config or ())):
        words += [word for value in values for word in (option, str(value))]
    command = shlex.join(words)
    file = EvaluationFile(
        data=_data_name(args), label=args.label, command=command, versions=versions(),
        detectors=kept,
    )  # fmt: skip
    write_whole(args.out, msgspec.json.encode(file), private=True)
    if not args.json:
        print(args.out)


def _data_name(args: argparse.Namespace) -> str:
    if args.recording is not None:
        return str(args.recording)
    return f"{' '.join(folder.name for folder in args.data)}, {args.split}"


def _contenders(args: argparse.Namespace) -> Any:
    """Each detector, as soon as it has been streamed."""
    from scenarios.benchmark.data_sets import read_labelled
    from scenarios.benchmark.scoring import contender, read_split
    from scenarios.trial.layers import trial_layers

    if args.recording is not None:
        recordings = read_labelled(args.recording)
    else:
        recordings = read_split(args.data, args.split, exits.say)
    data = _data_name(args)
    for name, tell in one_by_one(args.detector, "streaming", hidden=args.json):
        made = contender(name, recordings, data, args.label, args.config, args.set, tell)
        tell_untuned(made.config, trial_layers("can", "simulated", name, args.config, args.set))
        yield made


def scores_text(s: Any, rule: Any) -> str:
    """The score sheet as a person reads it, with the rule that makes events of samples."""
    from scenarios.report.run_decision import in_words

    lines = [
        f"{s.detector} on {s.data}: {s.n_samples} samples, label {s.label}",
        f"  AUC {_number(s.auc)}{_interval(s, 'auc')}  accuracy {s.accuracy:.3f}"
        f"{_interval(s, 'accuracy')} of samples, slip above {_threshold(s)}  "
        f"F1 slip {s.slip_f1:.3f}, weighted {s.weighted_f1:.3f}  ECE {s.ece:.3f}",
        f"  events: {in_words(rule)}",
        f"  slip events: {s.true_events - s.missed_events} of {s.true_events} caught, "
        f"{s.false_events} false ({_number(s.false_events_per_min)} a minute of rest"
        f"{_interval(s, 'false_events_per_min')}, {_number(s.false_events_per_min_hand)} of a "
        f"hand's)",
        f"  delay {_quantiles(s.delay_ms, 'ms')}{_interval(s, 'delay_ms_p50')}"
        f"{'' if s.delay_mm is None else ', ' + _quantiles(s.delay_mm, 'mm', 1)}  "
        f"release of those caught {_quantiles(s.release_delay_ms, 'ms')}",
        f"  cost of one update {_quantiles(s.compute_us, 'us')}",
    ]
    if len(s.false_events_per_min_by_cause) > 1:
        causes = s.false_events_per_min_by_cause.items()
        lines.append("  a minute: " + ", ".join(f"{cause} {rate:.2f}" for cause, rate in causes))
    if s.blows is not None:
        b = s.blows
        lines.append(
            f"  blows registered: {b.registered} of {b.moved} that moved it 1 mm, within 100 ms "
            f"{b.far_registered} of {b.far} that moved it 2 mm, {b.unmoved_registered} of "
            f"{b.unmoved} that left it within half a millimetre"
        )
    edges = ", ".join(
        f"{b.from_ms:g}-{'' if b.to_ms is None else format(b.to_ms, 'g')} ms {_number(b.accuracy)}"
        for b in s.by_edge_distance
    )
    return "\n".join([*lines, f"  accuracy by distance to the label's edge: {edges}"])


def _threshold(s: Any) -> str:
    return f"{s.threshold:g}" if s.threshold_counts is None else f"{s.threshold_counts:.3f} counts"


def _interval(s: Any, name: str) -> str:
    if name not in s.intervals:
        return ""
    low, high = s.intervals[name]
    return f" [{low:.0f}, {high:.0f}]" if name.startswith("delay") else f" [{low:.3f}, {high:.3f}]"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _quantiles(q: Any, unit: str, digits: int = 0) -> str:
    if q is None:
        return "-"
    return f"p50 {q.p50:.{digits}f} p90 {q.p90:.{digits}f} p99 {q.p99:.{digits}f} {unit}"


def tune(args: argparse.Namespace) -> int:
    check_named([args.detector], args.config, args.set)
    return _tune_unlabelled(args) if args.unlabelled else _tune_rule(args)


def _tune_rule(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.benchmark.scoring import contender, evidence, read_split, tune_rule

    recordings = read_split(args.data, "validation", exits.say)
    (name,) = [args.detector]
    for _, tell in one_by_one([name], "tuning", hidden=args.json):
        made = contender(name, recordings, "validation", "slip", args.config, args.set, tell)
        rest = evidence(made.streams, made.config.rule).minutes  # whatever the rule
        must_test(rest, args.budget, "more `validation` recordings or simulated sets beside, of "
                  "a finger alone three times as much")  # fmt: skip
        chosen = tune_rule(made, args.budget, tell)
    if chosen is None:
        remedy = "allow more false events with --budget"
        text = f"no rule keeps {name} within {args.budget:g} false events a minute"
        raise UsageError(text, remedy)
    known = evidence(made.streams, chosen.rule)
    if args.json:
        more = {"minutes": known.minutes, "slips": known.slips}
        print(json_line({**msgspec.to_builtins(chosen), **more}))
        return exits.SUCCESS
    print(f"# split validation: {point_text(chosen)}")
    for folder in args.data:
        its = [s for s in made.streams if Path(s.recording.source).is_relative_to(folder)]
        part = evidence(its, chosen.rule)
        print(f"# {folder}: {part.caught} of {part.slips} slips apart from blows, "
              f"{part.false} false in {rest_text(part.minutes)} of a hand at rest")  # fmt: skip
    if chosen.rule == made.config.rule:
        print("# which is the rule that there was")
    if known.slips < FEW_SLIPS or known.minutes * args.budget < FEW_EVENTS:
        print("# that is little: one more or less of either would make another rule; give more "
              "recordings, or simulated sets beside")  # fmt: skip
    _print_rule(chosen.rule)
    return exits.SUCCESS


def must_test(minutes: float, budget: float, more: str) -> None:
    """Raises UsageError for less of a hand's rest than one false event of the budget needs: there
    any rule that makes none is within it, and nothing tells them apart. ``more``: what would do.

    A budget of none at all is asked of whatever there is.
    """
    if minutes * budget >= 1.0 or budget == 0.0:
        return
    held, most = rest_text(minutes), _least_tested(minutes)
    looser = f", or --budget {most}" if most <= MOST_BUDGET else ""
    event = f", in which one false event would be {1.0 / minutes:.3g} a minute" if minutes else ""
    raise UsageError(
        f"a budget of {budget:g} a minute cannot be tested: {held} of a hand at rest{event}",
        f"give {more}{looser}",
    )


def _least_tested(minutes: float) -> float:
    """The smallest whole budget that so much rest can test; infinite without any."""
    if minutes <= 0.0:
        return math.inf
    least = math.ceil(1.0 / minutes)
    return least if minutes * least >= 1.0 else least + 1  # as floats multiply


def rest_text(minutes: float) -> str:
    """How long, in seconds where minutes would round to next to nothing."""
    return f"{minutes:.1f} minutes" if minutes >= SHORT_MINUTES else f"{60.0 * minutes:.1f} s"


def _tune_unlabelled(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.benchmark.label_free import hold_in, tune_unlabelled
    from scenarios.campaign.config import load_config

    config = load_config("can", "simulated", args.detector, args.config, args.set)
    found = tune_unlabelled(config, map(hold_in, args.unlabelled), args.budget)
    if args.json:
        print(msgspec.json.encode(found).decode())
        return exits.SUCCESS
    what = "limit" if found.rule.kind == "cusum" else "log-odds of the threshold"
    low, high = found.interval
    print(f"# {found.minutes:.1f} minutes of hold, {found.load_counts:.0f} counts of load; "
          f"{args.budget:g} false events a minute: {what} {found.level:.2f} "
          f"[{low:.2f}, {high:.2f}]")  # fmt: skip
    if found.rule == config.rule:
        print("# less than the rule has, which is kept: a still hand knows nothing of closing, of "
              "lifting or of blows")  # fmt: skip
    _print_rule(found.rule)
    return exits.SUCCESS


def _print_rule(rule: Any) -> None:
    print("\n".join(rule_lines(rule)))


def rule_lines(rule: Any) -> list[str]:
    """Those settings of it that are read, as TOML."""
    import msgspec

    read = {k: v for k, v in msgspec.to_builtins(rule).items() if k not in rule.unread}
    told = {k: v if isinstance(v, str) else round(v, 4) for k, v in read.items()}
    return ["[rule]", *(f"{key} = {json.dumps(value)}" for key, value in told.items())]


def point_text(p: Any) -> str:
    """A point of the sweep as a person reads it."""
    text = (f"{p.false_per_min:.2f} false events a minute, delay p50 {p.delay_ms:.0f} p90 "
            f"{p.p90_delay_ms:.0f} p99 {p.p99_delay_ms:.0f} ms, recall {p.recall:.3f}")  # fmt: skip
    if p.blows is not None:
        text += (f"; blows: {p.blows.registered} of {p.blows.moved} that moved it, "
                 f"{p.blows.unmoved_registered} of {p.blows.unmoved} that did not, "
                 f"{p.blows.nearly_registered} of {p.blows.nearly} without the weak")  # fmt: skip
    return text
