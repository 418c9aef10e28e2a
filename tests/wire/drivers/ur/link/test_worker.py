"""The worker's command side with a recorded ur_rtde: what it is told, and what it watches."""

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

SETTLED_S = 0.05  # after which a command shows: more than four cycles
SILENT_S = 1.0  # far more than the heartbeat


class Recorded:
    """Both interfaces of ur_rtde: keeps the calls, answers as it is told."""

    def __init__(self):
        self.calls = []
        self.takes = True
        self.running_operation = False
        self.speed_mps = 0.0
        self.safety_bits = 1
        self.runtime_state = 2

    def __getattr__(self, name):
        def call(*args, **options):
            self.calls.append((name, *args, *options.items()))
            return self.takes

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

    def names(self):
        return [call[0] for call in self.calls if call[0] != "kickWatchdog"]


@pytest.fixture
def rtde():
    return Recorded()


@pytest.fixture
def ours():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(10)
    with ours, theirs:
        yield SimpleNamespace(socket=ours, channel=Channel(theirs))


class Later:
    """The monotonic clock, which a test can put forward."""

    ahead_s = 0.0

    def __call__(self):
        return time.monotonic() + self.ahead_s


@pytest.fixture
def later():
    return Later()


@pytest.fixture
def commander(rtde, ours, later):
    return Commander(rtde, Robot(rtde, SETUP, ours.channel), SETUP, ours.channel, later)


def serve(commander, ours, *requests):
    """Everything at once, then the client goes; returns the replies."""
    for request in requests:
        ours.socket.send(msgspec.msgpack.encode(request))
    ours.socket.shutdown(socket.SHUT_WR)
    commander.serve()
    reports = []
    ours.socket.setblocking(False)
    while True:
        try:
            data = ours.socket.recv(messages.LONGEST_MESSAGE)
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


def test_setting_that_is_not_taken_is_no_start(commander, rtde):
    rtde.takes = False
    assert not commander.prepare()


def test_sample_says_where_the_speed_slider_stands(rtde, ours):
    assert Robot(rtde, SETUP, ours.channel).state().speed_fraction == 0.75


def test_moves_and_stops_are_asynchronous(commander, rtde, ours):
    replies = serve(commander, ours, move(), messages.Stop(2, 0.7))
    assert [reply.outcome for reply in replies] == [Outcome.DONE, Outcome.DONE]
    assert rtde.names() == ["moveL", "stopL"]
    assert all(("asynchronous", True) in call for call in rtde.calls if call[0] in rtde.names())


def test_move_during_a_move_brakes_and_waits(commander, rtde, ours, later):
    rtde.speed_mps = 0.1
    serve(commander, ours, move())
    assert rtde.names() == ["stopL"]
    rtde.speed_mps = 0.0
    rtde.running_operation = True
    later.ahead_s = SETTLED_S
    commander.step()
    assert rtde.names() == ["stopL"]
    rtde.running_operation = False
    commander.step()
    assert rtde.names() == ["stopL", "moveL"]


def test_move_that_waits_is_dropped_when_the_client_is_heard_no_more(commander, rtde, ours, later):
    rtde.speed_mps = 0.1
    serve(commander, ours, move(7))
    rtde.speed_mps = 0.0
    silence(commander, later)
    commander.step()
    assert "moveL" not in rtde.names()


def test_stop_forgets_the_move_that_waits(commander, rtde, ours, later):
    rtde.speed_mps = 0.1
    serve(commander, ours, move(1), messages.Stop(2, 1.0))
    rtde.speed_mps, later.ahead_s = 0.0, SETTLED_S
    commander.step()
    assert "moveL" not in rtde.names()


@pytest.mark.parametrize(
    ("bits", "runtime_state", "outcome"),
    [
        (1 << 2 | 1 << 10, 1, Outcome.STOPPED),
        (1 << 6 | 1 << 7 | 1 << 10, 1, Outcome.STOPPED),
        (1, 1, Outcome.STOPPED),
        (1, 2, Outcome.NOT_TAKEN),
    ],
)
def test_false_is_told_by_the_bits(commander, rtde, ours, bits, runtime_state, outcome):
    rtde.takes, rtde.safety_bits, rtde.runtime_state = False, bits, runtime_state
    (reply,) = serve(commander, ours, move())
    assert reply.outcome is outcome


def kicks(commander, rtde, later):
    later.ahead_s += SETTLED_S
    before = rtde.calls.count(("kickWatchdog",))
    commander.step()
    return rtde.calls.count(("kickWatchdog",)) > before


def silence(commander, later):
    """Nothing was found in the socket for longer than the heartbeat may be late."""
    later.ahead_s += SILENT_S
    commander.listened(False)


DRIVE = messages.DriveArm(1, (0.0, 0.0, 0.1, 0.0, 0.0, 0.0), 0.5)


def test_standing_arm_is_kept_alive_though_nobody_reads(commander, rtde, later):
    assert kicks(commander, rtde, later)
    silence(commander, later)
    assert kicks(commander, rtde, later)
    rtde.speed_mps = 0.1  # somebody pushes it, or the measured speed is restless
    assert kicks(commander, rtde, later)
    assert rtde.names() == []


