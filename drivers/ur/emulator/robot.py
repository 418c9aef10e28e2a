"""A UR10 controller on its own loopback address: RTDE, dashboard and script ports.

Real clients (ur_rtde, UR's own) connect to it unmodified. It must be another process than ur_rtde,
whose constructors hold Python's global lock. As a process of its own::

    python -m drivers.ur.emulator --host 127.0.0.2

prints one line of JSON when it is ready and ends on SIGTERM, SIGINT or when its parent dies.
"""

import argparse
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import partial
from ipaddress import ip_address
from typing import Self

import msgspec

from drivers.addresses import check_free, check_host
from drivers.errors import GraspError
from drivers.ur.emulator.controller import Controller
from drivers.ur.emulator.dashboard import BANNER, Dashboard
from drivers.ur.emulator.faults import FaultChannel
from drivers.ur.emulator.fields import output_values
from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.emulator.primary import version_message
from drivers.ur.emulator.rtde import RtdeConnection, RtdeServer, Told
from drivers.ur.emulator.rtde_wire import PORT as RTDE_PORT
from drivers.ur.emulator.settings import PROFILES, EmulatorSettings
from drivers.ur.emulator.sockets import LineTalk, ScriptTalk, Server, Talk
from drivers.ur.model import ArmModel, ArmModelSettings

DASHBOARD_PORT = 29999
STATE_PORTS = (30001, 30002)  # primary and secondary: programs in
SCRIPT_PORT = 30003  # real time: programs in
PORTS = (RTDE_PORT, DASHBOARD_PORT, *STATE_PORTS, SCRIPT_PORT)
SWITCH_S = 5e-4  # a thread that answers a client does not wait for others for longer
MOST_CLIENTS = 32  # of each port
_LONGEST_LAG_NS = 100_000_000  # cycles missed by more than this are skipped, not caught up


