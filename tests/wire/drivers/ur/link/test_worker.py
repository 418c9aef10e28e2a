"""Command side of the worker with a recorded ur_rtde: its calls, and what it monitors."""

import socket
import time
from contextlib import suppress
from types import SimpleNamespace

import msgspec
import pytest

from drivers.ur.link import messages
from drivers.ur.link.messages import Outcome
from drivers.ur.link.worker import Channel, Commander, Robot
from tests.wire.drivers.ur.link.conftest import SETUP, TARGET

SETTLED_S = 0.05  # a command shows after it: more than four cycles
SILENT_S = 1.0  # far more than the heartbeat


class Recorded:
    """Both interfaces of ur_rtde: records the calls, replies as set by the test."""

    def __init__(self):
        self.calls = []
        self.accepts = True
        self.running_operation = False
        self.speed_mps = 0.0
        self.safety_bits = 1
        self.runtime_state = 2

    def __getattr__(self, name):
        def call(*args, **options):
            self.calls.append((name, *args, *options.items()))
            return self.accepts

        return call

    def getAsyncOperationProgressEx(self):
        return SimpleNamespace(isAsyncOperationRunning=lambda: self.running_operation)

    def getTimestamp(self):
        return 1.0

    def getActualTCPPose(self):
        return list(TARGET)

    def getActualTCPSpeed(self):
        return [0.0, 0.0, self.speed_mps, 0.0, 0.0, 0.0]

    getTargetTCPSpeed = getActualTCPSpeed

    def getRobotMode(self):
        return 7

    def getSafetyStatusBits(self):
        return self.safety_bits

    def getRuntimeState(self):
        return self.runtime_state

    def getTargetSpeedFraction(self):
        return 0.75

    def getActualQ(self):
        return [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]

    def names(self):
        return [call[0] for call in self.calls if call[0] != "kickWatchdog"]


@pytest.fixture
def rtde():
    return Recorded()


@pytest.fixture
def client():
    client, worker = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    client.settimeout(10)
    with client, worker:
        yield SimpleNamespace(socket=client, channel=Channel(worker))


class ShiftedClock:
    """Monotonic clock that a test can shift forward."""

    ahead_s = 0.0

    def __call__(self):
        return time.monotonic() + self.ahead_s


@pytest.fixture
def clock():
    return ShiftedClock()


@pytest.fixture
def commander(rtde, client, clock):
    return Commander(rtde, Robot(rtde, SETUP, client.channel), SETUP, client.channel, clock)


def serve(commander, client, *requests):
    """Send all requests at once, then disconnect; returns the replies."""
    for request in requests:
        client.socket.send(msgspec.msgpack.encode(request))
    client.socket.shutdown(socket.SHUT_WR)
    commander.serve()
    reports = []
    client.socket.setblocking(False)
    while True:
        try:
            data = client.socket.recv(messages.MAX_MESSAGE_BYTES)
        except BlockingIOError:
            break
        reports.append(msgspec.msgpack.decode(data, type=messages.FromWorker))
    return [report for report in reports if isinstance(report, messages.Reply)]


def move(number=1, speed=0.1):
    return messages.Move(number, TARGET, speed, 1.0)


def test_tool_payload_and_watchdog_are_set_with_every_program(commander, rtde):
    assert commander.prepare()
    assert [call[0] for call in rtde.calls] == [
        "setTcp", "setPayload", "setWatchdog", "kickWatchdog",
    ]  # fmt: skip
    assert rtde.calls[1] == ("setPayload", 2.6, [0.0, 0.0, 0.05])


def test_a_rejected_setting_prevents_the_start(commander, rtde):
    rtde.accepts = False
    assert not commander.prepare()


def test_sample_has_the_fraction_of_the_speed_slider(rtde, client):
    assert Robot(rtde, SETUP, client.channel).state().speed_fraction == 0.75


def test_moves_and_stops_are_asynchronous(commander, rtde, client):
    replies = serve(commander, client, move(), messages.Stop(2, 0.7))
    assert [reply.outcome for reply in replies] == [Outcome.DONE, Outcome.DONE]
    assert rtde.names() == ["moveL", "stopL"]
    assert all(("asynchronous", True) in call for call in rtde.calls if call[0] in rtde.names())


