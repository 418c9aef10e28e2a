"""Every command of `grasp`: a class with its options and its help. A function of the command's name
takes these options and implements it, in the module from ``main.module_of``: `grasp gripper step`
is ``devices.gripper_step``."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal, get_args

from grasp.cli.device_commands import LAB, SET_UP
from grasp.cli.options import (
    BUDGET,
    OBJECT_HELP,
    Confirm,
    Detector,
    Json,
    Motion,
    Object,
    Pool,
    Profile,
    Rig,
    Runs,
    Seed,
    Settings,
    SettingsJson,
    decimal,
    file_to_write,
    file_with_folders,
    folder_to_fill,
    whole,
)
from grasp.cli.parser import ARGUMENT, SOURCE, How, Options, Parser

# fmt: off
Label = Literal["slip", "slip_true", "moved"]
Network = Literal["tcn", "gru", "tcn-paper", "freq-cnn-paper"]
Pace = Literal["real", "max"]
RUN_HELP = (
    "folder of a run, its name as `grasp runs` lists it, or its recording.mcap (default: the last "
    "lift or tap in the folder runs)"
)
LABELLED = "folders of `grasp dataset build`, `collect` or `import`"
TRY, MEASURE = "try", "measure"  # sections of the help


class RunOptions(SettingsJson, Motion):
    """Of all scenarios."""

    runs: Annotated[Runs, folder_to_fill] = Path("runs")
    pace: Annotated[Pace | None, "of the simulated rig: real time, or as fast as possible "
        "(default: real with --view or at a terminal)"] = None
    rig: Rig = "emulated"
    seed: Seed = 0
    view = False


class TrialsOptions(RunOptions):
    """Of lifts and taps."""

    scenario: ClassVar[Literal["lift", "tap"]]
    object: str | None
    profile: Profile = "default"
    detector: Detector = None
    trials: int | None
    out: Annotated[Path | None, "FILE", "SQLite file with one row per trial",
        file_with_folders] = None
    resume: Annotated[bool,
        "continue --out: run missing trials and those ended by a device"] = False
    report: Annotated[bool, "write an HTML page for each recording"] = False
    view: Annotated[bool, "show the run on a local web page"] = False
    keep = first = unattended = False
    feed: int | None = None

    @property
    def number(self) -> int:
        """Number of trials."""
        return self.trials or (20 if self.scenario == "tap" else 1)  # taps: paper, section V-B

    @property
    def single(self) -> bool:
        """Whether it is one lift, without a file of rows."""
        return self.scenario == "lift" and self.trials is None and self.out is None

    @property
    def asked(self) -> bool:
        """Whether an operator is asked on real devices: not by an unattended lift."""
        return not self.unattended


class LiftOptions(TrialsOptions, command="run lift",
    about="lift an object from a weak grip and respond to slip", examples=(
        "grasp run lift --object can",
        "grasp run lift --object ./thermos.toml --rig simulated --seed 7 --report",
        "grasp run lift --detector mine.py:Vibration --set object.mass_kg=0.3 --json",
        "grasp run lift --rig cell.toml --config grip.toml --trials 20 --confirm-motion", )):
    scenario = "lift"
    keep: Annotated[bool, "keep holding the object instead of setting it down"] = False
    force: Annotated[float | None, "N", "estimated force of the first grasp, N (default: 2)",
        decimal(0.5, 30, "N")] = None
    first: Annotated[bool,
        "first lift of a new setup: slow, with the least force, step by step"] = False
    unattended: Annotated[bool, "on real devices, for one lift of a script: ask nobody"] = False
    feed: Annotated[int | None, "FD", argparse.SUPPRESS, whole(3, 65_535)] = None  # for `grasp ros`
    object: Annotated[str | None, "NAME", f"{OBJECT_HELP} (default: can, on real devices an "
        "unnamed object; with --first: foam)"] = None
    trials: Annotated[int | None, "N", "trials to run (default: 1)", whole(1, 10_000)] = None


class TapOptions(
    TrialsOptions, command="run tap", about="tap an object that is held at the force limit",
    examples=("grasp run tap --object ball",
              "grasp run tap --object can --rig simulated --trials 5 --direction side")):
    scenario = "tap"
    direction: Annotated[str | None, "DIR", "top, side (across the closing axis), closing (along "
        "it), or alternate: top and side in turn (default: alternate)"] = None
    object: Object = "can"
    trials: Annotated[int | None, "N", "trials to run (default: 20)", whole(1, 10_000)] = None


class AcquireOptions(RunOptions, command="run acquire",
    about="press and stroke one fingertip, for labelled slip data",
    examples=("grasp run acquire --surface sphere --direction 45 --seconds 10",)):
    surface: Annotated[str, "NAME", "one of config/surfaces, or a .toml file"] = "planar"
    direction: Annotated[str, "DIR", "degrees in steps of 45, or cw or ccw"] = "0"
    speed: Annotated[float, "MPS", "speed of a stroke, m/s", decimal(0.004, 0.2, "m/s")] = 0.05
    seconds: Annotated[float, "S", "length of the recording, s", decimal(1, 3600, "s")] = 20.0


class RosOptions(Settings, Confirm, command="ros", section=TRY,
    about="ROS 2 node with topics, services and an action",
    more=". Each lift runs in its own process, as `grasp run lift`. Needs ROS 2, or the extra "
    "`ros`.", examples=("grasp ros --rig simulated",
              "grasp ros --rig cell.toml --config grip.toml --confirm-motion")):
    runs: Annotated[Runs, folder_to_fill] = Path("runs")
    pace: Annotated[Pace, "of the simulated rig"] = "real"
    object: Annotated[str | None, "NAME", f"{OBJECT_HELP} (default: as `grasp run lift`)"] = None
    profile: Profile = "default"
    detector: Detector = None
    rig: Rig = "emulated"
    seed: Seed = 0
    stop_without_client: Annotated[bool, "stop a lift as by /grasp/stop once its client is gone"] \
        = False
    ros_args: Annotated[Sequence[str], "...", "for ROS 2, last: -r __ns:=/cell2, -r FROM:=TO",
        How(rest=True)] = ()


class ReplayOptions(SettingsJson, command="replay", section=TRY,
    about="run detector and controller on a recording again",
    examples=("grasp replay runs/20260102-101500-lift-can --check",
              "grasp replay --tactile fingertip.csv --detector energy")):
    run: Annotated[Path | None, "RUN", RUN_HELP, ARGUMENT] = None
    check: Annotated[bool, "exit 1 if any event or command differs from the recording"] = False
    tactile: Annotated[Path | None, "PATH",
        "a fingertip recording (.npz, .csv, or a folder of one) instead of a run"] = None
    detector: Annotated[str | None, "NAME", "with --tactile: a detector's name or path (default: "
        "that of profile default); with a RUN: the present path of its detector file"] = None


class RunsOptions(Json, command="runs", section=TRY,
    about="list recorded runs, or summarize a campaign (paper's Table IV)",
    examples=("grasp runs", "grasp runs runs/campaigns/paper.sqlite")):
    file: Annotated[Path | None, "FILE", "SQLite file of a campaign", ARGUMENT] = None
    runs: Runs = Path("runs")


class ReportOptions(Options, command="report", section=TRY,
    about="write an HTML page of a run, campaign or score file",
    examples=("grasp report runs/20260102-101500-lift-can", "grasp report scores.json",
              "grasp report runs/campaigns/paper.sqlite")):
    run: Annotated[Path | None, "RUN", f"{RUN_HELP}; SQLite file of a campaign; .json file of "
        "`detector evaluate --out`; folder or .json file of `benchmark`", ARGUMENT] = None
    out: Annotated[Path | None, "FILE.html", "page to write (default: next to the RUN)",
        file_to_write] = None


class ExportOptions(Options, command="export", section=TRY,
    about="export runs or a campaign as a table, a plot or a data set",
    more=". csv: one row per control step, of a campaign per trial. svg: force, slip probability "
    "and slip distance over time (--out: also .png, .pdf); gif: the first slip in slow motion"
    ". layout: for Foxglove and Lichtblick. lerobot: a data set for LeRobot, one episode per RUN; "
    "rosbag: a ROS 2 bag with the topics of the node (both: a folder). csv and layout need no "
    "extra, the others `exports`.", examples=("grasp export runs/20260102-101500-lift-can --to svg",
              "grasp export runs/*-lift-can --to lerobot --out cans",
              "grasp export runs/campaigns/paper.sqlite --out paper.csv")):
    run: Annotated[Sequence[Path], "RUN", f"{RUN_HELP}; or a campaign's file", ARGUMENT] = ()
    to: Annotated[Literal["csv", "svg", "gif", "layout", "lerobot", "rosbag"] | None,
        "default: by --out, else csv"] = None
    out: Annotated[Path | None, "FILE", "file or folder to write (default: next to the RUN)",
        file_to_write] = None


class CampaignRunOptions(
    Pool, SettingsJson, command="campaign run", about="run the trials of a campaign file",
    more=". Each finished trial is a row of an SQLite file. Exit code 1 if a trial ended with an "
    "error; a failed lift is no error.",
    examples=("grasp campaign run paper", "grasp campaign run mine.toml --jobs 4 --config lab.toml",
              "grasp campaign run mine.toml --resume")):
    campaign: Annotated[str, "FILE", "campaign file, or the name of one of config/campaigns",
        ARGUMENT]
    out: Annotated[Path | None, "FILE", "(default: runs/campaigns/<name>.sqlite)",
        file_with_folders] = None
    detector: Annotated[str | None, "NAME", "use instead of the campaign file's detectors"] = None
    profile: Annotated[str | None, "NAME", "use instead of the campaign file's profiles"] = None
    repetitions: Annotated[int | None, "N", "use instead of the campaign file's number",
        whole(1, 10_000)] = None
    record: Annotated[Literal["failures", "all", "none"] | None, "record each failed trial by a "
        "second run of it (default: the campaign file's, or failures), all trials, or "
        "none"] = None
    resume: Annotated[bool, "continue an existing file: run the missing and errored trials"] = False


class DatasetOptions(Json):
    """Of all commands that make a data set."""

    out: Annotated[Path, "DIR", "folder to fill", folder_to_fill]


class DatasetBuildOptions(Pool, DatasetOptions, command="dataset build",
    about="make all recordings of a data set, on the simulated rig",
    more=". An interrupted build continues where it stopped."):
    config: Annotated[str, "FILE", "data set file, or the name of one of config/datasets", ARGUMENT]
    share: Annotated[float, "X", "share of the recordings to build", decimal(1e-4, 1)] = 1.0
    seed: Annotated[int | None, "N", "random seed (default: the file's)",
        whole(1, 2**31 - 1)] = None


class DatasetCollectOptions(DatasetOptions, command="dataset collect",
    about="make a data set of your labelled recordings",
    more=". Of each five recordings of a motion on a surface, three are for training, one for "
    "validation, one for test."):
    source: Annotated[Sequence[Path], "RUN|FILE", "acquisitions, .npz or .csv files", ARGUMENT]


class DatasetImportOptions(DatasetOptions, command="dataset import",
    about="bring recordings of other programs into this format",
    more=". Each file is a table of text, at any rate, with or without a header; a cell may hold a "
    "list. Prints every change, and keeps it and the file's SHA-256 in the result.",
    examples=("grasp dataset import slip.csv --unit ms --columns 2-7 --sign positive "
              "--rest-seconds 0.5 --labels truth.csv --resample --out own",)):
    file: Annotated[Sequence[Path], "FILE", "tables with the same columns", ARGUMENT]
    time_column: Annotated[str, "NAME", "name or number (default: t_s, time, timestamp, ...)",
        How(either="times")] = ""
    rate: Annotated[float | None, "HZ", "of a file without times", decimal(1, 100_000, "Hz"),
        How(either="times")] = None
    unit: Annotated[Literal["s", "ms", "us", "ns"] | None,
        "of the times (default: by the column's name, else s)"] = None
    columns: Annotated[str, "LIST", "pressures, finger by finger: names, numbers or ranges of "
        "numbers, with commas (default: all but time and label)"] = ""
    taxels: Annotated[int, "N", "of a fingertip", whole(1, 100)] = 6
    sign: Annotated[Literal["negative", "positive"], "of a press"] = "negative"
    scale: Annotated[float | None, "N", "counts per unit of the pressures, such as 8 for kPa "
        "(default: 1)", decimal(1e-9, 1e9)] = None
    rest_seconds: Annotated[float, "N", "subtract the median of the first seconds",
        decimal(0, 3600, "s")] = 0.0
    labels: Annotated[Path | None, "FILE",
        "table of times and labels, at any rate, in the same unit"] = None
    resample: Annotated[bool, "bring another rate to 100 Hz"] = False


class EvaluateOptions(SettingsJson, command="detector evaluate",
    about="score detectors on labelled fingertip recordings",
    examples=("grasp detector evaluate tcn energy --recording fingertip.csv",
              "grasp detector evaluate mine.onnx mine.py:Vibration --data sets/paper")):
    detector: Annotated[Sequence[str], "NAME", "one or more of config/detectors, or your files",
        ARGUMENT]
    recording: Annotated[Path | None, "RUN|FILE", "folder of `run acquire` or `dataset import`, "
        ".npz, or CSV with t_s,p0,p1,...,slip[,slip_true]", SOURCE] = None
    data: Annotated[Sequence[Path], "DIR", LABELLED, SOURCE] = ()
    split: Annotated[Literal["train", "validation", "test", "all"],
        "with --data: the split to score"] = "test"
    label: Annotated[Label, "slip: by the fingertip's speed; slip_true: the contact slides; moved: "
        "1 mm from the last rest"] = "slip"
    out: Annotated[Path | None, "FILE.json", "scores and misses, for `grasp report`",
        file_to_write] = None


class TuneOptions(SettingsJson, command="detector tune",
    about="find the fastest decision rule for a rate of false alarms",
    examples=("grasp detector tune mine.py:Vibration --data sets/paper sets/disturbances",)):
    detector: Annotated[str, "NAME", "one of config/detectors, or your file", ARGUMENT]
    budget: Annotated[float, "N", BUDGET, decimal(0, 6000)] = 1.0
    data: Annotated[Sequence[Path], "DIR", LABELLED, SOURCE] = ()
    unlabelled: Annotated[Sequence[Path], "RUN|FILE", "lifts, .npz or .csv of minutes of "
        "hold without slip: tunes only the threshold", SOURCE] = ()


class CardOptions(Json, command="detector card",
    about="show a network's training data, seed, commit, calibration"):
    network: Annotated[str | None, "NAME|FILE.onnx", "(default: list all packaged detectors)",
        ARGUMENT] = None


class TrainOptions(Json, command="detector train",
    about="train a network and write its weights (extra `train`)",
    more=". Stops early and calibrates on the split `validation`; never uses `test`."):
    network: Annotated[Network, "NAME", ", ".join(get_args(Network)), ARGUMENT]
    data: Annotated[Sequence[Path], "DIR", LABELLED]
    out: Annotated[Path | None, "FILE.onnx", "weights to write (default: runs/NAME.onnx)",
        file_with_folders] = None
    force: Annotated[bool,
        "overwrite --out, and the files of an unfinished training beside it"] = False
    resume: Annotated[bool, "continue from the checkpoint beside --out"] = False
    seed: Seed = 0
    steps: Annotated[int | None, "N", "optimiser steps", whole(1, 10**9)] = None
    validations: Annotated[int | None, "N", "validations (default: the network's)",
        whole(1, 1000)] = None
    augmentation: Annotated[Literal["none", "paper", "as-run", "ours"] | None,
        "paper: of the paper's text; as-run: of the paper's code; ours: also gain, offset, lost "
        "samples, dead and swapped taxels"] = None
    windows: Annotated[bool,
        "tcn-paper: train on the last sample of windows, as its authors did"] = False
    label: Annotated[Label | None, "label to train on, as for `evaluate` (default: slip)"] = None


class BenchmarkOptions(Settings, Pool, Json, command="benchmark", section=MEASURE,
    about="score detectors with one fixed protocol",
    more=": recordings, lifts in which false alarms have a price, taps, cost. Six minutes a "
    "detector, fifteen more in a new folder. The same command continues an interrupted run.",
    examples=("grasp benchmark", "grasp benchmark tcn mine.onnx mine.py:Vibration --quick")):
    detector: Annotated[Sequence[str], "NAME", "of config/detectors, or your files (default: all "
        "packaged ones)", ARGUMENT] = ()
    split: Annotated[Literal["validation", "test"],
        "tune and train on validation; test is for the last figure"] = "validation"
    quick: Annotated[bool, "the first quarter of lifts and taps, for a first look"] = False
    recording: Annotated[Sequence[Path], "FILE", "labelled real recordings to score as well"] = ()
    layout: Annotated[str, "NAME", "of the fingertips' taxels, in config/layouts"] = ""
    out: Annotated[Path, "DIR", "folder of recordings and results (default: %(default)s)",
        folder_to_fill] = Path("runs/benchmark")


# fmt: on
ROOT = (
    "Closed-loop grasp controller: detects slip with barometric fingertips and closes a Robotiq "
    "3-Finger gripper as fast as a force limit allows."
)
ROOT_END = (
    "`grasp COMMAND --help` shows options and examples. Exit codes: 0 success, 1 trial failed, "
    "2 usage or configuration, 3 device, 4 safety stop, 5 could not record or internal error, 130 "
    "interrupted (143 terminated, 129 terminal closed)."
)
GROUPS = {
    "run": ("run a scenario", TRY),
    "campaign": ("run a grid of trials in parallel", MEASURE),
    "dataset": ("data sets of labelled recordings", MEASURE),
    "detector": ("score, tune, train slip detectors", MEASURE),
    "gripper": ("activate the gripper, move it slowly", LAB),
    "arm": ("a slow step, the way back to a run's start, a stop", LAB),
    "tactile": ("show fingertip wiring, rest and noise", LAB),
    "calibrate": ("calibrate counts, force and noise", LAB),
}


def build_parser() -> Parser:
    root = Parser(prog="grasp", description=ROOT, epilog=ROOT_END)
    root.add_argument("--version", action="store_true", help="show the version and exit")
    known, sections = Options.commands, (TRY, MEASURE, LAB, SET_UP)
    section = {name: about[1] for name, about in GROUPS.items()}
    section |= {name: options.section for name, options in known.items() if options.section}
    for command in sorted(known, key=lambda name: sections.index(section[name.partition(" ")[0]])):
        options, (group, _, name) = known[command], command.rpartition(" ")
        parent = root.commands().get(group, root)
        if group and parent is root:
            parent = root.command(group, *GROUPS[group])
        parser = parent.command(
            name, options.about, options.section, options.more, options.examples
        )
        options.add_to(parser)
        parser.set_defaults(options=options)
    return root
