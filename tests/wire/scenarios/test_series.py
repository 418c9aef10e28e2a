"""Lifts one after the other on one emulated rig."""

from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.trial.series import Bench
from tests.wire.scenarios.cell.staged import QUICK

DEAF = "rule.consecutive=50"  # nothing is answered, and what slips is lost


def test_after_an_object_was_lost_the_hand_opens_for_the_next() -> None:
    config = load_config("mug", "emulated", "energy", None, (*QUICK, DEAF)).for_lift()
    made = [finished.result for finished in lift.run_series(config, (0, 1), Bench())]
    assert [result is not None and result.outcome for result in made] == ["dropped"] * 2
