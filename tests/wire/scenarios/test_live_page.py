"""The server of a live page: who is let in, what is told, and that nobody waits for a viewer."""

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
DATA: dict[str, Any] = {
    "fingers": ["fingertip"],
    "taxels": [],
    "columns": [["t", 1], ["estimated", 1]],
}
LONG_S = 20.0


@pytest.fixture
def feed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Feed]:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with closing(Feed("a run", VIEW, of=2)) as made:
        yield made


def asked(feed: Feed, path: str, **headers: str) -> http.client.HTTPResponse:
    """Whatever becomes of asking for that path."""
    at = urlsplit(feed.address)
    assert at.hostname is not None
    connection = http.client.HTTPConnection(at.hostname, at.port, timeout=LONG_S)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def looking_on(feed: Feed, **more: Any) -> ClientConnection:
    at = urlsplit(feed.address)
    address = feed.address.replace("http", "ws", 1) + "live"
    return connect(address, origin=f"http://{at.netloc}", open_timeout=LONG_S, **more)


def told(viewer: ClientConnection, rows: int) -> list[dict[str, Any]]:
    """Everything until so many rows have come."""
    found: list[dict[str, Any]] = []
    while sum(message["type"] == "Row" for message in found) < rows:
        found += json.loads(viewer.recv(LONG_S))
    return found


def shown(feed: Feed, rows: int, first: int = 0) -> None:
    """So many rows, as slowly as a pipe takes them."""
    for i in range(first, first + rows):
        lost = feed.lost
        feed.show("lift", [i * 0.01, 1.0])
        while feed.lost > lost:
            time.sleep(0.01)
            lost = feed.lost
            feed.show("lift", [i * 0.01, 1.0])


def test_the_page_is_for_who_knows_the_token(feed: Feed) -> None:
    path = urlsplit(feed.address).path
    page = asked(feed, path)
    assert page.status == 200
    text = page.read().decode()
    assert "a run" in text and f"connect-src ws://{urlsplit(feed.address).netloc};" in text
    assert page.getheader("Referrer-Policy") == "no-referrer"
    for other in ("/", path[:-2] + "/", path + "x", f"{path}../etc/passwd", "/favicon.ico"):
        assert asked(feed, other).status == 404
    assert asked(feed, path, Host="elsewhere.example").status == 404  # a name that leads here


def test_every_viewer_is_told_all_of_the_trial_however_late_he_comes(feed: Feed) -> None:
    feed.begin(DATA)
    with looking_on(feed) as early:
        shown(feed, 5)
        first = told(early, 5)
        with looking_on(feed) as late:
            assert told(late, 5) == first
            shown(feed, 3, first=5)
            assert [row["values"][0] for row in told(late, 3)] == pytest.approx([0.05, 0.06, 0.07])
    assert first[0]["type"] == "Begin" and first[0]["of"] == 2
    assert [row["values"][0] for row in first[1:]] == pytest.approx([0, 0.01, 0.02, 0.03, 0.04])


def test_a_stranger_is_not_let_in(feed: Feed) -> None:
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
        feed.show("lift", [0.0, 1.0])
    assert feed.lost > 0


@pytest.mark.parametrize("number", [signal.SIGSTOP])
def test_a_server_that_stands_still_or_has_gone_costs_pictures_alone(
    feed: Feed, number: int
) -> None:
    feed.begin(DATA)
    os.kill(feed.pid, number)
    until_lost(feed)
    os.kill(feed.pid, signal.SIGKILL)
