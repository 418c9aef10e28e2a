"""The short form of `make fuzz`: kept cases first, then new ones of a fixed seed."""

import random
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest

from tests.wire.fuzz import polite
from tests.wire.fuzz.campaign import Outcome, campaign, ended_badly, kept_cases
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
