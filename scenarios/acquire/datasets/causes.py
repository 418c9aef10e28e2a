"""Recordings with disturbances of the signal, which the paper's data set does not have.

Either a fixed surface is pressed without strokes while a script disturbs it: both labels use the
true motion of the contact, and `slip` omits sliding of less than LEAST_SLIP_M. Or three fingers
grasp a random object in the cell of a lift (contact level L1, or L3 for impacts that may turn the
object), mostly without slip response: `slip` is the sliding that a detector can detect
(``detectable_slip``).
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, Literal, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import AppliedDisturbance, Metadata, Recording
from drivers.interfaces import PERIOD_S
from grasp.control.controller import GraspController
from grasp.control.states import OPEN_STATES
from grasp.run.loop import Tick
from grasp.settings import Layer, load
from scenarios.acquire.config import AcquireConfig, layout_file, with_values
from scenarios.acquire.datasets.disturbances import (
    DisturbanceSettings,
    GripTrials,
    Performer,
    TimedDisturbance,
)
from scenarios.acquire.datasets.random_objects import first_grip_n
from scenarios.acquire.labels import TURN_LEVER_M, Floats, distance_moved, recording, slip_label
from scenarios.acquire.press import PressController, StrokeMotion
from scenarios.acquire.session import Script, Session, open_acquire_rig
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.execution import make_guard, run_trial
from scenarios.trial.layers import trial_layers
from scenarios.world.cell import SimulatedCell
from scenarios.world.contact import PadFrames
from scenarios.world.pressed_cell import PressedCell
from scenarios.world.truth import Truth

GraspedCause = Literal[
    "grasped_closing_and_tightening", "grasped_lift_acceleration", "grasped_uneven_load",
    "grasped_set_down", "grasped_slip", "grasped_tap", "grasped_impact", "grasped_touch",
    "grasped_pull", "grasped_drag", "grasped_arm_vibration",
]  # fmt: skip
GRASPED: tuple[str, ...] = get_args(GraspedCause)
EAGER_COUNTS = 0.2  # threshold of a detector that always detects slip: the hand tightens
SILENT_COUNTS = 500.0  # threshold of a detector that never detects slip
HOLD_S, SHORT_HOLD_S, LONG_HOLD_S = 1.5, 0.2, 600.0  # at the top; the last: until all is done
LEAST_SLIP_M = 0.0005
DETECTION_SAMPLES = 8  # time that a detector may need to detect a short slip
REST_AFTER_S = 0.4  # an object is at rest this long after the end of a disturbance
# Random fingertips differ from those that the plausibility checks were tuned on, and none is
# defective. So neither a check nor an estimated force ends a recording.
PERMISSIVE = {
    "monitors.mode": "report", "monitors.jump_counts": 1023,
    "guard.estimate_margin_n": 50.0, "controller.contact_n": 0.1,
    "tactile.rest_max_std_counts": 20.0,  # a run would refuse the noise of some fingertips
}  # fmt: skip
PLACEHOLDER = {  # object before a random one is chosen
    "name": "nothing", "grip_counts": [0, 0, 0], "mass_kg": 1.0, "friction_static": 1.0,
    "friction_kinetic": 1.0, "wall_stiffness_npm": 1e5, "half_width_m": 0.04,
}  # fmt: skip


def _config(body: dict[str, Any], layout: str) -> LiftConfig:
    layer = Layer("random object", {"object": body})
    return load(LiftConfig, trial_layers(layer, "simulated", "energy", layout_file(layout)))


@cache
def base_lift_config(layout: str) -> LiftConfig:
    """Settings of a lift before the random object and parameters are chosen."""
    return _config(PLACEHOLDER, layout)


def lift_config(
    metadata: Metadata, settings: DisturbanceSettings | None, turns: bool
) -> LiftConfig:
    """Settings of a lift of the recording's object. The detector always detects slip if the hand
    has to tighten, otherwise never."""
    tightens = metadata.cause == "grasped_closing_and_tightening"
    fixed: dict[str, Any] = PERMISSIVE | {
        "energy.threshold_counts": EAGER_COUNTS if tightens else SILENT_COUNTS,
        "controller.hold_s": HOLD_S if settings is None else LONG_HOLD_S,
    }
    if metadata.cause == "grasped_set_down":
        fixed["controller.hold_s"] = SHORT_HOLD_S
    if settings is not None and settings.firm:
        fixed |= {"controller.firm": True, "controller.reactions": False}
    fixed["world.impact_level"] = "L3" if turns else "L1"  # L4 hardly changes the signal
    return with_values(_config(metadata.object, metadata.layout), fixed | metadata.parameters)


def grasped_recording(
    metadata: Metadata, samples: int, settings: DisturbanceSettings | None, source: str
) -> Recording:
    """Recording of the last ``samples`` of a lift with disturbances, or of a shorter lift."""
    rng = np.random.default_rng([metadata.seed, 3])
    turns = settings is not None and bool(rng.random() < settings.turning)
    config = lift_config(metadata, settings, turns)
    observed: list[tuple[Tick, Truth]] = []
    with open_rig(config, metadata.seed, paced=False) as rig:
        performer = None
        if settings is not None and isinstance(rig.cell, SimulatedCell):
            trials = _trials(config, settings, turns, rng)
            performer = Performer(settings, trials, rig.cell, rng)

        def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
            if tick.frame is not None and truth is not None:
                observed.append((tick, truth))

        def follow(tick: Tick, truth: Truth | None) -> bool:
            return performer is not None and performer.take(tick, truth)

        run_trial(config, rig, make_guard(config), watch, follow)
    frames = PadFrames.at(math.radians(config.fingertip.slip_direction_deg))
    done = performer.done if performer is not None else []
    disturbances = _with_displacements(done, observed[-samples:])
    metadata = msgspec.structs.replace(metadata, disturbances=disturbances)
    return _lift_recording(observed[-samples:], frames, metadata, source)


def _trials(
    config: LiftConfig, settings: DisturbanceSettings, turns: bool, rng: np.random.Generator
) -> GripTrials:
    grip_n = config.guard.full_grip_n if settings.firm else first_grip_n(config)
    return GripTrials(config.object, config.contact, grip_n, turns, rng)


def _with_displacements(
    done: Sequence[TimedDisturbance], observed: Sequence[tuple[Tick, Truth]]
) -> tuple[AppliedDisturbance, ...]:
    """The disturbances with the object's displacement: the largest, and at rest afterwards."""
    t_s = np.array([tick.t_ns * 1e-9 for tick, _ in observed])
    positions = _positions([truth for _, truth in observed])
    applied = []
    for one in done:
        first = int(np.searchsorted(t_s, one.from_s, side="right")) - 1
        last = int(np.searchsorted(t_s, one.until_s + REST_AFTER_S, side="right")) - 1
        if first < 0 or last <= first:
            continue
        moved = np.linalg.norm(positions[first : last + 1] - positions[first], axis=1)
        applied.append(AppliedDisturbance(
            t_s=float(one.from_s - t_s[0]), kind=one.kind, direction=one.direction,
            impulse_n_s=one.impulse_n_s, furthest_m=float(moved.max()), moved_m=float(moved[-1]),
        ))  # fmt: skip
    return tuple(applied)


