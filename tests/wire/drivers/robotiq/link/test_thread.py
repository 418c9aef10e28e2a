"""The gripper thread: period, immediate wake-up, the same bytes as a loop, errors raised once."""

import itertools
import time

import pytest

from drivers.errors import LinkLost
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.emulator import FaultKind, WireFault
from drivers.robotiq.model.gripper import GripperModel, ModelTransport
from drivers.robotiq.settings import DriverSettings
from tests.calibrations import PAPER
from tests.wire.drivers.robotiq.rig import QUICK
from tests.wire.waiting import until

FAST = 0.11
MS = 1_000_000


def done(state) -> bool:
    """Whether the last verb is complete; an inactive hand has no motion to wait for."""
    return state.fresh and (state.at_rest or not state.active)


def script(gripper, rest) -> None:
    """Verbs, each after the previous one is complete."""
    rest()
    gripper.activate()
    rest()
    gripper.move_to((60, 70, 80), FAST, 12.0)
    rest()
    gripper.move_to((60, 70, 80), 0.05, 12.0)
    rest()
    gripper.close_to_limit(15.0, (True, False, True), (90, 90, 90), FAST)
    rest()
    gripper.hold()
    rest()
    gripper.open(FAST)
    rest()


def bytes_in_a_loop() -> list[bytes]:
    """Registers written by a driver polled in virtual time, without a wire."""
    model = GripperModel(QUICK, 0)
    written: list[bytes] = []

    def log(now_ns: int, registers) -> None:
        written.append(b"".join(word.to_bytes(2, "big") for word in registers))

    core = RobotiqDriver(ModelTransport(model), DriverSettings(), PAPER, log)
    now = [0]

    def rest() -> None:
        for _ in range(2000):
            now[0] += 10 * MS
            core.poll(now[0])
            if done(core.state) and not model.moving:
                return
        raise AssertionError("the hand did not come to rest")

    script(core, rest)
    return written


def without_repeats(images: list[bytes]) -> list[bytes]:
    """Images without repetitions; an image is written again while a finger moves."""
    return [image for image, _ in itertools.groupby(images)]


def test_the_same_bytes_in_a_thread_and_in_a_loop(serve, connect) -> None:
    served = serve(active=False)
    model, client = served.emulator.model, connect(served)
    with client.threaded() as gripper:

        def rest() -> None:
            until(lambda: done(gripper.state) and not model.moving)
            gripper.poll(0)

        script(gripper, rest)
    if client.driver._hand._position_jumped:  # noqa: SLF001  (then the driver limits the speed)
        pytest.skip("this machine stalled, so that the emulated fingers jumped")
    assert without_repeats(served.writes) == bytes_in_a_loop()


def test_a_verb_delayed_by_the_write_interval_is_sent_when_it_is_over(serve, connect) -> None:
    served = serve()
    with connect(served).threaded(period_s=600.0) as gripper:
        for speed in (0.03, 0.05, 0.07):
            gripper.move_to((60, 60, 60), speed, 10.0)
            gripper.move_to((60, 60, 60), speed + 0.01, 10.0)
        last = PAPER.speed_byte_at_most(0.08)
        until(lambda: served.writes[-1:] != [] and served.writes[-1][4] == last)
        until(lambda: gripper.acknowledgements_ns)


def test_a_lost_link_is_raised_once_and_reconnects(serve, connect) -> None:
    served = serve()
    client = connect(served)
    with client.threaded() as gripper:
        served.emulator.faults.add(WireFault(kind=FaultKind.DISCONNECT, times=5))
        until(lambda: client.driver.statistics.link_losses == 1)
        until(lambda: client.driver.statistics.reconnects == 1)
        with pytest.raises(LinkLost):
            until(lambda: gripper.poll(0))
        gripper.poll(0)
        seq = gripper.state.seq
        until(lambda: gripper.state.seq > seq)


def test_the_thread_can_be_stopped_and_started_again(serve, connect) -> None:
    client = connect(serve())
    gripper = client.threaded()
    for _ in range(2):
        gripper.start()
        gripper.start()
        gripper.stop()
        gripper.stop()
    assert gripper.state is not None
    gripper.close()
    with pytest.raises(LinkLost, match="closed the connection"):
        client.transport.read(0, 8, time.monotonic_ns())
