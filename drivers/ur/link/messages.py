"""Messages between the arm's client and its worker process, in msgpack."""

from enum import StrEnum

import msgspec

from drivers.interfaces import Vector3, Vector6
from drivers.ur.settings import Pose

PROGRAM_RUNNING = 2  # runtime_state; RTDE guide
ROBOT_RUNNING = 7  # robot_mode; RTDE guide
# safety_status_bits; RTDE guide: 2 protective stop, 10 stopped due to safety (with any of them)
_STOP_BITS = 1 << 2 | 1 << 10
_EMERGENCY_STOP_BITS = sum(1 << bit for bit in (4, 5, 6, 7, 8, 9))
MAX_MESSAGE_BYTES = 65536


class Outcome(StrEnum):
    """Result of a command; ur_rtde itself returns True or False."""

    DONE = "done"
    STOPPED = "stopped by safety, or the program has ended"
    NOT_ACCEPTED = "not accepted"


class Message(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """Base of all messages on the socket."""


class Setup(Message, frozen=True):
    """First message; tcp_offset in m and rad; payload_kg None: as set in the installation."""

    host: str
    tcp_offset: Pose
    payload_kg: float | None
    cog_m: Vector3
    upper_registers: bool
    watchdog_hz: float
    heartbeat_timeout_s: float
    link_timeout_s: float
    brake_timeout_s: float
    client_pid: int  # the worker ends with it


class Move(Message, frozen=True):
    """Move straight to a pose. A current motion is braked first, with this acceleration."""

    number: int
    target: Pose
    speed_mps: float
    acceleration_mps2: float


class DriveArm(Message, frozen=True):
    """Keep this velocity, m/s and rad/s in the base frame, until the next command."""

    number: int
    velocity: Pose
    acceleration_mps2: float


class Stop(Message, frozen=True):
    """Brake along the path."""

    number: int
    deceleration_mps2: float


class SetPayload(Message, frozen=True):
    """Set mass and centre of gravity of the payload."""

    number: int
    mass_kg: float
    cog_m: Vector3


class Heartbeat(Message, frozen=True):
    """Shows that the client is alive."""


class Shutdown(Message, frozen=True):
    """Brake, end the program, end the process."""


Command = Move | DriveArm | Stop | SetPayload
Request = Setup | Command | Heartbeat | Shutdown


class Ready(Message, frozen=True):
    """The program runs on the controller; states follow."""


class Failed(Message, frozen=True):
    """The process ends: ur_rtde could not start, or the link is lost."""

    reason: str


class Reply(Message, frozen=True):
    """Sent at once for each command, and again if a delayed motion failed later."""

    number: int
    outcome: Outcome


class State(Message, frozen=True):
    """Sample of the controller."""

    timestamp_s: float
    pose: Pose
    velocity_mps: Vector3
    moving: bool
    robot_mode: int
    safety_bits: int
    program_running: bool
    angular_velocity_radps: Vector3 = (0.0, 0.0, 0.0)  # base frame
    speed_fraction: float = 1.0  # of the speed slider
    joints_rad: Vector6 | None = None  # base first

    @property
    def stopped_by_safety(self) -> bool:
        return bool(self.safety_bits & (_STOP_BITS | _EMERGENCY_STOP_BITS))

    @property
    def emergency_stop(self) -> bool:
        """Whether a stop worse than a protective one is active: safeguard, emergency, fault."""
        return bool(self.safety_bits & _EMERGENCY_STOP_BITS)


FromWorker = Ready | Failed | Reply | State