def test_move_during_a_move_brakes_and_waits(commander, rtde, client, clock):
    rtde.speed_mps = 0.1
    serve(commander, client, move())
    assert rtde.names() == ["stopL"]
    rtde.speed_mps = 0.0
    rtde.running_operation = True
    clock.ahead_s = SETTLED_S
    commander.step()
    assert rtde.names() == ["stopL"]
    rtde.running_operation = False
    commander.step()
    assert rtde.names() == ["stopL", "moveL"]


def test_a_pending_move_is_dropped_when_the_client_is_silent(commander, rtde, client, clock):
    rtde.speed_mps = 0.1
    serve(commander, client, move(7))
    rtde.speed_mps = 0.0
    silence(commander, clock)
    commander.step()
    assert "moveL" not in rtde.names()


def test_stop_drops_the_pending_move(commander, rtde, client, clock):
    rtde.speed_mps = 0.1
    serve(commander, client, move(1), messages.Stop(2, 1.0))
    rtde.speed_mps, clock.ahead_s = 0.0, SETTLED_S
    commander.step()
    assert "moveL" not in rtde.names()


@pytest.mark.parametrize(
    ("bits", "runtime_state", "outcome"),
    [
        (1 << 2 | 1 << 10, 1, Outcome.STOPPED),
        (1 << 6 | 1 << 7 | 1 << 10, 1, Outcome.STOPPED),
        (1, 1, Outcome.STOPPED),
        (1, 2, Outcome.NOT_ACCEPTED),
    ],
)
def test_outcome_of_a_rejected_command_follows_from_the_status_bits(
    commander, rtde, client, bits, runtime_state, outcome
):
    rtde.accepts, rtde.safety_bits, rtde.runtime_state = False, bits, runtime_state
    (reply,) = serve(commander, client, move())
    assert reply.outcome is outcome


def kicks(commander, rtde, clock):
    clock.ahead_s += SETTLED_S
    before = rtde.calls.count(("kickWatchdog",))
    commander.step()
    return rtde.calls.count(("kickWatchdog",)) > before


def silence(commander, clock):
    """The client is silent for longer than the heartbeat time-out."""
    clock.ahead_s += SILENT_S
    commander.update_silence(False)


DRIVE = messages.DriveArm(1, (0.0, 0.0, 0.1, 0.0, 0.0, 0.0), 0.5)


def test_watchdog_of_a_stationary_arm_is_kicked_although_the_client_is_silent(
    commander, rtde, clock
):
    assert kicks(commander, rtde, clock)
    silence(commander, clock)
    assert kicks(commander, rtde, clock)
    rtde.speed_mps = 0.1  # somebody pushes it, or the measured speed is noisy
    assert kicks(commander, rtde, clock)
    assert rtde.names() == []


def test_nothing_is_braked_after_a_completed_move(commander, rtde, client, clock):
    serve(commander, client, move())
    assert kicks(commander, rtde, clock)
    silence(commander, clock)
    rtde.speed_mps = 0.1
    assert kicks(commander, rtde, clock)
    assert rtde.names() == ["moveL"]


def test_moving_arm_of_a_silent_client_is_braked_once_and_its_watchdog_not_kicked(
    commander, rtde, client, clock
):
    serve(commander, client, move())
    rtde.speed_mps = 0.1
    assert kicks(commander, rtde, clock)
    silence(commander, clock)
    assert not kicks(commander, rtde, clock)
    assert not kicks(commander, rtde, clock)
    assert rtde.names() == ["moveL", "stopL"]
    rtde.speed_mps = 0.0  # at rest again, but the program ends for the client to know
    assert not kicks(commander, rtde, clock)


def test_messages_that_wait_for_a_delayed_worker_are_not_silence(commander, rtde, client, clock):
    serve(commander, client, move())
    rtde.speed_mps = 0.1
    clock.ahead_s += SILENT_S
    commander.update_silence(True)  # one heartbeat of many
    assert kicks(commander, rtde, clock)
    assert rtde.names() == ["moveL"]


