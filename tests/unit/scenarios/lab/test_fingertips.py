"""What is kept of the fingertips' rest."""

import json
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest

from grasp.cli.main import main
from scenarios.lab import fingertips
from scenarios.lab.fingertips import Heard


def test_comment_codes_and_json_of_a_rest_say_the_same(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The codes are the mean of all samples; rest, which counts are told from, is that of the first
    half second. A frame that was lost is no sample."""

    def listen(*_: Any) -> Iterator[Heard]:
        def table(value: float) -> tuple[tuple[float, ...], ...]:
            return ((value,) * 6,) * 3

        lost = {"empty_ticks": 15, "implausible": 5, "too_old": 0}
        yield Heard(500, table(450.0), table(-3.6), table(0.5), lost)

    monkeypatch.setattr(fingertips, "listen", listen)
    assert main(["tactile", "watch", "--rest", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["rest"] == [[446] * 6] * 3
    assert tomllib.loads(told["file"])["tactile"]["rest_reference"] == told["rest"]
    assert told["samples"] == 480
    assert "mean of 480 samples" in told["file"]
