"""Which weights of a training are kept: a miss costs what it costs, likelihood comes after."""

import msgspec

from detector.training.validation import Score

KEPT = Score(delay_ms=180.0, loss=0.07, accuracy=0.97)


def test_the_quicker_weights_are_kept_and_the_likelier_of_equally_quick_ones() -> None:
    for delay_ms, loss, better in [
        (179.0, 0.20, True),  # quicker, though the samples are told far worse
        (181.0, 0.01, False),  # and the other way round
        (180.0, 0.06, True),
        (180.0, 0.08, False),
        (180.0, 0.07, False),  # the earlier of equals stays
    ]:
        found = msgspec.structs.replace(KEPT, delay_ms=delay_ms, loss=loss)
        assert found.better_than(KEPT) is better, (delay_ms, loss, better)


def test_any_validation_is_better_than_none() -> None:
    assert KEPT.better_than(None)
