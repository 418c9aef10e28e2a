"""The server of a live page: access, data for viewers, and no delay by viewers."""

import http.client
import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from scenarios.report.live_feed import Feed
from scenarios.report.run_view import Bound, View

VIEW = View(False, False, 10.0, Bound(0.5, True, "", ""))
DATA: dict[str, Any] = {"fingers": ["fingertip"], "taxels": []}
LONG_S = 20.0


@pytest.fixture
def feed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Feed]:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with closing(Feed("a run", VIEW, of=2)) as made:
        yield made


def get(feed: Feed, path: str, **headers: str) -> http.client.HTTPResponse:
    """Response to a request for that path."""
    at = urlsplit(feed.address)
    assert at.hostname is not None
    connection = http.client.HTTPConnection(at.hostname, at.port, timeout=LONG_S)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def viewer_of(feed: Feed, **more: Any) -> ClientConnection:
    at = urlsplit(feed.address)
    address = feed.address.replace("http", "ws", 1) + "live"
    return connect(address, origin=f"http://{at.netloc}", open_timeout=LONG_S, **more)


def received(viewer: ClientConnection, rows: int) -> list[dict[str, Any]]:
    """All messages until that many rows have arrived."""
    found: list[dict[str, Any]] = []
    while sum(message["type"] == "Row" for message in found) < rows:
        found += json.loads(viewer.recv(LONG_S))
    return found


def show_rows(feed: Feed, rows: int, first: int = 0) -> None:
    """Show that many rows, each repeated until the pipe accepts it."""
    for i in range(first, first + rows):
        lost = feed.lost
        feed.show("lift", {"t": [i * 0.01]})
        while feed.lost > lost:
            time.sleep(0.01)
            lost = feed.lost
            feed.show("lift", {"t": [i * 0.01]})


def test_page_is_served_only_with_the_token(feed: Feed) -> None:
    path = urlsplit(feed.address).path
    page = get(feed, path)
    assert page.status == 200
    text = page.read().decode()
    assert "a run" in text and f"connect-src ws://{urlsplit(feed.address).netloc};" in text
    assert page.getheader("Referrer-Policy") == "no-referrer"
    for other in ("/", path[:-2] + "/", path + "x", f"{path}../etc/passwd", "/favicon.ico"):
        assert get(feed, other).status == 404
    assert get(feed, path, Host="elsewhere.example").status == 404  # another name of this host


def test_every_viewer_receives_the_whole_trial_at_any_time(feed: Feed) -> None:
    feed.begin(DATA)
    with viewer_of(feed) as early:
        show_rows(feed, 5)
        first = received(early, 5)
        with viewer_of(feed) as late:
            assert received(late, 5) == first
            show_rows(feed, 3, first=5)
            assert [row["values"]["t"][0] for row in received(late, 3)] == pytest.approx(
                [0.05, 0.06, 0.07]
            )
    assert first[0]["type"] == "Begin" and first[0]["of"] == 2
    assert [row["values"]["t"][0] for row in first[1:]] == pytest.approx(
        [0, 0.01, 0.02, 0.03, 0.04]
    )


def test_connections_with_a_wrong_path_or_origin_are_refused(feed: Feed) -> None:
    address = feed.address.replace("http", "ws", 1)
    for path, origin, status in (
        ("live", "http://elsewhere.example", "403"),
        ("other", f"http://{urlsplit(feed.address).netloc}", "404"),
    ):
        with (
            pytest.raises(InvalidStatus, match=status),
            connect(f"{address}{path}", origin=origin, open_timeout=LONG_S),
        ):
            pass


def until_lost(feed: Feed) -> None:
    deadline = time.monotonic() + LONG_S
    while feed.lost == 0 and time.monotonic() < deadline:
        feed.show("lift", {"t": [0.0]})
    assert feed.lost > 0


@pytest.mark.parametrize("number", [signal.SIGSTOP])
def test_stopped_or_dead_server_only_loses_rows(feed: Feed, number: int) -> None:
    feed.begin(DATA)
    os.kill(feed.pid, number)
    until_lost(feed)
    os.kill(feed.pid, signal.SIGKILL)
