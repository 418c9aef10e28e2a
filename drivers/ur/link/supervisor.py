"""Supervision of the process that holds ur_rtde: started, heard and ended within deadlines."""

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from typing import NoReturn

import msgspec

from drivers.errors import DeviceFault, GraspError, LinkLost, Refused
from drivers.ur.link import messages, worker
from drivers.ur.link.messages import Outcome, State
from drivers.ur.link.preflight import CONNECT_AGAIN

START_AGAIN = "make sure that the arm may move, then start the run again"
SEE_PENDANT = "see the teach pendant for the cause, clear it there, then start the run again"
_LOG_LINES = 200


class WorkerProcess:
    """One worker, from start to end; never restarted, another one takes its place."""

    def __init__(self, setup: messages.Setup, command: tuple[str, ...] = ()) -> None:
        self.state: State | None = None  # latest value
        self.log: deque[str] = deque(maxlen=_LOG_LINES)  # what ur_rtde printed
        self._failures: deque[Outcome] = deque(maxlen=16)
        self._changed = threading.Condition()
        self._ready = False
        self._ended = ""  # why, once it has
        self._due: dict[int, float] = {}  # commands without reply: monotonic deadline
        self._outcomes: dict[int, Outcome] = {}  # of calls that wait for it
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
        """Until states flow; kills the worker and raises what is wrong when they do not."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._ended or (self._ready and self.state), timeout=timeout_s
            )
            reason = self._ended
            if self._ready and self.state and not reason:
                return
        self.kill()
        reason = reason or f"ur_rtde did not start within {timeout_s:g} s"
        printed = [line for line in self.log if line.strip()][-1:]
        raise _start_error(f"{reason} (ur_rtde: {printed[0]})" if printed else reason)

    def post(self, command: messages.Command, timeout_s: float) -> None:
        """Send without waiting; ``failure`` and ``check`` say what went wrong."""
        with self._changed:
            self._due[command.number] = time.monotonic() + timeout_s
        self._send(command)

    def call(self, command: messages.Command, timeout_s: float) -> Outcome:
        """Send and wait for what became of it; raises LinkLost when there is no answer."""
        self._calls.add(command.number)
        self.post(command, timeout_s)
        with self._changed:
            self._changed.wait_for(
                lambda: self._ended or command.number in self._outcomes, timeout=timeout_s
            )
        outcome = self._outcomes.pop(command.number, None)
        if outcome is None:
            self.check()
            self._give_up()
        return outcome

    def next_number(self) -> int:
        self._number += 1
        return self._number

    def beat(self) -> None:
        self._send(messages.Beat())

    def failure(self) -> Outcome | None:
        """One command that failed since it was asked last."""
        return self._failures.popleft() if self._failures else None

    def awaits(self, number: int) -> bool:
        return number in self._due

    def check(self) -> None:
        """Raise LinkLost when the worker has ended or owes a reply for too long (it is killed)."""
        if self._ended:
            remedy = f"{CONNECT_AGAIN}; {START_AGAIN}"
            raise LinkLost(f"link to the arm lost: {self._ended}", remedy)
        with self._changed:
            late = any(due < time.monotonic() for due in self._due.values())
        if late:
            self._give_up()

    def _give_up(self) -> NoReturn:
        self.kill()
        raise LinkLost("the arm controller did not take a command in time", START_AGAIN)

    def close(self, timeout_s: float) -> None:
        """Let it brake and end its program; kill it when that takes too long."""
        self._send(messages.Leave())
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        self.kill()

    def kill(self) -> None:
        """At once, without a word: the controller's watchdog then stops the arm."""
        self._process.kill()
        self._process.wait()
        for thread in self._threads:
            thread.join()
        self._socket.close()

    def _send(self, message: messages.Request) -> None:
        """A worker that does not read or is gone shows by its silence, so nothing is raised."""
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(message), socket.MSG_DONTWAIT)

    def _listen(self) -> None:
        """Thread: take in messages until the worker ends."""
        decoder = msgspec.msgpack.Decoder(messages.FromWorker)
        alive = True
        while alive:
            try:
                data = self._socket.recv(messages.LONGEST_MESSAGE)
                alive = self._take(decoder.decode(data) if data else None)
            except ConnectionResetError:  # it ended with requests unread; what it sent still comes
                continue
            except (OSError, msgspec.DecodeError):
                alive = self._take(None)

    def _keep_log(self) -> None:
        """Thread: what ur_rtde prints."""
        assert self._process.stdout is not None  # noqa: S101
        with self._process.stdout as printed:
            for line in printed:
                self.log.append(line.decode("utf-8", "replace").rstrip("\n"))

    def _take(self, said: messages.FromWorker | None) -> bool:
        with self._changed:
            if said is None:
                self._ended = self._ended or "its worker process ended"
            elif isinstance(said, State):
                self.state = said
            elif isinstance(said, messages.Reply):
                self._due.pop(said.number, None)
                if said.number in self._calls:
                    self._calls.discard(said.number)
                    self._outcomes[said.number] = said.outcome
                elif said.outcome is not Outcome.DONE:
                    self._failures.append(said.outcome)
            elif isinstance(said, messages.Ready):
                self._ready = True
            elif isinstance(said, messages.Failed):
                self._ended = said.reason
            self._changed.notify_all()
        return said is not None


def _spawn(descriptor: int, command: tuple[str, ...]) -> "subprocess.Popen[bytes]":
    """A fresh interpreter with this one's search path, out of reach of the terminal's Ctrl-C."""
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
    """By what ur_rtde says; pre-flight has ruled most of it out a moment before."""
    if "No module named" in reason:
        return Refused(f"ur_rtde is not installed: {reason}", "pip install 'ur-rtde>=1.6.3'")
    if "in use" in reason:
        return DeviceFault(reason, "end other RTDE clients and URCaps, then try again")
    if "remote control" in reason:
        return DeviceFault(reason, "switch the teach pendant to remote control")
    if "start control script" in reason or "took no setting" in reason:
        return DeviceFault(reason, SEE_PENDANT)
    return LinkLost(reason, CONNECT_AGAIN)
