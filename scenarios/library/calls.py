"""The six functions of the Python API. None of them can open a real device."""

import os
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from detector.interface import SlipDetector
from detector.recordings import SUFFIX, read
from drivers.errors import UsageError, one_line
from drivers.interfaces import FINGERS
from grasp.control.fault import INTERRUPTED
from grasp.policy_reflex import Reflex
from grasp.settings import Layer, file_of, layer_of
from scenarios.campaign import run as campaign_runner
from scenarios.campaign.config import RunConfig, load_config, load_lift
from scenarios.campaign.spec import read_spec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import summarize
from scenarios.library.reflex import make_reflex
from scenarios.library.results import (
    Campaign,
    Lift,
    Replayed,
    TactileResult,
    Tap,
    TrialT,
    read_trial,
)
from scenarios.lift.lift import lift as lift_experiment
from scenarios.rigs.compilation import tell_of_compilation
from scenarios.rigs.config import HARDWARE
from scenarios.rigs.workers import Workers
from scenarios.tap.tap import tap as tap_experiment
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.trial.replay import replay_run
from scenarios.trial.replay_tactile import replay_tactile, score
from scenarios.trial.result import JudgedTrial
from scenarios.world import COMPILING, is_compiled

File = str | Path
Settings = Mapping[str, Any]  # `section.key` to a value, or a section to a mapping
TACTILE = (".csv", SUFFIX)  # suffixes of a fingertip's recording


def lift(
    object: str = "can",  # noqa: A002  (the clearest name for a caller)
    rig: str = "simulated",
    seed: int = 0,
    *,
    detector: str | None = None,
    profile: str = DEFAULT_PROFILE,
    config: File | Sequence[File] | None = None,
    settings: Settings | None = None,
    runs: File | None = None,
) -> Lift:
    """Run one lift: grasp an object with little force, lift it, detect slip, hold it.

    Args:
        object: a name in `config/objects`, or the path of a `.toml` file.
        rig: `simulated` (virtual time) or `emulated` (real protocols, wall time), or a `.toml` file
            based on one of them.
        seed: random seed, 0 or more.
        detector: a name in `config/detectors`, or `FILE.py:NAME` or `FILE.onnx` of your own, which
            a replay can load again; None: the profile's.
        profile: a name in `config/profiles`.
        config: a TOML file that overrides the packaged settings, or several in order.
        settings: values that override the files, as `{"object.mass_kg": 0.3}` or
            `{"object": {"mass_kg": 0.3}}`.
        runs: parent of the run's folder; None: a temporary folder, deleted with the result.

    Raises:
        UsageError: for the rig `hardware`, and for a run without a result.
        ConfigError: for an unknown name, or a setting that is not allowed.
        BadFile: for a detector that cannot be loaded.
        KeyboardInterrupt: for Ctrl-C.
    """
    chosen = _config(object, rig, seed, detector, profile, config, settings, load_lift).for_lift()
    return _run(lambda folder: lift_experiment.run(chosen, seed, folder), runs, Lift)


def tap(
    object: str = "ball",  # noqa: A002
    rig: str = "simulated",
    seed: int = 0,
    *,
    detector: str | None = None,
    profile: str = DEFAULT_PROFILE,
    config: File | Sequence[File] | None = None,
    settings: Settings | None = None,
    runs: File | None = None,
) -> Tap:
    """Run one tap: tap an object held at the force limit, and check that slip is registered in time
    and its end too. Arguments and errors as for `lift`."""
    chosen = _config(object, rig, seed, detector, profile, config, settings).for_tap()
    return _run(lambda folder: tap_experiment.run(chosen, seed, folder), runs, Tap)


def replay(
    recording: File, *, detector: str | None = None, settings: Settings | None = None
) -> Replayed | TactileResult:
    """Feed a recording through detector, monitor, controller and guard again.

    Args:
        recording: the folder or `recording.mcap` of a run, whose replay is compared with the
            recording; or a fingertip's `.csv` or `.npz`, which gives probabilities and commands.
        detector: for a fingertip's recording; None: the default. For a run: the path of the user's
            code or weights that it was recorded with.
        settings: for a fingertip's recording, as for `lift`.

    Raises:
        BadFile: for another kind of file, or settings that do not fit this version.
        UsageError: for settings with a run, or a run with user code that is not named.
    """
    path = _path("recording", recording)
    if path.suffix in TACTILE:
        return _replay_tactile(path, detector, settings)
    if settings:
        raise UsageError(
            "a run is replayed with the settings that it was recorded with",
            "omit them, or give the .csv or .npz of a fingertip",
        )
    return Replayed(replay_run(path, detector))


def _replay_tactile(path: Path, detector: str | None, settings: Settings | None) -> TactileResult:
    config = _config("can", "simulated", 0, detector, DEFAULT_PROFILE, None, settings)
    recording = read(path)
    replayed = replay_tactile(config, recording)
    return TactileResult.of(recording, replayed, score(config, recording))


def campaign(
    spec: File, *, out: File | None = None, jobs: int | None = None, resume: bool = False
) -> Campaign:
    """Run a grid of trials on the simulated rig, in worker processes.

    Args:
        spec: the path of a campaign's `.toml`, or a name in `config/campaigns`.
        out: the SQLite file to create; None: a temporary one, whose rows are returned.
        jobs: number of worker processes; 0: run in this process; None: one per core.
        resume: continue an existing file with missing trials and those with an error.

    Raises:
        ConfigError: for a campaign that is not valid, before anything runs.
        CouldNotRecord: for a row that cannot be written.
    """
    if jobs is not None:
        _check_number("jobs", jobs)
    campaign_spec = read_spec(file_of("campaigns", str(spec)))
    workers = Workers(len(os.sched_getaffinity(0)) if jobs is None else jobs)
    with tempfile.TemporaryDirectory(prefix="grasp-library-") as folder:
        if out is None:  # nothing but the rows is kept
            campaign_spec = msgspec.structs.replace(campaign_spec, recordings="none")
        file = Path(folder) / "campaign.sqlite" if out is None else _path("out", out)
        if not is_compiled():
            _say(COMPILING)
        campaign_runner.run(campaign_spec, file, workers, resume)
        with CampaignStore.open(file) as store:
            rows = tuple(store.rows())
    summary = summarize(campaign_spec.name, rows)
    return Campaign(campaign_spec, rows, summary, None if out is None else file)


