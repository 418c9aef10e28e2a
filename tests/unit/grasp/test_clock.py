"""From when on a run's own time counts."""

import time
from datetime import UTC, datetime

from grasp.clock import PacedClock, VirtualClock, WallClock
from scenarios.trial.run_folder import dated


def test_a_wall_clock_knows_which_time_of_day_its_nought_was() -> None:
    clock = WallClock(time.monotonic_ns() - 5_000_000_000)
    now_ns = clock.unix_ns + clock.now_ns
    assert abs(now_ns - time.time_ns()) < 5_000_000_000
    assert clock.now_ns >= 5_000_000_000
    assert dated(clock.virtual, clock.unix_ns)["epoch"] == "wall clock"


def test_virtual_time_begins_at_the_stated_epoch_whatever_its_pace() -> None:
    for kind in (VirtualClock, PacedClock):
        clock = kind(lambda t_ns: None)
        begun = datetime.fromtimestamp(clock.unix_ns * 1e-9, UTC)
        assert f"{begun:%Y-%m-%dT%H:%M:%SZ}" in dated(clock.virtual, clock.unix_ns)["epoch"]
