"""What networks hear together, and what a rule that is chosen with hindsight hears more."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.scores.evaluation import Streamed
from detector.scores.sweep import SweepPoint, rules, sweep
from scripts import networks_together
from scripts.networks_together import caught, groups, rows, together, with_hindsight
from scripts.one_a_minute import Tuned
from tests.unit.detector.blow_toys import struck
from tests.unit.detector.scores.test_sweep import noisy


def test_what_networks_say_together_is_the_mean_of_their_log_odds() -> None:
    one = noisy(0)
    odds = np.array([3.0, 1.0])
    said = [
        msgspec.structs.replace(one, probabilities=np.full_like(one.probabilities, p))
        for p in 1.0 / (1.0 + np.exp(-odds))
    ]
    (found,) = together([[s] for s in said])
    assert found.recording is one.recording
    assert found.probabilities == pytest.approx(1.0 / (1.0 + np.exp(-2.0)))


def test_slips_are_counted_with_and_without_those_of_blows_that_moved_it_little() -> None:
    recording = struck((2.0, 0.003), (4.0, 0.0015), (6.0, 0.0))
    assert recording.slip_true is not None
    slips = msgspec.structs.replace(recording, slip=recording.slip_true)
    p = np.full((len(slips.t_s), 1), 0.01)
    p[203:206] = 0.99  # the blow of 3 mm alone is heard
    point = SweepPoint(RuleSettings(consecutive=1), 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, None)
    found = caught(Tuned("tcn", point, True, [Streamed(slips, p, np.empty(0))]))
    assert (found.every, found.moved, found.no_blows) == (0.5, 1.0, 0.0)
    assert found.delay_ms.count == 2
    assert found.delay_ms.p99 == np.inf


def test_hindsight_catches_no_less_than_any_rule_within_the_budget(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(networks_together, "BUDGET", 20.0)
    streams = [noisy(seed) for seed in range(3)]
    points = sweep(streams, list(rules(RuleSettings()))[::7])
    t = Tuned("tcn", points[0], True, streams)
    best = with_hindsight(t, points)
    assert best.point.false_per_min <= 20.0
    kept = [p for p in points if p.false_per_min <= 20.0]
    assert caught(best).every == max(p.recall for p in kept) > min(p.recall for p in kept)


def test_each_group_has_the_rule_of_validation_and_then_that_of_hindsight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(networks_together, "rules", lambda base: list(rules(base))[::40])
    chosen, best = rows("`tcn`", [noisy(0)], [noisy(1)])
    assert chosen.startswith("| `tcn` |")
    assert best.startswith("| `tcn`, with hindsight |")
    assert chosen.count("|") == best.count("|") == len(networks_together.HEADS) + 1


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--data", "sets"], "networks are needed"),
        (["--tcn", "one.onnx", "--data", "a", "b", "--every", "2"], "1 numbers for 2 sets"),
        (["--tcn", "one.onnx", "--data", "nowhere"], "nowhere"),
        (["--tcn", "one.onnx", "--data", "sets", "--every", "0"], "--every"),
    ],
)
def test_a_mistake_is_told_in_a_line(
    asked: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["networks_together.py", *asked])
    with pytest.raises(SystemExit) as ended:
        networks_together.main()
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]


def test_one_network_alone_says_what_it_said() -> None:
    alone = [noisy(0), noisy(1)]
    assert together([alone]) == alone


def test_the_first_of_a_kind_stands_alone_then_its_kind_then_all() -> None:
    paths = [Path(f"{i}.onnx") for i in range(3)]
    found = groups({"tcn": paths[:2], "gru": paths[2:]})
    assert list(found) == ["`tcn`", "2 of `tcn`", "`gru`", "all 3"]
    assert found["`tcn`"] == [("tcn", paths[0])]
    assert len(found["all 3"]) == 3
    assert list(groups({"gru": paths[:1]})) == ["`gru`"]
