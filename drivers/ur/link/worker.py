"""The process that holds ur_rtde; its client starts it.

ur_rtde holds Python's global lock in its constructors, never gives up reconnecting and can take the
interpreter down. So it lives in a process of its own, which ends when its link is lost and is then
replaced, not repaired. Messages are msgpack, one per packet of a local socket. While it starts, no
thread of Python may run, so the system ends it with its client; later it looks.

ur_rtde's calls share input registers with each other and with the watchdog, so one thread makes
them all, one after the other; another one only reads. The main thread kicks the controller's
watchdog, unless the client is not heard of while the arm moves: that is braked and kicked no more.
"""

import contextlib
import ctypes
import importlib
import math
import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec

from drivers.ur.link import messages
from drivers.ur.link.messages import PROGRAM_RUNNING, DriveArm, Move, Outcome, State

_RECIPE = [
    "timestamp", "actual_TCP_pose", "actual_TCP_speed", "target_TCP_speed", "robot_mode",
    "safety_status_bits", "runtime_state", "target_speed_fraction",
]  # fmt: skip
FREQUENCY_HZ = 125.0  # samples per s; RTDE guide: what a CB3 sends
_PERIOD_S = 1.0 / FREQUENCY_HZ
_STANDING_BELOW_MPS = 0.001  # assumed
_STANDING_BELOW_RADPS = 0.005  # assumed: the same at 0.2 m from the axis
_BRAKE_AGAIN_S = 0.2  # a drive that still moves is braked again: a controller may miss a call
_LONGEST_LOOK_S = 0.03  # 1 ms is to be slept; beyond that this process was not run
_SETTLE_S = 4 * _PERIOD_S  # until a command shows in what the controller reports
_KICKS_PER_LIMIT = 4  # kicks in the time after which the watchdog would bite
_PR_SET_PDEATHSIG = 1  # prctl(2), Linux


class Channel:
    """This process's end of the socket; sending never waits for a client that does not read."""

    def __init__(self, peer: socket.socket) -> None:
        self._socket = peer
        self._decoder = msgspec.msgpack.Decoder[messages.Request](messages.Request)

    def send(self, said: messages.FromWorker) -> None:
        # full: the client sees a silent robot; closed: receive() says so
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(said), socket.MSG_DONTWAIT)

    def receive(self, timeout_s: float) -> messages.Request | None:
        """None when nothing came in time; raises EOFError when the client is gone."""
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return None
        data = self._socket.recv(messages.LONGEST_MESSAGE)
        if not data:
            raise EOFError
        request: messages.Request = self._decoder.decode(data)
        return request


class Robot:
    """The state side: reads and publishes; ends the process when the link is lost."""

    def __init__(self, receive: Any, setup: messages.Setup, channel: Channel) -> None:
        self._receive = receive
        self._setup = setup
        self._channel = channel
        self.publishing = False

    def state(self) -> State:
        """All fields of one sample: read again when the next one came in between."""
        while True:
            timestamp_s = self._receive.getTimestamp()
            state = self._read(timestamp_s)
            if self._receive.getTimestamp() == timestamp_s:
                return state

    def _read(self, timestamp_s: float) -> State:
        receive = self._receive
        x, y, z, *turning = receive.getActualTCPSpeed()
        wanted = receive.getTargetTCPSpeed()
        speed = max(math.hypot(x, y, z), math.hypot(*wanted[:3]))
        turn = max(math.hypot(*turning), math.hypot(*wanted[3:]))
        return State(
            timestamp_s=timestamp_s,
            pose=tuple(receive.getActualTCPPose()),
            velocity_mps=(x, y, z),
            turning_radps=(turning[0], turning[1], turning[2]),
            moving=speed > _STANDING_BELOW_MPS or turn > _STANDING_BELOW_RADPS,
            robot_mode=receive.getRobotMode(),
            safety_bits=receive.getSafetyStatusBits(),
            program_running=receive.getRuntimeState() == PROGRAM_RUNNING,
            speed_fraction=receive.getTargetSpeedFraction(),
        )

    def watch(self) -> None:
        """Publish each new sample, for ever; never comes back. Time in which this process was not
        run is no silence of the controller: what came meanwhile is read only now."""
        timestamp_s, silent_s = -1.0, 0.0
        looked_at = time.monotonic()
        while self._receive.isConnected() and silent_s <= self._setup.link_timeout_s:
            now = time.monotonic()
            silent_s += min(now - looked_at, _LONGEST_LOOK_S)
            looked_at = now
            if (latest_s := self._receive.getTimestamp()) != timestamp_s:
                timestamp_s, silent_s = latest_s, 0.0
                if self.publishing:
                    self._channel.send(self.state())
            time.sleep(0.001)
        self._channel.send(messages.Failed("the arm controller sends no data any more"))
        os._exit(3)  # no destructor: ur_rtde's would wait, and can crash

    def outcome(self, taken: bool) -> Outcome:
        """Why ur_rtde said False, by the controller's own bits, given a few cycles to show."""
        if taken:
            return Outcome.DONE
        deadline = time.monotonic() + _SETTLE_S
        while True:
            state = self.state()
            stopped = state.stopped_by_safety or not state.program_running
            if stopped or time.monotonic() > deadline:
                break
            time.sleep(_PERIOD_S)
        self._channel.send(state)
        return Outcome.STOPPED if stopped else Outcome.NOT_TAKEN


