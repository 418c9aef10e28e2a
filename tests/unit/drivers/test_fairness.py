"""Places of clients and budgets of time, with times that the test says."""

import pytest

from drivers.fairness import IDLE_S, Places


def test_places_are_given_to_newcomers_once_somebody_is_silent() -> None:
    places: Places[str] = Places(2)
    assert places.enter("a", 0.0) is None
    assert places.enter("b", 0.0) is None
    with pytest.raises(OverflowError, match="too many connections: 2 are open"):
        places.enter("c", IDLE_S - 0.1)
    places.heard("a", 1.0)
    assert places.enter("c", IDLE_S) == "b"
    places.leave("a")
    assert places.enter("d", IDLE_S) is None
