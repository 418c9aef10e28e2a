"""One look at an arm over RTDE: joints, tool, modes. Reads, claims nothing, moves nothing.

Names and packets: UR's Real-Time Data Exchange (RTDE) guide.
"""

import math
import struct
from typing import Final

import msgspec

from drivers.errors import DeviceFault, LinkLost
from drivers.ur.link.messages import PROGRAM_RUNNING, ROBOT_RUNNING, Pose
from drivers.ur.link.preflight import CONNECT_AGAIN, RTDE_PORT, Rtde

JOINTS: Final = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
MOST_RAD: Final = 2 * math.pi + 0.01  # of any joint; UR10 user manual: 360 degrees either way
MOST_REACH_M: Final = 2.5  # of the tool from the base; UR20 manual: 1.75 m, and a long tool
STANDS_MPS: Final = 0.001  # as `ur.standing_below_mps`
MOVES, END_IT = "the arm moves", "end the program that moves it"

_FIELDS: Final = {
    "timestamp": "d", "actual_q": "6d", "actual_TCP_pose": "6d", "actual_TCP_speed": "6d",
    "robot_mode": "i", "safety_mode": "i", "runtime_state": "I", "target_speed_fraction": "d",
}  # fmt: skip
_DATA: Final = struct.Struct(">B" + "".join(_FIELDS.values()))
_FREQUENCY_HZ: Final = 125.0  # that every controller can send
_APART: Final = 10  # samples between the two that are compared

ROBOT_MODES: Final = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "power off",
    4: "power on", 5: "idle", 6: "backdrive", 7: "running", 8: "updating firmware",
}  # fmt: skip
SAFETY_MODES: Final = {
    1: "normal", 2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop",
    6: "system emergency stop", 7: "robot emergency stop", 8: "violation", 9: "fault",
}  # fmt: skip


class ArmLook(msgspec.Struct, frozen=True):
    """What the controller said in one cycle; angles in rad, the rest in m and s."""

    t_s: float
    joints_rad: Pose
    pose: Pose
    speed: Pose
    robot_mode: int
    safety_mode: int
    runtime_state: int
    speed_fraction: float

    @property
    def stands(self) -> bool:
        return math.hypot(*self.speed[:3]) < STANDS_MPS

    @property
    def running(self) -> bool:
        """Powered, brakes released: else pose and speed are not those of the tool."""
        return self.robot_mode == ROBOT_RUNNING


def look(host: str, timeout_s: float) -> tuple[ArmLook, ArmLook]:
    """Two looks, a moment apart. Raises LinkLost for a controller that answers otherwise."""
    try:
        with Rtde(host, timeout_s) as rtde:
            rtde.ask(b"V", struct.pack(">H", 2))
            names = ",".join(_FIELDS).encode()
            types = rtde.ask(b"O", struct.pack(">d", _FREQUENCY_HZ) + names)[1:]
            if b"NOT_FOUND" in types or rtde.ask(b"S") != b"\x01":
                raise ValueError(f"it does not send {names.decode()}: {types.decode()}")
            first = _decoded(rtde.wait(b"U"))
            for _ in range(_APART):
                last = _decoded(rtde.wait(b"U"))
            return first, last
    except (OSError, ValueError, struct.error) as error:
        why = "no answer in time" if isinstance(error, TimeoutError) else str(error)
        raise LinkLost(f"arm at {host}, RTDE port {RTDE_PORT}: {why}", CONNECT_AGAIN) from None


def require_standing(host: str, timeout_s: float) -> None:
    """Raises DeviceFault where the arm moves: a program of ours would end that which moves it."""
    if any(each.running and not each.stands for each in look(host, timeout_s)):
        raise DeviceFault(f"arm at {host}: {MOVES}", END_IT)


def _decoded(body: bytes) -> ArmLook:
    _, t_s, *v = _DATA.unpack(body)
    one, two, three = (tuple(v[i : i + 6]) for i in (0, 6, 12))
    return ArmLook(t_s, one, two, three, *v[18:])


def doubts(now: ArmLook, before: ArmLook) -> list[str]:
    """What no arm says; empty where nothing is strange. Of an arm without power only its clock."""
    found = []
    if now.t_s <= before.t_s:
        found.append("the controller's clock stands still")
    if not now.running:
        return found
    if not all(map(math.isfinite, (*now.joints_rad, *now.pose, *now.speed))):
        return [*found, "joints or pose are no numbers"]
    for name, q in zip(JOINTS, now.joints_rad, strict=True):
        if abs(q) > MOST_RAD:
            found.append(f"joint {name} at {math.degrees(q):.0f} degrees, and 360 is the most")
    if not any(now.joints_rad):
        found.append("all joints read exactly 0")
    away_m = math.hypot(*now.pose[:3])
    if away_m > MOST_REACH_M:
        found.append(f"the tool is {away_m:.2f} m from the base, beyond any arm's reach")
    moved_m, passed_s = math.dist(now.pose[:3], before.pose[:3]), now.t_s - before.t_s
    if now.stands and before.stands and moved_m > 0.005 + passed_s * STANDS_MPS:
        found.append(f"the tool went {moved_m * 1e3:.0f} mm at no speed")
    return found


def lines(now: ArmLook) -> list[str]:
    """A person's words, a line each."""
    degrees = ", ".join(
        f"{name} {math.degrees(q):.1f}" for name, q in zip(JOINTS, now.joints_rad, strict=True)
    )
    x, y, z, *turn = now.pose
    program = "runs" if now.runtime_state == PROGRAM_RUNNING else "does not run"
    return [
        f"robot mode {now.robot_mode}: {ROBOT_MODES.get(now.robot_mode, 'unknown')}",
        f"safety mode {now.safety_mode}: {SAFETY_MODES.get(now.safety_mode, 'unknown')}",
        f"program: {program} (runtime state {now.runtime_state})",
        f"speed slider: {now.speed_fraction * 100:.3g} %",
        f"joints, degrees: {degrees}",
        f"tool by the controller's own TCP, mm: x {x * 1e3:.1f}, y {y * 1e3:.1f}, "
        f"z {z * 1e3:.1f}; "
        f"turned, rad: {', '.join(f'{a:.3f}' for a in turn)}",
        f"tool speed, mm/s: {math.hypot(*now.speed[:3]) * 1e3:.1f}",
    ]
