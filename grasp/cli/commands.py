"""Every command of `grasp` with its options and help. A function of the command's name implements
it, in the module from ``main.module_of``: `grasp gripper step` is ``devices.gripper_step``."""

import argparse
from pathlib import Path

from grasp.cli.options import (
    OBJECT_HELP,
    decimal,
    file_to_write,
    file_with_folders,
    folder_to_fill,
    seed,
    share,
    whole,
)
from grasp.cli.parser import Parser

TRIALS = {"lift": 1, "tap": 20}  # taps: paper, section V-B
LABELS = ("slip", "slip_true", "moved")
NETWORKS = ("tcn", "gru", "tcn-paper", "freq-cnn-paper")
TRY, MEASURE, LAB, SET_UP = "try", "measure", "real devices", "settings"  # sections of the help
ROOT = (
    "Closed-loop grasp controller: detects slip with barometric fingertips and closes a Robotiq "
    "3-Finger gripper as fast as a force limit allows."
)
ROOT_END = (
    "`grasp COMMAND --help` shows options and examples. Exit codes: 0 success, 1 trial failed, "
    "2 usage or configuration, 3 device, 4 safety stop, 5 could not record or internal error, 130 "
    "interrupted (143 terminated, 129 terminal closed)."
)
FINGERS = ("A", "B", "C")
SLOW = "slowly, at the hand's least force"
RUN_HELP = (
    "folder of a run, its name as `grasp runs` lists it, or its recording.mcap (default: the last "
    "run in the folder runs)"
)
ARM_SPEED = "10 mm/s in a straight line"
MAX_FORCE_N = 60.0  # of the hand, by its manual
SHORTEST_HOLD_S = 30.0
OPERATOR_ACTIONS = (
    "place (the object on the table) | take (it away) | home (the arm) | look | scale (what each "
    "fingertip presses with) | tap [top|side|closing] | press FINGER TAXEL [NEWTONS] | lay FINGER "
    "NEWTONS | fault NAME [SETTING=VALUE ...] | fault help"
)


def build_parser() -> Parser:
    root = Parser(prog="grasp", description=ROOT, epilog=ROOT_END)
    root.flag("--version", "show the version and exit")
    _add_run(root.command("run", "run a scenario", section=TRY))
    _add_ros(root)
    _add_recordings(root)
    _add_campaign(root.command("campaign", "run a grid of trials in parallel", section=MEASURE))
    _add_dataset(root.command("dataset", "data sets of labelled recordings", section=MEASURE))
    _add_detector(root.command("detector", "score, tune, train slip detectors", section=MEASURE))
    _add_benchmark(root)
    _add_devices(root)
    config = root.command("config", "show the resolved settings, or check your files", ". "
        "Prints every setting with its value, its allowed range and its source. A FILE may be an "
        "object, surface, calibration, rig, campaign, data set, or settings for --config.", (
        "grasp config object --object ball", "grasp config thermos.toml cell.toml lab.toml",
        "grasp config --config lab.toml --config grip.toml"), section=SET_UP)  # fmt: skip
    config.option("section SECTION|FILE", "sections to show, or files to check", nargs="*")
    share(config, "object profile detector rig config set json")
    return root