def _positions(truths: Sequence[Truth]) -> Floats:
    """Position of the object in the hand (n, 3), m: down, across, and angle times TURN_LEVER_M."""
    return np.array([
        (truth.slip_distance_m, truth.across_m, TURN_LEVER_M * truth.turn_rad) for truth in truths
    ])  # fmt: skip


def _lift_recording(
    observed: Sequence[tuple[Tick, Truth]], frames: PadFrames, metadata: Metadata, source: str
) -> Recording:
    ticks = [tick for tick, _ in observed]
    t_s = np.array([(tick.t_ns - ticks[0].t_ns) * 1e-9 for tick in ticks])
    positions = _positions([truth for _, truth in observed])
    # an open hand may touch the object while it retreats: the detector is off, so this is not slip
    held = np.array([t.touched and tick.decision.state not in OPEN_STATES for tick, t in observed])
    # speeds between samples, because the slip of an impact is over before the next sample
    steps = np.diff(positions, axis=0, prepend=positions[:1]) * held[:, None]
    steps /= np.diff(t_s, prepend=t_s[0] - PERIOD_S)[:, None]
    speed, turn = np.hypot(*steps[:, :2].T), abs(steps[:, 2]) / TURN_LEVER_M
    velocity, spin = _thumb_motion(steps, frames)
    slides = slip_label(speed, turn)
    return Recording(
        t_s=t_s,
        counts=np.stack([tick.frame.counts for tick in ticks if tick.frame is not None]),
        slip=detectable_slip(slides, positions), slip_true=slides, source=source, metadata=metadata,
        contact_speed_mps=speed.astype(np.float32), contact_turn_radps=turn.astype(np.float32),
        velocity_mps=velocity.astype(np.float32), spin_radps=spin.astype(np.float32),
        moved_m=distance_moved(t_s, positions, held).astype(np.float32),
    )  # fmt: skip


