"""Profiles set detector, decision and reaction together."""

from typing import Any

import msgspec
import pytest

from drivers.errors import BadFile, ConfigError
from grasp.settings import named_layer
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import CampaignSpec, combinations
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.trial.config import TrialConfig
from tests.unit.scenarios.conftest import config, phases_but_landing


def paper(*assignments: str) -> LiftConfig:
    return load_config("can", "simulated", "energy", None, assignments, "paper").for_lift()


def test_the_default_profile_changes_no_setting() -> None:
    plain = LiftConfig(rig="simulated", detector_name="energy", object=config().object)
    same = msgspec.structs.replace(
        config(), gripper=plain.gripper, calibration=None, energy=plain.energy,
        fingertip=plain.fingertip,
    )  # fmt: skip
    assert same == plain


def test_a_profile_gives_the_detector_unless_one_is_named() -> None:
    assert (
        load_config("can", "simulated").detector_name
        == (named_layer("profiles", "default").table["detector_name"])
    )
    assert load_config("can", "simulated", "psd").detector_name == "psd"


def test_every_motor_at_its_limit_loads_the_thumb_twice_and_is_no_excess() -> None:
    result = lift.run(paper(), 0, None).result
    assert result is not None and result.peak_force_n is not None
    assert 18.0 < result.peak_force_n["A"] < 24.0
    assert result.commanded_force_n <= 10.0
    assert (result.force_limit_n, result.cap_mode) == (10.0, "each_motor")
    assert result.outcome != "over_force"


def test_a_detector_without_its_weights_is_refused_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(*_: Any) -> None:
        raise BadFile("detector/weights/tcn-paper.onnx", "no such file", "another one")

    monkeypatch.setattr(TrialConfig, "make_detector", missing)
    spec = CampaignSpec(name="x", objects=("can",), detectors=("energy",))
    with pytest.raises(ConfigError, match=r"tcn-paper\.onnx"):
        combinations(spec)
    unknown = CampaignSpec(name="x", objects=("can",), detectors=("no-such-network",))
    with pytest.raises(ConfigError, match="no-such-network"):
        combinations(unknown)


def test_the_paper_s_profile_never_gives_up_at_the_cap() -> None:
    """Its loop closes once and holds: an alarm that stays is reported, the object decides."""
    result = lift.run(paper("energy.threshold_counts=0.3", "scoring.early_s=1"), 0, None).result
    assert result is not None
    assert result.outcome not in ("cap_reached", "alarm_stayed")
    assert phases_but_landing(result)[-4:] == ["lower", "release", "retreat", "done"]
    assert result.alarm_stayed
