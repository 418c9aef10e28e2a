"""The trials of `grasp run lift` and `grasp run tap`: shown, kept as rows, and reported."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from drivers.errors import GraspError, UnreadError, UsageError
from grasp import interruption
from grasp.cli import exits
from grasp.cli.first import tell_end
from grasp.cli.options import whole
from grasp.cli.output import json_line
from grasp.cli.parser import Parser
from grasp.cli.places import file_with_folders

TRIALS = {"lift": 1, "tap": 20}  # taps: paper, section V-B


def add_series_options(parser: Parser, scenario: str) -> None:
    """`--trials N`, `--out FILE`, `--resume`."""
    parser.option("--trials N", "number of trials in sequence, with seeds from --seed on "
        f"(default: {TRIALS[scenario]})", whole(1, 10_000))  # fmt: skip
    parser.option("--out FILE", "write one row per trial to this SQLite file; `grasp runs FILE` "
        "reads it (default on the hardware rig, for several trials: a new file in --runs)",
        file_with_folders)  # fmt: skip
    parser.flag(
        "--resume", "continue --out: run the trials that are missing or that a device ended"
    )
    parser.flag("--report", "write a page beside each recording, as `grasp report` does")


def trials_of(args: argparse.Namespace) -> int:
    """How many there are to be."""
    return args.trials or TRIALS[args.scenario]


def _is_alone(args: argparse.Namespace) -> bool:
    """One lift of which no row is kept."""
    return args.scenario == "lift" and args.trials is None and args.out is None


def is_asked(args: argparse.Namespace) -> bool:
    """Whether somebody at real devices is asked: a lift that nobody asked more of may be started
    by a script, and nobody is there to answer."""
    return not _is_alone(args) or (sys.stdin is not None and sys.stdin.isatty())


def paced(args: argparse.Namespace) -> bool:
    """Whether virtual time goes at the wall's pace."""
    seen = args.view or (sys.stdout.isatty() and not args.json)
    return args.pace == "real" or (args.pace is None and seen)


class _Seen:
    """What came of the trials of this call."""

    def __init__(self) -> None:
        self.failure: Any = None
        self._results: dict[int, Any] = {}  # by seed: of a trial that was repeated, the last
        self._rows: dict[int, Any] = {}
        self._physics: list[Any] = []

    def first_of_its_physics(self, result: Any) -> bool:
        """Whether no trial before it had the same contact levels."""
        known = result.physics in self._physics
        self._physics.append(result.physics)
        return not known

    def take(self, finished: Any, row: Any) -> None:
        self.failure = finished.failure
        if finished.result is not None:
            self._results[finished.result.seed] = finished.result
        if row is not None:
            self._rows[row.trial] = row

    @property
    def results(self) -> list[Any]:
        return list(self._results.values())

    @property
    def rows(self) -> list[Any]:
        return list(self._rows.values())


def run_trials(
    args: argparse.Namespace, config: Any, permit: Any, begin: Callable[[], None]
) -> int:
    """One lift or several, or taps. ``config``: of the scenario. ``begin`` is called when nothing
    that was asked for stands against it any more."""
    from scenarios.campaign.trial_series import TrialSeries

    alone = _is_alone(args)
    experiment = TrialSeries(args.scenario, config, args.seed, trials_of(args))
    if config.controller.keep and experiment.trials > 1:
        told = "--keep, or controller.keep, holds one object and ends"
        raise UsageError(told, "leave it out, or --trials 1")
    if args.resume and args.out is None:
        raise UsageError("--resume goes on with a file", "name it with --out FILE")
    out = args.out
    if out is None and config.rig == "hardware" and not alone:
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # noqa: DTZ005  (a person's local time)
        out = args.runs / f"{stamp}-{args.scenario}-{config.object.name}.sqlite"
    with interruption.held():  # no signal cuts off what is to be told of arm and hand
        with nullcontext() if out is None else experiment.store(out, args.resume) as store:
            begin()
            seen = _follow(args, experiment, permit, store, alone)
            rows = seen.rows if store is None else store.rows()
        with interruption.watched():
            if alone and seen.results:
                code = _report(seen.results[0], seen.failure, args, config)
            else:
                code = _report_series(args, experiment, seen, rows, out)
            if args.report:
                _write_pages(seen.results, args.json)
            return code


