"""UR10 controller on its own loopback address: RTDE, dashboard and script ports.

Real clients (ur_rtde, UR's own) connect to it unmodified. It must run in another process than
ur_rtde, whose constructors hold Python's global lock. Input of clients is handled in the rest of
each cycle, a chunk of each client in turn.
"""

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from ipaddress import ip_address
from typing import Protocol, Self

from drivers.ur.emulator.controller import Controller, EmulatorSettings
from drivers.ur.emulator.dashboard import BANNER, Dashboard, FaultChannel
from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.emulator.rtde import PORT as RTDE_PORT
from drivers.ur.emulator.rtde import RtdeConnection, RtdeServer, Sample
from drivers.ur.emulator.urscript_parser import MAX_CHARS, depth_change
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings

DASHBOARD_PORT = 29999
SCRIPT_PORT = 30003  # real time: accepts programs
PORTS = (RTDE_PORT, DASHBOARD_PORT, SCRIPT_PORT)
SWITCH_S = 5e-4  # switch interval of Python threads, so that replies are not delayed
MAX_CLIENTS = 32  # per port
_MAX_LAG_NS = 100_000_000  # cycles missed by more than this are skipped
_CHUNK = 1024  # bytes read at a time: at most a millisecond's work
_MAX_LINE = 65536
_MAX_UNSENT = 1 << 20  # a client that does not read is disconnected beyond this


class Dialogue(Protocol):
    """Dialogue of one connection: bytes in, bytes out."""

    broken: bool

    def feed(self, data: bytes) -> bytes: ...

    def close(self) -> None: ...


class LineDialogue:
    """Dialogue with one reply per line."""

    def __init__(self, reply: Callable[[str], str]) -> None:
        self._reply = reply
        self._unparsed = b""
        self.broken = False

    def feed(self, data: bytes) -> bytes:
        *lines, self._unparsed = (self._unparsed + data).split(b"\n")
        self.broken = len(self._unparsed) > _MAX_LINE
        return b"".join(
            self._reply(line.decode("utf-8", "replace")).encode() + b"\n" for line in lines
        )

    def close(self) -> None: ...


class ScriptDialogue(LineDialogue):
    """Collects the lines of a program until all its blocks are closed, then loads it; logs a
    program that is not complete when the connection ends."""

    def __init__(self, load: Callable[[str], None], log: Callable[[str], None]) -> None:
        super().__init__(lambda line: "")
        self._load, self._log = load, log
        self._program: list[str] = []
        self._depth = 0

    def feed(self, data: bytes) -> bytes:
        *lines, self._unparsed = (self._unparsed + data).split(b"\n")
        for line in lines:
            self._program.append(line.decode("utf-8", "replace"))
            self._depth += depth_change(self._program[-1])
            if self._depth <= 0:
                text = "\n".join(self._program)
                self._program, self._depth = [], 0
                if text.strip():
                    self._load(text)
        self.broken = len(self._unparsed) + sum(map(len, self._program)) > MAX_CHARS
        return b""

    def close(self) -> None:
        last = self._unparsed.decode("utf-8", "replace")
        if not (self._program or last.strip()):
            return
        why = "a block without end, or no line end after it"
        if self.broken:
            why = f"longer than {MAX_CHARS} characters"
        self._log(f"incomplete program ignored: {why}")


class Connection:
    """Non-blocking socket of a client, with the data that wait to be sent."""

    def __init__(self, sock: socket.socket, dialogue: Dialogue, port: int) -> None:
        self.sock = sock
        self.dialogue = dialogue
        self.port = port
        self._unsent = bytearray()

    def receive(self) -> bool:
        """Read and reply; False when the connection has ended."""
        try:
            data = self.sock.recv(_CHUNK)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return bool(data) and self.send(self.dialogue.feed(data)) and not self.dialogue.broken

    def send(self, data: bytes) -> bool:
        """Send as much as the client accepts; False when it is gone or does not read."""
        self._unsent += data
        try:
            while self._unsent:
                del self._unsent[: self.sock.send(self._unsent)]
        except BlockingIOError:
            return len(self._unsent) <= _MAX_UNSENT
        except OSError:
            return False
        return True


