"""Supervision of the worker process that holds ur_rtde: start, messages, deadlines, end."""

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from typing import NoReturn

import msgspec

from drivers.errors import DeviceFault, GraspError, LinkLost
from drivers.ur.link import messages, worker
from drivers.ur.link.connections import CHECK_CONNECTION
from drivers.ur.link.messages import Outcome, State

START_AGAIN = "make sure that the arm may move, then start the run again"
SEE_PENDANT = "see the teach pendant for the cause, clear it there, then start the run again"
_LOG_LINES = 200


class WorkerProcess:
    """Worker process from start to end; it is never restarted but replaced."""

    def __init__(self, setup: messages.Setup, command: tuple[str, ...] = ()) -> None:
        self.state: State | None = None  # latest sample
        self.log: deque[str] = deque(maxlen=_LOG_LINES)  # what ur_rtde printed
        self._failures: deque[Outcome] = deque(maxlen=16)
        self._changed = threading.Condition()
        self._ready = False
        self._end_reason = ""  # reason, once it has ended
        self._deadlines: dict[int, float] = {}  # monotonic deadlines of commands without reply
        self._outcomes: dict[int, Outcome] = {}  # of finished calls
        self._calls: set[int] = set()
        self._number = 0
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket = ours
        with theirs:
            self._process = _spawn(theirs.fileno(), command)
        self._threads = [
            threading.Thread(target=target, name="ur-worker", daemon=True)
            for target in (self._listen, self._keep_log)
        ]
        for thread in self._threads:
            thread.start()
        self._send(setup)

    def wait_ready(self, timeout_s: float) -> None:
        """Wait until states arrive; otherwise kill the worker and raise the reason."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._end_reason or (self._ready and self.state), timeout=timeout_s
            )
            reason = self._end_reason
            if self._ready and self.state and not reason:
                return
        self.kill()
        reason = reason or f"ur_rtde did not start within {timeout_s:g} s"
        printed = [line for line in self.log if line.strip()][-1:]
        raise _start_error(f"{reason} (ur_rtde: {printed[0]})" if printed else reason)

    def post(self, command: messages.Command, timeout_s: float) -> None:
        """Send without waiting; errors appear in ``next_failure`` and ``check``."""
        with self._changed:
            self._deadlines[command.number] = time.monotonic() + timeout_s
        self._send(command)

    def call(self, command: messages.Command, timeout_s: float) -> Outcome:
        """Send and wait for the outcome; raises LinkLost when there is no reply."""
        self._calls.add(command.number)
        self.post(command, timeout_s)
        with self._changed:
            self._changed.wait_for(
                lambda: self._end_reason or command.number in self._outcomes, timeout=timeout_s
            )
        outcome = self._outcomes.pop(command.number, None)
        if outcome is None:
            self.check()
            self._kill_and_raise()
        return outcome

    def next_number(self) -> int:
        self._number += 1
        return self._number

    def send_heartbeat(self) -> None:
        self._send(messages.Heartbeat())

    def next_failure(self) -> Outcome | None:
        """Outcome of a command that failed since the last call; None if none did."""
        return self._failures.popleft() if self._failures else None

    def is_pending(self, number: int) -> bool:
        return number in self._deadlines

    def check(self) -> None:
        """Raise LinkLost when the worker has ended or a reply is overdue (then it is killed)."""
        if self._end_reason:
            remedy = f"{CHECK_CONNECTION}; {START_AGAIN}"
            raise LinkLost(f"link to the arm lost: {self._end_reason}", remedy)
        with self._changed:
            late = any(due < time.monotonic() for due in self._deadlines.values())
        if late:
            self._kill_and_raise()

    def _kill_and_raise(self) -> NoReturn:
        self.kill()
        raise LinkLost("the arm controller did not accept a command in time", START_AGAIN)

    def close(self, timeout_s: float) -> None:
        """Let the worker brake and end its program; kill it when that takes too long."""
        self._send(messages.Shutdown())
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        self.kill()

    def kill(self) -> None:
        """Kill the worker at once: the controller's watchdog then stops the arm."""
        self._process.kill()
        self._process.wait()
        for thread in self._threads:
            thread.join()
        self._socket.close()

    def _send(self, message: messages.Request) -> None:
        """Send a message; a worker that does not read or is gone is detected by its missing
        replies."""
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(message), socket.MSG_DONTWAIT)

    def _listen(self) -> None:
        """Thread: handle messages until the worker ends."""
        decoder = msgspec.msgpack.Decoder(messages.FromWorker)
        alive = True
        while alive:
            try:
                data = self._socket.recv(messages.MAX_MESSAGE_BYTES)
                alive = self._handle(decoder.decode(data) if data else None)
            except (
                ConnectionResetError
            ):  # the worker ended with unread requests; its last messages can still be read
                continue
            except (OSError, msgspec.DecodeError):
                alive = self._handle(None)

    def _keep_log(self) -> None:
        """Thread: keep the output of ur_rtde."""
        assert self._process.stdout is not None  # noqa: S101
        with self._process.stdout as printed:
            for line in printed:
                self.log.append(line.decode("utf-8", "replace").rstrip("\n"))

    def _handle(self, message: messages.FromWorker | None) -> bool:
        with self._changed:
            if message is None:
                self._end_reason = self._end_reason or "its worker process ended"
            elif isinstance(message, State):
                self.state = message
            elif isinstance(message, messages.Reply):
                self._deadlines.pop(message.number, None)
                if message.number in self._calls:
                    self._calls.discard(message.number)
                    self._outcomes[message.number] = message.outcome
                elif message.outcome is not Outcome.DONE:
                    self._failures.append(message.outcome)
            elif isinstance(message, messages.Ready):
                self._ready = True
            elif isinstance(message, messages.Failed):
                self._end_reason = message.reason
            self._changed.notify_all()
        return message is not None


def _spawn(descriptor: int, command: tuple[str, ...]) -> "subprocess.Popen[bytes]":
    """Start an interpreter with the same search path, unaffected by the terminal's Ctrl-C."""
    path = f"import sys; sys.path[:] = {sys.path!r}"
    code = f"{path}; from {worker.__name__} import main; main()"
    return subprocess.Popen(
        [*(command or (sys.executable, "-c", code)), str(descriptor)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        pass_fds=(descriptor,),
        start_new_session=True,
    )


def _start_error(reason: str) -> GraspError:
    """Error for ur_rtde's failure text; pre-flight has excluded most causes before."""
    if "in use" in reason:
        return DeviceFault(reason, "end other RTDE clients and URCaps, then try again")
    if "remote control" in reason:
        return DeviceFault(reason, "switch the teach pendant to remote control")
    if "start control script" in reason or "accepted no setting" in reason:
        return DeviceFault(reason, SEE_PENDANT)
    return LinkLost(reason, CHECK_CONNECTION)
