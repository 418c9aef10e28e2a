"""How long a command takes to the gripper's acknowledgement, beside a bare socket."""

import multiprocessing
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection

import pytest

from drivers.robotiq.driver import DriverSettings, RobotiqDriver
from drivers.robotiq.emulator.tcp import GripperEmulator
from drivers.robotiq.link.modbus import ModbusSettings, ModbusTransport, TimedTransport
from drivers.robotiq.link.thread import ThreadedGripper
from drivers.robotiq.model.gripper import GripperModel, HandSettings
from grasp.realtime import RealTimeSettings, real_time
from tests.calibrations import PAPER

WRITES = 6000  # a minute
FRAME_S = 0.01
SPEEDS_MPS = (0.05, 0.1)


def serve(pipe: Connection) -> None:
    model = GripperModel(HandSettings(), time.monotonic_ns(), active=True)
    with GripperEmulator(model) as emulator:
        pipe.send(emulator.address)
        pipe.recv()


@pytest.fixture
def address() -> Iterator[tuple[str, int]]:
    """An emulator in a process of its own, as in use."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(there,))
    process.start()
    assert here.poll(60)
    yield here.recv()
    here.send(None)
    process.join(10)
    process.close()
    here.close()
    there.close()


def every_frame(work: Callable[[int], None]) -> None:
    start_s = time.monotonic()
    for frame in range(WRITES):
        time.sleep(max(0.0, start_s + frame * FRAME_S - time.monotonic()))
        work(frame)


def through_the_driver(
    address: tuple[str, int], period_s: float, interval_s: float, asked: RealTimeSettings
) -> tuple[Sequence[int], str]:
    transport = ModbusTransport(ModbusSettings(host=address[0], port=address[1], timeout_s=1.0))
    timed = TimedTransport(transport, time.monotonic_ns)
    settings = DriverSettings(write_interval_s=interval_s)
    core = RobotiqDriver(timed, settings, PAPER)
    made = ThreadedGripper(
        core, period_s, timed=timed, write_interval_s=interval_s, close=transport.close
    )
    with made as gripper, real_time(asked):
        every_frame(
            lambda frame: gripper.move_to((50, 50, 50), SPEEDS_MPS[frame % 2], 10.0) and None
        )
        time.sleep(5 * FRAME_S)
        seen = gripper.statistics
        note = f"{core.statistics.writes} writes, {seen.missed} periods missed"
        return gripper.acknowledgements_ns, note


def through_a_socket(address: tuple[str, int]) -> list[int]:
    taken_ns = []
    with socket.create_connection(address, timeout=1.0) as wire:

        def exchange(frame: int) -> None:
            start_ns = time.monotonic_ns()
            values = bytes((9, 4, 0, 50, frame % 2, 0, 50, 0, 0, 50, 0, 0, 0, 0, 0, 0))
            header = bytes((frame >> 8, frame & 255, 0, 0, 0, 23, 2, 16, 0, 0, 0, 8, 16))
            wire.sendall(header + values)
            assert len(wire.recv(12)) == 12
            taken_ns.append(time.monotonic_ns() - start_ns)

        every_frame(exchange)
    return taken_ns


def show(name: str, taken_ns: Sequence[int], note: str = "") -> None:
    ordered = sorted(taken_ns)
    shares = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "most": 1.0}
    told = {n: ordered[round((len(ordered) - 1) * q)] * 1e-6 for n, q in shares.items()}
    shown = "  ".join(f"{n} {value:7.3f}" for n, value in told.items())
    print(f"{name:28} {len(ordered):5} {shown} ms  {note}")


@pytest.mark.bench
@pytest.mark.timeout(1800)
def test_from_verb_to_acknowledgement(address: tuple[str, int]) -> None:
    """A new speed every frame of 10 ms. Where writes may be no closer than a frame, what one frame
    was late the next ones wait for, until a command is skipped.
    """
    for priority in (0, 20):
        asked = RealTimeSettings(priority=priority, collect_garbage=priority == 0)
        with real_time(asked) as granted:
            print(f"\n{'real-time priority' if granted else 'ordinary scheduling'}")
            show("bare socket", through_a_socket(address))
        for interval_s in (0.01, 0.008):
            name = f"100 Hz, writes {interval_s * 1e3:.0f} ms apart"
            show(name, *through_the_driver(address, 0.01, interval_s, asked))
