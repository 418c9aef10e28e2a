"""The trials of `grasp run lift` and `grasp run tap`: display, storage and report."""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from datetime import datetime
from pathlib import Path

import msgspec

from drivers.errors import GraspError, OutputClosedError, UsageError
from grasp.cli import exits, lab
from grasp.cli.commands import RunOptions, TrialsOptions
from grasp.cli.detector import check_weights, rule_of_weights, warn_of_untuned_rule
from grasp.cli.lab import say
from grasp.cli.live import Display, trial_line, verdict, viewed
from grasp.cli.output import print_status, show
from grasp.cli.questions import TerminalOperator
from grasp.control.monitors.checks import CHECKS
from grasp.run import signals
from scenarios.campaign.config import RunConfig
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import summarize
from scenarios.campaign.trial_series import TrialSeries
from scenarios.campaign.worker import Row
from scenarios.report.step_feed import StepFeed
from scenarios.rigs.permission import MotionPermit
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard
from scenarios.trial.experiment import TrialContext
from scenarios.trial.layers import trial_layers
from scenarios.trial.result import Failure, TrialResult

QUIT, POLL_S = "q", 0.05  # of a question in a first lift


def start(
    args: TrialsOptions, config: RunConfig, object_name: str, assignments: Sequence[str]
) -> int:
    """Run lifts or taps with these settings, after all checks, or their dry run. ``object_name``
    and ``assignments``: those of the settings."""
    if args.dry_run:
        from grasp.cli.plans import dry_run

        return dry_run(config, args)
    permit = lab.permit_run(config, args)
    if permit is not None:
        _check_attended(args)
    make_guard(config)  # raises before any output if the limit cannot be kept
    if permit is not None:
        from grasp.cli.plans import as_run, plan

        for line in plan(as_run(config, args), args):
            say(f"will {line}")
        lab.warn_of_height(config)
        lab.warn_of_slow_arm(config)
        lab.warn_of_mode(config)
    if args.first:
        config = _begin_first(config, permit, args)
        make_guard(config)
    check_weights(config)
    grip_n, limit_n = config.controller.grip_force_n, config.guard.force_limit_n
    if grip_n > limit_n:
        say(f"grip force {grip_n:g} N is reduced to guard.force_limit_n, {limit_n:g} N")

    def begin() -> None:
        if not args.json and (rule := rule_of_weights(config)):
            print(rule)
        chosen = (args.rig, args.detector, args.config, assignments, args.profile)
        warn_of_untuned_rule(config, trial_layers(object_name, *chosen))

    used = config.for_lift() if args.scenario == "lift" else config.for_tap()
    return run_trials(args, used, permit, begin)


def _check_attended(args: TrialsOptions) -> None:
    """Raise UsageError where a question to a person would have no answer."""
    later = args.first or not args.single  # its operator needs a terminal, and says so
    if args.unattended and later:
        raise UsageError("--unattended is for one lift that asks nobody", "leave it out")
    if not (args.unattended or later or (sys.stdin is not None and sys.stdin.isatty())):
        remedy = "start it at one; a script that may move the arm without a person: --unattended"
        raise UsageError("nobody is at a terminal to watch and to answer questions", remedy)


def _begin_first(config: RunConfig, permit: MotionPermit | None, args: TrialsOptions) -> RunConfig:
    """Ask, close in free air, ask again; returns the settings of the gentle lift that follows.
    Raises UsageError on a rig without real devices, and if the person quits."""
    from scenarios.lab.preflight import STOP_INSTRUCTIONS, close_in_free_air, gentle_settings

    if permit is None or args.json or args.trials is not None or args.resume:
        raise UsageError("--first is one supervised lift on the rig hardware, without --json, "
                         "--trials and --resume", "leave these out, or --first")  # fmt: skip
    slow = gentle_settings(config)
    TerminalOperator().expect()
    for line in STOP_INSTRUCTIONS:
        print(f"  {line}")
    with signals.deferred():
        _ask("Step 1 of 2, free air: with an empty hand and the arm at rest, the fingers close to "
             f"the grasp positions of {config.object.name} without contact")  # fmt: skip
        moved = close_in_free_air(slow, permit, say)
        print(f"  {moved.summary()}, as expected")
        controller, guard = slow.controller, slow.guard
        _ask(f"Step 2 of 2, {config.object.name}: put it, or an object as soft, between the "
             f"fingers. The arm lifts it {controller.lift_height_m * 1e3:.0f} mm at "
             f"{controller.lift_speed_mps * 1e3:.0f} mm/s, with at most {guard.force_limit_n:g} N "
             "commanded per finger")  # fmt: skip
    return slow