@pytest.mark.parametrize("request_", [move(2), DRIVE])
def test_no_motion_starts_after_the_client_was_lost(commander, rtde, client, clock, request_):
    serve(commander, client, move())
    rtde.speed_mps = 0.1
    silence(commander, clock)
    commander.step()
    rtde.speed_mps = 0.0
    commander.update_silence(True)
    assert commander.execute(request_) is Outcome.STOPPED
    assert rtde.names() == ["moveL", "stopL"]


def test_an_arm_that_is_braking_is_not_braked_again(commander, rtde, client, clock):
    serve(commander, client, move(1), messages.Stop(2, 5.0))
    rtde.speed_mps = 0.1
    silence(commander, clock)
    assert not kicks(commander, rtde, clock)
    assert rtde.names() == ["moveL", "stopL"]


@pytest.mark.parametrize("speed_mps", [0.1, 0.0005])
def test_a_drive_of_a_silent_client_is_braked_by_its_own_verb_at_any_speed(
    commander, rtde, client, clock, speed_mps
):
    serve(commander, client, DRIVE)
    rtde.speed_mps = speed_mps
    clock.ahead_s += SETTLED_S
    commander.step()
    silence(commander, clock)
    commander.step()
    assert rtde.names()[:2] == ["speedL", "speedL"]
    assert ("speedL", [0.0] * 6, 0.5) in rtde.calls


def test_shutdown_repeats_a_brake_that_the_controller_missed(commander, rtde, client, clock):
    serve(commander, client, DRIVE)
    rtde.speed_mps = 0.1
    clock.ahead_s += SETTLED_S
    commander.shut_down()
    brakes = [call for call in rtde.calls if call[:2] == ("speedL", [0.0] * 6)]
    assert len(brakes) > 1
    assert rtde.names()[-1] == "stopScript"


def test_shutdown_ends_the_program(commander, rtde):
    commander.shut_down()
    assert rtde.names() == ["stopScript"]


class NoMoreSleeps(Exception):
    pass


def published(rtde, client, monkeypatch, sleeps, dated=lambda now: 1.0):
    """Messages of a robot whose thread wakes after each of these sleeps, and whether it ends;
    ``dated``: its controller's clock."""
    now, left = 100.0, list(sleeps)

    def sleep(_):
        nonlocal now
        if not left:
            raise NoMoreSleeps
        now += left.pop(0)

    def end(code):
        raise SystemExit(code)

    monkeypatch.setattr(
        "drivers.ur.link.worker.time", SimpleNamespace(monotonic=lambda: now, sleep=sleep)
    )
    monkeypatch.setattr("drivers.ur.link.worker.os._exit", end)
    rtde.isConnected, rtde.getTimestamp = lambda: True, lambda: dated(now)
    robot = Robot(rtde, SETUP, client.channel)
    robot.publishing = True
    with pytest.raises((NoMoreSleeps, SystemExit)) as ended:
        robot.publish_samples()
    sent = []
    client.socket.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            data = client.socket.recv(messages.MAX_MESSAGE_BYTES)
            sent.append(type(msgspec.msgpack.decode(data, type=messages.FromWorker)).__name__)
    return sent, ended.type is SystemExit


def test_each_new_sample_of_the_controller_is_published_once(rtde, client, monkeypatch):
    assert published(rtde, client, monkeypatch, [0.001] * 85) == (["State"], False)
    sent, _ = published(rtde, client, monkeypatch, [0.001] * 85, lambda now: now // 0.008)
    assert set(sent) == {"State"} and len(sent) in (11, 12)


def test_time_in_which_the_worker_did_not_run_is_not_silence_of_the_controller(
    rtde, client, monkeypatch
):
    """It wakes before ur_rtde's own thread has read the data of that time."""
    sent, ended = published(rtde, client, monkeypatch, [5.0, 0.001, 0.001, 0.001])
    assert (sent, ended) == (["State"], False)
    assert published(rtde, client, monkeypatch, [0.5, 0.02, *[0.01] * 90])[1] is False
    sent, ended = published(rtde, client, monkeypatch, [0.5, 0.02, *[0.01] * 110])
    assert (sent[-1], ended) == ("Failed", True)