def detector(
    name: str,
    fingers: int = FINGERS,
    taxels: int | None = None,
    *,
    settings: Settings | None = None,
) -> SlipDetector:
    """Load a detector in its initial state. Its `update` takes a frame (fingers, taxels) of int16,
    raw minus rest, every 10 ms, and returns the probability of slip of each finger, (fingers,).

    Raises:
        ConfigError: for an unknown name.
        BadFile: for a network whose file is damaged.
        UsageError: for a number of taxels that it does not support.
    """
    _check_number("fingers", fingers)
    _check_number("taxels", taxels or 0)
    config = _config("can", "simulated", 0, name, DEFAULT_PROFILE, None, settings)
    return config.make_detector(fingers, taxels)


def reflex(
    detector: str | None = None,
    force_limit_n: float | None = None,
    *,
    rig: str = "simulated",
    profile: str = DEFAULT_PROFILE,
    config: File | Sequence[File] | None = None,
    settings: Settings | None = None,
) -> Reflex:
    """Make the reflex that keeps the grip of your own policy: see `grasp.policy_reflex`. It moves
    nothing itself; its `step` returns what to send to hand and arm.

    Args:
        detector: as for `lift`.
        force_limit_n: force limit of each finger; None: that of the settings, 10 N.
        rig: whose hand the force limit is for. A real hand needs its own calibration, by a rig file
            or `config`.
        profile: as for `lift`.
        config: as for `lift`.
        settings: as for `lift`. With `controller.reactions` false, only the force guard acts.

    Raises:
        ConfigError: for an unknown name, or a force limit that the hand cannot keep.
        BadFile: for a detector that cannot be loaded.
    """
    if force_limit_n is not None and isinstance(settings, Mapping | None):
        settings = {**(settings or {}), "guard.force_limit_n": force_limit_n}
    return make_reflex(_config("can", rig, 0, detector, profile, config, settings, moves=False))


def _config(
    name: str,
    rig: str,
    seed: int,
    detector: str | None,
    profile: str,
    config: File | Sequence[File] | None,
    settings: Settings | None,
    loads: Callable[..., RunConfig] = load_config,
    moves: bool = True,
) -> RunConfig:
    """Resolved settings; raises UsageError for real devices where it ``moves`` them, or a value of
    a wrong type."""
    words = {"object": name, "rig": rig, "detector": detector, "profile": profile}
    for key, word in words.items():
        if word is not None or key in ("rig", "profile"):
            _path(key, word)
            words[key] = str(word)
    _check_number("seed", seed)
    named = words["object"], words["rig"], words["detector"]
    chosen = loads(*named, _files(config), _layer(settings), words["profile"])
    if moves and chosen.rig == HARDWARE:
        raise UsageError(
            "the library moves no real devices", f"`grasp run --rig {rig} --confirm-motion` does"
        )
    return chosen


def _files(config: File | Sequence[File] | None) -> list[Path]:
    given = config if isinstance(config, Sequence) and not isinstance(config, str) else [config]
    return [_path("config", file) for file in given if file is not None]


def _path(name: str, value: object) -> Path:
    if not isinstance(value, str | Path) or value == "":
        raise UsageError(f"{name}: {value!r} is neither a name nor a path", "give a text")
    return Path(value)


def _check_number(name: str, value: object) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**63:
        raise UsageError(f"{name}: {value!r} is not a whole number from 0 to 2^63 - 1", "use 0, 1")


def _layer(settings: Settings | None) -> Layer:
    """The user's settings; raises UsageError for what is no mapping to values."""
    if not isinstance(settings, Mapping | None):
        raise UsageError(f"settings: {settings!r} is not a mapping",
                         'use a dict, such as {"object.mass_kg": 0.3}')  # fmt: skip
    try:
        plain = msgspec.to_builtins(dict(settings or {}), enc_hook=lambda value: value.item())
        return layer_of("settings", plain.items())
    except (AttributeError, TypeError) as error:
        remedy = "names as keys, and numbers, words, true or false as values"
        raise UsageError(f"settings: {one_line(str(error))}", remedy) from None


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")


def _run(
    run: Callable[[Path], JudgedTrial[Any]], runs: File | None, kind: Callable[..., TrialT]
) -> TrialT:
    """What a run in a folder gives. A temporary folder is deleted with it. Raises UsageError where
    there is no result."""
    folder = _path("runs", tempfile.mkdtemp(prefix="grasp-library-") if runs is None else runs)
    with tell_of_compilation(_say):
        finished = run(folder)
    result, failure = finished.result, finished.failure
    if result is not None and result.outcome == INTERRUPTED:
        raise KeyboardInterrupt
    if result is None or result.recording is None:
        text = "nothing was recorded" if failure is None else failure.message
        remedy = "run it again" if failure is None else failure.remedy
        raise UsageError(f"the run has no result: {text}", remedy)
    record = read_trial(Path(result.recording).parent)
    trial = kind(result=result, failure=failure, record=record, folder=record.path.parent)
    if runs is None:
        weakref.finalize(trial, shutil.rmtree, folder, ignore_errors=True)
    return trial
