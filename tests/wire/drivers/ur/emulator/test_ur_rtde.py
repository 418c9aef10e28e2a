"""Unmodified ur_rtde against the emulator; the scenarios are in clients.py."""

import pytest


@pytest.mark.parametrize(
    "scenario",
    [
        "fields",
        "move_l",
        "async_move_and_stop",
        "speed_l",
        "settings",
        "path",
        "watchdog",
        "protective_stop",
        "emergency_stop",
        "stop_after_speed",
        "not_emulated",
        "force_settings",
        "io",
        "dashboard",
        "custom_script",
        "pose_trans",
        "in_use",
        "frozen",
        "dropped",
        "wrench",
    ],
)
def test_cb3(emulator, scenario):
    emulator.client(scenario)
    assert emulator.fault(do="state")["ignored_packets"] == 0


@pytest.mark.parametrize(
    "scenario",
    ["move_l", "speed_l", "pose_trans", "contact_refused", "not_remote"],
)
def test_e_series_at_500_hz(emulate, scenario):
    """125 Hz controllers have no remote control mode that ur_rtde could ask for."""
    emulate("--profile", "e-series").client(scenario)


def test_registers_are_released_on_disconnect(emulator):
    """A register belongs to one client until that client is gone."""
    emulator.client("connect")
    emulator.client("connect")
    emulator.fault(do="claim", names=["input_double_register_3"])
    with pytest.raises(AssertionError, match="already in use"):
        emulator.client("connect")
