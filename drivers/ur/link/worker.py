"""Worker process that holds ur_rtde; started by its client.

ur_rtde holds Python's global lock in its constructors, never stops reconnecting and can crash the
interpreter. So it runs in its own process, which ends when its link is lost and is then replaced.
Messages are msgpack, one per packet of a local socket. During the start no Python thread may run;
the operating system then ends the process with its client. Later the process checks its parent.

ur_rtde's calls share input registers with each other and with the watchdog. Therefore one thread
makes all calls, one after the other; another thread only reads. The main thread kicks the
controller's watchdog. When no message of the client arrives while the arm moves, it brakes the
arm and stops kicking.
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
    "actual_q",
]  # fmt: skip
FREQUENCY_HZ = 125.0  # samples per s; RTDE guide: what a CB3 sends
_PERIOD_S = 1.0 / FREQUENCY_HZ
_STATIONARY_BELOW_MPS = 0.001  # assumed
_STATIONARY_BELOW_RADPS = 0.005  # assumed: the same speed at 0.2 m from the axis
_REPEAT_BRAKE_S = 0.2  # a controller may miss a call, so a moving drive is braked again
_MAX_INTERVAL_S = 0.03  # of the 1 ms loop; beyond that this process did not run
_SETTLE_S = 4 * _PERIOD_S  # until the controller reports the effect of a command
_KICKS_PER_LIMIT = 4  # kicks within the watchdog's time-out
_PR_SET_PDEATHSIG = 1  # prctl(2), Linux


class Channel:
    """Worker's end of the socket; sending never waits for a client that does not read."""

    def __init__(self, peer: socket.socket) -> None:
        self._socket = peer
        self._decoder = msgspec.msgpack.Decoder[messages.Request](messages.Request)

    def send(self, message: messages.FromWorker) -> None:
        # full: the client detects missing samples; closed: receive() raises
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(message), socket.MSG_DONTWAIT)

    def receive(self, timeout_s: float) -> messages.Request | None:
        """Next message, or None after the time-out; raises EOFError when the client is gone."""
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return None
        data = self._socket.recv(messages.MAX_MESSAGE_BYTES)
        if not data:
            raise EOFError
        request: messages.Request = self._decoder.decode(data)
        return request


class Robot:
    """State side: reads and publishes samples; ends the process when the link is lost."""

    def __init__(self, receive: Any, setup: messages.Setup, channel: Channel) -> None:
        self._receive = receive
        self._setup = setup
        self._channel = channel
        self.publishing = False

    def state(self) -> State:
        """All fields of one sample; read again when the next sample arrived in between."""
        while True:
            timestamp_s = self._receive.getTimestamp()
            state = self._read(timestamp_s)
            if self._receive.getTimestamp() == timestamp_s:
                return state

    def _read(self, timestamp_s: float) -> State:
        receive = self._receive
        x, y, z, *angular = receive.getActualTCPSpeed()
        target_speed = receive.getTargetTCPSpeed()
        speed = max(math.hypot(x, y, z), math.hypot(*target_speed[:3]))
        angular_speed = max(math.hypot(*angular), math.hypot(*target_speed[3:]))
        return State(
            timestamp_s=timestamp_s,
            pose=tuple(receive.getActualTCPPose()),
            velocity_mps=(x, y, z),
            angular_velocity_radps=(angular[0], angular[1], angular[2]),
            moving=speed > _STATIONARY_BELOW_MPS or angular_speed > _STATIONARY_BELOW_RADPS,
            robot_mode=receive.getRobotMode(),
            safety_bits=receive.getSafetyStatusBits(),
            program_running=receive.getRuntimeState() == PROGRAM_RUNNING,
            speed_fraction=receive.getTargetSpeedFraction(),
            joints_rad=tuple(receive.getActualQ()),
        )

    def publish_samples(self) -> None:
        """Publish each new sample; never returns.

        Time in which this process did not run does not count as silence of the controller, since
        samples that arrived in that time are read only now.
        """
        timestamp_s, silent_s = -1.0, 0.0
        looked_at = time.monotonic()
        while self._receive.isConnected() and silent_s <= self._setup.link_timeout_s:
            now = time.monotonic()
            silent_s += min(now - looked_at, _MAX_INTERVAL_S)
            looked_at = now
            if (latest_s := self._receive.getTimestamp()) != timestamp_s:
                timestamp_s, silent_s = latest_s, 0.0
                if self.publishing:
                    self._channel.send(self.state())
            time.sleep(0.001)
        self._channel.send(messages.Failed("the arm controller sends no data any more"))
        os._exit(3)  # no destructor: ur_rtde's waits, and can crash

    def outcome(self, taken: bool) -> Outcome:
        """Reason why ur_rtde returned False, by the controller's bits, after a few cycles."""
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
        return Outcome.STOPPED if stopped else Outcome.NOT_ACCEPTED


