"""Draws over what nobody knows, and Table IV over them as a range."""

import json
import math

import numpy as np
import pytest

from drivers.errors import ConfigError
from grasp.cli.frontier_view import print_spread
from grasp.settings import Layer, load
from scenarios.campaign.paper import TABLE_IV
from scenarios.campaign.spec import CampaignSpec, combinations
from scenarios.campaign.spread import between, log_mean, rank_correlation, summarize
from scenarios.campaign.unknowns import Unknown, latin_hypercube
from scenarios.campaign.worker import Row

UNKNOWNS = {
    "fingertip.noise_counts": Unknown(low=0.1, high=0.5),
    "object.friction_static": Unknown(
        low=0.5, high=2.0, times=True, log=True, also=("object.friction_kinetic",)
    ),
}


def test_every_part_of_every_range_is_drawn_once() -> None:
    draws = latin_hypercube(UNKNOWNS, 16)
    for key, unknown in UNKNOWNS.items():
        ends = [unknown.at(k / 16) for k in range(17)]
        counts, _ = np.histogram([draw[key] for draw in draws], ends)
        assert counts.tolist() == [1] * 16
    assert draws == latin_hypercube(UNKNOWNS, 16)


def test_draw_sets_values_and_multiplies_what_the_object_says() -> None:
    spec = CampaignSpec(
        name="x", scenarios=("lift", "tap"), objects=("can", "foam"), unknowns=UNKNOWNS, draws=3
    )
    places = combinations(spec)
    assert len(places) == 2 * 2 * 3
    for place in places:
        factor = place.swept["object.friction_static"]
        body = place.config.object
        own = {"can": (0.8, 0.7), "foam": (0.7, 0.6)}[body.name]
        assert (body.friction_static, body.friction_kinetic) == pytest.approx(
            (own[0] * factor, own[1] * factor), rel=1e-4
        )
        assert place.config.fingertip.noise_counts == pytest.approx(
            place.swept["fingertip.noise_counts"]
        )
    assert [place.swept["draw"] for place in places[:3]] == [0, 1, 2]


@pytest.mark.parametrize(
    "wrong", [{"low": 1.0, "high": 1.0}, {"low": 0.0, "high": 1.0, "log": True}, {"low": 1.0}]
)
def test_range_that_is_none_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        load(Unknown, [Layer("x", wrong)])


@pytest.mark.parametrize("times", [False, True])
@pytest.mark.parametrize("key", ["object.colour", "colour", "object.shape"])
def test_unknown_that_is_no_number_among_the_settings_is_refused(key: str, times: bool) -> None:
    unknown = Unknown(low=0.1, high=1, times=times)
    spec = CampaignSpec(name="x", objects=("can",), unknowns={key: unknown}, draws=2)
    with pytest.raises(ConfigError, match=key):
        combinations(spec)


def rows(rates: list[float], n: int = 20) -> list[Row]:
    """Lifts of all six objects under draws of which each succeeds so often."""
    found = []
    for draw, rate in enumerate(rates):
        swept = json.dumps({"draw": draw, "fingertip.noise_counts": 0.1 + 0.1 * draw})
        for name in TABLE_IV:
            for i in range(n):
                found.append(
                    Row(
                        trial=len(found), scenario="lift", object=name, profile="paper",
                        detector="energy", swept=swept, repetition=i, seed=i, status="done",
                        success=i < rate * n, outcome="held" if i < rate * n else "dropped",
                        config_hash="", detector_hash="",
                    )
                )  # fmt: skip
    return found


def test_range_holds_the_paper_where_some_draw_is_below_it_and_some_above() -> None:
    (column,) = summarize("x", rows([0.2, 0.6, 0.9])).columns
    cells = {cell.object: cell for cell in column.cells}
    assert (cells["ball"].least, cells["ball"].median, cells["ball"].most) == (0.2, 0.6, 0.9)
    assert cells["ball"].inside and not cells["box"].inside
    assert column.draws == 3
    assert column.tendencies[0].with_rate == pytest.approx(1.0)


def test_likelihood_over_the_draws_is_the_mean_of_theirs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    spread = summarize("x", rows([0.2, 0.75, 1.0]))
    (column,) = spread.columns
    scores = column.log_likelihoods
    assert scores is not None and column.log_likelihood is not None
    mean = sum(math.exp(s) for s in scores) / 3
    assert column.log_likelihood == pytest.approx(math.log(mean))
    assert min(scores) < column.log_likelihood < max(scores)
    assert column.best_draw == pytest.approx({"fingertip.noise_counts": 0.2})
    print_spread(spread)
    shown = capsys.readouterr().out
    assert "likeliest draw: fingertip.noise_counts 0.2" in shown
    assert "20%, 75%, 100%" in shown
    assert "fingertip.noise_counts: rank correlation with the rate +1.00" in shown


def test_spread_beyond_chance_is_that_of_the_true_rates() -> None:
    rng = np.random.default_rng(3)
    same = [(int(rng.binomial(20, 0.8)), 20) for _ in range(400)]
    assert between(same) < 0.04
    true = rng.uniform(0.5, 1.0, 400)
    assert between([(int(rng.binomial(20, p)), 20) for p in true]) == pytest.approx(
        0.5 / math.sqrt(12), abs=0.02
    )
    assert between([(3, 3)]) == 0.0


def test_log_mean_does_not_underflow() -> None:
    assert log_mean([-2000.0, -2000.0]) == pytest.approx(-2000.0)


def test_rank_correlation_takes_ties_and_what_does_not_vary() -> None:
    assert rank_correlation([1, 2, 3, 4], [1, 4, 9, 16]) == pytest.approx(1.0)
    assert rank_correlation([1, 2, 3], [3, 2, 1]) == pytest.approx(-1.0)
    assert rank_correlation([1, 2, 3], [1, 1, 1]) == 0.0
    assert rank_correlation([1, 1, 2, 2], [1, 2, 1, 2]) == pytest.approx(0.0)
