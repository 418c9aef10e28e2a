"""A series of trials on one rig has the rows of a campaign and can be resumed."""

from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.errors import ConfigError
from grasp.cli.main import main
from scenarios.campaign.config import load_config
from scenarios.campaign.run import run as run_campaign
from scenarios.campaign.spec import CampaignSpec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.trial_series import TrialSeries, home_of, row_of
from scenarios.campaign.worker import Row
from scenarios.rigs.workers import Workers
from scenarios.trial.experiment import TrialContext
from scenarios.trial.result import Failure, JudgedTrial

MACHINE = (
    "wall_s",
    "cpu_s",
    "versions",
    "timing",
    "recording",
)  # columns that depend on the machine
QUICK = ("hand.activation_s=0.5", "energy.threshold_counts=12", "tap.impulse_n_s=0.25")


def config(scenario: str, *words: str) -> Any:
    whole = load_config("can", "simulated", "energy", None, (*QUICK, *words))
    return whole.for_lift() if scenario == "lift" else whole.for_tap()


def of_trial(row: Row) -> dict[str, Any]:
    return {key: value for key, value in msgspec.structs.asdict(row).items() if key not in MACHINE}


def run_all(made: TrialSeries, out: Path, *, resume: bool = False) -> list[Row | None]:
    context = TrialContext(out.parent / "runs")
    with made.store(out, resume) as store:
        return [row for _, row in made.run(context, store)]


@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_rows_are_those_of_a_campaign(scenario: str, tmp_path: Path) -> None:
    run_all(TrialSeries(scenario, config(scenario), 0, 1), tmp_path / "e.sqlite")
    spec = CampaignSpec(
        name="c", scenarios=(scenario,), objects=("can",), detectors=("energy",),
        settings=(*QUICK, "controller.keep=false"), repetitions=1, recordings="none",
    )  # fmt: skip
    run_campaign(spec, tmp_path / "c.sqlite", Workers(0))
    with (
        CampaignStore.open(tmp_path / "e.sqlite") as series,
        CampaignStore.open(tmp_path / "c.sqlite") as campaign,
    ):
        assert [*map(of_trial, series.rows())] == [*map(of_trial, campaign.rows())]
        for row in series.rows():
            assert row.recording is not None
            assert (tmp_path / row.recording).is_file()
            assert row.versions is not None and row.wall_s is not None


def test_resume_runs_only_missing_trials(tmp_path: Path) -> None:
    made, out = TrialSeries("lift", config("lift"), 0, 3), tmp_path / "e.sqlite"
    context = TrialContext()
    with made.store(out, resume=False) as store:
        interrupted = made.run(context, store)
        next(interrupted)
        interrupted.close()  # type: ignore[attr-defined]
    assert [row.seed for row in run_all(made, out, resume=True) if row] == [1, 2]
    assert run_all(made, out, resume=True) == []
    with CampaignStore.open(out) as store:
        assert [row.trial for row in store.rows()] == [0, 1, 2]


def test_file_is_resumed_only_with_the_same_experiment_and_settings(tmp_path: Path) -> None:
    out = tmp_path / "e.sqlite"
    TrialSeries("lift", config("lift"), 0, 2).store(out, resume=False).__exit__()
    for other, named in [
        (TrialSeries("lift", config("lift"), 1, 2), "name = "),
        (TrialSeries("lift", config("lift"), 0, 3), "repetitions = 2, not 3"),
        (TrialSeries("tap", config("tap"), 0, 2), "name = "),
        (
            TrialSeries("lift", config("lift", "controller.lift_speed_mps=0.2"), 0, 2),
            "controller.lift_speed_mps = 0.1, not 0.2",
        ),
    ]:
        with pytest.raises(ConfigError, match=f"created with {named}"):
            other.store(out, resume=True)
        with pytest.raises(ConfigError, match="exists already"):
            other.store(out, resume=False)


@cache
def judged_lift() -> JudgedTrial[Any]:
    made = TrialSeries("lift", config("lift"), 0, 1)
    context = TrialContext()
    return next(iter(made.run(context, None)))[0]


def test_device_error_makes_an_error_row_and_an_interruption_none() -> None:
    task = TrialSeries("lift", config("lift"), 0, 1).tasks()[0]
    finished = judged_lift()

    def ended_by(kind: str) -> Row | None:
        failure = Failure(kind, "what happened", "what to do")
        return row_of(task, msgspec.structs.replace(finished, failure=failure))

    assert ended_by("interrupted") is None
    for kind in ("link_lost", "device_fault", "stale", "implausible", "could_not_record"):
        row = ended_by(kind)
        assert row is not None and row.status == "error" and row.error == "what happened"
    safe = ended_by("safety_stop")
    assert safe is not None and safe.status == "done" and safe.error == "what happened"


def test_options_that_do_not_fit_a_series_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in [
        (["lift", "--resume"], "name it with --out FILE"),
        (["lift", "--keep", "--trials", "2"], "--trials 1"),
        (["acquire", "--trials", "2"], "`grasp run acquire` does not take --trials 2"),
        (["tap", "--taps", "4"], "does not take --taps 4"),
    ]:
        assert main(["run", *arguments, "--rig", "simulated"]) == 2, (arguments, message)
        assert message in capsys.readouterr().err, (arguments, message)


def test_error_row_keeps_the_partial_result_and_its_home() -> None:
    task = TrialSeries("lift", config("lift"), 0, 1).tasks()[0]
    finished = judged_lift()
    assert finished.result is not None and finished.result.home_m is not None
    row = row_of(task, msgspec.structs.replace(finished, failure=Failure("stale", "late", "")))
    assert row is not None and row.status == "error" and row.outcome is None
    assert home_of([row]) == finished.result.home_m
    nothing = msgspec.structs.replace(row, result=None)
    assert home_of([nothing]) is None
    assert home_of([nothing, row]) == finished.result.home_m
