"""The server of a live page: who is let in, what is told, and that nobody waits for a viewer."""

import http.client
import json
import os
import resource
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from scenarios.report.drawn import Seen
from scenarios.report.live.feed import Feed
from scenarios.report.live.server import MOST_BYTES, MOST_VIEWERS

SEEN = Seen(False, False, False, None, None)
DATA: dict[str, Any] = {"fingers": ["fingertip"], "taxels": [], "columns": [["t", 1], ["felt", 1]]}
LONG_S = 20.0
FEW = 32  # descriptors


@pytest.fixture
def feed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Feed]:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with Feed("a run", ("fingertip",), SEEN, of=2) as made:
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


def test_no_path_of_the_machine_is_served(feed: Feed) -> None:
    text = asked(feed, urlsplit(feed.address).path).read().decode()
    for path in (Path.home(), Path.cwd(), Path(__file__).parents[3]):
        assert str(path) not in text.replace("://", "") or str(path) == "/"


def test_only_loopback_listens(feed: Feed) -> None:
    at = urlsplit(feed.address)
    assert at.hostname == "127.0.0.1"
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None)}
    for address in others - {"127.0.0.1", "127.0.1.1", "::1"}:
        with pytest.raises(OSError), socket.create_connection((address, at.port), timeout=2.0):
            pass


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


def test_another_trial_begins_anew_with_what_is_left(feed: Feed) -> None:
    feed.begin(DATA)
    shown(feed, 3)
    feed.say("the first one held")
    feed.begin(DATA, 2)
    shown(feed, 1, first=100)
    with looking_on(feed) as viewer:
        begin, row = told(viewer, 1)
    assert begin["type"] == "Begin" and begin["number"] == 2 and begin["left_s"] > 0.0
    assert row["values"][0] == pytest.approx(1.0)


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


def test_viewers_are_few(feed: Feed) -> None:
    feed.begin(DATA)
    shown(feed, 1)
    with ExitStack() as open_ones:
        viewers = [open_ones.enter_context(looking_on(feed)) for _ in range(MOST_VIEWERS)]
        for viewer in viewers:
            told(viewer, 1)
        with pytest.raises(InvalidStatus, match="503"), looking_on(feed):
            pass


def test_who_speaks_too_loudly_is_shown_out_and_others_are_told_on(feed: Feed) -> None:
    feed.begin(DATA)
    with looking_on(feed) as good, looking_on(feed) as bad:
        bad.send(b"x" * (MOST_BYTES + 1))
        with pytest.raises(ConnectionClosed):
            while True:
                bad.recv(LONG_S)
        shown(feed, 3)
        assert len(told(good, 3)) == 4


def test_who_takes_nothing_holds_nobody_up(feed: Feed) -> None:
    at = urlsplit(feed.address)
    assert at.hostname is not None and at.port is not None
    feed.begin(DATA)
    with socket.create_connection((at.hostname, at.port)) as silent, looking_on(feed) as good:
        silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        silent.sendall(
            f"GET {at.path}live HTTP/1.1\r\nHost: {at.netloc}\r\nOrigin: http://{at.netloc}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        shown(feed, 3_000)
        assert told(good, 3_000)[-1]["values"][0] == pytest.approx(29.99)


def test_more_viewers_than_descriptors_are_turned_away_without_a_word(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with Feed("a run", ("fingertip",), SEEN, of=1) as feed, ExitStack() as silent:
        at = urlsplit(feed.address)
        assert asked(feed, at.path).status == 200  # it is up
        resource.prlimit(feed.pid, resource.RLIMIT_NOFILE, (FEW, FEW))
        for _ in range(2 * FEW):
            silent.enter_context(socket.create_connection((at.hostname, at.port), LONG_S))
        deadline = time.monotonic() + LONG_S
        while len(os.listdir(f"/proc/{feed.pid}/fd")) < FEW - 1 and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.5)
        silent.close()
        assert asked(feed, at.path).status == 200
    assert capfd.readouterr().err == ""


def test_where_there_is_a_display_a_browser_is_opened_and_never_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    browser, opened = tmp_path / "browser", tmp_path / "opened"
    browser.write_text(f'#!/bin/sh\necho noise\necho "$1" > {opened}.part\n'
                       f"mv {opened}.part {opened}\nsleep 30\n")  # fmt: skip
    browser.chmod(0o700)
    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setenv("BROWSER", str(browser))
    with Feed("a run", ("fingertip",), SEEN, of=1) as feed:
        deadline = time.monotonic() + LONG_S
        while not opened.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        assert opened.read_text().strip() == feed.address
    assert "noise" not in capfd.readouterr().out


def until_lost(feed: Feed) -> None:
    deadline = time.monotonic() + LONG_S
    while feed.lost == 0 and time.monotonic() < deadline:
        feed.show("lift", [0.0, 1.0])
    assert feed.lost > 0


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_server_that_stands_still_or_has_gone_costs_pictures_alone(
    feed: Feed, number: int
) -> None:
    feed.begin(DATA)
    os.kill(feed.pid, number)
    until_lost(feed)
    os.kill(feed.pid, signal.SIGKILL)


def test_a_trial_whose_begin_was_lost_is_begun_with_a_later_row(feed: Feed) -> None:
    os.kill(feed.pid, signal.SIGSTOP)
    feed.begin(DATA)
    until_lost(feed)
    feed.begin(DATA, 2)
    feed.show("lift", [7.0, 1.0])
    os.kill(feed.pid, signal.SIGCONT)
    with looking_on(feed) as viewer:
        time.sleep(0.2)
        shown(feed, 1, first=800)
        found = told(viewer, 1)
        while found[-1]["values"][0] != pytest.approx(8.0):
            found += told(viewer, 1)
    assert [m["number"] for m in found if m["type"] == "Begin"][-1] == 2


def test_when_the_run_is_over_the_server_ends_and_has_told_the_last(feed: Feed) -> None:
    feed.begin(DATA)
    with looking_on(feed) as viewer:
        shown(feed, 1)
        feed.say("held")
        feed.close()
        found: list[dict[str, Any]] = []
        with pytest.raises(ConnectionClosed):
            while True:
                found += json.loads(viewer.recv(LONG_S))
    assert found[-1] == {"type": "Said", "text": "held"}
    with pytest.raises(OSError):
        asked(feed, urlsplit(feed.address).path)
