"""The gymnasium environment `grasp/Lift-v0`: a policy lifts an object on the simulated rig.

`import grasp.gym` registers it. One step is one control step of 10 ms in virtual time.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from drivers.errors import Refused
from drivers.interfaces import PERIOD_NS, ArmState, GripperState, TactileFrame
from grasp.control.commands import MoveFingers
from grasp.policy_reflex import Admitted, PolicyCommand
from scenarios.campaign.config import load_config
from scenarios.library.reflex import make_reflex
from scenarios.lift.scoring import LIFTED_M
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import wider
from scenarios.rigs.simulated import simulated
from scenarios.trial.execution import PRESHAPE_COUNTS, THUMB_BACK_COUNTS
from scenarios.world.settings import HALF_APERTURE_M

Floats = NDArray[np.float32]
TOP_M = 0.25  # highest position of the arm above the grasp
SPAN_COUNTS = 5  # from a finger's position to its target, at most; assumed
REST_TRIES = 5  # of rest counts that may be unsteady by chance; assumed
BRAKE_S = 0.2  # the arm is no faster than its distance from either end over this time
DROP_REWARD = -100.0


class LiftEnvironment(gymnasium.Env[dict[str, Floats], Floats]):
    """Grasp an object and lift it; the fingers start just short of the object.

    Observation: ``taxels`` (3, taxels) counts, ``fingers`` (3,) position counts, ``force_n`` (3,)
    estimated force, ``arm`` (2,) height above the start in m and vertical speed in m/s.

    Action (4,), each -1 to 1: target of fingers A, B, C from their present positions in units of 5
    counts (positive: closing), and vertical speed of the arm in units of 0.1 m/s. The fingers move
    at 22 mm/s. Every action passes the force guard. No action releases an object which the reflex
    holds.

    Reward, an example: 1 while the object is off the table, -100 where it drops, which ends the
    episode.

    ``info`` alone has the truth of the simulation: ``height_m``, ``slip_m``,
    ``touched`` (by a finger), ``held`` (off the table and touched), ``dropped``, ``peak_force_n``
    (highest so far); also ``commanded_force_n``
    (of this step's command, 0 without one) and ``admitted``, the result of the reflex.
    """

    def __init__(
        self,
        object: str = "can",  # noqa: A002  (as in `grasp.lift`)
        *,
        reflex: bool = True,
        detector: str | None = None,
    ) -> None:
        """``object``, ``detector``: as for `grasp.lift`. ``reflex``: False: the force guard acts
        alone. ``options`` of ``reset`` with these names take their place. Raises ConfigError."""
        self._options = {"object": object, "reflex": reflex, "detector": detector}
        self._configure(self._options)
        taxels = self._config.tactile.taxels
        self.action_space = Box(-1.0, 1.0, (4,))
        self.observation_space: gymnasium.Space[Any] = Dict({
            "taxels": Box(-1023.0, 1023.0, (3, taxels)), "fingers": Box(0.0, 255.0, (3,)),
            "force_n": Box(0.0, 1000.0, (3,)), "arm": Box(-1.0, 1.0, (2,)),
        })  # fmt: skip

    def _configure(self, options: dict[str, Any]) -> None:
        settings = (
            "hand.activation_s=0.1", f"controller.reactions={str(bool(options['reflex'])).lower()}"
        )  # fmt: skip
        config = load_config(options["object"], "simulated", options["detector"], None, settings)
        self._config, known = config.for_lift(), calibration(config)
        self._force_n = max(config.guard.force_limit_n, known.least_force_n)
        free_m = HALF_APERTURE_M - wider(config.object, config.variation).half_width_m
        b = max(0, round(free_m / known.m_per_count) - PRESHAPE_COUNTS)
        self._start = max(0, b - THUMB_BACK_COUNTS), b, b

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Floats], dict[str, Any]]:
        """Place the object between the open fingers, move them near it and take rest counts."""
        super().reset(seed=seed)
        if options is not None:
            if unknown := sorted(options.keys() - self._options.keys()):
                raise ValueError(f"unknown options: {unknown}, allowed: {[*self._options]}")
            self._configure({**self._options, **options})
        world = int(self.np_random.integers(2**31))
        self._rig = simulated(self._config.built_for(world), world, paced=False)
        self.reflex = make_reflex(self._config)
        devices, s = self._rig.devices, self._config.controller
        devices.gripper.move_to(self._start, s.approach_speed_mps, self._force_n)
        self._wait()
        while devices.gripper.state is None or not devices.gripper.state.at_rest:
            self._wait()
        for tries in range(1, REST_TRIES + 1):
            devices.tactile.begin_rest()
            try:
                while not devices.tactile.rest_taken:
                    self._wait()
            except Refused:  # unsteady by chance: take it again
                if tries == REST_TRIES:
                    raise
            else:
                break
        self._home_m, self._lifted = self.states()[2].position_m[2], False
        hold = PolicyCommand(hand=MoveFingers(self._start, s.grip_speed_mps, self._force_n))
        admitted = self.reflex.step(*self.states(), hold, t_ns=self._rig.clock.now_ns)
        return self._observation(admitted), self._info(admitted, 0.0)

    def step(self, action: Floats) -> tuple[dict[str, Floats], float, bool, bool, dict[str, Any]]:
        """Do one control step with this action; never truncates. Raises ValueError for an action
        that is not four finite numbers."""
        action = np.asarray(action, np.float32)
        if action.shape != self.action_space.shape or not np.isfinite(action).all():
            raise ValueError(f"the action {action.tolist()} is not four finite numbers")
        frame, gripper, arm = self.states()
        s, devices = self._config.controller, self._rig.devices
        *fingers, rise = np.clip(action, -1.0, 1.0).tolist()
        a, b, c = (
            min(255, max(0, round(at + SPAN_COUNTS * to)))
            for at, to in zip(gripper.positions, fingers, strict=True)
        )
        height_m = min(TOP_M, max(0.0, arm.position_m[2] - self._home_m))
        speed_mps = max(
            rise * s.lift_speed_mps, -height_m / BRAKE_S
        )  # the ends are approached slowly
        speed_mps = min(speed_mps, (TOP_M - height_m) / BRAKE_S)
        wanted = PolicyCommand(
            hand=MoveFingers((a, b, c), s.grip_speed_mps, self._force_n),
            arm_velocity_mps=(0.0, 0.0, speed_mps),
        )
        admitted = self.reflex.step(frame, gripper, arm, wanted, t_ns=self._rig.clock.now_ns)
        applied = admitted.send(devices.gripper, devices.arm)
        self._wait()
        info = self._info(admitted, 0.0 if applied is None else applied.force_n)
        reward = DROP_REWARD if info["dropped"] else float(info["held"])
        return self._observation(admitted), reward, info["dropped"], False, info

    def _wait(self) -> None:
        """Advance the world by one control period and read all devices."""
        clock, devices = self._rig.clock, self._rig.devices
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        for device in (devices.tactile, devices.gripper, devices.arm):
            device.poll(clock.now_ns)

    def states(self) -> tuple[TactileFrame, GripperState, ArmState]:
        """Latest fingertip frame and states of gripper and arm, as the reflex takes them."""
        devices = self._rig.devices
        frame, gripper, arm = devices.tactile.frame, devices.gripper.state, devices.arm.state
        assert frame is not None and gripper is not None and arm is not None  # noqa: S101
        return frame, gripper, arm

    def _observation(self, admitted: Admitted) -> dict[str, Floats]:
        frame, gripper, arm = self.states()
        return {
            "taxels": frame.counts.astype(np.float32),
            "fingers": np.array(gripper.positions, np.float32),
            "force_n": np.array(admitted.estimated_force_n, np.float32),
            "arm": np.array([arm.position_m[2] - self._home_m, arm.velocity_mps[2]], np.float32),
        }

    def _info(self, admitted: Admitted, commanded_n: float) -> dict[str, Any]:
        truth = self._rig.truth()
        assert truth is not None  # noqa: S101
        up = truth.height_m >= LIFTED_M
        self._lifted = self._lifted or up
        return {
            "height_m": truth.height_m, "slip_m": truth.slip_distance_m,
            "touched": truth.touched, "held": up and truth.touched,
            "dropped": self._lifted and not truth.touched,
            "peak_force_n": max(truth.peak_n), "commanded_force_n": commanded_n,
            "admitted": admitted,
        }  # fmt: skip