def _add_run(group: Parser) -> None:
    lift = group.command("lift", "lift an object from a weak grip and respond to slip", "", (
        "grasp run lift --object can",
        "grasp run lift --object ./thermos.toml --rig simulated --seed 7 --report",
        "grasp run lift --detector mine.py:Vibration --set object.mass_kg=0.3 --json",
        "grasp run lift --rig cell.toml --config grip.toml --trials 20 --confirm-motion",
    ))  # fmt: skip
    tap = group.command("tap", "tap an object that is held at the force limit", "", (
        "grasp run tap --object ball",
        "grasp run tap --object can --rig simulated --trials 5 --direction side"))  # fmt: skip
    press = group.command("acquire", "press and stroke one fingertip, for labelled slip data", "", (
        "grasp run acquire --surface sphere --direction 45 --seconds 10",))  # fmt: skip
    lift.flag("--keep", "keep holding the object instead of setting it down")
    lift.option("--force N", "estimated force of the first grasp, N (default: 2)",
                decimal(0.5, 30, "N"))  # fmt: skip
    lift.flag("--first", "first lift of a new setup: slow, with the least force, step by step")
    tap.option("--direction DIR", "top, side (across the closing axis), closing (along it), or "
        "alternate: top and side in turn (default: alternate)")  # fmt: skip
    lift.option("--feed FD", argparse.SUPPRESS, whole(3, 65_535))  # steps for `grasp ros`
    tap.set_defaults(keep=False, first=False, feed=None)
    press.option("--surface NAME", "one of config/surfaces, or a .toml file", default="planar")
    press.option("--direction DIR", "degrees in steps of 45, or cw or ccw", default="0")
    press.option("--speed MPS", "speed of a stroke, m/s", decimal(0.004, 0.2, "m/s"), default=0.05)
    press.option("--seconds S", "length of the recording, s", decimal(1, 3600, "s"), default=20.0)
    press.set_defaults(view=False)
    lift.option("--object NAME", f"{OBJECT_HELP} (default: can, on real devices "
        "an unnamed object; with --first: foam)")  # fmt: skip
    share(tap, "object")
    for name, parser in (("lift", lift), ("tap", tap)):
        share(parser, "profile detector")
        parser.option("--trials N", f"trials to run (default: {TRIALS[name]})", whole(1, 10_000))
        parser.option("--out FILE", "SQLite file with one row per trial", file_with_folders)
        parser.flag("--resume", "continue --out: run missing trials and those ended by a device")
        parser.flag("--report", "write an HTML page for each recording")
        parser.flag("--view", "show the run on a local web page")
    for name, parser in (("lift", lift), ("tap", tap), ("acquire", press)):
        parser.set_defaults(scenario=name)
        parser.option("--runs DIR", "folder of recordings", folder_to_fill, default="runs")
        parser.option("--pace", "of the simulated rig: real time, or as fast as possible (default: "
            "real with --view or at a terminal)", choices=("real", "max"))  # fmt: skip
        share(parser, "rig seed config set json confirm dry")


def _add_ros(root: Parser) -> None:
    ros = root.command("ros", "ROS 2 node with topics, services and an action", ". Each lift runs "
        "in its own process, as `grasp run lift`. Needs ROS 2, or the extra `ros`.",
        ("grasp ros --rig simulated", "grasp ros --rig cell.toml --config grip.toml "
        "--confirm-motion"), section=TRY)  # fmt: skip
    ros.option("--runs DIR", "folder of recordings", folder_to_fill, default="runs")
    ros.option("--pace", "of the simulated rig", choices=("real", "max"), default="real")
    ros.option("--object NAME", f"{OBJECT_HELP} (default: as `grasp run lift`)")
    share(ros, "profile detector rig seed config set confirm")


def _add_recordings(root: Parser) -> None:
    replay = root.command("replay", "run detector and controller on a recording again", "", (
        "grasp replay runs/20260102-101500-lift-can --check",
        "grasp replay --tactile fingertip.csv --detector energy"), section=TRY)  # fmt: skip
    replay.option("run RUN", RUN_HELP, Path, nargs="?")
    replay.flag("--check", "exit 1 if any event or command differs from the recording")
    replay.option("--tactile PATH", "a fingertip recording (.npz or .csv) instead of a run", Path)
    replay.option("--detector NAME", "with --tactile: a detector's name or path (default: that of "
        "profile default); with a RUN: the present path of its detector file")  # fmt: skip
    share(replay, "config set json")
    runs = root.command("runs", "list recorded runs, or summarize a campaign (paper's Table IV)",
        "", ("grasp runs", "grasp runs runs/campaigns/paper.sqlite"), section=TRY)  # fmt: skip
    runs.option("file FILE", "SQLite file of a campaign", Path, nargs="?")
    share(runs, "runs json")
    report = root.command("report", "write an HTML page of a run, campaign or score file", "", (
        "grasp report runs/20260102-101500-lift-can", "grasp report scores.json",
        "grasp report runs/campaigns/paper.sqlite"), section=TRY)  # fmt: skip
    report.option("run RUN", f"{RUN_HELP}; SQLite file of a campaign; .json file of "
        "`detector evaluate --out`; folder or .json file of `benchmark`",
        Path, nargs="?")  # fmt: skip
    report.option("--out FILE.html", "page to write (default: next to the RUN)", file_to_write)
    export = root.command("export", "export runs or a campaign as a table, a plot or a data "
        "set", ". csv: one row per control step, of a campaign per trial. svg: force, slip "
        "probability and slip distance over time (--out: also .png, .pdf); gif: the first slip in "
        "slow motion. layout: for Foxglove and Lichtblick. lerobot: a data "
        "set for LeRobot, one episode per RUN; rosbag: a ROS 2 bag with the topics of the node "
        "(both: a folder). csv and layout need no extra, the others `exports`.",
        ("grasp export runs/20260102-101500-lift-can --to svg",
        "grasp export runs/*-lift-can --to lerobot --out cans",
        "grasp export runs/campaigns/paper.sqlite --out paper.csv"), section=TRY)  # fmt: skip
    export.option("run RUN", f"{RUN_HELP}; or a campaign's file", Path, nargs="*")
    export.option("--to", "default: by --out, else csv",
        choices=("csv", "svg", "gif", "layout", "lerobot", "rosbag"))  # fmt: skip
    export.option("--out FILE", "file or folder to write (default: next to the RUN)",
        file_to_write)  # fmt: skip


