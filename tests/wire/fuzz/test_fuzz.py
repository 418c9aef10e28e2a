"""The short form of `make fuzz`: kept cases first, then new ones of a fixed seed."""

import random

import pytest

from tests.wire.fuzz.campaign import campaign, kept_cases
from tests.wire.fuzz.grammars import GRAMMARS, MOST_BYTES

MOST_RATIO = 8.0  # the aim is 2, on a machine with nothing else to do; see docs/emulators.md


@pytest.mark.parametrize("name", GRAMMARS)
def test_a_seed_says_the_same_each_time_and_not_without_end(name) -> None:
    for seed in range(30):
        said = GRAMMARS[name](random.Random(seed))
        assert said == GRAMMARS[name](random.Random(seed))
        assert sum(map(len, said)) <= 1.2 * MOST_BYTES


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_hostile_clients_of_all_ports_leave_a_cell_that_serves_the_others() -> None:
    found = campaign(7, 40.0, kept_cases())
    assert not found.trouble, found.last
    ratios = found.ratios()
    assert set(ratios) == {"dashboard", "modbus", "control", "faults", "hop", "rtde"}
    assert max(ratio for _, _, ratio in ratios.values()) < MOST_RATIO, ratios
