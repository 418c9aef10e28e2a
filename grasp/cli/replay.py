"""`grasp replay`: a recorded run or fingertip through detector and controller again."""

import argparse
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.detector import scores_text
from grasp.cli.options import add_settings
from grasp.cli.output import json_line
from grasp.cli.parser import verb

HELP = "feed a recording through detector, slip monitor and controller"
SHOWN_DIFFERENCES = 10


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "replay", replay, HELP)
    parser.option("run RUN", "folder or recording.mcap of a run", Path, nargs="?")
    parser.flag("--check", "exit 1 if any event or command differs from the recording")
    parser.option("--tactile PATH", "a fingertip recording instead of a run: .npz, or .csv "
        "(t_s,p0,p1,...,slip)", Path)  # fmt: skip
    parser.option("--detector NAME", "with --tactile: a detector's name or path (default: that of "
        "profile default); else where that of one's own is which the run was "
        "recorded with")  # fmt: skip
    add_settings(parser, of="with --tactile: ")
    parser.flag("--json", "one JSON object on standard output, nothing else")


def replay(args: argparse.Namespace) -> int:
    if (args.run is None) == (args.tactile is None):
        raise UsageError("give either a RUN or --tactile PATH", "not both, not neither")
    if args.tactile is None and (args.config or args.set):
        what = "--config" if args.config else "--set"
        told = f"{what} goes with --tactile: a run is replayed with the settings it was made with"
        raise UsageError(told, "leave it out")
    return _run(args) if args.tactile is None else _tactile(args)


def _run(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.trial.replay import replay_run

    done = replay_run(args.run, args.detector)
    same = not done.differences
    if args.json:
        print(json_line({**msgspec.to_builtins(done), "same": same}))
    else:
        for t_s, what in done.events:
            print(f"{t_s:7.2f} s  {what}")
        cut = "" if done.complete else " (recording was cut off)"
        known = f"{done.steps} steps replayed, {done.writes} writes to the gripper compared{cut}"
        print(f"{known}: {'as recorded' if same else 'DIFFERENT'}")
        for d in done.differences[:SHOWN_DIFFERENCES]:
            print(f"  {d.t_s:7.2f} s  {d.what}: recorded {d.recorded}, replayed {d.replayed}")
        if len(done.differences) > SHOWN_DIFFERENCES:
            print(f"  and {len(done.differences) - SHOWN_DIFFERENCES} more")
    return exits.TRIAL_FAILED if args.check and not same else exits.SUCCESS


def _tactile(args: argparse.Namespace) -> int:
    import msgspec

    from detector.recordings import read
    from detector.scores.evaluation import evaluate_recording
    from grasp.clock import stopwatch_ns
    from scenarios.campaign.config import load_config
    from scenarios.trial.replay_tactile import replay_tactile

    config = load_config("can", "simulated", args.detector, args.config, args.set)
    recording = read(args.tactile)
    done = replay_tactile(config, recording)
    detector = config.make_detector(recording.fingers, recording.taxels)
    scores = evaluate_recording(detector, config.rule, recording, clock_ns=stopwatch_ns)
    if args.json:
        print(json_line({**msgspec.to_builtins(done), "evaluation": msgspec.to_builtins(scores)}))
        return exits.SUCCESS
    _print_tactile(done, recording, scores, config.rule)
    return exits.SUCCESS


def _print_tactile(done: Any, recording: Any, scores: Any, rule: Any) -> None:
    """Labels, registered events and commands on one time line, then the score."""
    edges = [
        (float(recording.t_s[i]), f"label: slip {'begins' if recording.slip[i] else 'ends'}")
        for i in range(1, len(recording.t_s))
        if recording.slip[i] != recording.slip[i - 1]
    ]
    lines = [
        *edges,
        *((t_s, f"    registered at finger {finger}") for t_s, finger in done.registered),
        *((c.t_s, f"        {c.phase}: {c.text}") for c in done.commands),
    ]
    for t_s, text in sorted(lines, key=lambda line: line[0]):
        print(f"{t_s:8.3f} s  {text}")
    print(scores_text(scores, rule))