def _follow(
    args: argparse.Namespace, experiment: Any, permit: Any, store: Any, alone: bool
) -> _Seen:
    """Run what the store lacks and show it."""
    from grasp.cli.live import Display, physics_lines, trial_line, viewed
    from grasp.cli.operator import TerminalOperator
    from scenarios.campaign.trial_series import run
    from scenarios.report.live.feed import LiveTrials
    from scenarios.trial.result import Failure
    from scenarios.trial.series import Bench

    asked = experiment.config.rig == "hardware" and is_asked(args)
    operator = TerminalOperator() if asked else None
    if operator is not None:
        operator.expect()
    seen = _Seen()
    config, of = experiment.config, experiment.trials
    title = f"{args.scenario} · {config.object.name} · {config.rig} rig"
    with (
        logged(args, config.object.name, config.rig) as log,
        Display(config.rig, args.json, plain=asked, brief=not alone) as display,
        viewed(args, lambda: LiveTrials(config, title, of)) as live,
    ):
        display.setting_up()
        watch = None if live is None else live.watch

        def begins(number: int, of: int) -> None:
            display.trial(number, of)
            if live is not None:
                live.trial(number)

        on_tick = display.tick if log is None else _both(display.tick, log.tick)
        bench = Bench(
            args.runs,
            paced(args),
            on_tick,
            operator,
            permit,
            watch=watch,
            on_trial=begins,
            placed=args.first,
        )
        try:
            for finished, row in run(experiment, bench, store):
                seen.take(finished, row)
                if log is not None:
                    result = finished.result
                    became = "" if result is None else f"seed {result.seed}: {result.outcome}"
                    log_end(log, became, finished.failure)
                if live is not None and finished.result is not None:
                    live.feed.say(trial_line(finished.result))
                if finished.result is not None and not alone:
                    if args.json:
                        print(trial_line(finished.result), file=sys.stderr, flush=True)
                    display.note(trial_line(finished.result))
                    if args.verbose and seen.first_of_its_physics(finished.result):
                        display.note("\n".join(physics_lines(finished.result)))
        except KeyboardInterrupt as stop:
            if alone:
                raise
            cause = f"{interruption.cause(stop)} between two trials"
            seen.failure = Failure("interrupted", cause, "")
        except GraspError as error:  # of the disk, between two trials
            if not seen.results:
                raise
            seen.failure = Failure(error.kind, error.message, error.remedy)
        display.close()
    return seen


def _both(one: Any, other: Any) -> Any:
    def tick(tick: Any) -> None:
        one(tick)
        other(tick)

    return tick


@contextmanager
def logged(args: argparse.Namespace, what: str, rig: str) -> Iterator[Any]:
    """The log of `-v`, named once it is closed; None without."""
    from grasp.cli.run_log import RunLog

    if not args.verbose:
        yield None
        return
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # noqa: DTZ005  (a person's local time)
    with RunLog(args.runs / f"{stamp}-{args.scenario}-{what}.log") as log:
        log.say(f"{args.scenario} of {what} on rig {rig}, {sys.argv[1:]}")
        yield log
    exits.say(f"log: {log.path}")


def log_end(log: Any, became: str, failure: Any) -> None:
    """What a run has become, empty for nothing, and how all was left where it failed."""
    if became:
        log.say(became)
    if failure is not None:
        log.say(f"{failure.kind}: {failure.message}")
        if failure.end is not None:
            log.say(f"{failure.end.arm}; {failure.end.hand}")


def _write_pages(results: list[Any], quiet: bool) -> None:
    """A page beside each recording; what goes wrong there changes no verdict."""
    from grasp.cli.report import write_page

    for result in results:
        if result.recording is None:
            continue
        try:
            page = write_page(Path(result.recording))
        except (GraspError, OSError) as error:
            exits.report_line(f"no page of seed {result.seed}: {error}")
        else:
            if not quiet:
                print(f"  page: {page}")


