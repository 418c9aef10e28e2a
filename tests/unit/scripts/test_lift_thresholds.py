"""What a row says of lifts by one threshold."""

from scripts.last_draw import Lifted
from scripts.lift_thresholds import row


def test_a_row_names_what_was_not_held_with_its_seed_and_counts_no_rise_as_a_miss() -> None:
    made = [
        Lifted("can", 1, "held", True, 80.0, 1.5),
        Lifted("mug", 2, "dropped", False, None, 52.25),
    ]
    assert row("tcn", 0.65, made, False) == (
        "| `tcn` | 0.65 | 1 of 2 (50 % [9, 91]) | 80 / inf / inf | 1.5 / 52.2 / 52.2 "
        "| mug 2 dropped |"
    )


def test_the_packaged_threshold_is_told_apart() -> None:
    made = [Lifted("can", 1, "held", True, 80.0, 1.5)]
    assert "| **0.7471, packaged** |" in row("tcn", 0.7471, made, True)
    assert row("tcn", 0.7471, made, True).endswith("| – |")
