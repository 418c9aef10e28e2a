"""The process that holds ur_rtde is told the settings of the link, each by its own name."""

import msgspec
import pytest

from drivers.errors import LinkLost
from drivers.ur.link import client
from drivers.ur.link.client import UrLink, UrSettings
from drivers.ur.link.messages import Setup

SETTINGS = UrSettings(
    host="10.0.0.9", frequency_hz=100.0, tcp_offset=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    cog_m=(0.01, 0.02, 0.03), watchdog_hz=11.0, heartbeat_timeout_s=0.31, link_timeout_s=0.73,
    standing_below_mps=0.004,
)  # fmt: skip


def test_the_worker_is_told_the_settings_of_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Setup] = []

    def start(setup: Setup) -> None:
        told.append(setup)
        raise LinkLost("enough is known", "none")

    monkeypatch.setattr(client, "preflight", lambda *_: None)
    monkeypatch.setattr(client, "require", lambda _: None)
    monkeypatch.setattr(client, "WorkerProcess", start)
    with pytest.raises(LinkLost):
        UrLink(SETTINGS).connect()
    (setup,) = told
    said = msgspec.structs.asdict(setup)
    assert said.pop("payload_kg") is None
    assert said == {name: getattr(SETTINGS, name) for name in said}