class Server:
    """All listeners and connections; ``serve`` handles them until a time."""

    def __init__(self) -> None:
        self._selector = selectors.SelectSelector()  # epoll has a resolution of a millisecond
        self._connections: list[Connection] = []

    def listen(self, host: str, port: int, make: Callable[[], tuple[Dialogue, bytes]]) -> int:
        """Listen on a port; returns it. ``make`` returns the dialogue of a new connection and its
        greeting."""
        sock = socket.create_server((host, port), backlog=128, reuse_port=False)
        sock.setblocking(False)
        number = int(sock.getsockname()[1])
        self._selector.register(
            sock, selectors.EVENT_READ, lambda: self._accept(sock, number, make)
        )
        return number

    def _accept(
        self, sock: socket.socket, port: int, make: Callable[[], tuple[Dialogue, bytes]]
    ) -> None:
        with contextlib.suppress(OSError):
            client, _ = sock.accept()
            if sum(each.port == port for each in self._connections) >= MAX_CLIENTS:
                client.close()
                return
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            dialogue, greeting = make()
            connection = Connection(client, dialogue, port)
            self._connections.append(connection)
            self._selector.register(
                client,
                selectors.EVENT_READ,
                lambda: self._close_if_ended(connection, connection.receive()),
            )
            self._close_if_ended(connection, connection.send(greeting))

    def _close_if_ended(self, connection: Connection, alive: bool) -> None:
        if alive or connection not in self._connections:
            return
        self._connections.remove(connection)
        self._selector.unregister(connection.sock)
        connection.sock.close()
        connection.dialogue.close()

    def serve(self, until_ns: int) -> None:
        """Handle input until a time; input that is already there is always handled."""
        while True:
            left_ns = until_ns - time.monotonic_ns()
            for key, _ in self._selector.select(max(0.0, left_ns * 1e-9)):
                key.data()  # a connection that a handler before it closed does nothing
            if left_ns <= 0:
                return

    def broadcast(self, cycle: int, sample: Sample) -> None:
        """Send each RTDE client its fields of this cycle."""
        for connection in list(self._connections):
            dialogue = connection.dialogue
            if isinstance(dialogue, RtdeConnection) and (data := dialogue.sample(cycle, sample)):
                self._close_if_ended(connection, connection.send(data))

    def drop_links(self, but: int) -> None:
        """Close the connections of all clients except those of one port."""
        for connection in [each for each in self._connections if each.port != but]:
            self._close_if_ended(connection, False)

    def close(self) -> None:
        for connection in list(self._connections):
            self._close_if_ended(connection, False)
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()


class UrEmulator:
    """Emulated controller; ``run`` is its loop, in the caller's thread.

    A process that simulates several devices passes the arm of its world, the lock that guards it
    and ``advance``, which is called with the time of each cycle before the arm is read. Raises
    ValueError for a host beyond loopback without a token, OSError for a port that is taken.
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
        self._period_ns = settings.controller.period_ns
        # whole cycles of the clock, as in the arm model
        self._start_ns = -(-time.monotonic_ns() // self._period_ns) * self._period_ns
        self._advance = advance
        self._frozen_until_ns = 0
        motion = RobotMotion(
            self._period_ns * 1e-9,
            arm or _arm(settings, self._start_ns),
            lock or threading.Lock(),
            self._start_ns,
        )
        self.controller = Controller(settings, motion, self._start_ns)
        self._rtde = RtdeServer(settings.controller)
        self._server = Server()
        try:
            self.fault_port = self._listen(settings)
        except OSError:
            self.close()
            raise

    def _listen(self, settings: EmulatorSettings) -> int:
        dashboard = Dashboard(settings, self.controller)
        faults = FaultChannel(self.controller, self._rtde, self, settings.token)
        listen, host = self._server.listen, settings.host
        listen(host, RTDE_PORT, lambda: (RtdeConnection(self._rtde), b""))
        listen(host, DASHBOARD_PORT, lambda: (LineDialogue(dashboard.reply), BANNER))
        load, log = self.controller.load, self.controller.log
        listen(host, SCRIPT_PORT, lambda: (ScriptDialogue(load, log), b""))
        return listen(host, settings.fault_port, lambda: (LineDialogue(faults.reply), b""))

    def run(self, ended: Callable[[], bool]) -> None:
        """Serve until ``ended`` returns True; it is called once per cycle."""
        while not ended():
            if time.monotonic_ns() < self._frozen_until_ns:
                time.sleep(self._period_ns * 1e-9)
                continue
            self._server.serve(self._now_ns + self._period_ns)
            late_ns = time.monotonic_ns() - self._now_ns - self._period_ns
            if late_ns > _MAX_LAG_NS:
                self.controller.cycles += late_ns // self._period_ns
            self._cycle()

    @property
    def _now_ns(self) -> int:
        """Time of the last cycle."""
        return self._start_ns + self.controller.cycles * self._period_ns

    def _cycle(self) -> None:
        now_ns = self._now_ns + self._period_ns
        if self._advance is not None:
            self._advance(now_ns)
        self.controller.step(now_ns, self._rtde.take_inputs())
        self._server.broadcast(self.controller.cycles, Sample(self.controller))

    def drop_links(self) -> None:
        self._server.drop_links(but=self.fault_port)

    def freeze(self, seconds: float) -> None:
        """Stop serving and running cycles for so long."""
        self._frozen_until_ns = time.monotonic_ns() + round(seconds * 1e9)

    def close(self) -> None:
        self.controller.stop_program("the emulator ends")
        self._server.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _arm(settings: EmulatorSettings, now_ns: int) -> ArmModel:
    """An arm model whose commands take effect in the cycle in which they are given."""
    arm = ArmModelSettings(start_m=settings.start_m, period_s=settings.controller.period_ns * 1e-9)
    return ArmModel(arm, now_ns, command_latency_s=0.0)
