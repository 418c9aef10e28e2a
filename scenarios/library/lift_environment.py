"""The gymnasium environment `grasp/Lift-v0`: a policy lifts an object on the simulated rig.

`import grasp.gym` registers it. One step is one control step of 10 ms in virtual time.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from drivers.errors import Refused, UsageError
from drivers.interfaces import PERIOD_NS, ArmState, GripperState, TactileFrame
from grasp.control.commands import MoveFingers
from grasp.policy_reflex import Admitted, PolicyCommand
from scenarios.campaign.config import load_config
from scenarios.library.episode_recording import EpisodeRecording
from scenarios.library.reflex import make_reflex
from scenarios.lift.scoring import LIFTED_M
from scenarios.report.animation import frame_drawer
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import wider
from scenarios.rigs.rig import GraspRig
from scenarios.rigs.simulated import simulated
from scenarios.trial.execution import PRESHAPE_COUNTS, THUMB_BACK_COUNTS
from scenarios.trial.run_folder import check_runs
from scenarios.world.settings import HALF_APERTURE_M
from scenarios.world.truth import Truth

Floats = NDArray[np.float32]
TOP_M = 0.25  # highest position of the arm above the grasp
SPAN_COUNTS = 5  # from a finger's position to its target, at most; assumed
REST_TRIES = 5  # of rest counts that may be unsteady by chance; assumed
BRAKE_S = 0.2  # the arm is no faster than its distance from either end over this time
DROP_REWARD = -100.0
CHOICES = {"reflex": "True or False", "reward": "'sparse' or 'dense'",
           "render_mode": "None or 'rgb_array'"}  # fmt: skip


class LiftEnvironment(gymnasium.Env[dict[str, Floats], Floats], EzPickle):
    """Grasp an object and lift it; the fingers start just short of the object.

    Observation: ``taxels`` (3, taxels) counts, ``fingers`` (3,) position counts, ``force_n`` (3,)
    estimated force, ``arm`` (2,) height above the start in m and vertical speed in m/s.

    Action (4,), each -1 to 1: target of fingers A, B, C from their present positions in units of 5
    counts (positive: closing), and vertical speed of the arm in units of 0.1 m/s. The fingers move
    at 22 mm/s. Every action passes the force guard. No action releases an object which the reflex
    holds.

    Reward of a step: ``sparse``: 1 while the object is off the table and touched. ``dense``:
    0.5 min(1, g / 5 N) + 2 h / 0.25 m - 0.1 s, with g the true force of the thumb or of B and C
    together, the smaller one; h the object's height; s the slip in mm since the step before, if it
    touched the object. Both are -100 where the object drops, which ends the episode. Examples.

    ``info`` alone has the truth of the simulation, as numbers: ``height_m``, ``slip_m``,
    ``touched`` (by a finger), ``held`` (off the table and touched), ``dropped``, ``peak_force_n``
    (highest so far), ``is_success`` (held, and no force so far above the limit and its overshoot);
    also ``commanded_force_n`` (of this step's command, 0 without one), ``slip_registered``, and the
    one object ``admitted``, the result of the reflex (`grasp.policy_reflex.Admitted`).

    A copy, by `copy` or `pickle`, has the same arguments and no episode: call its ``reset``.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": round(1e9 / PERIOD_NS)}  # noqa: RUF012

    def __init__(
        self,
        object: str | Path = "can",  # noqa: A002  (as in `grasp.lift`)
        *,
        reflex: bool = True,
        detector: str | Path | None = None,
        reward: str = "sparse",
        render_mode: str | None = None,
        runs: str | Path | None = None,
    ) -> None:
        """``object``, ``detector``: as for `grasp.lift`. ``reflex``: False: the force guard acts
        alone. ``reward``: ``sparse`` or ``dense``. ``options`` of ``reset`` with these names take
        their place for one episode. ``render_mode``: None, or ``rgb_array`` (extra `exports`).
        ``runs``: folder that gets a recording of each episode, for `grasp report`; the next
        ``reset``, or ``close``, completes it.
        Raises ConfigError, and UsageError for a value of a wrong type."""
        EzPickle.__init__(
            self, object, reflex=reflex, detector=detector, reward=reward,
            render_mode=render_mode, runs=runs,
        )  # fmt: skip
        self._options = {"object": object, "reflex": reflex, "detector": detector, "reward": reward}
        _check({**self._options, "render_mode": render_mode, "runs": runs})
        self.render_mode = render_mode
        self._draw = None if render_mode is None else frame_drawer()
        self._configure(self._options)
        self._runs = None if runs is None else Path(runs)
        check_runs(self._runs)
        self._recording: EpisodeRecording | None = None
        self._rig: GraspRig | None = None
        taxels = self._config.tactile.taxels
        self.action_space = Box(-1.0, 1.0, (4,))
        self.observation_space: gymnasium.Space[Any] = Dict({
            "taxels": Box(-1023.0, 1023.0, (3, taxels)), "fingers": Box(0.0, 255.0, (3,)),
            "force_n": Box(0.0, 1000.0, (3,)), "arm": Box(-1.0, 1.0, (2,)),
        })  # fmt: skip

    def _configure(self, options: dict[str, Any]) -> None:
        given = "hand.activation_s=0.1", f"controller.reactions={str(options['reflex']).lower()}"
        name, detector = (options[key] and str(options[key]) for key in ("object", "detector"))
        config = load_config(name, "simulated", detector, None, given)
        self._config, known = config.for_lift(), calibration(config)
        self._configured = options
        self._force_n = max(config.guard.force_limit_n, known.least_force_n)
        free_m = HALF_APERTURE_M - wider(config.object, config.variation).half_width_m
        b = max(0, round(free_m / known.m_per_count) - PRESHAPE_COUNTS)
        self._start = max(0, b - THUMB_BACK_COUNTS), b, b

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Floats], dict[str, Any]]:
        """Place the object between the open fingers, move them near it and take rest counts."""
        super().reset(seed=seed)
        if not isinstance(options, dict | None):
            raise UsageError(f"options: {options!r:.60} is no dict", 'give {"object": "ball"}')
        if unknown := sorted(map(str, (options or {}).keys() - self._options.keys())):
            raise UsageError(f"options: unknown {unknown}, known {[*self._options]}", "omit it")
        options = {**self._options, **(options or {})}
        _check(options)
        if options != self._configured:
            self._configure(options)
        self.close()
        world = int(self.np_random.integers(2**31))
        self._rig = rig = simulated(self._config.built_for(world), world, paced=False)
        self.reflex = make_reflex(self._config)
        devices, s = rig.devices, self._config.controller
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
        if self._runs is not None:
            self._recording = EpisodeRecording(self._runs, self._config, world, rig.clock)
        hold = PolicyCommand(hand=MoveFingers(self._start, s.grip_speed_mps, self._force_n))
        admitted = self.reflex.step(*self.states(), hold, t_ns=rig.clock.now_ns)
        self._truth = self._true_state()
        return self._observation(admitted), self._info(admitted, 0.0)

    def step(self, action: Floats) -> tuple[dict[str, Floats], float, bool, bool, dict[str, Any]]:
        """Do one control step with this action; never truncates. Raises ValueError for an action
        that is not four finite numbers."""
        action = np.asarray(action, np.float32)
        if action.shape != self.action_space.shape or not np.isfinite(action).all():
            raise ValueError(f"the action {action.tolist()} is not four finite numbers")
        frame, gripper, arm = self.states()
        s, rig = self._config.controller, self._open_rig
        *fingers, rise = np.clip(action, -1.0, 1.0).tolist()
        a, b, c = (
            min(255, max(0, round(at + SPAN_COUNTS * to)))
            for at, to in zip(gripper.positions, fingers, strict=True)
        )
        height_m = min(TOP_M, max(0.0, arm.position_m[2] - self._home_m))
        # the ends are approached slowly
        speed_mps = max(rise * s.lift_speed_mps, -height_m / BRAKE_S)
        speed_mps = min(speed_mps, (TOP_M - height_m) / BRAKE_S)
        wanted = PolicyCommand(
            hand=MoveFingers((a, b, c), s.grip_speed_mps, self._force_n),
            arm_velocity_mps=(0.0, 0.0, speed_mps),
        )
        admitted = self.reflex.step(frame, gripper, arm, wanted, t_ns=rig.clock.now_ns)
        applied = admitted.send(rig.devices.gripper, rig.arm)
        if self._recording is not None and self.reflex.last_step is not None:
            self._recording.write(self.reflex.last_step, wanted, admitted, applied, self._truth)
        self._wait()
        before, self._truth = self._truth, self._true_state()
        info = self._info(admitted, 0.0 if applied is None else applied.force_n)
        dense = self._configured["reward"] == "dense"
        reward = _dense_reward(before, self._truth) if dense else float(info["held"])
        reward = DROP_REWARD if info["dropped"] else reward
        return self._observation(admitted), reward, info["dropped"], False, info

    def close(self) -> None:
        """Complete the recording of the episode; raises CouldNotRecord."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.close()

    def render(self) -> NDArray[np.uint8] | None:
        """Side view in the frame of the hand, (height, width, 3); None without a render mode."""
        if self._draw is None:
            return None
        rig, truth = self._open_rig, self._truth
        text = f"{rig.clock.now_ns * 1e-9:.2f} s, {1e3 * truth.height_m:.0f} mm above the table"
        return self._draw(truth.slip_distance_m, np.array(truth.normal_n), text)

    @property
    def _open_rig(self) -> GraspRig:
        if self._rig is None:
            raise ResetNeeded("call reset first; a copy of an environment has no episode")
        return self._rig

    def _true_state(self) -> Truth:
        truth = self._open_rig.truth()
        assert truth is not None  # noqa: S101
        return truth

    def _wait(self) -> None:
        """Advance the world by one control period and read all devices."""
        clock, devices = self._open_rig.clock, self._open_rig.devices
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        for device in (devices.tactile, devices.gripper, devices.arm):
            device.poll(clock.now_ns)

    def states(self) -> tuple[TactileFrame, GripperState, ArmState]:
        """Latest fingertip frame and states of gripper and arm, as the reflex takes them."""
        devices = self._open_rig.devices
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
        truth, guard = self._truth, self._config.guard
        up, peak_n = truth.height_m >= LIFTED_M, max(truth.peak_n)
        self._lifted, held = self._lifted or up, up and truth.touched
        within = peak_n <= guard.force_limit_n + guard.overshoot_n
        return {
            "height_m": truth.height_m, "slip_m": truth.slip_distance_m,
            "touched": truth.touched, "held": held,
            "dropped": self._lifted and not truth.touched, "is_success": held and within,
            "peak_force_n": peak_n, "commanded_force_n": commanded_n,
            "slip_registered": admitted.slip.registered, "admitted": admitted,
        }  # fmt: skip


def _check(options: Mapping[str, Any]) -> None:
    """Raise UsageError for a value of a wrong type."""
    for name, value in options.items():
        if name in CHOICES:
            if repr(value) not in CHOICES[name].split(" or "):
                raise UsageError(f"{name}: {value!r} is not {CHOICES[name]}", "give one of them")
        elif not isinstance(value, str | Path) and (value is not None or name == "object"):
            raise UsageError(f"{name}: {value!r} is neither a name nor a path", "give a text")


def _dense_reward(before: Truth, now: Truth) -> float:
    """See `LiftEnvironment`; the weights are assumed."""
    thumb_n, b_n, c_n = now.normal_n
    slip_mm = 1e3 * (now.slip_distance_m - before.slip_distance_m) if before.touched else 0.0
    grip = min(1.0, min(thumb_n, b_n + c_n) / 5.0)
    return 0.5 * grip + 2.0 * now.height_m / TOP_M - 0.1 * slip_mm
