"""Every command of `grasp` with its options and help. What a command does is a function of its name
in the module that ``main.module_of`` gives: `grasp gripper step` is ``devices.gripper_step``."""

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
TRY, MEASURE, LAB, SET_UP = "try", "measure", "a lab's devices", "set up"  # sections of the help
ROOT = (
    "Closed-loop grasp controller: feels slip with barometric fingertips and closes a Robotiq "
    "3-Finger gripper as fast as it can within a force limit."
)
ROOT_END = (
    "`grasp COMMAND --help` has its options and examples. Exit codes: 0 success, 1 trial failed, "
    "2 usage or configuration, 3 device, 4 safety stop, 5 could not record or internal error, 130 "
    "interrupted (143 told to end, 129 terminal closed)."
)
FINGERS = ("A", "B", "C")
SLOW = "slowly, at its least force"
ARM_SPEED = "10 mm/s in a straight line"
MANUAL_MOST_N = 60.0  # of the hand, at its greatest force
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
    _add_recordings(root)
    _add_campaign(root.command("campaign", "run a grid of trials in parallel", section=MEASURE))
    _add_dataset(root.command("dataset", "data sets of labelled recordings", section=MEASURE))
    _add_detector(root.command("detector", "score, tune, train slip detectors", section=MEASURE))
    _add_devices(root)
    config = root.command("config", "show the resolved settings, or check files of your own", ". "
        "Prints every setting with its value, its allowed range and its source. A FILE may be an "
        "object, surface, calibration, rig, campaign, data set, or settings for --config.", (
        "grasp config object --object ball", "grasp config mug.toml cell.toml lab.toml",
        "grasp config --config lab.toml --config grip.toml"), section=SET_UP)  # fmt: skip
    config.option("section SECTION|FILE", "sections to show, or files to check", nargs="*")
    share(config, "object profile detector rig config set json")
    return root


def _add_run(group: Parser) -> None:
    lift = group.command("lift", "lift an object held too weakly", "", (
        "grasp run lift --object can",
        "grasp run lift --object ./mug.toml --rig simulated --seed 7 --report",
        "grasp run lift --detector mine.py:Tremble --set object.mass_kg=0.3 --json",
        "grasp run lift --rig cell.toml --config grip.toml --trials 20 --confirm-motion",
    ))  # fmt: skip
    tap = group.command("tap", "strike an object held at the force limit", "", (
        "grasp run tap --object ball",
        "grasp run tap --object can --rig simulated --trials 5 --direction side"))  # fmt: skip
    press = group.command("acquire", "press and stroke one fingertip, for labelled slip data", "", (
        "grasp run acquire --surface sphere --direction 45 --seconds 10",))  # fmt: skip
    lift.flag("--keep", "keep holding the object instead of setting it down")
    lift.flag("--first", "a lab's first lift: slow, at the least force, with questions between")
    tap.option("--direction DIR", "top, side (across the closing axis), closing (along it), or "
        "alternate: top and side in turn (default: alternate)")  # fmt: skip
    tap.set_defaults(keep=False, first=False)
    press.option("--surface NAME", "one of config/surfaces, or a .toml file", default="planar")
    press.option("--direction DIR", "degrees in steps of 45, or cw or ccw", default="0")
    press.option("--speed MPS", "speed of a stroke, m/s", decimal(0.004, 0.2), default=0.05)
    press.option("--seconds S", "length of the recording", decimal(1, 3600), default=20.0)
    press.set_defaults(view=False)
    for name, parser in (("lift", lift), ("tap", tap)):
        share(parser, "object profile detector")
        parser.option("--trials N", f"number (default: {TRIALS[name]})", whole(1, 10_000))
        parser.option("--out FILE", "SQLite file with one row per trial", file_with_folders)
        parser.flag("--resume", "continue --out: run missing trials and those ended by a device")
        parser.flag("--report", "write a page beside each recording")
        parser.flag("--view", "show the run on a page for a browser on this machine")
    for name, parser in (("lift", lift), ("tap", tap), ("acquire", press)):
        parser.set_defaults(scenario=name)
        parser.option("--runs DIR", "folder of recordings", folder_to_fill, default="runs")
        parser.option("--pace", "virtual time (default: real if watched)", choices=("real", "max"))
        share(parser, "rig seed config set json confirm dry")