def _report(result: Any, failure: Any, args: argparse.Namespace, config: Any) -> int:
    """One lift."""
    import msgspec

    from grasp.cli.live import print_verdict

    with suppress(UnreadError):  # how arm and hand were left is told all the same
        if not args.json:
            print_verdict(result, args.verbose)
            print(f"  {_by(args, config)}")
            _tell_height(result, config)
            if args.first and failure is None:
                tell_end(result)
    if failure is not None:
        extra = {"result": msgspec.to_builtins(result)} if args.json else {}
        return exits.report_failure(failure, args.json, **extra)
    if args.json:
        print(msgspec.json.encode(result).decode())
    return exits.SUCCESS if result.success else exits.TRIAL_FAILED


def _by(args: argparse.Namespace, config: Any) -> str:
    """Who listened, and how slip was answered."""
    return (
        f"detector {config.detector_label}, profile {args.profile}, answer to slip: "
        f"{config.controller.answer}"
    )


def _tell_height(result: Any, config: Any) -> None:
    """A real arm that has set an object down stands above it: the next run would begin there."""
    phases = [entry.phase for entry in result.phases]
    retreat_mm = config.controller.retreat_m * 1e3
    lift = result.rig == "hardware" and result.scenario == "lift"
    if lift and phases[-2:-1] == ["release.retreat"]:
        print(f"  the arm stands {retreat_mm:.0f} mm above where it let go, and begins there next")


def _report_series(
    args: argparse.Namespace, experiment: Any, seen: _Seen, rows: list[Any], out: Path | None
) -> int:
    """Several: their figures, and Table IV of all rows where they are kept."""
    import msgspec

    from grasp.cli.campaign_view import print_summary
    from scenarios.campaign.summary import summarize

    kept = "" if out is None else _kept(rows, out, experiment.trials)
    if seen.failure is not None and not rows and not seen.results:
        code = exits.report_failure(seen.failure, args.json)
        if not args.json:
            exits.say(kept)
        return code
    tap = args.scenario == "tap"
    table = summarize(experiment.spec().name, rows)
    series = {
        "scenario": args.scenario, "object": experiment.config.object.name, "rig": args.rig,
        "detector": experiment.config.detector_label, "seed": args.seed,
        "summary": msgspec.to_builtins(table),
        f"{args.scenario}s": msgspec.to_builtins(seen.results),
    }  # fmt: skip
    if out is not None:
        series["campaign"] = str(out)
    with suppress(UnreadError):
        if rows and not args.json:
            print_summary(table)
        if out is not None and not args.json:
            print(out)
    if seen.failure is not None:
        code = exits.report_failure(
            seen.failure, args.json, **({"result": series} if args.json else {})
        )
        if not args.json:
            exits.say(kept)
        return code
    # a measured rate of taps is a result, as a campaign's is
    failed = [row for row in rows if not (row.status == "done" if tap else row.success)]
    if args.json:
        print(json_line(series))
    else:
        _tell_last(seen, experiment, kept)
        if failed:
            why = "were not judged" if tap else "did not succeed"
            exits.report_line(f"{len(failed)} of {len(rows)} trials {why}: exit code 1")
    return exits.TRIAL_FAILED if failed else exits.SUCCESS


def _tell_last(seen: _Seen, experiment: Any, kept: str) -> None:
    """How the last trial of a series without a fault left arm and hand."""
    if not seen.results:
        exits.report_line(kept)
        return
    last = seen.results[-1]
    _tell_height(last, experiment.config)
    if last.rig == "hardware" and last.end is not None and not last.end.open:
        exits.report_line(f"seed {last.seed}: {last.phases[-1].cause}")
        exits.say_end(last.end)
        exits.say(kept)


def _kept(rows: list[Any], out: Path, of: int) -> str:
    """What a series ``of`` so many has left, and how to go on with it where some are missing."""
    judged = sum(row.status == "done" for row in rows)
    more = len(rows) - judged
    void = f", {more} more {'does' if more == 1 else 'do'} not count" if more else ""
    trials = "1 trial is" if judged == 1 else f"{judged} trials are"
    left = f"go on with --out {out} --resume" if judged < of else "none is left to run"
    return f"{trials} in {out}{void}: {left}"