def _ask(question: str) -> None:
    """Wait for Enter; raises UsageError for other input."""
    operator = TerminalOperator()
    operator.say(f"{question}. Enter: continue; {QUIT}: quit")
    while (line := operator.poll()) is None:
        signals.check()
        time.sleep(POLL_S)
    if line.strip():
        raise UsageError("quit by the operator: nothing more was moved", "start it again")


def is_paced(args: RunOptions) -> bool:
    watched = args.view or (sys.stdout.isatty() and not args.json)
    return args.pace == "real" or (args.pace is None and watched)


def run_trials(
    args: TrialsOptions,
    config: TrialConfig,
    permit: MotionPermit | None,
    begin: Callable[[], None],
) -> int:
    """Run lifts or taps. ``config``: of the scenario. ``begin``: called once checks have passed."""
    single = args.single
    series = TrialSeries(args.scenario, config, args.seed, args.number)
    if config.controller.keep and series.trials > 1:
        problem = "--keep (controller.keep) keeps holding one object, so only one trial is possible"
        raise UsageError(problem, "leave it out, or use --trials 1")
    if args.resume and args.out is None:
        raise UsageError("--resume needs the file to continue", "name it with --out FILE")
    out = args.out
    if out is None and config.rig == "hardware" and not single:
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # noqa: DTZ005  (a person's local time)
        out = args.runs / f"{stamp}-{args.scenario}-{config.object.name}.sqlite"
    with signals.deferred():  # the final state of arm and hand is always reported
        with nullcontext() if out is None else series.store(out, args.resume) as store:
            begin()
            results, rows, failure = _follow(args, series, permit, store, single)
            rows = rows if store is None else store.rows()
        if single and results:
            code = _report(results[0], failure, args, config)
        else:
            code = _report_series(args, series, results, rows, failure, out)
        if args.report:
            _write_pages(results, args.json)
        return code


def _follow(
    args: TrialsOptions, series: TrialSeries, permit: MotionPermit | None,
    store: CampaignStore | None, single: bool,
) -> tuple[list[TrialResult], list[Row], Failure | None]:  # fmt: skip
    """Results and rows of this call's trials, and why they ended; of a repeated trial, the last
    result."""
    config, of = series.config, series.trials
    operator = None
    if config.rig == "hardware" and args.asked:
        operator = TerminalOperator()
        operator.expect()
    title = f"{args.scenario} · {config.object.name} · {config.rig} rig"
    results: dict[int, TrialResult] = {}
    rows: dict[int, Row] = {}
    failure: Failure | None = None
    with (
        viewed(args.view, config, title, of) as page,
        Display(config.rig, args.json, operator, not single, page) as display,
    ):
        display.setting_up()
        context = TrialContext(
            args.runs, is_paced(args), display.tick, operator, permit, on_trial=display.trial,
            watch=None if page is None else page.watch, placed=args.first,
        )  # fmt: skip
        if args.feed is not None:
            feed = StepFeed(args.feed)
            context = msgspec.structs.replace(context, watch=feed.watch, on_open=feed.begin)
        try:
            for judged, row in series.run(context, store):
                failure, result = judged.failure, judged.result
                if row is not None:
                    rows[row.trial] = row
                if result is None:
                    continue
                results[result.seed] = result
                if args.json and not single:
                    print_status(trial_line(result))
                display.ended(trial_line(result), note=not single)
                if not single:
                    _say_reported(result)
        except KeyboardInterrupt as stop:
            if single:
                raise
            failure = Failure("interrupted", f"{signals.cause(stop)} between two trials", "")
        except GraspError as error:  # of the disk, between two trials
            if not results:
                raise
            failure = Failure(error.kind, error.message, error.remedy)
        display.close()
    return list(results.values()), list(rows.values()), failure


def _say_reported(result: TrialResult) -> None:
    """Print failed checks that did not end the run, and exceptions that were ignored."""
    for fault in result.reported:
        ends = "would have ended the run: " if CHECKS[fault.code].ends else ""
        exits.report_line(f"seed {result.seed}, {ends}{fault.line}")
    for text, number in result.hidden.items():
        exits.report_line(f"seed {result.seed}, a bug that was ignored {number} times: {text}")