def _add_campaign(group: Parser) -> None:
    run = group.command("run", "run the trials of a campaign file", ". Each finished trial is a "
        "row of an SQLite file. Exit code 1 if a trial ended with an error; a failed lift is no "
        "error.", (
        "grasp campaign run paper", "grasp campaign run mine.toml --jobs 4 --config lab.toml",
        "grasp campaign run mine.toml --resume"))  # fmt: skip
    run.option("campaign FILE", "campaign file, or the name of one of config/campaigns")
    run.option("--out FILE", "(default: runs/campaigns/<name>.sqlite)", file_with_folders)
    run.option("--detector NAME", "use instead of the campaign file's detectors")
    run.option("--profile NAME", "use instead of the campaign file's profiles")
    run.option("--repetitions N", "use instead of the campaign file's number", whole(1, 10_000))
    run.option(
        "--record",
        "record each failed trial by a second run of it (default: the campaign "
        "file's, or failures), all trials, or none",
        choices=("failures", "all", "none"),
    )
    run.flag("--resume", "continue an existing file: run the missing and errored trials")
    share(run, "jobs cluster config set json")


def _add_dataset(group: Parser) -> None:
    build = group.command("build", "make all recordings of a data set, on the simulated rig", ". "
        "An interrupted build continues where it stopped.")  # fmt: skip
    build.option("config FILE", "data set file, or the name of one of config/datasets")
    build.option("--share X", "share of the recordings to build", decimal(1e-4, 1), default=1.0)
    build.option("--seed N", "random seed (default: the file's)", whole(1, 2**31 - 1))
    share(build, "jobs cluster")
    collect = group.command("collect", "make a data set of your labelled recordings", ". Of each "
        "five recordings of a motion on a surface, three are for training, one for validation, one "
        "for test.")  # fmt: skip
    collect.option("source RUN|FILE", "acquisitions, .npz or .csv files", Path, nargs="+")
    bring = group.command("import", "bring recordings of other programs into this format", ". Each "
        "file is a table of text, at any rate, with or without a header; a cell may hold a list. "
        "Prints every change, and keeps it and the file's SHA-256 in the result.", (
        "grasp dataset import slip.csv --unit ms --columns 2-7 --sign positive --rest-seconds 0.5 "
        "--labels truth.csv --resample --out own",))  # fmt: skip
    bring.option("file FILE", "tables with the same columns", Path, nargs="+")
    times = bring.add_mutually_exclusive_group()
    times.add_argument("--time-column", default="", metavar="NAME", help="name or number (default: "
        "t_s, time, timestamp, ...)")  # fmt: skip
    times.add_argument("--rate", type=decimal(1, 100_000, "Hz"), metavar="HZ", help="of a file "
        "without times")  # fmt: skip
    bring.option("--unit", "of the times", choices=("s", "ms", "us", "ns"), default="s")
    bring.option("--columns LIST", "pressures, finger by finger: names, numbers or ranges of "
        "numbers, with commas (default: all but time and label)", default="")  # fmt: skip
    bring.option("--taxels N", "of a fingertip", whole(1, 100), default=6)
    bring.option("--sign", "of a press", choices=("negative", "positive"), default="negative")
    bring.option("--rest-seconds N", "subtract the median of the first seconds",
        decimal(0, 3600, "s"), default=0.0)  # fmt: skip
    bring.option("--labels FILE", "table of times and labels, at any rate, in the same unit", Path)
    bring.flag("--resample", "bring another rate to 100 Hz")
    for parser in (build, collect, bring):
        parser.option("--out DIR", "folder to fill", folder_to_fill, required=True)
        share(parser, "json")


