import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.energy import EnergyDetector, EnergySettings
from detector.scores.evaluation import WARM_UP_SAMPLES, stream_recordings
from drivers.errors import BadFile
from scenarios.campaign.config import load_config
from scenarios.studies.detectors import robustness
from scenarios.studies.detectors.figures import COLOURS, in_colour
from scenarios.studies.detectors.robustness import (
    AMOUNTS,
    PAD,
    chosen,
    endured,
    made_stiffer,
    rest_min,
    stream_together,
    study,
    table,
    versions_of,
)
from tests.unit.detector.blow_toys import struck
from tests.unit.detector.toys import toy, toys


def energy(fingers, taxels=6):
    return EnergyDetector(EnergySettings(threshold_counts=2.0), fingers, taxels)


def of_cause(cause, n):
    return [
        msgspec.structs.replace(r, metadata=msgspec.structs.replace(r.metadata, cause=cause))
        for r in toys("test", n, 0)
    ]


def test_recordings_side_by_side_are_heard_as_one_after_the_other():
    mixed = [*toys("test", 2, 0), struck((3.0, 0.003), n=500), *toys("test", 1, 7)]
    alone = stream_recordings(energy, mixed)
    together = stream_together(energy, mixed)
    for one, other in zip(alone, together, strict=True):
        assert one.recording is other.recording
        assert (one.probabilities == other.probabilities).all()


def test_every_row_says_of_which_detector_and_rule_it_is():
    (rows,) = study(["energy"], toys("test", 2, 0), []).values()
    assert {row.detector_hash for row in rows} == {
        load_config("can", "simulated", "energy").detector_hash()
    }


def test_every_cause_keeps_its_share_and_each_at_least_one_recording():
    every = of_cause("often", 40) + of_cause("seldom", 8) + of_cause("once", 1)
    found = [r.metadata.cause for r in chosen(every, 12)]
    assert (found.count("often"), found.count("seldom"), found.count("once")) == (10, 2, 1)
    assert [r.source for r in chosen(every, 12)] == [r.source for r in chosen(every, 12)]


def test_a_smaller_choice_is_all_where_there_are_no_more():
    assert len(chosen(of_cause("often", 5), 100)) == 5


def test_nothing_wrong_comes_once_and_first_and_the_stiffer_pad_last():
    found = versions_of(toys("test", 1, 0), toys("test", 1, 1))
    kinds = [(kind, amount) for kind, amount, _ in found]
    assert kinds[0] == ("", 0.0) and kinds[-1][0] == PAD
    assert len(set(kinds)) == len(kinds) == 2 + sum(len(a) - 1 for a in AMOUNTS.values())


def test_what_a_detector_endures_is_told_by_its_own_rule():
    recordings = toys("test", 6, 20)
    streams = stream_together(energy, recordings)
    heard = endured("", 0.0, 0.5, RuleSettings(threshold=0.5), streams)
    deaf = endured("", 0.0, 0.5, RuleSettings(threshold=0.999999), streams)
    assert heard.accuracy > 0.8 and heard.recall == 1.0 and heard.delay_ms.p90 < 200
    assert heard.far_share is None  # nothing was struck
    assert deaf.recall == 0.0 and deaf.delay_ms.p50 == np.inf and deaf.false_per_min == 0.0


def test_blows_are_told_apart_by_how_far_they_moved_it():
    hand = struck((3.0, 0.003), (6.0, 0.0001))
    loud = np.zeros((900, 3))
    loud[303:310] = 1.0  # the first motion of the blow that moved it
    streams = [robustness.Streamed(hand, loud, np.empty(0))]
    found = endured("dead", 1.0, 0.5, RuleSettings(consecutive=1), streams)
    assert (found.far_share, found.idle_share) == (1.0, 0.0)


def test_the_table_has_a_row_for_each_and_a_miss_is_no_number():
    streams = stream_together(energy, toys("test", 2, 0))
    rows = [endured(k, a, 0.5, RuleSettings(threshold=0.999999), streams)
            for k, a in (("", 0.0), ("lost", 0.03))]  # fmt: skip
    lines = table({"energy": rows}).splitlines()
    assert len(lines) == 4 and "lost: 3 % of the samples" in lines[-1]
    assert "inf / inf / inf" in lines[-1]


def test_a_picture_leaves_no_detector_out_however_many_there_are():
    many = [f"mine-{i}" for i in range(len(COLOURS) + 1)]
    coloured = list(in_colour(many))
    assert [name for name, _ in coloured] == many
    assert len({colour for _, colour in coloured[:-1]}) == len(COLOURS)


def test_a_pad_is_made_stiffer_only_from_a_folder_that_says_how_it_was_built(tmp_path):
    with pytest.raises(BadFile, match="says not how the set was made"):
        made_stiffer([tmp_path], toys("test", 1, 0))


def test_rest_is_what_is_no_slip_after_the_warm_up_of_a_hand():
    one = toy(3, "test")
    still = (~one.slip[WARM_UP_SAMPLES:]).sum() * 0.01 / 60.0
    hand = msgspec.structs.replace(one, counts=np.repeat(one.counts, 3, axis=1))
    assert rest_min([hand]) == pytest.approx(still, rel=0.01)
    assert rest_min([one, hand]) == pytest.approx(still * 4 / 3, rel=0.01)
    assert rest_min([msgspec.structs.replace(one, slip=np.ones_like(one.slip))]) == 0.0