def _add_recordings(root: Parser) -> None:
    replay = root.command("replay", "feed a recording through detector and controller again", "", (
        "grasp replay runs/20260102-101500-lift-can --check",
        "grasp replay --tactile fingertip.csv --detector energy"), section=TRY)  # fmt: skip
    replay.option("run RUN", "folder or recording.mcap of a run", Path, nargs="?")
    replay.flag("--check", "exit 1 if any event or command differs from the recording")
    replay.option("--tactile PATH", "a fingertip recording (.npz or .csv) instead of a run", Path)
    replay.option("--detector NAME", "with --tactile: a detector's name or path (default: that of "
        "profile default); with a RUN: where its own detector file is now")  # fmt: skip
    share(replay, "config set json")
    runs = root.command("runs", "list recorded runs, or sum up a campaign as the paper's Table IV",
        "", ("grasp runs", "grasp runs runs/campaigns/paper.sqlite"), section=TRY)  # fmt: skip
    runs.option("file FILE", "SQLite file of a campaign", Path, nargs="?")
    share(runs, "runs json")
    report = root.command("report", "write the page of a run, a campaign or an evaluation", "", (
        "grasp report runs/20260102-101500-lift-can", "grasp report scores.json",
        "grasp report runs/campaigns/paper.sqlite"), section=TRY)  # fmt: skip
    report.option("run RUN", "folder or recording.mcap of a run, SQLite file of a campaign, or "
        ".json file of `grasp detector evaluate --out`", Path)  # fmt: skip
    report.option("--out FILE.html", "(default: beside what it shows)", file_to_write)
    export = root.command("export", "a run or a campaign as a table, a run as a picture", ". csv: "
        "one row per control step, of a campaign per trial. svg: force, slip probability and slip "
        "distance over time; gif: the first slip in slow motion (both: extra `charts`). layout: "
        "for Foxglove and Lichtblick.",
        ("grasp export runs/20260102-101500-lift-can --to svg",
        "grasp export runs/campaigns/paper.sqlite --out paper.csv"), section=TRY)  # fmt: skip
    export.option("run RUN", "folder or recording.mcap of a run, or a campaign's file", Path)
    export.option("--to", "(default: by --out, else csv)", choices=("csv", "svg", "gif", "layout"))
    export.option("--out FILE", "(default: beside what it is made of)", file_to_write)


def _add_campaign(group: Parser) -> None:
    run = group.command("run", "run the trials of a campaign file", ". Each is a row of an SQLite "
        "file when it finishes. Exit code 1 if any ended with an error, whatever the verdicts.", (
        "grasp campaign run paper", "grasp campaign run mine.toml --jobs 4 --config lab.toml",
        "grasp campaign run mine.toml --resume"))  # fmt: skip
    run.option("campaign FILE", "campaign file, or the name of one of config/campaigns")
    run.option("--out FILE", "(default: runs/campaigns/<name>.sqlite)", file_with_folders)
    run.option("--detector NAME", "instead of the detectors of the campaign file")
    run.option("--profile NAME", "instead of the profiles of the campaign file")
    run.option("--repetitions N", "instead of the campaign file's", whole(1, 10_000))
    run.flag("--resume", "continue an existing file: run the missing and errored trials")
    share(run, "jobs cluster config set json")


def _add_dataset(group: Parser) -> None:
    build = group.command("build", "make all recordings of a data set, on the simulated rig", ". "
        "An interrupted build continues where it stopped.")  # fmt: skip
    build.option("config FILE", "its path, or the name of one of config/datasets")
    build.option("--share X", "share of the recordings to build", decimal(1e-4, 1), default=1.0)
    build.option("--seed N", "random seed (default: the file's)", whole(1, 2**31 - 1))
    share(build, "jobs cluster")
    collect = group.command("collect", "make a data set of your own labelled recordings", ". Of "
        "each five of a motion on a surface, three are for training, one for validation, one for "
        "test.")  # fmt: skip
    collect.option("source RUN|FILE", "acquisitions, .npz or .csv files", Path, nargs="+")
    for parser in (build, collect):
        parser.option("--out DIR", "folder to fill", folder_to_fill, required=True)
        share(parser, "json")


