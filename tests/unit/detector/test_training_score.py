"""Selection of the best weights of a training: by delay, then by loss."""

import msgspec

from detector.training.validation import Score

KEPT = Score(delay_ms=180.0, loss=0.07, accuracy=0.97)


def test_weights_with_shorter_delay_or_equal_delay_and_lower_loss_are_kept() -> None:
    for delay_ms, loss, better in [
        (179.0, 0.20, True),  # shorter delay, although the loss is higher
        (181.0, 0.01, False),  # longer delay, although the loss is lower
        (180.0, 0.06, True),
        (180.0, 0.08, False),
        (180.0, 0.07, False),  # of equal scores the earlier is kept
    ]:
        found = msgspec.structs.replace(KEPT, delay_ms=delay_ms, loss=loss)
        assert found.better_than(KEPT) is better, (delay_ms, loss, better)


def test_any_validation_is_better_than_none() -> None:
    assert KEPT.better_than(None)