class Commander:
    """The command side: every call to ur_rtde's control interface is made here, by one thread.

    Moves and stops are asynchronous ones only. ur_rtde's synchronous stop brakes joint by joint
    when no asynchronous one came before, and a move started while a stop is under way ends the
    program ("another thread is already controlling the robot"), so such a move waits here. A drive
    is a thread of the program too, and only its own verb ends it; that verb blocks for as long as
    the tool brakes, longer than the watchdog waits, so the drive is brought to rest first.
    """

    def __init__(
        self,
        control: Any,
        robot: Robot,
        setup: messages.Setup,
        channel: Channel,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock  # s
        self._control = control
        self._robot = robot
        self._setup = setup
        self._channel = channel
        self._waiting: Move | DriveArm | None = None
        self._moving = False  # a move that was begun, and has not been seen to be over
        self._driving = False
        self._braking = False  # a drive is coming to rest
        self._stopping = False  # since the last move
        self._abandoned = False  # the arm moved and nobody read
        self._acceleration_mps2 = 1.2  # of the last move; UR manual: movel's default
        self._deceleration_mps2 = self._acceleration_mps2  # of the last stop
        self._commanded_at = -math.inf
        self._heard_at = self._clock()
        self._silent_s = 0.0
        self._kicked_at = -math.inf

    def prepare(self) -> bool:
        """What ends with every program: tool, payload and watchdog; then the first kick."""
        setup = self._setup
        done = self._control.setTcp(list(setup.tcp_offset))
        if setup.payload_kg is not None:
            done = done and self._control.setPayload(setup.payload_kg, list(setup.cog_m))
        return bool(
            done and self._control.setWatchdog(setup.watchdog_hz) and self._control.kickWatchdog()
        )

    def serve(self) -> None:
        """Until the client says so or is gone."""
        while True:
            self.step()
            try:
                request = self._channel.receive(self._wait_s)
            except EOFError:
                return
            if isinstance(request, messages.Leave) or os.getppid() != self._setup.client_pid:
                return  # where others hold its end of the socket too, its death is not heard
            self.listened(request is not None)
            if isinstance(request, Move | DriveArm | messages.Stop | messages.SetPayload):
                self._channel.send(messages.Reply(request.number, self.carry_out(request)))

    def listened(self, heard: bool) -> None:
        """Silence counts only from a look that found the socket empty: after a time in which this
        process did not run, messages wait there."""
        if heard:
            self._heard_at = self._clock()
        self._silent_s = self._clock() - self._heard_at

    def step(self) -> None:
        """What is due without a request: the motion that waits, a brake, and the watchdog."""
        self._go_on()
        self._moving = self._moving and self.busy
        self._brake_abandoned()
        self._kick()

    def leave(self) -> None:
        """Brake if need be, then end the program, so that nothing is left running."""
        deadline = self._clock() + self._setup.leave_timeout_s
        if self._driving or self.busy:
            self._stop(self._acceleration_mps2)
        while self.busy and self._clock() < deadline:
            self._go_on()
            self._control.kickWatchdog()
            time.sleep(_PERIOD_S)
        self._control.stopScript()

    @property
    def busy(self) -> bool:
        """A move or a stop is under way, or was commanded so lately that it does not show yet."""
        state = self._robot.state()
        if state.moving or not state.program_running:  # a program that ended leaves its flags
            return state.moving
        running = self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()
        return bool(running) or self._clock() - self._commanded_at < _SETTLE_S

    def carry_out(self, command: messages.Command) -> Outcome:
        """Tell ur_rtde, and what it said; no motion begins after the arm was left alone."""
        if isinstance(command, messages.SetPayload):
            taken = self._control.setPayload(command.mass_kg, list(command.cog_m))
            return self._robot.outcome(bool(taken))
        if isinstance(command, messages.Stop):
            self._stop(command.deceleration_mps2)
            return Outcome.DONE  # ur_rtde does not say; the speed will
        if self._abandoned:  # its program is about to end
            return Outcome.STOPPED
        self._acceleration_mps2 = command.acceleration_mps2
        if self._driving and isinstance(command, DriveArm):
            return self._start(command)
        if not self._driving and not self.busy:
            return self._start(command)
        if self._waiting is None and not self._stopping:
            self._stop(command.acceleration_mps2)
        self._waiting = command
        return Outcome.DONE

    def _go_on(self) -> None:
        """Send the motion that waits, as soon as the tool stands, if anyone still wants it."""
        if self._braking and not self.busy:
            self._end_drive()
        elif self._braking and self._clock() - self._commanded_at > _BRAKE_AGAIN_S:
            self._brake()
        motion = self._waiting
        if motion is None or self._braking or self.busy:
            return
        self._waiting = None
        outcome = self._start(motion) if self._client_lives else Outcome.NOT_TAKEN
        if outcome is not Outcome.DONE:
            self._channel.send(messages.Reply(motion.number, outcome))

    def _start(self, motion: Move | DriveArm) -> Outcome:
        self._stopping = False
        self._moving = isinstance(motion, Move)
        if isinstance(motion, DriveArm):
            self._driving, self._braking = True, False
            taken = self._control.speedL(list(motion.velocity), motion.acceleration_mps2)
        else:
            taken = self._control.moveL(
                list(motion.target), motion.speed_mps, motion.acceleration_mps2, asynchronous=True
            )
        self._commanded_at = self._clock()
        return self._robot.outcome(bool(taken))

    def _stop(self, deceleration_mps2: float) -> None:
        self._waiting = None
        self._stopping = True
        if self._driving:  # stopL would end the program: the drive's thread holds the robot
            self._braking = True
            self._deceleration_mps2 = deceleration_mps2
            self._brake()
        else:
            self._control.stopL(deceleration_mps2, asynchronous=True)
            self._commanded_at = self._clock()

    def _brake(self) -> None:
        """Bring a drive to rest; said again while it moves, since a controller may miss a call."""
        self._control.speedL([0.0] * 6, self._deceleration_mps2)
        self._commanded_at = self._clock()

    def _end_drive(self) -> None:
        self._driving = self._braking = False
        self._control.speedStop(self._acceleration_mps2)
        self._commanded_at = self._clock()

    @property
    def _kick_period_s(self) -> float:
        return 1.0 / (_KICKS_PER_LIMIT * self._setup.watchdog_hz)

    def _brake_abandoned(self) -> None:
        """Nobody reads while the arm is on its way: brake at once, unless it is braking. The
        watchdog, kicked no more, ends the program, which the next reader sees."""
        on_its_way = self._moving or self._driving
        if self._abandoned or self._client_lives or not on_its_way:
            return
        self._abandoned, self._waiting = True, None
        if not self._stopping:
            self._stop(self._acceleration_mps2)

    @property
    def _wait_s(self) -> float:
        """No longer than until something of all that may be due."""
        if self._waiting or self._braking:
            return _PERIOD_S
        return min(self._kick_period_s, self._setup.heartbeat_timeout_s / _KICKS_PER_LIMIT)

    def _kick(self) -> None:
        now = self._clock()
        if not self._abandoned and now - self._kicked_at >= self._kick_period_s:
            self._kicked_at = now
            self._control.kickWatchdog()

    @property
    def _client_lives(self) -> bool:
        return self._silent_s <= self._setup.heartbeat_timeout_s


def _start(setup: messages.Setup, channel: Channel) -> Commander:
    """Both interfaces of ur_rtde, the reading thread, and the program prepared."""
    receive_module = importlib.import_module("rtde_receive")
    control_class = importlib.import_module("rtde_control").RTDEControlInterface
    receive = receive_module.RTDEReceiveInterface(setup.host, FREQUENCY_HZ, _RECIPE)
    flags = control_class.FLAG_UPLOAD_SCRIPT | control_class.FLAG_NO_EXT_FT
    control = control_class(setup.host, FREQUENCY_HZ, flags)
    robot = Robot(receive, setup, channel)
    threading.Thread(target=robot.watch, daemon=True).start()
    commander = Commander(control, robot, setup, channel)
    if not commander.prepare():
        raise RuntimeError(f"the arm took no setting: {robot.outcome(False)}")
    time.sleep(_SETTLE_S)  # until poses are those of the tool just set
    robot.publishing = True
    return commander


def _die_with_client(number: int) -> None:
    """The system sends this signal when the client dies (Linux alone); 0: none."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


def main() -> None:
    """Entry of the child process; its only argument is the socket's descriptor."""
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    setup = channel.receive(timeout_s=10.0)
    if not isinstance(setup, messages.Setup):
        os._exit(2)
    try:
        _die_with_client(signal.SIGKILL)
        if os.getppid() != setup.client_pid:  # it was gone before that
            os._exit(4)
        commander = _start(setup, channel)
        _die_with_client(0)  # from now on the arm is braked first
        channel.send(messages.Ready())
        commander.serve()
        commander.leave()
    except Exception as error:  # ur_rtde raises what its C++ threw
        channel.send(messages.Failed(str(error)))
        os._exit(2)
    os._exit(0)  # no destructor: ur_rtde's takes half a second