class Commander:
    """Command side: makes every call to ur_rtde's control interface, in one thread.

    Only asynchronous moves and stops are used. ur_rtde's synchronous stop brakes joint by joint
    unless an asynchronous one came before. A move started during a stop ends the program ("another
    thread is already controlling the robot"), so such a move waits here. A drive is also a thread
    of the program, and only its own verb ends it. That verb blocks while the tool brakes, longer
    than the watchdog allows, so the drive is brought to rest first.
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
        self._pending_motion: Move | DriveArm | None = None
        self._moving = False  # a move was started, and its end was not observed yet
        self._driving = False
        self._braking = False  # a drive is coming to rest
        self._stopping = False  # since the last move
        self._client_lost = False  # the arm moved while the client was silent
        self._acceleration_mps2 = 1.2  # of the last move; UR manual: movel's default
        self._deceleration_mps2 = self._acceleration_mps2  # of the last stop
        self._commanded_at = -math.inf
        self._last_message_at = self._clock()
        self._silent_s = 0.0
        self._kicked_at = -math.inf

    def prepare(self) -> bool:
        """Set tool, payload and watchdog, which end with every program; then kick the watchdog."""
        setup = self._setup
        done = self._control.setTcp(list(setup.tcp_offset))
        if setup.payload_kg is not None:
            done = done and self._control.setPayload(setup.payload_kg, list(setup.cog_m))
        return bool(
            done and self._control.setWatchdog(setup.watchdog_hz) and self._control.kickWatchdog()
        )

    def serve(self) -> None:
        """Serve requests until the client shuts down or is gone."""
        while True:
            self.step()
            try:
                request = self._channel.receive(self._wait_s)
            except EOFError:
                return
            if isinstance(request, messages.Shutdown) or os.getppid() != self._setup.client_pid:
                return  # needed where other processes hold the client's end of the socket too
            self.update_silence(request is not None)
            if isinstance(request, Move | DriveArm | messages.Stop | messages.SetPayload):
                self._channel.send(messages.Reply(request.number, self.execute(request)))

    def update_silence(self, received: bool) -> None:
        """Update the silence of the client after a look into the socket.

        Silence counts only when the socket was empty: after a time in which this process did not
        run, messages wait there.
        """
        if received:
            self._last_message_at = self._clock()
        self._silent_s = self._clock() - self._last_message_at

    def step(self) -> None:
        """Do what is due without a request: the pending motion, braking, the watchdog."""
        self._continue()
        self._moving = self._moving and self.busy
        self._brake_without_client()
        self._kick()

    def shut_down(self) -> None:
        """Brake if necessary, then end the program, so that nothing is left running."""
        deadline = self._clock() + self._setup.brake_timeout_s
        if self._driving or self.busy:
            self._stop(self._acceleration_mps2)
        while self.busy and self._clock() < deadline:
            self._continue()
            self._control.kickWatchdog()
            time.sleep(_PERIOD_S)
        self._control.stopScript()

    @property
    def busy(self) -> bool:
        """Whether a move or stop is under way, or was commanded too recently to show."""
        state = self._robot.state()
        if state.moving or not state.program_running:  # a program that ended leaves its flags set
            return state.moving
        running = self._control.getAsyncOperationProgressEx().isAsyncOperationRunning()
        return bool(running) or self._clock() - self._commanded_at < _SETTLE_S

    def execute(self, command: messages.Command) -> Outcome:
        """Execute a command by ur_rtde; no motion starts after the client was lost."""
        if isinstance(command, messages.SetPayload):
            taken = self._control.setPayload(command.mass_kg, list(command.cog_m))
            return self._robot.outcome(bool(taken))
        if isinstance(command, messages.Stop):
            self._stop(command.deceleration_mps2)
            return Outcome.DONE  # ur_rtde returns no result; the speed shows it
        if self._client_lost:  # its program is about to end
            return Outcome.STOPPED
        self._acceleration_mps2 = command.acceleration_mps2
        if self._driving and isinstance(command, DriveArm):
            return self._start(command)
        if not self._driving and not self.busy:
            return self._start(command)
        if self._pending_motion is None and not self._stopping:
            self._stop(command.acceleration_mps2)
        self._pending_motion = command
        return Outcome.DONE

    def _continue(self) -> None:
        """Start the pending motion as soon as the tool is stationary, if the client is alive."""
        if self._braking and not self.busy:
            self._end_drive()
        elif self._braking and self._clock() - self._commanded_at > _REPEAT_BRAKE_S:
            self._brake()
        motion = self._pending_motion
        if motion is None or self._braking or self.busy:
            return
        self._pending_motion = None
        outcome = self._start(motion) if self._client_alive else Outcome.NOT_ACCEPTED
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
        self._pending_motion = None
        self._stopping = True
        if (
            self._driving
        ):  # stopL would end the program, since the drive's thread controls the robot
            self._braking = True
            self._deceleration_mps2 = deceleration_mps2
            self._brake()
        else:
            self._control.stopL(deceleration_mps2, asynchronous=True)
            self._commanded_at = self._clock()

    def _brake(self) -> None:
        """Bring a drive to rest; repeated while it moves, since a controller may miss a call."""
        self._control.speedL([0.0] * 6, self._deceleration_mps2)
        self._commanded_at = self._clock()

    def _end_drive(self) -> None:
        self._driving = self._braking = False
        self._control.speedStop(self._acceleration_mps2)
        self._commanded_at = self._clock()

    @property
    def _kick_period_s(self) -> float:
        return 1.0 / (_KICKS_PER_LIMIT * self._setup.watchdog_hz)

    def _brake_without_client(self) -> None:
        """Brake at once when the client is silent during a motion, unless the arm is braking. The
        watchdog is kicked no more, so it ends the program, which the next client detects."""
        in_motion = self._moving or self._driving
        if self._client_lost or self._client_alive or not in_motion:
            return
        self._client_lost, self._pending_motion = True, None
        if not self._stopping:
            self._stop(self._acceleration_mps2)

    @property
    def _wait_s(self) -> float:
        """Longest wait for a message until something is due."""
        if self._pending_motion or self._braking:
            return _PERIOD_S
        return min(self._kick_period_s, self._setup.heartbeat_timeout_s / _KICKS_PER_LIMIT)

    def _kick(self) -> None:
        now = self._clock()
        if not self._client_lost and now - self._kicked_at >= self._kick_period_s:
            self._kicked_at = now
            self._control.kickWatchdog()

    @property
    def _client_alive(self) -> bool:
        return self._silent_s <= self._setup.heartbeat_timeout_s


def _start(setup: messages.Setup, channel: Channel) -> Commander:
    """Both interfaces of ur_rtde, the reading thread, and the prepared program."""
    receive_module = importlib.import_module("rtde_receive")
    control_class = importlib.import_module("rtde_control").RTDEControlInterface
    receive = receive_module.RTDEReceiveInterface(setup.host, FREQUENCY_HZ, _RECIPE)
    flags = control_class.FLAG_UPLOAD_SCRIPT | control_class.FLAG_NO_EXT_FT
    if setup.upper_registers:
        flags |= control_class.FLAG_UPPER_RANGE_REGISTERS
    control = control_class(setup.host, FREQUENCY_HZ, flags)
    robot = Robot(receive, setup, channel)
    threading.Thread(target=robot.publish_samples, daemon=True).start()
    commander = Commander(control, robot, setup, channel)
    if not commander.prepare():
        raise RuntimeError(f"the arm accepted no setting: {robot.outcome(False)}")
    time.sleep(_SETTLE_S)  # until poses refer to the new tool centre point
    robot.publishing = True
    return commander


def _set_death_signal(number: int) -> None:
    """Set the signal that the system sends when the client dies (Linux only); 0: none."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


def main() -> None:
    """Entry point of the child process; its only argument is the socket's descriptor."""
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    setup = channel.receive(timeout_s=10.0)
    if not isinstance(setup, messages.Setup):
        os._exit(2)
    try:
        _set_death_signal(signal.SIGKILL)
        if os.getppid() != setup.client_pid:  # the client died before the signal was set
            os._exit(4)
        commander = _start(setup, channel)
        _set_death_signal(0)  # from now on the arm is braked first
        channel.send(messages.Ready())
        commander.serve()
        commander.shut_down()
    except Exception as error:  # ur_rtde raises any C++ exception
        channel.send(messages.Failed(str(error)))
        os._exit(2)
    os._exit(0)  # no destructor: ur_rtde's takes half a second