def _add_detector(group: Parser) -> None:
    labelled = "folders of `grasp dataset build` or `collect`"
    evaluate = group.command("evaluate", "score detectors on labelled fingertip recordings", "", (
        "grasp detector evaluate tcn energy --recording fingertip.csv",
        "grasp detector evaluate mine.onnx mine.py:Vibration --data sets/paper"))  # fmt: skip
    evaluate.option("detector NAME", "one or more of config/detectors, or your files", nargs="+")
    source = evaluate.add_mutually_exclusive_group(required=True)
    source.add_argument("--recording", type=Path, metavar="RUN|FILE", help="folder of `grasp run "
        "acquire`, .npz, or CSV with t_s,p0,p1,...,slip[,slip_true]")  # fmt: skip
    source.add_argument("--data", type=Path, nargs="+", metavar="DIR", help=labelled)
    evaluate.option("--split", "with --data: the split to score",
        choices=("train", "validation", "test", "all"), default="test")  # fmt: skip
    evaluate.option("--label", "slip: by the fingertip's speed; slip_true: the contact slides; "
        "moved: 1 mm from the last rest", choices=LABELS, default="slip")  # fmt: skip
    evaluate.option("--out FILE.json", "scores and misses, for `grasp report`", file_to_write)
    tune = group.command("tune", "find the fastest decision rule for a rate of false alarms", "",
        ("grasp detector tune mine.py:Vibration --data sets/paper sets/disturbances",))  # fmt: skip
    tune.option("detector NAME", "one of config/detectors, or your file")
    tune.option("--budget N", "false alarms per minute and hand", decimal(0, 6000), default=1.0)
    source = tune.add_mutually_exclusive_group(required=True)
    source.add_argument("--data", type=Path, nargs="+", metavar="DIR", help=labelled)
    source.add_argument("--unlabelled", type=Path, nargs="+", metavar="RUN|FILE", help="lifts, "
        ".npz or .csv of minutes of hold without slip: tunes only the threshold")  # fmt: skip
    share(evaluate, "config set json")
    share(tune, "config set json")
    card = group.command("card", "show a network's training data, seed, commit, calibration")
    card.option("network NAME|FILE.onnx", "(default: list all packaged detectors)", nargs="?")
    share(card, "json")
    train = group.command("train", "train a network and write its weights (extra `train`)", ". "
        "Stops early and calibrates on the split `validation`; never uses `test`.")  # fmt: skip
    train.option("network NAME", ", ".join(NETWORKS), choices=NETWORKS)
    train.option("--data DIR", labelled, Path, nargs="+", required=True)
    train.option("--out FILE.onnx", "weights to write (default: runs/NAME.onnx)", file_with_folders)
    train.flag("--force", "overwrite --out, and the files of an unfinished training beside it")
    train.flag("--resume", "continue from the checkpoint beside --out")
    train.option("--seed N", "random seed", seed, default=0)
    train.option("--steps N", "optimiser steps", whole(1, 10**9))
    train.option("--validations N", "validations (default: the network's)", whole(1, 1000))
    train.option("--augmentation", "paper: of the paper's text; as-run: of the paper's code; ours: "
        "also gain, offset, lost samples, dead and swapped taxels",
        choices=("none", "paper", "as-run", "ours"))  # fmt: skip
    train.flag("--windows", "tcn-paper: train on the last sample of windows, as its authors did")
    train.option("--label", "label to train on, as for `evaluate` (default: slip)", choices=LABELS)
    share(train, "json")


