"""The five calls of the library. None of them can open a real device."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from detector.interface import SlipDetector
from detector.recordings import SUFFIX, read
from detector.scores.evaluation import evaluate_recording
from drivers.errors import UsageError
from drivers.interfaces import FINGERS
from grasp.clock import stopwatch_ns
from grasp.fault import INTERRUPTED
from grasp.settings import file_of
from scenarios.campaign import run as campaign_room
from scenarios.campaign.config import RunConfig, load_config
from scenarios.campaign.spec import read_spec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import summarize
from scenarios.library.results import Campaign, Heard, Lift, Replayed, Tap, read_trial, with_folder
from scenarios.lift.lift import lift as lift_experiment
from scenarios.report.run_record import RunRecord
from scenarios.rigs.permission import HARDWARE
from scenarios.rigs.workers import Workers
from scenarios.tap.tap import tap as tap_experiment
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.trial.replay import replay_run
from scenarios.trial.replay_tactile import replay_tactile
from scenarios.trial.result import Failure, FinishedRun, ResultT

File = str | Path
Settings = Mapping[str, Any]  # `section.key` to a value, as `--set` takes them
TACTILE = (".csv", SUFFIX)  # of the recording of a fingertip


def lift(
    object: str = "can",  # noqa: A002  (what a caller reads best)
    rig: str = "simulated",
    seed: int = 0,
    *,
    detector: str | None = None,
    profile: str = DEFAULT_PROFILE,
    config: File | Sequence[File] | None = None,
    settings: Settings | None = None,
    runs: File | None = None,
) -> Lift:
    """Grasp an object with little force, lift it, feel it slip, hold it: one judged trial.

    Args:
        object: a name of `config/objects`, or the path of a `.toml` file.
        rig: `simulated` (virtual time) or `emulated` (real protocols, wall time), or a `.toml` file
            that is like one of them.
        seed: of everything random, 0 or more.
        detector: a name of `config/detectors`; None: the profile's.
        profile: a name of `config/profiles`.
        config: a TOML file over the packaged settings, or several, later ones on top.
        settings: single values over that, as `{"object.mass_kg": 0.3}`.
        runs: the folder in which the run leaves one of its own; None: a temporary one, which
            goes when the result goes.

    Raises:
        UsageError: for the rig `hardware`, and for a run that left nothing to judge.
        ConfigError: for an unknown name, or what cannot be set so.
        BadFile: for a detector that cannot be loaded.
        KeyboardInterrupt: when it is stopped.
    """
    chosen = _config(object, rig, detector, profile, config, settings).for_lift()
    folder = _folder(runs)
    result, failure, record = _judged(lift_experiment.run(chosen, seed, folder))
    made = Lift(result=result, failure=failure, record=record, folder=record.path.parent)
    return with_folder(made, None if runs else folder)


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
    """Strike an object that is held at the force limit: is slip felt, and is it over when it is
    over? One judged trial; arguments and errors as of `lift`."""
    chosen = _config(object, rig, detector, profile, config, settings).for_tap()
    folder = _folder(runs)
    result, failure, record = _judged(tap_experiment.run(chosen, seed, folder))
    made = Tap(result=result, failure=failure, record=record, folder=record.path.parent)
    return with_folder(made, None if runs else folder)


def replay(
    recording: File, *, detector: str | None = None, settings: Settings | None = None
) -> Replayed | Heard:
    """Feed a recording through detector, monitor, controller and guard again.

    Args:
        recording: the folder or `recording.mcap` of a run, which is compared with what was
            recorded; or a fingertip's `.csv` or `.npz`, of which detector and controller say what
            they make of it.
        detector: for a fingertip's recording; None: the default one. For a run, where the code
            or weights of one's own are that it was recorded with.
        settings: likewise, as for `lift`.

    Raises:
        BadFile: for what is no recording, or was made with other settings.
        UsageError: for arguments that a run does not take.
    """
    path = Path(recording)
    if path.suffix in TACTILE:
        return _heard(path, detector, settings)
    if settings:
        raise UsageError(
            "a run is replayed with the settings that it was recorded with",
            "leave them out, or give the .csv or .npz of a fingertip",
        )
    return Replayed(replay_run(path, detector))


def _heard(path: Path, detector: str | None, settings: Settings | None) -> Heard:
    config = load_config("can", "simulated", detector, None, _words(settings))
    recording = read(path)
    told = replay_tactile(config, recording)
    made = config.make_detector(recording.fingers, recording.taxels)
    sheet = evaluate_recording(made, config.rule, recording, clock_ns=stopwatch_ns)
    return Heard.of(recording, told, sheet)


def campaign(
    spec: File, *, out: File | None = None, jobs: int | None = None, resume: bool = False
) -> Campaign:
    """Run a grid of trials, in worker processes, on the simulated rig.

    Args:
        spec: the path of a campaign's `.toml`, or a name of `config/campaigns`.
        out: the SQLite file to make; None: a temporary one, of which the rows stay.
        jobs: worker processes; 0: none, this process does the work; None: one a core.
        resume: go on with the file, running what is missing or errored.

    Raises:
        ConfigError: before anything runs, for a campaign that cannot be run so.
        CouldNotRecord: where a row cannot be written.
    """
    wanted = read_spec(file_of("campaigns", str(spec)))
    workers = Workers(len(os.sched_getaffinity(0)) if jobs is None else jobs)
    with tempfile.TemporaryDirectory(prefix="grasp-library-") as folder:
        file = Path(folder) / "campaign.sqlite" if out is None else Path(out)
        campaign_room.run(wanted, file, workers, resume)
        with CampaignStore.open(file) as store:
            rows = tuple(store.rows())
    summary = summarize(wanted.name, rows)
    return Campaign(wanted, rows, summary, None if out is None else file)


def detector(
    name: str,
    fingers: int = FINGERS,
    taxels: int | None = None,
    *,
    settings: Settings | None = None,
) -> SlipDetector:
    """A detector, reset: feed `update` a frame (fingers, taxels) of int16 every 10 ms, raw minus
    rest, and it gives a probability of slip a finger, (fingers,).

    Raises:
        ConfigError: for an unknown name.
        BadFile: for a network whose file is damaged.
        UsageError: for taxels that it was not made for.
    """
    config = load_config("can", "simulated", name, None, _words(settings))
    return config.make_detector(fingers, taxels)


def _config(
    name: str,
    rig: str,
    detector: str | None,
    profile: str,
    config: File | Sequence[File] | None,
    settings: Settings | None,
) -> RunConfig:
    """Resolved settings of a rig that is none of real devices."""
    given = [config] if isinstance(config, str | Path) else config or ()
    files = [Path(file) for file in given]
    chosen = load_config(name, rig, detector, files, _words(settings), profile)
    if chosen.rig == HARDWARE:
        raise UsageError(
            "the library moves no real devices", f"`grasp run --rig {rig} --confirm-motion` does"
        )
    return chosen


def _words(settings: Settings | None) -> list[str]:
    """As `--set` takes them."""
    return [f"{key}={msgspec.json.encode(x).decode()}" for key, x in (settings or {}).items()]


def _folder(runs: File | None) -> Path:
    return Path(tempfile.mkdtemp(prefix="grasp-library-")) if runs is None else Path(runs)


def _judged(finished: FinishedRun[ResultT]) -> tuple[ResultT, Failure | None, RunRecord]:
    """What a run left, if it left something to judge."""
    result, failure = finished.result, finished.failure
    if result is not None and result.outcome == INTERRUPTED:
        raise KeyboardInterrupt
    if result is None or result.recording is None:
        text = "nothing was recorded" if failure is None else failure.message
        remedy = "run it again" if failure is None else failure.remedy
        raise UsageError(f"the run left nothing to judge: {text}", remedy)
    return result, failure, read_trial(Path(result.recording).parent)
