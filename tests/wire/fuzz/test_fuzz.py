"""The short form of `make fuzz`: kept cases first, then new ones of a fixed seed."""

import os
import random
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from tests.wire.fuzz import campaign as campaigns
from tests.wire.fuzz import polite
from tests.wire.fuzz.campaign import (
    Outcome,
    campaign,
    ended_badly,
    keep,
    kept_cases,
    kept_lines,
    main,
    marked,
)
from tests.wire.fuzz.grammars import GRAMMARS, MOST_BYTES

# `make fuzz` asks for 2, of the median of an hour's blocks. Here are two blocks, beside other tests
# on all cores: what the machine does between a block and the quiet beside it is as much as what the
# cell does. One that lets somebody wait for a hostile client takes hundreds of times as long.
MOST_RATIO = 8.0


@pytest.mark.parametrize("name", GRAMMARS)
def test_a_seed_says_the_same_each_time_and_not_without_end(name) -> None:
    for seed in range(30):
        said = GRAMMARS[name](random.Random(seed))
        assert said == GRAMMARS[name](random.Random(seed))
        assert sum(map(len, said)) <= 1.2 * MOST_BYTES


def test_kept_cases_say_what_they_said() -> None:
    """A grammar was changed, or a list that it draws from: find the case again, or take it out."""
    assert kept_lines() == list(map(marked, kept_cases()))


def test_what_a_campaign_met_last_before_trouble_is_written_down_and_played_first_the_next_time(
    tmp_path, monkeypatch, capsys
) -> None:
    """The trouble is made up: the cell is this process, and a client says that it got no answer."""
    found, played = tmp_path / "new" / "found.txt", []
    nowhere = {"host": "127.0.0.1", "port": 1}
    at = {
        "pid": os.getpid(), "host": "127.0.0.1", "tactile": {"url": "tcp://127.0.0.1:1"},
        "arm": {"rtde": 1, "dashboard": 1, "script": 1, "faults": 1},
        "gripper": nowhere, "control": nowhere,
    }  # fmt: skip

    def unanswered(_, seconds):
        until = time.monotonic() + 60.0
        while (
            seconds == campaigns.BLOCK_S
            and len(played) < 2 * campaigns.LAST
            and time.monotonic() < until
        ):
            time.sleep(0.01)
        errors = {"modbus": "made\nup"} if seconds == campaigns.BLOCK_S else {}
        return {"median_ms": {}, "most_ms": {}, "errors": errors}

    monkeypatch.setattr(
        campaigns, "cell_process", lambda *_: nullcontext(SimpleNamespace(endpoints=at))
    )
    monkeypatch.setattr(campaigns, "polite", unanswered)
    monkeypatch.setattr(campaigns, "play", lambda _, case: not played.append(case))
    assert main(["--found", str(found)]) == 1
    assert str(found) in capsys.readouterr().out
    last = kept_cases(found)
    assert last
    assert set(last) <= set(played)
    assert found.read_text().startswith("# unanswered: {'modbus': 'made\\nup'}\n")

    played.clear()
    assert main(["--found", str(found), "--seed", "2"]) == 1
    first = kept_cases() + last
    assert set(first) <= set(played[: len(first) + campaigns.ATTACKERS])  # each may be one late


def test_a_case_that_found_nobody_is_not_among_the_last(monkeypatch) -> None:
    """A cell that has ended refuses them, and the one that ended it would be forgotten."""
    at = {name: [("127.0.0.1", 1)] for name in GRAMMARS}
    monkeypatch.setattr(campaigns, "ports", lambda _: at)
    with socket.create_server(("127.0.0.1", 0)) as server:
        at["rtde"] = [server.getsockname()]
        attack = campaigns.Attack({}, 1, [("hop", 1), ("rtde", 6), ("modbus", 1)])
        monkeypatch.setattr(
            attack, "_random", SimpleNamespace(choice=lambda _: "hop", randrange=int)
        )
        with attack:
            until = time.monotonic() + 60.0
            while (attack.played < 20 or not attack.last) and time.monotonic() < until:
                time.sleep(0.01)
    assert list(attack.last) == [("rtde", 6)]


