"""The leak fixture of conftest.py: a planted leak fails its test, a clean test passes."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

PLANTED = """
import socket
import subprocess
import sys
import threading
import time

import pytest

kept = []


def test_thread():
    kept.append(threading.Thread(target=time.sleep, args=(30.0,), daemon=True))
    kept[-1].start()


def test_process():
    command = [sys.executable, "-c", "import sys; sys.stdin.read()"]
    kept.append(subprocess.Popen(command, stdin=subprocess.PIPE))


def test_zombie():
    kept.append(subprocess.Popen([sys.executable, "-c", ""]))


def test_socket():
    kept.append(socket.create_server(("127.0.0.1", 0)))


def test_far_away():
    with socket.socket() as far, pytest.raises(AssertionError, match="loopback only"):
        far.connect(("192.0.2.1", 502))
    with socket.socket(type=socket.SOCK_DGRAM) as far, pytest.raises(AssertionError):
        far.sendto(b"x", ("192.0.2.1", 502))


def test_clean():
    thread = threading.Thread(target=time.sleep, args=(0.05,))
    thread.start()
    subprocess.run([sys.executable, "-c", ""], check=True)
    with socket.create_server(("127.0.0.1", 0)) as server:
        with socket.create_connection(server.getsockname()):
            pass


@pytest.fixture(scope="module")
def server():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def test_shared_server(server):
    assert server.getsockname()[0] == "127.0.0.1"


def test_lab_settings():
    import os

    assert "GRASP_CONFIG" not in os.environ


def teardown_module():
    for thing in kept:
        if isinstance(thing, subprocess.Popen):
            thing.stdin and thing.stdin.close()
            thing.wait(10)
        elif isinstance(thing, socket.socket):
            thing.close()
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Message of each planted test's failure; empty for those that passed."""
    folder = tmp_path_factory.mktemp("planted")
    conftest = (ROOT / "tests/conftest.py").read_text()
    (folder / "conftest.py").write_text(conftest.replace("GRACE_S = 2.0", "GRACE_S = 0.2"))
    (folder / "test_planted.py").write_text(PLANTED)
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rA", "-p", "no:cacheprovider", "-W", "error"],
        cwd=folder,
        env=os.environ | {"GRASP_CONFIG": "/lab", "COLUMNS": "2000"},  # messages in full
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    passed = re.findall(r"^PASSED .*::(\w+)", run.stdout, re.MULTILINE)
    failed = re.findall(r"^(?:ERROR|FAILED) .*::(\w+) - (.*)", run.stdout, re.MULTILINE)
    assert passed or failed, run.stdout + run.stderr
    return dict.fromkeys(passed, "") | dict(failed)


@pytest.mark.parametrize(
    ("test", "left"),
    [
        ("test_thread", "thread"),
        ("test_process", "process"),
        ("test_zombie", "process"),
        ("test_socket", "socket"),
    ],
)
def test_a_leak_fails_its_test(outcomes: dict[str, str], test: str, left: str) -> None:
    assert re.match(rf"Failed: left behind: {left}\b", outcomes[test])


@pytest.mark.parametrize(
    "test", ["test_clean", "test_shared_server", "test_far_away", "test_lab_settings"]
)
def test_a_clean_test_passes(outcomes: dict[str, str], test: str) -> None:
    assert outcomes[test] == ""
