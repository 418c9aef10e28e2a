"""Decision rules, sample by sample and on whole streams."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from detector.decision import (
    DecisionRule,
    RuleSettings,
    log_odds,
    registered_events,
)
from drivers.errors import ConfigError
from scenarios.campaign.config import load_config


def rule(fingers: int = 3, **settings: float) -> DecisionRule:
    return DecisionRule(RuleSettings(**settings), fingers)  # type: ignore[arg-type]


def feed(r: DecisionRule, *samples: tuple[float, ...]) -> list[list[bool]]:
    return [r.update(list(p)) for p in samples]


def registered_after(r: DecisionRule, *values: float) -> list[bool]:
    states = []
    for p in values:
        r.update([p])
        states.append(r.registered)
    return states


def test_default_is_the_paper_s_rule() -> None:
    assert (RuleSettings().consecutive, RuleSettings().release) == (2, 3)
    assert RuleSettings().threshold == 0.5


def test_each_kind_of_rule_lists_its_unused_settings() -> None:
    assert RuleSettings(kind="consecutive").unused == {"drift", "limit"}
    assert RuleSettings(kind="cusum").unused == {"consecutive"}
    assert RuleSettings(kind="either").unused == set()


def test_log_odds_of_a_sample_are_limited() -> None:
    assert log_odds(np.array([0.0, 0.5, 1.0])) == pytest.approx([-7.0, 0.0, 7.0])


def test_every_rule_restarts_the_count_of_quiet_samples_when_interrupted() -> None:
    for kind in ["consecutive", "cusum", "either"]:
        for fusion in ["any", "mean"]:
            settings = RuleSettings(kind=kind, fusion=fusion, threshold=0.7, release=2)  # type: ignore[arg-type]
            r = DecisionRule(settings, 3)
            assert r.threshold == 0.7, (kind, fusion)
            high, low = [0.99] * 3, [0.01] * 3
            for sample in (high, high, high, low):
                r.update(sample)
            r.interrupt()
            r.update(low)
            assert r.registered, (kind, fusion)
            r.update(low)
            assert not r.registered, (kind, fusion)


def test_reset_clears_registration_and_interruption_clears_evidence() -> None:
    for fusion in ["any", "mean"]:
        r = DecisionRule(RuleSettings(fusion=fusion), 3)  # type: ignore[arg-type]
        high = [0.99] * 3
        r.update(high)
        r.interrupt()
        assert not any(r.update(high)), fusion
        assert any(r.update(high)) and r.registered, fusion
        r.reset()
        assert not r.registered and not any(r.update(high)), fusion


def test_evidence_at_the_limit_is_not_above_it() -> None:
    p = np.array([0.9])
    settings = RuleSettings(kind="cusum", limit=float(log_odds(p)[0]))
    assert not any(DecisionRule(settings, 1).update(p.tolist()))
    assert len(registered_events(p[None], settings)) == 0
    assert len(registered_events(np.array([p, p]), settings)) == 1


def test_k_samples_in_a_row_on_one_finger_register_it_for_as_long_as_they_last() -> None:
    high, low = (0.0, 0.9, 0.0), (0.0, 0.0, 0.0)
    found = feed(rule(), high, high, high, low, high)
    assert [f[1] for f in found] == [False, True, True, False, False]
    assert not any(f[0] or f[2] for f in found)


def test_samples_in_a_row_on_different_fingers_register_nothing() -> None:
    found = feed(rule(), (0.9, 0, 0), (0, 0.9, 0), (0, 0, 0.9), (0.9, 0, 0))
    assert not np.any(found)


def test_a_probability_at_the_threshold_is_not_above_it() -> None:
    assert not np.any(feed(rule(1), (0.5,), (0.5,), (0.5,)))
    assert np.any(feed(rule(1), (0.5000001,), (0.5000001,)))


def test_slip_stays_registered_until_enough_quiet_samples_on_all_fingers() -> None:
    r = rule(1, release=3)
    assert registered_after(r, 1, 1, 0, 0, 1, 0, 0, 0, 0) == [
        False, True, True, True, True, True, True, False, False,
    ]  # fmt: skip
    both = rule(2, release=2)
    states = []
    for p in [(1, 0), (1, 0), (0, 1), (0, 0), (0, 1), (0, 0), (0, 0)]:
        both.update([float(each) for each in p])
        states.append(both.registered)
    assert states == [False, True, True, True, True, True, False]


def test_an_event_ends_at_the_quiet_probability_and_never_above_the_threshold() -> None:
    p = [0.9, 0.9, 0.3, 0.3, 0.3, 0.2, 0.2, 0.2]
    for quiet, after in ((0.2, 7), (0.3, 4), (0.0, 4), (0.9, 4)):
        states = registered_after(rule(1, quiet=quiet), *p)
        assert states == [False, *[True] * (after - 1), *[False] * (8 - after)], quiet
    for wrong in ("-0.1", "1.0"):
        with pytest.raises(ConfigError, match=r"rule\.quiet"):
            load_config("can", "simulated", "tcn", None, [f"rule.quiet={wrong}"])


def test_events_of_a_stream_countable_by_hand() -> None:
    p = np.array([0, 1, 1, 1, 0, 0, 0, 1, 0, 1, 1, 0, 1, 0, 0, 0, 1, 1], float)[:, None]
    assert registered_events(p, RuleSettings(release=3)).tolist() == [[2, 6], [10, 15], [17, 18]]


CUSUM = {"kind": "cusum", "limit": 4.0, "drift": 0.5}


def test_cusum_registers_high_probabilities_sooner() -> None:
    for p, expected in ((0.99, 0), (0.95, 1), (0.9, 2), (0.7, 11), (0.6, None)):
        r = DecisionRule(RuleSettings(**CUSUM), 1)  # type: ignore[arg-type]
        registered = [r.update([p])[0] for _ in range(30)]
        assert (registered.index(True) if any(registered) else None) == expected


def test_either_registers_what_the_count_or_the_sum_registers() -> None:
    settings = {"threshold": 0.7, "drift": -1.5, "limit": 30.0, "quiet": 0.3, "release": 5}
    for p, count, total in ((0.9, 1, 8), (0.6, None, 15), (0.35, None, 34), (0.25, None, None)):
        found = []
        for kind in ("consecutive", "cusum", "either"):
            r = DecisionRule(RuleSettings(kind=kind, **settings), 1)  # type: ignore[arg-type]
            registered = [r.update([p])[0] for _ in range(100)]
            found.append(registered.index(True) if any(registered) else None)
        first = min((at for at in (count, total) if at is not None), default=None)
        assert found == [count, total, first], p


def test_mean_of_the_fingers_decides_and_the_most_probable_finger_registers() -> None:
    r = DecisionRule(RuleSettings(fusion="mean", consecutive=1), 3)
    assert r.update([0.9, 0.2, 0.2]) == [False, False, False]
    assert r.update([0.7, 0.95, 0.4]) == [False, True, False]
    assert r.registered


@given(
    seed=st.integers(0, 10_000), fingers=st.integers(1, 3), release=st.integers(1, 4),
    kind=st.sampled_from(["consecutive", "cusum", "either"]),
    fusion=st.sampled_from(["any", "mean"]),
    limit=st.floats(0.5, 8.0), quiet=st.sampled_from([0.0, 0.2, 0.6, 0.9]),
)  # fmt: skip
def test_events_of_a_whole_stream_equal_those_sample_by_sample(
    seed: int, fingers: int, release: int, kind: str, fusion: str, limit: float, quiet: float
) -> None:
    p = np.random.default_rng(seed).uniform(0.0, 1.0, (60, fingers))
    settings = RuleSettings(
        kind=kind, fusion=fusion, limit=limit, release=release, drift=0.3, threshold=0.6,
        quiet=quiet,
    )  # type: ignore[arg-type]  # fmt: skip
    r = DecisionRule(settings, fingers)
    registered = []
    for row in p:
        r.update(row.tolist())
        registered.append(r.registered)
    edges = np.flatnonzero(np.diff([False, *registered, False]))
    expected = edges.reshape(-1, 2)
    assert registered_events(p, settings).tolist() == expected.tolist()


def test_nan_of_one_finger_does_not_block_detection_on_the_others() -> None:
    for kind in ["consecutive", "cusum", "either"]:
        for fusion in ["any", "mean"]:
            for never in [np.nan, 0.5]:
                made = DecisionRule(RuleSettings(kind=kind, fusion=fusion), 3)  # type: ignore[arg-type]
                verdicts = [made.update([never, 0.99, 0.9]) for _ in range(10)]
                assert made.registered, (kind, fusion, never)
                assert verdicts[-1][1], (kind, fusion, never)
                assert not verdicts[-1][0], (kind, fusion, never)
                quiet = [made.update([never, 0.01, 0.01]) for _ in range(10)]
                assert not any(quiet[-1]), (kind, fusion, never)
                assert not made.registered, (kind, fusion, never)
                stream = np.array([[never, 0.99, 0.9]] * 10)
                assert len(registered_events(stream, made.settings)) == 1, (kind, fusion, never)
