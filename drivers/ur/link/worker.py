"""The process that holds ur_rtde, and what is said to it; run it by its client, not by hand.

ur_rtde holds Python's global lock in its constructors, never gives up reconnecting and can take the
interpreter down. So it lives in a process of its own, which ends when its link is lost and is then
replaced, not repaired. Messages are msgpack, one per packet of a local socket. While it starts, no
thread of Python may run, so the system ends it with its client, or by an alarm; later it looks.

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

from drivers.ur.link.messages import (
    LONGEST_MESSAGE,
    PROGRAM_RUNNING,
    Command,
    DriveArm,
    Failed,
    FromWorker,
    Leave,
    Move,
    NothingNew,
    Outcome,
    Ready,
    Reply,
    Request,
    SetPayload,
    Setup,
    State,
    Stop,
)

_RECIPE = [
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "target_TCP_speed",
    "robot_mode",
    "safety_status_bits",
    "runtime_state",
    "target_speed_fraction",
]
_PAUSE_S = 0.03  # between two looks, where 1 ms was to be slept: this process was not run
_SETTLE_CYCLES = 4  # until a command shows in what the controller reports
_KICKS_PER_LIMIT = 4  # kicks in the time after which the watchdog would bite
_PR_SET_PDEATHSIG = 1  # prctl(2), Linux
_GRACE_S = 2.0  # beyond its times, in which a client that lives would have ended it


class Channel:
    """This process's end of the socket; sending never waits for a client that does not read."""

    def __init__(self, peer: socket.socket) -> None:
        self._socket = peer
        self._decoder = msgspec.msgpack.Decoder[Request](Request)

    def send(self, said: FromWorker) -> None:
        # full: the client sees a silent robot; closed: receive() says so
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(said), socket.MSG_DONTWAIT)

    def receive(self, timeout_s: float) -> Request | None:
        """None when nothing came in time; raises EOFError when the client is gone."""
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return None
        data = self._socket.recv(LONGEST_MESSAGE)
        if not data:
            raise EOFError
        request: Request = self._decoder.decode(data)
        return request


class Robot:
    """The state side: reads and publishes; ends the process when the link is lost."""

    def __init__(self, receive: Any, setup: Setup, channel: Channel) -> None:
        self._receive = receive
        self._setup = setup
        self._channel = channel
        self.publishing = False

    @property
    def period_s(self) -> float:
        return 1.0 / self._setup.frequency_hz

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
        setup = self._setup
        speed = max(math.hypot(x, y, z), math.hypot(*wanted[:3]))
        turn = max(math.hypot(*turning), math.hypot(*wanted[3:]))
        return State(
            timestamp_s=timestamp_s,
            pose=tuple(receive.getActualTCPPose()),
            velocity_mps=(x, y, z),
            turning_radps=(turning[0], turning[1], turning[2]),
            moving=speed > setup.standing_below_mps or turn > setup.standing_below_radps,
            robot_mode=receive.getRobotMode(),
            safety_bits=receive.getSafetyStatusBits(),
            program_running=receive.getRuntimeState() == PROGRAM_RUNNING,
            speed_fraction=receive.getTargetSpeedFraction(),
        )

    def watch(self) -> None:
        """Publish each new sample, for ever; never comes back. A cycle without one is told too, so
        that a controller whose clock stands still is no silence of this process. What passes while
        this process is not run is no silence of the controller: what came then is read only now.
        """
        seen_s = -1.0
        seen_at = said_at = ran_at = time.monotonic()
        while self._receive.isConnected():
            now = time.monotonic()
            if now - ran_at > _PAUSE_S:
                seen_at, said_at = seen_at + now - ran_at, now
            ran_at = now
            timestamp_s = self._receive.getTimestamp()
            if timestamp_s != seen_s:
                seen_s, seen_at, said_at = timestamp_s, now, now
                if self.publishing:
                    self._channel.send(self.state())
            elif now - seen_at > self._setup.link_timeout_s:
                break
            elif self.publishing and now - said_at >= self.period_s:
                said_at = now
                self._channel.send(NothingNew())
            time.sleep(min(0.001, 0.25 * self.period_s))
        self._channel.send(Failed("the arm controller sends no data any more"))
        os._exit(3)  # no destructor: ur_rtde's would wait, and can crash

    def outcome(self, taken: bool) -> Outcome:
        """Why ur_rtde said False, by the controller's own bits, given a few cycles to show."""
        if taken:
            return Outcome.DONE
        for _ in range(_SETTLE_CYCLES):
            state = self.state()
            if state.stopped_by_safety or not state.program_running:
                break
            time.sleep(self.period_s)
        self._channel.send(state)
        if state.emergency_stop:
            return Outcome.EMERGENCY_STOP
        if state.stopped_by_safety:
            return Outcome.PROTECTIVE_STOP
        return Outcome.NOT_TAKEN if state.program_running else Outcome.PROGRAM_ENDED


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
        setup: Setup,
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
        self._forsaken = False  # the arm moved and nobody read
        self._acceleration_mps2 = 1.2  # of the last move; UR manual: movel's default
        self._deceleration_mps2 = self._acceleration_mps2  # of the last stop
        self._commanded_at = -math.inf
        self._heard_at = self._clock()
        self._unheard_s = 0.0
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
            self.turn()
            try:
                request = self._channel.receive(self._wait_s)
            except EOFError:
                return
            if isinstance(request, Leave) or os.getppid() != self._setup.client_pid:
                return  # where others hold its end of the socket too, its death is not heard
            self.listened(request is not None)
            if isinstance(request, Move | DriveArm | Stop | SetPayload):
                self._channel.send(Reply(request.number, self.carry_out(request)))

    def listened(self, heard: bool) -> None:
        """Silence is what a look at the socket did not find: where this process was held up, what
        was said meanwhile waits there."""
        if heard:
            self._heard_at = self._clock()
        self._unheard_s = self._clock() - self._heard_at

    def turn(self) -> None:
        """What is due without a request: the motion that waits, a brake, and the watchdog."""
        self._go_on()
        self._moving = self._moving and self.busy
        self._brake_unheard()
        self._kick()

    def leave(self) -> None:
        """Brake if need be, then end the program, so that nothing is left running."""
        deadline = self._clock() + self._setup.leave_timeout_s
        if self._driving or self.busy:
            self._stop(self._acceleration_mps2)
        while self.busy and self._clock() < deadline:
            self._go_on()
            self._control.kickWatchdog()
            time.sleep(self._robot.period_s)
        self._control.stopScript()

    @property
    def busy(self) -> bool:
        """A move or a stop is under way, or was commanded so lately that it does not show yet."""
        state = self._robot.state()
        if state.moving or not state.program_running:  # a program that ended leaves its flags
            return state.moving
        settle_s = _SETTLE_CYCLES * self._robot.period_s
        running = self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()
        return bool(running) or self._clock() - self._commanded_at < settle_s

    def carry_out(self, command: Command) -> Outcome:
        """Tell ur_rtde, and what it said; no motion begins after the arm was left alone."""
        if isinstance(command, SetPayload):
            taken = self._control.setPayload(command.mass_kg, list(command.cog_m))
            return self._robot.outcome(bool(taken))
        if isinstance(command, Stop):
            self._stop(command.deceleration_mps2)
            return Outcome.DONE  # ur_rtde does not say; the speed will
        if self._forsaken:  # its program is about to end
            return Outcome.PROGRAM_ENDED
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
        elif self._braking and self._clock() - self._commanded_at > self._setup.brake_again_s:
            self._brake()
        motion = self._waiting
        if motion is None or self._braking or self.busy:
            return
        self._waiting = None
        outcome = self._start(motion) if self._client_lives else Outcome.NOT_TAKEN
        if outcome is not Outcome.DONE:
            self._channel.send(Reply(motion.number, outcome))

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

    def _brake_unheard(self) -> None:
        """Nobody reads while the arm is on its way: brake at once, unless it is braking. The
        watchdog, kicked no more, ends the program, so that whoever reads again is told."""
        on_its_way = self._moving or self._driving
        if self._forsaken or self._client_lives or not on_its_way:
            return
        self._forsaken, self._waiting = True, None
        if not self._stopping:
            self._stop(self._acceleration_mps2)

    @property
    def _wait_s(self) -> float:
        """No longer than until something of all that may be due."""
        if self._waiting or self._braking:
            return self._robot.period_s
        return min(self._kick_period_s, self._setup.heartbeat_timeout_s / _KICKS_PER_LIMIT)

    def _kick(self) -> None:
        now = self._clock()
        if not self._forsaken and now - self._kicked_at >= self._kick_period_s:
            self._kicked_at = now
            self._control.kickWatchdog()

    @property
    def _client_lives(self) -> bool:
        return self._unheard_s <= self._setup.heartbeat_timeout_s