def test_move_that_is_over_leaves_nothing_to_brake(commander, rtde, ours, later):
    serve(commander, ours, move())
    assert kicks(commander, rtde, later)
    silence(commander, later)
    rtde.speed_mps = 0.1
    assert kicks(commander, rtde, later)
    assert rtde.names() == ["moveL"]


def test_moving_arm_that_nobody_reads_is_braked_once_and_kicked_no_more(
    commander, rtde, ours, later
):
    serve(commander, ours, move())
    rtde.speed_mps = 0.1
    assert kicks(commander, rtde, later)
    silence(commander, later)
    assert not kicks(commander, rtde, later)
    assert not kicks(commander, rtde, later)
    assert rtde.names() == ["moveL", "stopL"]
    rtde.speed_mps = 0.0  # braked: the program ends all the same, so that its client is told
    assert not kicks(commander, rtde, later)


def test_what_waits_in_the_socket_of_a_worker_that_was_held_up_is_no_silence(
    commander, rtde, ours, later
):
    serve(commander, ours, move())
    rtde.speed_mps = 0.1
    later.ahead_s += SILENT_S
    commander.listened(True)  # a beat, of many
    assert kicks(commander, rtde, later)
    assert rtde.names() == ["moveL"]


@pytest.mark.parametrize("request_", [move(2), DRIVE])
def test_nothing_begins_once_the_arm_has_been_left_alone(commander, rtde, ours, later, request_):
    serve(commander, ours, move())
    rtde.speed_mps = 0.1
    silence(commander, later)
    commander.step()
    rtde.speed_mps = 0.0
    commander.listened(True)
    assert commander.carry_out(request_) is Outcome.STOPPED
    assert rtde.names() == ["moveL", "stopL"]


def test_arm_that_brakes_already_is_not_told_to_brake_otherwise(commander, rtde, ours, later):
    serve(commander, ours, move(1), messages.Stop(2, 5.0))
    rtde.speed_mps = 0.1
    silence(commander, later)
    assert not kicks(commander, rtde, later)
    assert rtde.names() == ["moveL", "stopL"]


@pytest.mark.parametrize("speed_mps", [0.1, 0.0005])
def test_drive_that_nobody_reads_is_braked_by_its_own_verb_however_slow(
    commander, rtde, ours, later, speed_mps
):
    serve(commander, ours, DRIVE)
    rtde.speed_mps = speed_mps
    later.ahead_s += SETTLED_S
    commander.step()
    silence(commander, later)
    commander.step()
    assert rtde.names()[:2] == ["speedL", "speedL"]
    assert ("speedL", [0.0] * 6, 0.5) in rtde.calls


def test_leaving_repeats_a_brake_that_a_controller_missed(commander, rtde, ours, later):
    serve(commander, ours, DRIVE)
    rtde.speed_mps = 0.1
    later.ahead_s += SETTLED_S
    commander.leave()
    brakes = [call for call in rtde.calls if call[:2] == ("speedL", [0.0] * 6)]
    assert len(brakes) > 1
    assert rtde.names()[-1] == "stopScript"


def test_leaving_ends_the_program(commander, rtde):
    commander.leave()
    assert rtde.names() == ["stopScript"]


class Slept(Exception):
    pass


def watched(rtde, ours, monkeypatch, sleeps, dated=lambda now: 1.0):
    """What a robot says while its thread wakes after each of these sleeps, and whether it ends;
    ``dated``: its controller's clock."""
    now, left = 100.0, list(sleeps)

    def sleep(_):
        nonlocal now
        if not left:
            raise Slept
        now += left.pop(0)

    def end(code):
        raise SystemExit(code)

    monkeypatch.setattr(
        "drivers.ur.link.worker.time", SimpleNamespace(monotonic=lambda: now, sleep=sleep)
    )
    monkeypatch.setattr("drivers.ur.link.worker.os._exit", end)
    rtde.isConnected, rtde.getTimestamp = lambda: True, lambda: dated(now)
    robot = Robot(rtde, SETUP, ours.channel)
    robot.publishing = True
    with pytest.raises((Slept, SystemExit)) as ended:
        robot.watch()
    said = []
    ours.socket.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            data = ours.socket.recv(messages.LONGEST_MESSAGE)
            said.append(type(msgspec.msgpack.decode(data, type=messages.FromWorker)).__name__)
    return said, ended.type is SystemExit


def test_each_new_sample_of_the_controller_is_published_once(rtde, ours, monkeypatch):
    assert watched(rtde, ours, monkeypatch, [0.001] * 85) == (["State"], False)
    said, _ = watched(rtde, ours, monkeypatch, [0.001] * 85, lambda now: now // 0.008)
    assert set(said) == {"State"} and len(said) in (11, 12)


def test_what_passes_while_the_worker_is_not_run_is_no_silence_of_the_controller(
    rtde, ours, monkeypatch
):
    """It wakes before ur_rtde's own thread has read what came meanwhile."""
    said, ended = watched(rtde, ours, monkeypatch, [5.0, 0.001, 0.001, 0.001])
    assert (said, ended) == (["State"], False)
    assert watched(rtde, ours, monkeypatch, [0.5, 0.02, *[0.01] * 90])[1] is False
    said, ended = watched(rtde, ours, monkeypatch, [0.5, 0.02, *[0.01] * 110])
    assert (said[-1], ended) == ("Failed", True)
