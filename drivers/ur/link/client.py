"""Link to the arm: ``ArmLink`` for the driver, executed by ur_rtde in a worker process.

It never reconnects and never unlocks a stop by itself; ``UrLink.connect`` connects again.
"""

import math
import os
from typing import Self

from drivers.checks import raise_failures
from drivers.errors import DeviceFault, LinkLost, Refused, on_failure
from drivers.interfaces import Vector3
from drivers.ur import kinematics
from drivers.ur.driver import ArmSample
from drivers.ur.link import messages
from drivers.ur.link.messages import ROBOT_RUNNING, Outcome, State
from drivers.ur.link.preflight import preflight, require_stationary, require_ur_rtde
from drivers.ur.link.supervisor import SEE_PENDANT, START_AGAIN, WorkerProcess
from drivers.ur.settings import UrSettings

_HEARTBEAT_NS = 10_000_000


class UrLink:
    """Implements ``drivers.ur.driver.ArmLink`` on a controller; ``connect`` before the first use.

    ``read`` is also the heartbeat: the arm is braked when the caller stops reading. Verbs of motion
    return at once; if the controller does not execute them, the next ``read`` raises. The tool
    keeps its orientation at connection, except for the rotation about its z axis by ``speed_l``.
    """

    def __init__(self, settings: UrSettings) -> None:
        """Raises UsageError if ur_rtde is not installed."""
        require_ur_rtde()
        self._settings = settings
        self._worker: WorkerProcess | None = None
        self._payload_kg: float | None = None
        self._powered_state: State | None = None
        self._rotation: Vector3 = (0.0, 0.0, 0.0)  # at connection
        self._has_rotated = False
        self._heartbeat_ns = 0
        self._raised_faults: set[str] = set()  # faults that are still present
        self._stop_number: int | None = None
        self._stop_deadline_ns = 0

    def connect(self) -> None:
        """Run the pre-flight checks, start the worker; raises LinkLost or DeviceFault, also when
        the arm moves."""
        self.close()
        s = self._settings
        checks = preflight(s.host, s.step_timeout_s, s.upper_registers)
        raise_failures(checks, f"arm at {s.host}: ")
        require_stationary(s.host, s.step_timeout_s)
        setup = messages.Setup(
            host=s.host,
            tcp_offset=s.tcp_offset,
            payload_kg=self._payload_kg,
            cog_m=s.cog_m,
            upper_registers=s.upper_registers,
            watchdog_hz=s.watchdog_hz,
            heartbeat_timeout_s=s.heartbeat_timeout_s,
            link_timeout_s=s.link_timeout_s,
            brake_timeout_s=s.brake_timeout_s,
            client_pid=os.getpid(),
        )
        started = WorkerProcess(setup)
        with on_failure(
            lambda: started.close(s.close_timeout_s)
        ):  # so that no program of ours is left running
            started.wait_ready(s.start_timeout_s)
        self._worker, self._powered_state = started, started.state
        self._raised_faults.clear()
        self._stop_number = None
        self._has_rotated = False
        if self._powered_state is not None:
            self._rotation = self._powered_state.pose[3:]

    def close(self) -> None:
        """Brake if necessary, end the program on the controller and the worker."""
        if self._worker is not None:
            self._worker.close(self._settings.close_timeout_s)
            self._worker = None

    def __enter__(self) -> Self:
        if self._worker is None:
            self.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Start a straight move; False in a safety stop, DeviceFault when no program runs."""
        process, state = self._connected()
        rotation = state.pose[3:] if self._has_rotated else self._rotation
        target = (*target_m, *rotation)
        number = process.next_number()
        return self._start(messages.Move(number, target, speed_mps, acceleration_mps2), now_ns)

    def speed_l(
        self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Drive at a velocity while ``read`` is called; results as of ``move_l``."""
        process, state = self._connected()
        self._has_rotated = self._has_rotated or spin_radps != 0.0
        wx, wy, wz = (spin_radps * kinematics.rotation(state.pose[3:])[:, 2]).tolist()
        velocity, number = (*velocity_mps, wx, wy, wz), process.next_number()
        return self._start(messages.DriveArm(number, velocity, acceleration_mps2), now_ns)

    def _start(self, motion: messages.Move | messages.DriveArm, now_ns: int) -> bool:
        process, state = self._connected()
        if state.stopped_by_safety:
            return False
        if not state.program_running:
            raise _program_ended()
        self._stop_number = None
        self._heartbeat_ns = now_ns
        process.post(motion, self._settings.step_timeout_s)
        return True

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        """Brake. ``read`` confirms the stop by the speed, or raises DeviceFault."""
        process, state = self._connected()
        number = process.next_number()
        process.post(messages.Stop(number, deceleration_mps2), self._settings.step_timeout_s)
        braking_s = math.hypot(*state.velocity_mps) / deceleration_mps2
        self._stop_number, self._heartbeat_ns = number, now_ns
        self._stop_deadline_ns = now_ns + round((braking_s + self._settings.stop_margin_s) * 1e9)

    def set_payload(self, mass_kg: float) -> None:
        """Set the payload and wait until the controller has accepted it; repeated at each
        connection."""
        process, _ = self._connected()
        command = messages.SetPayload(process.next_number(), mass_kg, self._settings.cog_m)
        outcome = process.call(command, self._settings.step_timeout_s)
        if outcome is not Outcome.DONE:
            raise Refused(f"the arm controller did not accept the payload: {outcome}", SEE_PENDANT)
        self._payload_kg = mass_kg

    def read(self, now_ns: int) -> ArmSample:
        """Latest sample; raises each fault once at its onset, a lost link every time.

        Position, velocity and joints are those of the last sample with power on the motors: without
        power a controller reports a pose that the tool does not have.
        """
        process, state = self._connected()
        if now_ns - self._heartbeat_ns >= _HEARTBEAT_NS:
            self._heartbeat_ns = now_ns
            process.send_heartbeat()
        if state.robot_mode == ROBOT_RUNNING:
            self._powered_state = state
        self._raise_faults(process, state)
        self._confirm_stop(process, state, now_ns)
        trusted = self._powered_state or state
        powered = trusted is state
        return ArmSample(
            t_ns=round(state.timestamp_s * 1e9),
            position_m=trusted.pose[:3],
            velocity_mps=state.velocity_mps if powered else (0.0, 0.0, 0.0),
            moving=powered and state.moving,
            protective_stop=state.stopped_by_safety,
            angle_rad=self._angle(trusted.pose[3:]),
            spin_radps=_along_axis(trusted) if powered else 0.0,
            speed_fraction=state.speed_fraction,
            joints_rad=trusted.joints_rad,
        )

    def _angle(self, rotation: Vector3) -> float:
        """Rotation about the tool's z axis since the link was connected."""
        if not self._has_rotated:
            return 0.0
        start, present = kinematics.rotation(self._rotation), kinematics.rotation(rotation)
        return kinematics.rotation_vector(start.T @ present)[2]

    def _connected(self) -> tuple[WorkerProcess, State]:
        process = self._worker
        if process is None:
            raise LinkLost("the arm link is not connected", "connect it first")
        process.check()
        state = process.state
        if state is None:
            raise LinkLost("the arm controller sent no sample yet", START_AGAIN)
        return process, state

    def _raise_faults(self, process: WorkerProcess, state: State) -> None:
        """Raise each fault once, at its onset. The driver raises protective stops itself."""
        failure = process.next_failure()
        stopped = state.stopped_by_safety
        safety_stop = DeviceFault(
            f"the arm is stopped by its safety system (bits {state.safety_bits:#x})",
            "release the emergency stop or close the safeguard, power the robot on at the "
            "teach pendant, then start the run again",
        )
        no_power = DeviceFault(
            f"the arm's motors are off (robot mode {state.robot_mode})",
            "power the robot on at the teach pendant, then start the run again",
        )
        for name, present, fault in (
            ("stop", state.emergency_stop, safety_stop),
            ("mode", state.robot_mode != ROBOT_RUNNING and not stopped, no_power),
            ("program", not state.program_running and not stopped, _program_ended()),
        ):
            if not present:
                self._raised_faults.discard(name)
            elif name not in self._raised_faults:
                self._raised_faults.add(name)
                raise fault
        if failure is Outcome.NOT_ACCEPTED:
            raise Refused("the arm controller did not accept a command", SEE_PENDANT)

    def _confirm_stop(self, process: WorkerProcess, state: State, now_ns: int) -> None:
        number = self._stop_number
        if number is None:
            return
        if not state.moving and not process.is_pending(number):
            self._stop_number = None
        elif now_ns > self._stop_deadline_ns:
            self._stop_number = None
            process.kill()  # ends the watchdog's kicks, so the controller ends the program
            raise DeviceFault(
                "the arm did not stop on command; its program is being ended",
                f"press the emergency stop if it still moves; {START_AGAIN}",
            )


def _program_ended() -> DeviceFault:
    return DeviceFault(
        "the program on the arm controller has ended",
        "look at the log of the teach pendant, whether it was turned to Local, and whether this "
        f"computer was too busy to keep the program's watchdog alive; {START_AGAIN}",
    )


def _along_axis(state: State) -> float:
    """Spin about the tool's z axis, rad/s."""
    return float(kinematics.rotation(state.pose[3:])[:, 2] @ state.angular_velocity_radps)