def _add_detector(group: Parser) -> None:
    labelled = "folders of `grasp dataset build` or `collect`"
    evaluate = group.command("evaluate", "score detectors on labelled fingertip recordings", "", (
        "grasp detector evaluate tcn energy --recording fingertip.csv",
        "grasp detector evaluate mine.onnx mine.py:Tremble --data sets/paper"))  # fmt: skip
    evaluate.option("detector NAME", "one or more of config/detectors, or your own", nargs="+")
    source = evaluate.add_mutually_exclusive_group(required=True)
    source.add_argument("--recording", type=Path, metavar="RUN|FILE", help="folder of `grasp run "
        "acquire`, .npz, or CSV with t_s,p0,p1,...,slip[,slip_true]")  # fmt: skip
    source.add_argument("--data", type=Path, nargs="+", metavar="DIR", help=labelled)
    evaluate.option("--split", "with --data: the split to score",
        choices=("train", "validation", "test", "all"), default="test")  # fmt: skip
    evaluate.option("--label", "slip: by the fingertip's speed; slip_true: the contact itself "
        "slides; moved: 1 mm from its last rest", choices=LABELS, default="slip")  # fmt: skip
    evaluate.option("--out FILE.json", "scores and misses, for `grasp report`", file_to_write)
    tune = group.command("tune", "find the quickest decision within a budget of false events", "",
        ("grasp detector tune mine.py:Tremble --data sets/paper sets/disturbances",))  # fmt: skip
    tune.option("detector NAME", "one of config/detectors, or your own")
    tune.option("--budget N", "false events a minute of a hand", decimal(0, 6000), default=1.0)
    source = tune.add_mutually_exclusive_group(required=True)
    source.add_argument("--data", type=Path, nargs="+", metavar="DIR", help=labelled)
    source.add_argument("--unlabelled", type=Path, nargs="+", metavar="RUN|FILE", help="lifts, "
        ".npz or .csv of minutes of hold without slip: tunes the threshold alone")  # fmt: skip
    share(evaluate, "config set json")
    share(tune, "config set json")
    card = group.command("card", "show the card of a network: data, seed, commit, calibration")
    card.option("network NAME|FILE.onnx", "(default: list all packaged detectors)", nargs="?")
    share(card, "json")
    train = group.command("train", "train a network and write its weights (extra `train`)", ". "
        "Stops early and calibrates on the split `validation`, never uses `test`.")  # fmt: skip
    train.option("network NAME", ", ".join(NETWORKS), choices=NETWORKS)
    train.option("--data DIR", labelled, Path, nargs="+", required=True)
    train.option("--out FILE.onnx", "weights to write (default: NAME.onnx)", file_with_folders)
    train.flag("--force", "overwrite --out, and the files of an unfinished training beside it")
    train.flag("--resume", "continue from the checkpoint beside --out")
    train.option("--seed N", "", seed, default=0)
    train.option("--steps N", "optimiser steps", whole(1, 10**9))
    train.option("--validations N", "validations (default: the network's)", whole(1, 1000))
    train.option("--augmentation", "paper: as its text says; as-run: as its code ran; ours: also "
        "gain, offset, lost samples, dead and swapped taxels",
        choices=("none", "paper", "as-run", "ours"))  # fmt: skip
    train.flag("--windows", "tcn-paper: learn from the last sample of windows, as its authors did")
    train.option("--label", "what to learn, as for `evaluate` (default: slip)", choices=LABELS)
    share(train, "json")


def _add_devices(root: Parser) -> None:
    doctor = root.command("doctor", "check this machine and a rig's devices; moves nothing", "", (
        "grasp doctor", "grasp doctor --rig hardware --config lab.toml",
        "grasp doctor 192.168.1.10"), section=LAB)  # fmt: skip
    doctor.option("hosts HOST", "list the devices that answer there, with settings for a --config "
        "file. HOST, HOST:PORT of a gripper, or tcp://HOST:PORT of an emulated fingertip board",
        nargs="*")  # fmt: skip
    doctor.option("--rig NAME", "also query the devices of this rig")
    share(doctor, "object profile detector config set runs json")
    status = root.command("status", "what a lab's gripper or arm reports; moves nothing", "", (
        "grasp status gripper --config lab.toml", "grasp status arm --config lab.toml"),
        section=LAB)  # fmt: skip
    status.option("device", "", choices=("gripper", "arm"))
    _add_lab(status, moves=False)
    _add_gripper(root.command("gripper", "activate a lab's gripper, move it slowly", section=LAB))
    _add_arm(root.command("arm", "move a lab's arm by one slow step, stop it", section=LAB))
    _add_tactile(root.command("tactile", "fingertips: wiring, rest and noise", section=LAB))
    _add_calibrate(root.command("calibrate", "calibrate counts, force and noise", section=LAB))
    release = root.command("release", f"open all fingers of a hand {SLOW}", ". Support the object "
        "first: it falls when the fingers open. Needs only the gripper.",
        ("grasp release --rig cell.toml --confirm-motion",), section=LAB)  # fmt: skip
    release.flag("--activate", "activate an inactive hand, which opens and closes it fully")
    _add_lab(release)
    _add_emulate(root)