def _start(setup: Setup, channel: Channel) -> Commander:
    """Both interfaces of ur_rtde, the reading thread, and the program prepared."""
    receive_module = importlib.import_module("rtde_receive")
    control_class = importlib.import_module("rtde_control").RTDEControlInterface
    receive = receive_module.RTDEReceiveInterface(setup.host, setup.frequency_hz, _RECIPE)
    flags = control_class.FLAG_UPLOAD_SCRIPT | control_class.FLAG_NO_EXT_FT
    control = control_class(setup.host, setup.frequency_hz, flags)
    robot = Robot(receive, setup, channel)
    threading.Thread(target=robot.watch, daemon=True).start()
    commander = Commander(control, robot, setup, channel)
    if not commander.prepare():
        raise RuntimeError(f"the arm took no setting: {robot.outcome(False)}")
    time.sleep(_SETTLE_CYCLES * robot.period_s)  # until poses are those of the tool just set
    robot.publishing = True
    return commander


def _end_with(client_pid: int, within_s: float) -> None:
    """Die with the client from now on, where the system can (Linux), and after a time anyhow: not
    by a handler of ours, for ur_rtde's constructors let no Python run."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, within_s + _GRACE_S)
    _die_with_client(signal.SIGKILL)
    if os.getppid() != client_pid:  # it was gone before that
        os._exit(4)


def _stay() -> None:
    """The arm is to be left standing and without a program: no more sudden ends. A death of the
    client is asked for in turn; the system's signal would follow that of its thread alone."""
    _die_with_client(0)
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def _die_with_client(number: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


def main() -> None:
    """Entry of the child process; its only argument is the socket's descriptor."""
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    setup = channel.receive(timeout_s=10.0)
    if not isinstance(setup, Setup):
        os._exit(2)
    try:
        _end_with(setup.client_pid, setup.start_timeout_s)
        commander = _start(setup, channel)
        _stay()
        channel.send(Ready())
        commander.serve()
        signal.setitimer(signal.ITIMER_REAL, setup.leave_timeout_s + _GRACE_S)
        commander.leave()
    except Exception as error:  # ur_rtde raises what its C++ threw
        channel.send(Failed(str(error)))
        os._exit(2)
    os._exit(0)  # no destructor: ur_rtde's takes half a second


if __name__ == "__main__":
    main()