def test_a_case_that_is_found_again_is_written_down_once(tmp_path) -> None:
    found = tmp_path / "found.txt"
    keep([("rtde", 1), ("hop", 2), ("rtde", 1)], "the cell\nhas grown", found)
    keep([("hop", 2), ("modbus", 3)], "again", found)
    assert kept_cases(found) == [("rtde", 1), ("hop", 2), ("modbus", 3)]
    assert "# the cell has grown\n" in found.read_text()


@pytest.mark.parametrize(
    ("on_sigterm", "said"),
    [("lambda *_: sys.exit(0)", ""), ("lambda *_: sys.exit(3)", "with 3"),
     ("signal.SIG_DFL", "with 15"), ("signal.SIG_IGN", "not ended")],
)  # fmt: skip
def test_a_cell_that_sigterm_does_not_end_well_is_trouble(on_sigterm, said) -> None:
    program = (
        f"import signal, sys, time\nsignal.signal(signal.SIGTERM, {on_sigterm})\n"
        "print(flush=True)\ntime.sleep(600)"
    )
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        patience_s = 0.3 if said == "not ended" else 30.0
        found = ended_badly(child.pid, patience_s)
        child.kill()
    assert said in found
    assert bool(found) == bool(said)


@pytest.mark.parametrize("said", ["ConnectionError", "TimeoutError"])
def test_a_port_that_no_longer_tells_its_state_is_told_of(said, monkeypatch) -> None:
    """It closes, or falls silent. States are counted, other messages are not."""
    monkeypatch.setattr(polite, "TIMEOUT_S", 1.0)
    messages = struct.pack(">IB", 5, 20) + struct.pack(">IB3s", 8, polite.STATE, b"...") * 3
    over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with server.accept()[0] as client:
                client.sendall(messages)
                if said == "TimeoutError":
                    over.wait(60.0)

        thread = threading.Thread(target=serve)
        thread.start()
        heard = polite.Heard(*server.getsockname())
        until = time.monotonic() + 60.0
        while not heard.error and time.monotonic() < until:
            time.sleep(0.01)
        heard.end()
        over.set()
        thread.join()
    assert said in heard.error
    assert len(heard.waits) == 3


def test_a_client_that_waits_more_than_twice_as_long_is_trouble_unless_the_machine_was_slow() -> (
    None
):
    """Of each block's ratio to the quiet before and after it the median counts."""

    def waits(rtde_ms: float, modbus_ms: float) -> dict[str, dict[str, float]]:
        return {"median_ms": {"rtde": rtde_ms, "modbus": modbus_ms}}

    outcome = Outcome()
    outcome.quiet = [waits(1.0, 1.0), waits(1.0, 1.0), waits(7.0, 1.0), waits(9.0, 1.0)]
    outcome.loud = [waits(1.5, 1.9), waits(5.0, 30.0), waits(12.0, 1.5)]
    assert outcome.ratios() == {"rtde": (4.0, 5.0, 1.5), "modbus": (1.0, 1.9, 1.9)}
    assert not outcome.starved(2.0)
    outcome.loud[0] = waits(1.5, 2.1)
    assert outcome.starved(2.0) == "waited more than 2 times as long: modbus 2.10"


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_hostile_clients_of_all_ports_leave_a_cell_that_serves_the_others() -> None:
    found = campaign(7, 40.0, kept_cases(), MOST_RATIO)
    assert not found.trouble, found.last
    ratios = found.ratios()
    asked = {"dashboard", "modbus", "control", "faults", "hop", "rtde"}
    assert set(ratios) == asked | {"state 30001", "state 30002", "state 30003"}