def _add_benchmark(root: Parser) -> None:
    parser = root.command("benchmark", "score detectors with one fixed protocol", ": recordings, "
        "lifts in which false alarms have a price, taps, cost. Three minutes a detector, seven "
        "more in a new folder.", (
        "grasp benchmark", "grasp benchmark tcn mine.onnx mine.py:Vibration --split validation"),
        section=MEASURE)  # fmt: skip
    parser.option("detector NAME", "of config/detectors, or your files (default: all packaged "
        "ones)", nargs="*")  # fmt: skip
    parser.option("--split", "tune and train on validation; test is for the last figure",
        choices=("validation", "test"), default="test")  # fmt: skip
    parser.option("--recording FILE", "labelled real recordings to score as well", Path, nargs="+")
    parser.option("--layout NAME", "of the fingertips' taxels, in config/layouts", default="")
    parser.option("--out DIR", "folder of recordings and results (default: %(default)s)",
        folder_to_fill, default=Path("runs/benchmark"))  # fmt: skip
    share(parser, "config set jobs cluster json")


def _add_devices(root: Parser) -> None:
    doctor = root.command("doctor", "check this machine and a rig's devices; moves nothing", "", (
        "grasp doctor", "grasp doctor --rig hardware --config lab.toml",
        "grasp doctor 192.168.1.10"), section=LAB)  # fmt: skip
    doctor.option("hosts HOST", "list the devices that respond there, with settings for a --config "
        "file. HOST, HOST:PORT of a gripper, or tcp://HOST:PORT of an emulated fingertip board",
        nargs="*")  # fmt: skip
    doctor.option("--rig NAME", "also query the devices of this rig")
    share(doctor, "object profile detector config set runs json")
    status = root.command("status", "show the state of the gripper or arm; moves nothing", "", (
        "grasp status gripper --config lab.toml", "grasp status arm --config lab.toml"),
        section=LAB)  # fmt: skip
    status.option("device", "device to query", choices=("gripper", "arm"))
    _add_lab(status, moves=False)
    _add_gripper(root.command("gripper", "activate the gripper, move it slowly", section=LAB))
    _add_arm(root.command("arm", "a slow step, the way back to a run's start, a stop", section=LAB))
    _add_tactile(root.command("tactile", "show fingertip wiring, rest and noise", section=LAB))
    _add_calibrate(root.command("calibrate", "calibrate counts, force and noise", section=LAB))
    release = root.command("release", f"open all fingers {SLOW}", ". Support the object first: it "
        "falls when the fingers open. Needs only the gripper.",
        ("grasp release --rig cell.toml --confirm-motion",), section=LAB)  # fmt: skip
    release.flag("--activate", "activate an inactive hand: it opens and closes fully")
    _add_lab(release)
    _add_emulate(root)


def _add_lab(parser: Parser, moves: bool = True) -> None:
    """Add the shared options; if the command ``moves``, `--confirm-motion` and `--dry-run` too."""
    parser.option("--rig NAME", "hardware, or a .toml file of a similar rig", default="hardware")
    share(parser, "config set json confirm dry" if moves else "config set json")


def _add_gripper(group: Parser) -> None:
    activate = group.command("activate", "activate the hand: it opens and closes fully")
    activate.flag("--empty", "confirm that the hand is empty, instead of being asked")
    close = group.command("close", f"close fingers {SLOW}: B and C until contact, then the thumb")
    close.option("--to COUNTS", "largest position", whole(0, 255), default=255)
    step = group.command("step", f"move a finger by a few millimetres {SLOW}", "", (
        "grasp gripper step --finger B --mm 2 --config lab.toml --confirm-motion",
        "grasp gripper step --finger B --mm 2 --open --config lab.toml --dry-run"))  # fmt: skip
    step.option(
        "--mm MM", "travel of the fingertip, at most 5", decimal(0.01, 5, "mm"), default=2.0
    )
    step.flag("--open", "open instead of closing")
    for parser, finger in ((close, "all"), (step, "A")):
        parser.option("--finger", "A is the thumb", choices=(*FINGERS, "all"), default=finger)
    for parser in (activate, close, step):
        _add_lab(parser)


def _add_arm(group: Parser) -> None:
    step = group.command("step", f"one step of at most 5 mm in the base frame, at {ARM_SPEED}", "",
        ("grasp arm step --z 3 --config lab.toml --confirm-motion",))  # fmt: skip
    for axis, text in (("x", "mm along x"), ("y", "mm along y"), ("z", "mm upwards")):
        step.option(f"--{axis} MM", text, decimal(-5, 5, "mm"), default=0.0)
    back = group.command("back", f"move back to the height where a run began, at {ARM_SPEED}", "",
        ("grasp arm back --config lab.toml --confirm-motion",))  # fmt: skip
    back.option("run RUN", "folder of the run (default: the last one in runs/)", Path, nargs="?")
    stop = group.command("stop", "stop the arm's program; needs no --confirm-motion")
    for parser in (step, back, stop):
        _add_lab(parser)


