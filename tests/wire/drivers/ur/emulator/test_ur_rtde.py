"""Unmodified ur_rtde against the emulator; the scenarios are in clients.py."""

import pytest

CB3 = (
    "fields", "move_l", "path_and_custom_script", "settings", "protective_stop", "stop_after_speed",
    "io", "dashboard", "in_use",
)  # fmt: skip


@pytest.mark.parametrize("scenario", CB3)
def test_scenarios_on_a_cb3(emulator, scenario):
    emulator.client(scenario)
    assert emulator.fault(do="state")["ignored_packets"] == 0


@pytest.mark.parametrize("scenario", ["move_l", "not_remote"])
def test_scenarios_on_an_e_series_at_500_hz(emulate, scenario):
    """A CB3 (125 Hz) has no remote control mode that ur_rtde could check."""
    emulate("--profile", "e-series").client(scenario)


def test_registers_are_released_on_disconnect(emulator):
    """A register belongs to one client until that client is gone."""
    emulator.client("connect")
    emulator.client("connect")
    emulator.fault(do="claim", names=["input_double_register_3"])
    with pytest.raises(AssertionError, match="already in use"):
        emulator.client("connect")
