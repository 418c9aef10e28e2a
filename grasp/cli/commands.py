"""Every command of `grasp` with its options and help. What a command does is a function of its name
in the module that ``main.module_of`` gives: `grasp gripper step` is ``devices.gripper_step``."""

from pathlib import Path

from grasp.cli.options import (
    OBJECT_HELP,
    decimal,
    file_to_write,
    file_with_folders,
    folder_to_fill,
    picture,
    seed,
    share,
    whole,
)
from grasp.cli.parser import Parser

TRIALS = {"lift": 1, "tap": 20}  # taps: paper, section V-B
LABELS = ("slip", "slip_true", "moved")
NETWORKS = ("tcn", "gru", "tcn-paper", "freq-cnn-paper")
NO_LIMIT_MINUTES = 1e9
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
MANUAL_LEAST_N, MANUAL_MOST_N = 15.0, 60.0  # of the hand, at its least and greatest force
SHORTEST_HOLD_S = 30.0


def build_parser() -> Parser:
    """The whole command line."""
    root = Parser(prog="grasp", description=ROOT, epilog=ROOT_END)
    root.flag("--version", "show the version and exit")
    _add_run(root.command("run", "run a scenario", section=TRY))
    _add_recordings(root)
    _add_campaign(root.command("campaign", "run a grid of trials in parallel; sum it up as the "
        "paper's Table IV", section=MEASURE))  # fmt: skip
    _add_dataset(root.command("dataset", "build and collect data sets of labelled fingertip "
        "recordings", section=MEASURE))  # fmt: skip
    _add_detector(root.command("detector", "score, tune and train slip detectors",
        section=MEASURE))  # fmt: skip
    _add_devices(root, LAB)
    config = root.command("config", "show the resolved settings, check files of your own", ". "
        "Prints every setting with its value, its allowed range and its source. With FILE (your "
        "own .toml: an object, surface, calibration, rig, campaign, data set, or settings for "
        "--config) it checks that file alone instead. Opens no device and runs no trial, but loads "
        "the detectors of a campaign. Exit code 2 if a file is wrong.", (
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
    tap = group.command("tap", "strike an object held at the force cap", "", (
        "grasp run tap --object ball",
        "grasp run tap --object can --rig simulated --trials 5 --direction side"))  # fmt: skip
    for parser in (lift, tap):
        share(parser, "object profile detector rig seed config set")
    lift.flag("--keep", "keep holding the object instead of setting it down")
    lift.flag("--first", "a lab's first lift: close in free air, then lift a soft object, at half "
        "speed and the least force, with a question before each")  # fmt: skip
    tap.option("--direction DIR", "direction of the taps: top, side (across the closing axis), "
        "alternate (the two in turn), or closing (along that axis; default: "
        "alternate)")  # fmt: skip
    tap.set_defaults(keep=False, first=False)
    press = group.command("acquire", "press one fingertip on a fixed surface and stroke it, for "
        "labelled slip data", "", (
        "grasp run acquire --surface sphere --direction 45 --seconds 10",))  # fmt: skip
    press.option("--surface NAME", "one of config/surfaces: planar, sphere, cylinder-x, "
        "cylinder-y, or the path of a .toml file", default="planar")  # fmt: skip
    press.option("--direction DIR", "degrees in the fingertip's plane in steps of 45, or cw or "
        "ccw", default="0")  # fmt: skip
    press.option("--speed MPS", "commanded speed of a stroke, m/s; a rotation turns at 1 rad/s",
        decimal(0.004, 0.2), default=0.05)  # fmt: skip
    press.option("--seconds S", "length of the recording", decimal(1, 3600), default=20.0)
    share(press, "rig seed config set")
    for name, parser in (("lift", lift), ("tap", tap)):
        parser.option("--trials N", "number of trials in sequence, with seeds from --seed on "
            f"(default: {TRIALS[name]})", whole(1, 10_000))  # fmt: skip
        parser.option("--out FILE", "write one row per trial to this SQLite file; `grasp runs "
            "FILE` reads it (default on the hardware rig, for several trials: a new file in "
            "--runs)", file_with_folders)  # fmt: skip
        parser.flag("--resume", "continue --out: run the trials that are missing or that a device "
            "ended")  # fmt: skip
        parser.flag("--report", "write a page beside each recording, as `grasp report` does")
    for name, parser in (("lift", lift), ("tap", tap), ("acquire", press)):
        parser.set_defaults(scenario=name)
        parser.option("--runs DIR", "folder of recordings", folder_to_fill, default="runs")
        if parser is press:
            parser.set_defaults(view=False)
        else:
            parser.flag("--view", "show the run on a page for a browser, on this machine only; its "
                "address is printed on standard error")  # fmt: skip
        parser.option("--pace", "on the simulated rig: virtual time in real time, or as fast as "
            "possible (default: real in a terminal and with --view, max otherwise)",
            choices=("real", "max"))  # fmt: skip
        share(parser, "json confirm dry")


def _add_recordings(root: Parser) -> None:
    replay = root.command("replay", "feed a recording through detector, slip monitor and "
        "controller", "", ("grasp replay runs/20260102-101500-lift-can --check",
        "grasp replay --tactile fingertip.csv --detector energy"), section=TRY)  # fmt: skip
    replay.option("run RUN", "folder or recording.mcap of a run", Path, nargs="?")
    replay.flag("--check", "exit 1 if any event or command differs from the recording")
    replay.option("--tactile PATH", "a fingertip recording instead of a run: .npz, or .csv "
        "(t_s,p0,p1,...,slip); --config and --set are for this alone", Path)  # fmt: skip
    replay.option("--detector NAME", "with --tactile: a detector's name or path (default: that of "
        "profile default); else where the run's own detector file is now")  # fmt: skip
    share(replay, "config set json")
    runs = root.command("runs", "list recorded runs with their verdicts; summarise a campaign as "
        "the paper's Table IV", "", ("grasp runs", "grasp runs runs/campaigns/paper.sqlite"),
        section=TRY)  # fmt: skip
    runs.option("file FILE", "SQLite file of a campaign: rates with intervals, latencies, slip "
        "distances", Path, nargs="?")  # fmt: skip
    share(runs, "runs json")
    report = root.command("report", "one page that shows a run, a campaign or an evaluation, in "
        "one file that opens from disk", ". A run: verdict, a picture that plays, forces, slip "
        "probability, commands, settings. A campaign: Table IV, distributions, failures. An "
        "evaluation of detectors: false events against delay, calibration, the worst misses.", (
        "grasp report runs/20260102-101500-lift-can", "grasp report scores.json",
        "grasp report runs/campaigns/paper.sqlite"), section=TRY)  # fmt: skip
    report.option("run RUN", "folder or recording.mcap of a lift or a tap, the SQLite file of a "
        "campaign, or the .json file of `grasp detector evaluate --out`", Path)  # fmt: skip
    report.option("--out FILE.html", "(default: beside the recording, or beside the file of a "
        "campaign or an evaluation, with its name)", file_to_write)  # fmt: skip
    export = root.command("export", "a run or a campaign as a CSV table, a run as a picture, or a "
        "viewer's layout", ". csv: one row per control step with units in the column names; for a "
        "campaign one row per trial. svg: force, slip probability and slip distance over time "
        "(needs the extra `charts`). layout: a Foxglove and Lichtblick layout for recording.mcap.",
        ("grasp export runs/20260102-101500-lift-can --to svg",
        "grasp export runs/campaigns/paper.sqlite --out paper.csv"), section=TRY)  # fmt: skip
    export.option("run RUN", "folder or recording.mcap of a lift or a tap, or the SQLite file of a "
        "campaign", Path)  # fmt: skip
    export.option("--to", "(default: by the name of --out, else csv)",
        choices=("csv", "svg", "layout"))  # fmt: skip
    export.option("--out FILE", "(default: beside the recording or the campaign, with its name; "
        "csv: .csv, svg: .svg, .png or .pdf, layout: .json)", file_to_write)  # fmt: skip


def _add_campaign(group: Parser) -> None:
    run = group.command("run", "run the trials of a campaign file", ". Runs every trial of a "
        "campaign file and writes each as a row of an SQLite file when it finishes. Exit code 0 "
        "when every trial ran, whatever its verdict; 1 if any errored; 130 when interrupted, with "
        "all finished rows kept.", ("grasp campaign run paper",
        "grasp campaign run mine.toml --jobs 4 --config lab.toml",
        "grasp campaign run mine.toml --resume"))  # fmt: skip
    run.option("campaign FILE", "campaign file, or the name of one of config/campaigns")
    run.option("--out FILE", "SQLite file to write (default: runs/campaigns/<name>.sqlite)",
        file_with_folders)  # fmt: skip
    run.option("--detector NAME", "use this instead of the detectors of the campaign file")
    run.option("--profile NAME", "use this instead of the profiles of the campaign file")
    run.option("--repetitions N", "use this instead of the campaign file's", whole(1, 10_000))
    run.flag("--resume", "continue an existing file: run the missing and errored trials")
    share(run, "jobs cluster config set json")


def _add_dataset(group: Parser) -> None:
    build = group.command("build", "make all recordings of a data set, on the simulated rig", ". "
        "The same file gives the same recordings, on any number of processes. An interrupted build "
        "continues where it stopped.")  # fmt: skip
    build.option("config FILE", "its path, or the name of one of config/datasets: paper, "
        "confusers, grasped-slip, mallet, observer, turning")  # fmt: skip
    build.option("--share X", "share of the recordings to build, at most 1, with the same "
        "distribution; at least three recordings of each kind", decimal(1e-4, 1),
        default=1.0)  # fmt: skip
    build.option("--seed N", "random seed for other recordings of the same distribution "
        "(default: the file's seed)", whole(1, 2**31 - 1))  # fmt: skip
    share(build, "jobs cluster")
    collect = group.command("collect", "make a data set of your own recordings", ": labelled "
        "samples of acquisitions, and .npz or .csv files. Of each five of a motion on a surface, "
        "three are for training, one for validation, one for test; three put it into each "
        "split.")  # fmt: skip
    collect.option("source RUN|FILE", "folders of `grasp run acquire`, and files of counts (.npz, "
        ".csv)", Path, nargs="+")  # fmt: skip
    for parser in (build, collect):
        parser.option("--out DIR", "folder to fill", folder_to_fill, required=True)
        share(parser, "json")


def _add_detector(group: Parser) -> None:
    labelled = "folders of `grasp dataset build`, or `collect`"
    evaluate = group.command("evaluate", "score detectors on labelled fingertip recordings", ". "
        "Scores the samples from the hundredth of a recording on; a miss counts as an infinite "
        "delay.", ("grasp detector evaluate tcn energy --recording fingertip.csv",
        "grasp detector evaluate mine.onnx mine.py:Tremble --data sets/paper"))  # fmt: skip
    evaluate.option("detector NAME", "one or more of config/detectors", nargs="+")
    source = evaluate.add_mutually_exclusive_group(required=True)
    source.add_argument("--recording", type=Path, metavar="RUN|FILE", help="folder of `grasp run "
        "acquire`, .npz, or CSV with t_s,p0,p1,...,slip[,slip_true], counts with the rest value "
        "removed")  # fmt: skip
    source.add_argument("--data", type=Path, nargs="+", metavar="DIR", help=labelled)
    evaluate.option("--split", "with --data: the split to score; `all` is fair only on a set built "
        "from another seed", choices=("train", "validation", "test", "all"),
        default="test")  # fmt: skip
    evaluate.option("--label", "slip: by the fingertip's speed, as in the paper; slip_true: the "
        "contact itself slides; moved: 1 mm from where it last rested", choices=LABELS,
        default="slip")  # fmt: skip
    evaluate.option("--out FILE.json", "write the scores, those of each rule in the sweep of "
        "`tune`, and the worst misses; `grasp report FILE.json` makes a page of it",
        file_to_write)  # fmt: skip
    tune = group.command("tune", "find the quickest decision within a budget of false events", ". "
        "With --data: kind, threshold and length of the decision rule, on the split `validation`; "
        "with --unlabelled its threshold, on holds in which nothing slips.",
        ("grasp detector tune mine.py:Tremble --data sets/paper sets/confusers",))  # fmt: skip
    tune.option("detector NAME", "one of config/detectors, or your own")
    tune.option("--budget N", "false events a minute of all three fingers; too little rest for "
        "one event is refused; 0: none in the rest that the data have", decimal(0, 6000),
        default=1.0)  # fmt: skip
    source = tune.add_mutually_exclusive_group(required=True)
    source.add_argument("--data", type=Path, nargs="+", metavar="DIR", help=labelled)
    source.add_argument("--unlabelled", type=Path, nargs="+", metavar="RUN|FILE", help="minutes of "
        "hold in which nothing slips, each ended by opening the hand: folders of lifts with a long "
        "controller.hold_s, .npz or .csv")  # fmt: skip
    share(evaluate, "config set json")
    share(tune, "config set json")
    card = group.command("card", "show the card of a network: data, seed, commit, calibration")
    card.option("network NAME|FILE.onnx", "packaged name, or a file; without it: list all "
        "detectors, the default and the rule of each", nargs="?")  # fmt: skip
    share(card, "json")
    _add_train(group.command("train", "train a network on data sets and write its weights (extra "
        "`train`)", ". One thread. Trains on the split `train`, stops early and calibrates on the "
        "split `validation`, never uses `test`."), labelled)  # fmt: skip


def _add_train(train: Parser, labelled: str) -> None:
    train.option("network NAME", ", ".join(NETWORKS), choices=NETWORKS)
    train.option("--data DIR", labelled, Path, nargs="+", required=True)
    train.option("--out FILE.onnx", "weights to write (default: NAME.onnx here); checkpoint and "
        "log are beside it, and start again without --resume", file_with_folders)  # fmt: skip
    train.flag("--force", "overwrite --out, and the files of an unfinished training beside it")
    train.flag("--resume", "continue from the checkpoint beside --out")
    train.option("--seed N", "", seed, default=0)
    train.option("--steps N", "optimiser steps", whole(1, 10**9))
    train.option("--validations N", "validations, evenly over the steps (default: the network's)",
        whole(1, 1000))  # fmt: skip
    train.option("--minutes M", "processor minutes after which it ends with what it has (default: "
        "no limit)", decimal(0, NO_LIMIT_MINUTES), default=NO_LIMIT_MINUTES)  # fmt: skip
    train.option("--augmentation", "four symmetries at 25 %% and noise of 1 %% of the range (the "
        "paper's text), half turns at 75 %% and noise of half a count (its code as it ran), or "
        "ours: symmetries, gain, offset, noise, lost samples, dead, stuck and swapped taxels",
        choices=("none", "paper", "as-run", "ours"))  # fmt: skip
    train.flag("--windows", "tcn-paper: learn from the last sample of windows alone, at one rate, "
        "as its authors did")  # fmt: skip
    train.option("--label", "what to learn: slip by the fingertip's speed, slip of the contact "
        "itself, or distance from where it last rested (default: slip)",
        choices=LABELS)  # fmt: skip
    train.option("--moved-m M", "of the label moved: further than this, in metres (default: "
        "0.001)", decimal(1e-5, 0.1))  # fmt: skip
    share(train, "json")


def _add_devices(root: Parser, section: str) -> None:
    _add_doctor(root, section)
    status = root.command("status", "what a lab's gripper or arm reports, and what prevents a run; "
        "moves nothing", "", ("grasp status gripper --config lab.toml",
        "grasp status arm --config lab.toml"), section=section)  # fmt: skip
    status.option("device", "", choices=("gripper", "arm"))
    _add_lab(status, moves=False)
    _add_gripper(root.command("gripper", "activate a lab's gripper, move it slowly",
        section=section))  # fmt: skip
    _add_arm(root.command("arm", "move a lab's arm by one slow step, stop it", section=section))
    _add_tactile(root.command("tactile", "fingertips: wiring, rest and noise", section=section))
    _add_calibrate(root.command("calibrate", "calibrate counts and force bytes on a scale; fit the "
        "simulated fingertip", section=section))  # fmt: skip
    release = root.command("release", f"open all fingers of a hand {SLOW}", ". Support the object "
        "first: it falls when the fingers open. Needs only the gripper. The state of arm and "
        "fingertips is printed and prevents nothing.",
        ("grasp release --rig cell.toml --confirm-motion",), section=section)  # fmt: skip
    release.flag("--activate", "activate an inactive hand, which opens and closes it fully; it "
        "must be empty, or its object supported")  # fmt: skip
    _add_lab(release)
    _add_emulate(root, section)


def _add_lab(parser: Parser, moves: bool = True) -> None:
    """Options that they share; of what ``moves``, `--confirm-motion` and `--dry-run` too."""
    parser.option("--rig NAME", "hardware, or a .toml file of a similar rig", default="hardware")
    share(parser, "config set json confirm dry" if moves else "config set json")


def _add_doctor(root: Parser, section: str) -> None:
    doctor = root.command("doctor", "check this machine and the devices of a rig, or which devices "
        "answer at addresses; moves nothing", ". Reads only.", ("grasp doctor",
        "grasp doctor --rig hardware --config lab.toml", "grasp doctor 192.168.1.10"),
        section=section)  # fmt: skip
    doctor.option("hosts HOST", "query only these and print settings for a --config file. HOST: "
        "gripper (Modbus, port 502) and arm (29999, 30004); HOST:PORT: a gripper there; "
        "tcp://HOST:PORT: an emulated fingertip board", nargs="*")  # fmt: skip
    doctor.option("--rig NAME", "also query the devices of this rig (one of config/rigs, or a "
        ".toml file)")  # fmt: skip
    share(doctor, "object profile detector config set runs json")


def _add_gripper(group: Parser) -> None:
    activate = group.command("activate", "make the hand ready, which opens and closes it fully; "
        "one that is active in another mode is set to the basic one, for which it "
        "opens")  # fmt: skip
    activate.flag("--empty", "the hand is empty: do not ask whether it is")
    close = group.command("close", f"close fingers {SLOW}: B and C until anything is felt, then "
        "the thumb alone, under the force guard of a run, and refused where a run would "
        "be")  # fmt: skip
    close.option("--to COUNTS", "no further than this (default: %(default)s, closed)",
        whole(0, 255), default=255)  # fmt: skip
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
    for axis in "xyz":
        more = "; z is upwards" if axis == "z" else ""
        step.option(f"--{axis} MM", f"mm along that axis of the base{more}", decimal(-5, 5),
            default=0.0)  # fmt: skip
    stop = group.command("stop", "end the program that moves the arm, whichever client started it, "
        "and wait until the arm stands; needs no --confirm-motion, because a stop is never "
        "refused")  # fmt: skip
    for parser in (step, stop):
        _add_lab(parser)


def _add_tactile(group: Parser) -> None:
    identify = group.command("identify", "press a pad and see which finger and taxel responds")
    identify.option("--url URL", "an emulated board, tcp://HOST:PORT (default: usb.url, else the "
        "board on the USB bus)")  # fmt: skip
    identify.option("--serial", "the board with this number (default: usb.serial, else the first)")
    identify.option("--seconds N", "watch for N seconds", decimal(0.01, 86_400), default=10.0)
    identify.option("--least-fall COUNTS", "a code this far below its rest code is a press "
        "(default: %(default)d, about half a newton; an untouched taxel varies by one or two)",
        whole(2, 1023), default=20)  # fmt: skip
    share(identify, "config set json")
    watch = group.command("watch", "counts, noise and lost frames of each second, then of every "
        "taxel; begin unloaded")  # fmt: skip
    watch.option("--seconds N", "watch for N seconds (default: 3600, with --rest 5)",
        decimal(1, 86_400))  # fmt: skip
    watch.flag("--rest", "measure the rest codes of the unloaded hand and print them as "
        "tactile.rest_reference for your file")  # fmt: skip
    watch.option("--out FILE", "with --rest: write that file (a new one)", file_to_write)
    _add_lab(watch, moves=False)


def _add_calibrate(group: Parser) -> None:
    force = group.command("force", "counts of a fingertip to newtons: put weights on it or press "
        "a scale against it, and type what they say; nothing is moved", "", (
        "grasp calibrate force --finger B --out force-B.toml --config lab.toml",))  # fmt: skip
    hand = group.command("hand", "force byte 0 to newtons (an upper bound): the finger presses on "
        "a scale, and you type what it says", "", (
        "grasp calibrate hand --up-to 16 --out hand3.toml --config lab.toml --confirm-motion",
    ))  # fmt: skip
    hand.option("--presses N", "presses of force byte 0; a hand that presses with less than the "
        f"manual's {MANUAL_LEAST_N:g} N gets at least ten", whole(4, 100),
        default=10)  # fmt: skip
    hand.flag("--scale", "one fingertip over a scale, and no object in the hand: do not ask")
    for parser in (force, hand):
        parser.option("--finger", "", choices=FINGERS, default="A")
        parser.option("--up-to N", "largest force, N; it may exceed the limit of a run, up to the "
            f"manual's {MANUAL_MOST_N:g}; by the manual byte 0 may press with {MANUAL_LEAST_N:g}"
            + (" (default: the limit of a run, guard.force_limit_n)" if parser is force else ""),
            decimal(0.1, MANUAL_MOST_N), required=parser is hand)  # fmt: skip
    noise = group.command("noise", "the rule on slip that your fingertips allow, without labels: "
        "the hand holds something still for three minutes and lets it go; never below the rule "
        "that is there", "", (
        "grasp calibrate noise --out rule.toml --config lab.toml --confirm-motion",))  # fmt: skip
    noise.option("--detector NAME", "", default="tcn")
    noise.option("--budget N", "false events a minute of a hand", decimal(0.001, 60), default=0.5)
    noise.option("--seconds N", "duration of the hold", decimal(SHORTEST_HOLD_S + 5, 3600),
        default=180.0)  # fmt: skip
    for parser in (force, hand, noise):
        parser.option("--out FILE", "new .toml file to write, with date, spread and source",
            file_to_write, required=True)  # fmt: skip
        parser.option("--note TEXT", "text to add to the source in the file", default="")
        _add_lab(parser)
    fit = group.command("fingertip", "fit the simulated fingertip to a real recording, and show "
        "both side by side", ". The recording needs labelled strokes with pauses. Simulated "
        "recordings that the search did not use judge the fitted values. To use them, pass the "
        "--out file as --config to `grasp run`. The built-in values are fitted to the recording of "
        "the paper's authors.")  # fmt: skip
    fit.option("--recording PATH", "one fingertip, columns t_s,p0,p1,...,slip", Path, required=True)
    fit.flag("--check", "judge the built-in values without a search")
    fit.option("--rounds N", "rounds of the local search (default: 8)", whole(1, 1000))
    fit.option("--seed N", "random seed of the search; results of two seeds differ in what the "
        "recording does not determine", whole(0, 2**31 - 1), default=0)  # fmt: skip
    fit.option("--clips N", "number of simulated recordings that judge the result",
        whole(2, 100_000), default=48)  # fmt: skip
    fit.option("--out FILE.toml", "write the fitted values", file_to_write)
    fit.option("--figure FILE", "plot a simulated recording under the real one", picture)
    share(fit, "json")


def _add_emulate(root: Parser, section: str) -> None:
    parser = root.command("emulate", "run the emulated cell: gripper on Modbus TCP, fingertips "
        "over USB transfers, arm on RTDE", ". Prints its endpoints as one JSON line when it is "
        "ready and ends on SIGINT or SIGTERM. An object appears between the fingers once the hand "
        "is activated. Standard input takes the actions of an operator, one per line: place (the "
        "object on the table), take (it away), scale (what each fingertip presses with), home (the "
        "arm, to where it began), look, tap [top|side|closing], press FINGER TAXEL [NEWTONS] (on a "
        "pad, for a second, as `grasp tactile identify` asks), lay FINGER NEWTONS, fault NAME "
        "[SETTING=VALUE ...], fault help.", ("grasp emulate --host 127.0.0.2 --gripper-port 5020",),
        section=section)  # fmt: skip
    parser.option("--host ADDRESS", "loopback address, e.g. 127.0.0.2 (default: a free one; never "
        "127.0.0.1, where ur_rtde skips a check)")  # fmt: skip
    parser.option("--gripper-port PORT", "Modbus TCP port (default: a free one; 502 needs "
        "privileges)", whole(0, 65_535), default=0)  # fmt: skip
    parser.flag("--beyond-loopback", "let --host be any address of this machine, e.g. in a "
        "container; what the control and fault channels are asked then needs the token that is "
        "printed with the endpoints")  # fmt: skip
    parser.option("--profile", "the arm's controller: CB3 at 125 Hz (default), or e-Series at 500 "
        "Hz", choices=("cb3", "e-series"), default="cb3")  # fmt: skip
    parser.flag("--rtu", "put the gripper on a serial line too, a pseudo-terminal that is printed "
        "with the endpoints")  # fmt: skip
    parser.option("--object NAME", OBJECT_HELP, default="can")
    share(parser, "seed config set")