def _add_tactile(group: Parser) -> None:
    identify = group.command("identify", "press a pad and see which finger and taxel respond")
    identify.option("--url URL", "emulated board, tcp://HOST:PORT (default: usb.url)")
    identify.option("--seconds N", "duration, s", decimal(0.01, 86_400, "s"), default=10.0)
    share(identify, "config set json")
    watch = group.command("watch", "show counts, noise and lost frames each second; start unloaded")
    watch.option("--seconds N", "duration, s (default: 3600, with --rest 5)",
        decimal(1, 86_400, "s"))  # fmt: skip
    watch.flag("--rest", "print the rest codes of the unloaded hand as tactile.rest_reference")
    watch.option("--out FILE", "with --rest: new file to write", file_to_write)
    _add_lab(watch, moves=False)


def _add_calibrate(group: Parser) -> None:
    force = group.command("force", "calibrate the fingertips' counts with a scale", "", (
        "grasp calibrate force --out force.toml --config lab.toml",))  # fmt: skip
    hand = group.command("hand", "measure the force of force byte 0 with a scale", "", (
        "grasp calibrate hand --up-to 16 --out hand3.toml --config lab.toml --confirm-motion",
    ))  # fmt: skip
    hand.flag("--scale", "confirm that one fingertip is over a scale and the hand is empty")
    force.option("--finger", "all: one after the other", choices=(*FINGERS, "all"), default="all")
    hand.option("--finger", "finger to calibrate", choices=FINGERS, default="A")
    for parser in (force, hand):
        parser.option("--up-to N", "largest force to measure, N; larger readings are refused"
            + (" (default: guard.force_limit_n)" if parser is force else ""),
            decimal(0.1, MAX_FORCE_N, "N"), required=parser is hand)  # fmt: skip
    noise = group.command("noise", "tune the decision rule to your fingertips' noise, without "
        "labels: the hand holds an object at rest, then opens", "", (
        "grasp calibrate noise --out rule.toml --config lab.toml --confirm-motion",))  # fmt: skip
    noise.option("--detector NAME", "detector to tune", default="tcn")
    noise.option("--budget N", "false alarms per minute and hand", decimal(0.001, 60), default=0.5)
    shortest_s = SHORTEST_HOLD_S + 5
    noise.option("--seconds N", f"duration of the hold, s ({shortest_s:g} to 3600, default: 180)",
        decimal(shortest_s, 3600, "s"), default=180.0)  # fmt: skip
    for parser in (force, hand, noise):
        parser.option("--out FILE", "new .toml file to write", file_to_write, required=True)
        parser.option("--note TEXT", "text to add to the source in the file", default="")
        _add_lab(parser)


def _add_emulate(root: Parser) -> None:
    parser = root.command("emulate", "run the emulated cell: gripper, fingertips and arm", ". "
        "Prints its endpoints as one JSON line and ends on SIGINT or SIGTERM. Standard input takes "
        f"the actions of an operator, one per line: {OPERATOR_ACTIONS}.",
        ("grasp emulate --host 127.0.0.2 --gripper-port 5020",), section=LAB)  # fmt: skip
    parser.option("--host ADDRESS", "loopback address, not 127.0.0.1 (default: a free one)")
    parser.option("--gripper-port PORT", "(default: a free one)", whole(0, 65_535), default=0)
    parser.flag("--beyond-loopback", "allow any --host of this machine; control and fault channels "
        "need the token printed with the endpoints")  # fmt: skip
    parser.option("--profile", "arm controller", choices=("cb3", "e-series"), default="cb3")
    parser.option("--write FILE.toml", "write the settings of a lab that has these devices, for "
        "--config with the rig hardware", file_to_write)  # fmt: skip
    parser.flag("--rtu", "offer the gripper on a serial line (a pseudo-terminal) too")
    parser.option("--object NAME", OBJECT_HELP, default="can")
    share(parser, "seed config set")
