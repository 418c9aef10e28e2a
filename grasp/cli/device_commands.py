"""Commands of `grasp` for real devices and for settings, as in ``grasp.cli.commands``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from grasp.cli.options import (
    BUDGET,
    Detector,
    Motion,
    Object,
    Profile,
    Rig,
    Runs,
    Seed,
    Settings,
    SettingsJson,
    decimal,
    file_to_write,
    whole,
)
from grasp.cli.parser import ARGUMENT

# fmt: off
LAB, SET_UP = "real devices", "settings"  # sections of the help
Finger = Literal["A", "B", "C"]
FingerOrAll = Literal["A", "B", "C", "all"]
SLOW = "slowly, at the hand's least force"
ARM_SPEED = "10 mm/s in a straight line"
TO_MEASURE = "largest force to measure, N; larger readings are refused"
MAX_FORCE_N = 60.0  # of the hand, by its manual
SHORTEST_HOLD_S = 35.0
OPERATOR_ACTIONS = (
    "place (the object on the table) | take (it away) | home (the arm) | look | scale (what each "
    "fingertip presses with) | tap [top|side|closing] | press FINGER TAXEL [NEWTONS] | lay FINGER "
    "NEWTONS | fault NAME [SETTING=VALUE ...] | fault help"
)


class DoctorOptions(SettingsJson, command="doctor", section=LAB,
    about="check this machine and a rig's devices; moves nothing",
    examples=("grasp doctor", "grasp doctor --rig hardware --config lab.toml",
              "grasp doctor 192.168.1.10")):
    hosts: Annotated[Sequence[str], "HOST", "list the devices that respond there, with settings "
        "for a --config file. HOST, HOST:PORT of a gripper, or tcp://HOST:PORT of an emulated "
        "fingertip board", ARGUMENT] = ()
    rig: Annotated[str | None, "NAME", "also query the devices of this rig"] = None
    object: Object = "can"
    profile: Profile = "default"
    detector: Detector = None
    runs: Runs = Path("runs")


class LabOptions(SettingsJson):
    """Of commands for real devices."""

    rig: Annotated[str, "NAME", "hardware, or a .toml file of a similar rig"] = "hardware"


class MotionOptions(LabOptions, Motion):
    """Of commands that move real devices."""


class StatusOptions(LabOptions, command="status", section=LAB,
    about="show the state of the gripper or arm; moves nothing",
    examples=("grasp status gripper --config lab.toml", "grasp status arm --config lab.toml")):
    device: Annotated[Literal["gripper", "arm"], "device to query", ARGUMENT]


class ActivateOptions(MotionOptions, command="gripper activate",
    about="activate the hand: it opens and closes fully"):
    empty: Annotated[bool, "confirm that the hand is empty, instead of being asked"] = False


class CloseOptions(MotionOptions, command="gripper close",
    about=f"close fingers {SLOW}: B and C until contact, then the thumb"):
    to: Annotated[int, "COUNTS", "largest position", whole(0, 255)] = 255
    finger: Annotated[FingerOrAll, "A is the thumb"] = "all"


class StepOptions(
    MotionOptions, command="gripper step", about=f"move a finger by a few millimetres {SLOW}",
    examples=("grasp gripper step --finger B --mm 2 --config lab.toml --confirm-motion",
              "grasp gripper step --finger B --mm 2 --open --config lab.toml --dry-run")):
    mm: Annotated[float, "MM", "travel of the fingertip, at most 5", decimal(0.01, 5, "mm")] = 2.0
    open: Annotated[bool, "open instead of closing"] = False
    finger: Annotated[FingerOrAll, "A is the thumb"] = "A"


class ArmStepOptions(MotionOptions, command="arm step",
    about=f"one step of at most 5 mm in the base frame, at {ARM_SPEED}",
    examples=("grasp arm step --z 3 --config lab.toml --confirm-motion",)):
    x: Annotated[float, "MM", "mm along x", decimal(-5, 5, "mm")] = 0.0
    y: Annotated[float, "MM", "mm along y", decimal(-5, 5, "mm")] = 0.0
    z: Annotated[float, "MM", "mm upwards", decimal(-5, 5, "mm")] = 0.0


class ArmBackOptions(MotionOptions, command="arm back",
    about=f"move back to the height where a run began, at {ARM_SPEED}",
    examples=("grasp arm back --config lab.toml --confirm-motion",)):
    run: Annotated[Path | None, "RUN", "folder of the run (default: the last one in runs/)",
        ARGUMENT] = None


class ArmStopOptions(
    MotionOptions, command="arm stop", about="stop the arm's program; needs no --confirm-motion"):
    pass


class IdentifyOptions(SettingsJson, command="tactile identify",
    about="press a pad and see which finger and taxel respond"):
    url: Annotated[str | None, "URL", "emulated board, tcp://HOST:PORT (default: usb.url)"] = None
    seconds: Annotated[float, "N", "duration, s", decimal(0.01, 86_400, "s")] = 10.0


class WatchOptions(LabOptions, command="tactile watch",
    about="show counts, noise and lost frames each second; start unloaded"):
    seconds: Annotated[float | None, "N", "duration, s (default: 3600, with --rest 5)",
        decimal(1, 86_400, "s")] = None
    rest: Annotated[bool,
        "print the rest codes of the unloaded hand as tactile.rest_reference"] = False
    out: Annotated[Path | None, "FILE", "with --rest: new file to write", file_to_write] = None


class CalibrateOptions(MotionOptions):
    """Of all calibrations."""

    out: Annotated[Path, "FILE", "new .toml file to write", file_to_write]
    note: Annotated[str, "TEXT", "text to add to the source in the file"] = ""


class ForceOptions(CalibrateOptions, command="calibrate force",
    about="calibrate the fingertips' counts with a scale",
    examples=("grasp calibrate force --out force.toml --config lab.toml",)):
    finger: Annotated[FingerOrAll, "all: one after the other"] = "all"
    up_to: Annotated[float | None, "N", f"{TO_MEASURE} (default: guard.force_limit_n)",
        decimal(0.1, MAX_FORCE_N, "N")] = None


class HandOptions(CalibrateOptions, command="calibrate hand",
    about="measure the force of force byte 0 with a scale",
    examples=("grasp calibrate hand --up-to 16 --out hand3.toml --config lab.toml "
              "--confirm-motion",)):
    scale: Annotated[bool,
        "confirm that one fingertip is over a scale and the hand is empty"] = False
    finger: Annotated[Finger, "finger to calibrate"] = "A"
    up_to: Annotated[float, "N", TO_MEASURE, decimal(0.1, MAX_FORCE_N, "N")]


class NoiseOptions(CalibrateOptions, command="calibrate noise",
    about="tune the decision rule to your fingertips' noise, without labels: the hand holds an "
    "object at rest, then opens",
    examples=("grasp calibrate noise --out rule.toml --config lab.toml --confirm-motion",)):
    detector: Annotated[str, "NAME", "detector to tune"] = "tcn"
    budget: Annotated[float, "N", BUDGET, decimal(0.001, 60)] = 0.5
    seconds: Annotated[float, "N", f"duration of the hold, s ({SHORTEST_HOLD_S:g} to 3600, "
        "default: 180)", decimal(SHORTEST_HOLD_S, 3600, "s")] = 180.0


class ReleaseOptions(
    MotionOptions, command="release", section=LAB, about=f"open all fingers {SLOW}",
    more=". Support the object first: it falls when the fingers open. Needs only the gripper.",
    examples=("grasp release --rig cell.toml --confirm-motion",)):
    activate: Annotated[bool, "activate an inactive hand: it opens and closes fully"] = False


class EmulateOptions(Settings, command="emulate", section=LAB,
    about="run the emulated cell: gripper, fingertips and arm",
    more=". Prints its endpoints as one JSON line and ends on SIGINT or SIGTERM. Standard input "
    f"takes the actions of an operator, one per line: {OPERATOR_ACTIONS}.",
    examples=("grasp emulate --host 127.0.0.2 --gripper-port 5020",)):
    host: Annotated[str | None, "ADDRESS",
        "loopback address, not 127.0.0.1 (default: a free one)"] = None
    gripper_port: Annotated[int, "PORT", "(default: a free one)", whole(0, 65_535)] = 0
    beyond_loopback: Annotated[bool, "allow any --host of this machine; control and fault channels "
        "need the token printed with the endpoints"] = False
    profile: Annotated[Literal["cb3", "e-series"], "arm controller"] = "cb3"
    write: Annotated[Path | None, "FILE.toml", "write the settings of a lab that has these "
        "devices, for --config with the rig hardware", file_to_write] = None
    rtu: Annotated[bool, "offer the gripper on a serial line (a pseudo-terminal) too"] = False
    object: Object = "can"
    seed: Seed = 0


class ConfigOptions(SettingsJson, command="config", section=SET_UP,
    about="show the resolved settings, or check your files",
    more=". Prints every setting with its value, its allowed range and its source. A FILE may be "
    "an object, surface, calibration, rig, campaign, data set, or settings for --config.",
    examples=("grasp config object --object ball", "grasp config thermos.toml cell.toml lab.toml",
              "grasp config --config lab.toml --config grip.toml")):
    sections: Annotated[Sequence[str], "SECTION|FILE", "sections to show, or files to check",
        ARGUMENT] = ()
    object: Object = "can"
    profile: Profile = "default"
    detector: Detector = None
    rig: Rig = "emulated"