def _report(
    result: TrialResult, failure: Failure | None, args: TrialsOptions, config: TrialConfig
) -> int:
    with suppress(OutputClosedError):  # the final state of arm and hand is reported in any case
        if not args.json:
            print(verdict(result))
            engine = f" ({result.engine})" if result.engine else ""
            print(f"  detector {config.detector_label}{engine}, profile {args.profile}, slip "
                  f"response {config.controller.slip_response}")  # fmt: skip
            _print_height(result, config)
            if args.first and failure is None and result.success:
                print("  next: `grasp arm back` to the start, then the same without --first, at "
                      "full speed, then your own object")  # fmt: skip
            elif args.first and failure is None:
                say("check the phases above before you continue")
        _say_reported(result)
    if failure is not None:
        return exits.report_failure(failure, args.json, result=result)
    return show(args, result, "", exits.SUCCESS if result.success else exits.TRIAL_FAILED)


def _report_series(
    args: TrialsOptions, series: TrialSeries, results: Sequence[TrialResult],
    rows: Sequence[Row], failure: Failure | None, out: Path | None,
) -> int:  # fmt: skip
    from grasp.cli.campaign import print_summary

    config = series.config
    kept = "" if out is None else _kept(rows, out, series.trials)
    table = summarize(series.spec().name, rows)
    value = {
        "scenario": args.scenario, "object": config.object.name, "rig": args.rig,
        "detector": config.detector_label, "seed": args.seed, "summary": table,
        f"{args.scenario}s": results, "campaign": out,
    }  # fmt: skip
    with suppress(OutputClosedError):
        if rows and not args.json:
            print_summary(table, config.rig)
        if out is not None and not args.json:
            print(out)
    if failure is not None:
        begun = {"result": value} if rows or results else {}
        code = exits.report_failure(failure, args.json, **begun)
        if not args.json:
            exits.print_detail(kept)
        return code
    # a measured rate of taps is a result, so a failed trial is no error
    done = [row.status == "done" if args.scenario == "tap" else row.success for row in rows]
    if not args.json:
        _report_last(results, config, kept)
        if not all(done):
            why = "were not judged" if args.scenario == "tap" else "did not succeed"
            say(f"{done.count(False)} of {len(rows)} trials {why}: exit code 1")
    return show(args, value, "", exits.SUCCESS if all(done) else exits.TRIAL_FAILED)


def _print_height(result: TrialResult, config: TrialConfig) -> None:
    """Print the height of a real arm above the object that it set down: the next start position."""
    phases = [entry.phase for entry in result.phases]
    retreat_mm = config.controller.retreat_m * 1e3
    lift = result.rig == "hardware" and result.scenario == "lift"
    if lift and phases[-2:-1] == ["release.retreat"]:
        print(
            f"  the arm is {retreat_mm:.0f} mm above the set-down point; a next run starts there, "
            "unless `grasp arm back` moves it down"
        )


def _report_last(results: Sequence[TrialResult], config: TrialConfig, kept: str) -> None:
    """Print the final state of arm and hand after a series without a fault."""
    if not results:
        say(kept)
        return
    last = results[-1]
    _print_height(last, config)
    if last.rig == "hardware" and last.end is not None and not last.end.open:
        say(f"seed {last.seed}: {last.phases[-1].cause}")
        exits.print_end(last.end)
        exits.print_detail(kept)


def _kept(rows: Sequence[Row], out: Path, of: int) -> str:
    """Number of trials stored of a series ``of`` so many, and how to continue it, in words."""
    judged = sum(row.status == "done" for row in rows)
    void = f", {len(rows) - judged} more not counted" if len(rows) > judged else ""
    trials = "1 trial is" if judged == 1 else f"{judged} trials are"
    left = f"continue with --out {out} --resume" if judged < of else "the series is complete"
    return f"{trials} in {out}{void}: {left}"


def _write_pages(results: Sequence[TrialResult], quiet: bool) -> None:
    """Write a page next to each recording; errors are reported and change no verdict."""
    from grasp.cli.recordings import write_page

    for result in results:
        if result.recording is None:
            continue
        try:
            page = write_page(Path(result.recording))
            if not quiet:
                print(f"  open this page in a browser: {page.resolve()}")
        except (GraspError, OSError) as error:
            say(f"no page of seed {result.seed}: {error}")