def _add_lab(parser: Parser, moves: bool = True) -> None:
    """Options that they share; of what ``moves``, `--confirm-motion` and `--dry-run` too."""
    parser.option("--rig NAME", "hardware, or a .toml file of a similar rig", default="hardware")
    share(parser, "config set json confirm dry" if moves else "config set json")


def _add_gripper(group: Parser) -> None:
    activate = group.command("activate", "make the hand ready, which opens and closes it fully")
    activate.flag("--empty", "the hand is empty: do not ask whether it is")
    close = group.command("close", f"close fingers {SLOW}: B and C until contact, then the thumb")
    close.option("--to COUNTS", "no further than this", whole(0, 255), default=255)
    step = group.command("step", f"move a finger by a few millimetres {SLOW}", "", (
        "grasp gripper step --finger B --mm 2 --config lab.toml --confirm-motion",
        "grasp gripper step --finger B --mm 2 --open --config lab.toml --dry-run"))  # fmt: skip
    step.option("--mm MM", "travel of the fingertip, at most 5", decimal(0.01, 5), default=2.0)
    step.flag("--open", "open by that instead of closing")
    for parser, finger in ((close, "all"), (step, "A")):
        parser.option("--finger", "A is the thumb", choices=(*FINGERS, "all"), default=finger)
    for parser in (activate, close, step):
        _add_lab(parser)


def _add_arm(group: Parser) -> None:
    step = group.command("step", f"one step of at most 5 mm in the base frame, at {ARM_SPEED}", "",
        ("grasp arm step --z 3 --config lab.toml --confirm-motion",))  # fmt: skip
    for axis, text in (("x", "mm along x"), ("y", "mm along y"), ("z", "mm upwards")):
        step.option(f"--{axis} MM", text, decimal(-5, 5), default=0.0)
    stop = group.command("stop", "end the program that moves the arm; needs no --confirm-motion")
    for parser in (step, stop):
        _add_lab(parser)


def _add_tactile(group: Parser) -> None:
    identify = group.command("identify", "press a pad and see which finger and taxel responds")
    identify.option("--url URL", "an emulated board, tcp://HOST:PORT (default: usb.url)")
    identify.option("--seconds N", "watch for N seconds", decimal(0.01, 86_400), default=10.0)
    share(identify, "config set json")
    watch = group.command("watch", "counts, noise and lost frames each second; begin unloaded")
    watch.option("--seconds N", "(default: 3600, with --rest 5)", decimal(1, 86_400))
    watch.flag("--rest", "print the rest codes of the unloaded hand as tactile.rest_reference")
    watch.option("--out FILE", "with --rest: write that file (a new one)", file_to_write)
    _add_lab(watch, moves=False)


def _add_calibrate(group: Parser) -> None:
    force = group.command("force", "counts of a fingertip to newtons; type what a scale says", "", (
        "grasp calibrate force --finger B --out force-B.toml --config lab.toml",))  # fmt: skip
    hand = group.command("hand", "force byte 0 to newtons: the finger presses on a scale", "", (
        "grasp calibrate hand --up-to 16 --out hand3.toml --config lab.toml --confirm-motion",
    ))  # fmt: skip
    hand.flag("--scale", "one fingertip over a scale, and no object in the hand: do not ask")
    for parser in (force, hand):
        parser.option("--finger", "", choices=FINGERS, default="A")
        parser.option("--up-to N", "largest force, N; it may exceed the limit of a run"
            + (" (default: guard.force_limit_n)" if parser is force else ""),
            decimal(0.1, MANUAL_MOST_N), required=parser is hand)  # fmt: skip
    noise = group.command("noise", "the decision rule that your fingertips allow, without labels: "
        "the hand holds something still, and lets it go", "", (
        "grasp calibrate noise --out rule.toml --config lab.toml --confirm-motion",))  # fmt: skip
    noise.option("--detector NAME", "", default="tcn")
    noise.option("--budget N", "false events a minute of a hand", decimal(0.001, 60), default=0.5)
    noise.option("--seconds N", "of hold", decimal(SHORTEST_HOLD_S + 5, 3600), default=180.0)
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
    parser.flag("--beyond-loopback", "let --host be any address of this machine; control and fault "
        "channels need the token printed with the endpoints")  # fmt: skip
    parser.option("--profile", "the arm's", choices=("cb3", "e-series"), default="cb3")
    parser.flag("--rtu", "put the gripper on a serial line (a pseudo-terminal) too")
    parser.option("--object NAME", OBJECT_HELP, default="can")
    share(parser, "seed config set")