def _thumb_motion(steps_mps: Floats, frames: PadFrames) -> tuple[Floats, Floats]:
    """Velocity (n, 2) of the thumb's fingertip over the object along its x and y, and spin (n,),
    from the object's motion ``steps_mps`` (n, 3): down, across and rotation. The motion of the
    other two fingertips is mirrored at the upward direction."""
    down, across, turn = steps_mps.T
    velocity = np.outer(down, frames.up[0]) - np.outer(across, frames.across[0])
    return velocity, -frames.turns[0] * turn / TURN_LEVER_M


def detectable_slip(slides: NDArray[np.bool_], positions_m: Floats) -> NDArray[np.bool_]:
    """Label `slip` (n,) of an object with these positions in the hand (n, d). A lasting
    displacement below LEAST_SLIP_M is elastic motion of the pads, not slip. A short slip is
    extended to DETECTION_SAMPLES, because its samples reach the detector after it has ended."""
    label = np.zeros_like(slides)
    for first, end in _spans(slides):
        before, after = positions_m[max(first - 1, 0)], positions_m[min(end, len(positions_m) - 1)]
        if np.linalg.norm(after - before) >= LEAST_SLIP_M:
            label[first : max(end, first + DETECTION_SAMPLES)] = True
    return label


def _spans(label: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First sample of each span of True, and the one after its last (spans, 2)."""
    return np.flatnonzero(np.diff(label, prepend=False, append=False)).reshape(-1, 2)


# Pressing on a fixed surface

FixedCause = Literal[
    "contact_made_and_broken", "force_steps", "tap", "arm_vibration", "temperature_drift",
    "lost_samples", "steady",
]  # fmt: skip
SETTLED_S = 4.0  # time of the first disturbance, after rest, approach and settling
MAX_LOST = 20  # missed samples in a row that do not end a session with lost samples

# Uniform between these bounds; all assumed.
PAUSES_S = {  # between disturbances
    "contact_made_and_broken": (2.0, 4.0),
    "force_steps": (0.4, 1.5),
    "tap": (0.4, 1.5),
    "arm_vibration": (0.5, 2.0),
}
STEPS_N = (1.2, 7.0)  # target force
KNOCKS_N_S = (0.005, 0.06)  # impulse on a pressed pad
KNOCKS_S = (0.004, 0.015)


def pressed_recording(
    base: AcquireConfig, metadata: Metadata, samples: int, motion: StrokeMotion | None, source: str
) -> Recording:
    """Recording of a pressed fingertip. ``base``: settings without the random parameters."""
    values = dict(metadata.parameters)
    if metadata.cause == "lost_samples":
        values["tactile.stale_after_missed"] = MAX_LOST
    config = with_values(base, values)
    rng = np.random.default_rng([metadata.seed, 3])
    script = _script(metadata.cause, rng)
    with open_acquire_rig(config, metadata.seed, paced=False) as rig:
        session = Session(config, motion, metadata.seed, rig, script=script)
        session.run(samples, from_start=metadata.cause == "contact_made_and_broken")
    return _labelled_by_truth(recording(session.ticks, config, metadata, source))


def _script(cause: str, rng: np.random.Generator) -> Script:
    """Script of the disturbances of a cause; without effect if parameters alone define it."""

    def disturb(controller: PressController, cell: PressedCell) -> None:
        if cause == "contact_made_and_broken":
            controller.lift_off()
        elif cause == "force_steps":
            controller.target_n = float(rng.uniform(*STEPS_N))
        elif cause == "tap":
            cell.pad.knock(float(rng.uniform(*KNOCKS_N_S)), float(rng.uniform(*KNOCKS_S)))
        else:
            cell.shaken = not cell.shaken

    pauses_s = PAUSES_S.get(cause)
    due_s = SETTLED_S

    def script(t_s: float, controller: PressController, cell: PressedCell | None) -> None:
        nonlocal due_s
        if pauses_s is not None and t_s >= due_s and cell is not None:
            due_s = t_s + float(rng.uniform(*pauses_s))
            disturb(controller, cell)

    return script


def _labelled_by_truth(r: Recording) -> Recording:
    """The recording with the label `slip` from the true motion of the contact, without sliding of
    less than LEAST_SLIP_M, which is a vibrating pad."""
    if r.slip_true is None or r.contact_speed_mps is None or r.contact_turn_radps is None:
        raise ValueError("a recording without truth cannot be labelled by it")
    speed_mps = np.hypot(r.contact_speed_mps, TURN_LEVER_M * r.contact_turn_radps)
    slid_m = speed_mps * np.diff(r.t_s, prepend=r.t_s[0] - PERIOD_S)
    label = r.slip_true.copy()
    for first, end in _spans(r.slip_true):
        label[first:end] = slid_m[first:end].sum() >= LEAST_SLIP_M
    return msgspec.structs.replace(r, slip=label)