class UrEmulator:
    """One emulated controller; ``run`` is its loop, in whatever thread calls it.

    A process that owns the world of several devices passes the arm of that world, the lock that
    guards it and ``advance``, which is called with the time of each cycle before the arm is read.
    Raises ValueError for a host beyond loopback without a token, OSError for a port that is taken.
    """

    def __init__(
        self,
        settings: EmulatorSettings,
        arm: ArmModel | None = None,
        lock: AbstractContextManager[object] | None = None,
        advance: Callable[[int], None] | None = None,
    ) -> None:
        if not (ip_address(settings.host).is_loopback or settings.token):
            raise ValueError(f"{settings.host} is no loopback address")
        self._profile = settings.controller
        self._period_ns = settings.controller.period_ns
        # whole cycles of the clock, as the arm model counts them
        self._start_ns = -(-time.monotonic_ns() // self._period_ns) * self._period_ns
        self._advance = advance
        self._frozen_until_ns = 0
        motion = RobotMotion(
            settings,
            arm or _arm(settings, self._start_ns),
            lock or threading.Lock(),
            self._start_ns,
        )
        self.controller = Controller(settings, motion, self._start_ns)
        self._rtde = RtdeServer(settings.controller)
        self._dashboard = Dashboard(settings, self.controller)
        self._faults = FaultChannel(self.controller, self._rtde, self, settings.token)
        self._server = Server(self.controller.log)
        try:
            self.fault_port = self._listen(settings)
        except OSError:
            self.close()
            raise

    def _listen(self, settings: EmulatorSettings) -> int:
        host, listen = settings.host, partial(self._server.listen, most=MOST_CLIENTS)
        listen(host, RTDE_PORT, lambda: (RtdeConnection(self._rtde), b""))
        listen(host, DASHBOARD_PORT, lambda: (LineTalk(self._dashboard.answer), BANNER))
        version = version_message(settings.controller)
        for port in STATE_PORTS:
            listen(host, port, lambda: (ScriptTalk(self._load), version))
        listen(host, SCRIPT_PORT, lambda: (ScriptTalk(self._load), b""))
        faults = lambda: (LineTalk(self._faults.answer), b"")  # noqa: E731
        return listen(host, settings.fault_port, faults, ours=True)

    def _load(self, text: str) -> None:
        if self.controller.remote_control:
            self.controller.load(text)
        else:
            self.controller.log("program refused: not in remote control")

    def run(self, ended: Callable[[], bool]) -> None:
        """Serve until ``ended`` says so; it is asked once per cycle."""
        while not ended():
            if time.monotonic_ns() < self._frozen_until_ns:
                time.sleep(self._period_ns * 1e-9)
                continue
            self._serve_until(self._now_ns + self._period_ns)
            self._cycle()

    @property
    def _now_ns(self) -> int:
        """Time of the last cycle."""
        return self._start_ns + self.controller.cycles * self._period_ns

    def _serve_until(self, deadline_ns: int) -> None:
        """Answer clients until the next cycle is due, once in any case."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        self._server.serve(remaining_ns * 1e-9)
        while (remaining_ns := deadline_ns - time.monotonic_ns()) > 0:
            self._server.serve(remaining_ns * 1e-9)
        if -remaining_ns > _LONGEST_LAG_NS:
            self.controller.skip(-remaining_ns // self._period_ns)

    def _cycle(self) -> None:
        now_ns = self._now_ns + self._period_ns
        if self._advance is not None:
            self._advance(now_ns)
        self.controller.step(now_ns, self._rtde.take_inputs(), wait=False)
        self._server.broadcast(self._news())

    def _news(self) -> Callable[[Talk], bytes]:
        """What each RTDE client receives in this cycle."""
        cycle = self.controller.cycles
        sampled = any(isinstance(talk, RtdeConnection) for talk in self._server.talks())
        told = Told(output_values(self.controller) if sampled else {}, self._profile)

        def news(talk: Talk) -> bytes:
            return talk.sample(cycle, told) if isinstance(talk, RtdeConnection) else b""

        return news

    def drop_links(self) -> None:
        self._server.drop_links()

    def freeze(self, seconds: float) -> None:
        """Neither serve nor run cycles for so long."""
        self._frozen_until_ns = time.monotonic_ns() + round(seconds * 1e9)

    def close(self) -> None:
        self.controller.close()
        self._server.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _arm(settings: EmulatorSettings, now_ns: int) -> ArmModel:
    """An arm whose commands take effect in the cycle that gives them."""
    arm = ArmModelSettings(
        start_m=settings.start_m, period_s=settings.controller.period_ns * 1e-9, command_latency_s=0
    )
    return ArmModel(arm, now_ns)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Emulated UR10 controller.")
    parser.add_argument("--host", required=True, help="loopback address of its own, 127.0.0.2 ff.")
    parser.add_argument("--profile", choices=sorted(PROFILES), default="cb3")
    parser.add_argument("--fault-port", type=int, default=0, help="control channel; 0: any port")
    parser.add_argument("--unlock-delay", type=float, default=5.0, help="s after a protective stop")
    options = parser.parse_args(arguments)
    try:
        settings = msgspec.convert(
            {
                "host": options.host,
                "profile": options.profile,
                "fault_port": options.fault_port,
                "unlock_delay_s": options.unlock_delay,
            },
            EmulatorSettings,
        )
        check_host(settings.host, beyond_loopback=False)
        check_free(settings.host, (*PORTS, settings.fault_port))
    except (msgspec.ValidationError, GraspError) as error:
        sys.exit(f"error: {'; '.join(error.args)}")
    _serve(settings)


def _serve(settings: EmulatorSettings) -> None:
    sys.setswitchinterval(SWITCH_S)
    parent = os.getppid()
    asked_to_end = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: asked_to_end.set())
    with UrEmulator(settings) as emulator:
        ready = {
            "ready": True,
            "host": settings.host,
            "fault_port": emulator.fault_port,
            "version": settings.controller.polyscope,
        }
        sys.stdout.write(msgspec.json.encode(ready).decode() + "\n")
        sys.stdout.flush()
        emulator.run(lambda: asked_to_end.is_set() or os.getppid() != parent)
