"""Recordings in which something shakes or moves what is touched, which the paper's data set lacks.

A fixed surface is pressed as in the acquisition, without strokes, while a script disturbs it; both
labels of slip say whether the contact truly moves, and `slip` leaves out what slides and goes
nowhere. Or three fingers grasp an object that was drawn for the recording, in the lift's own cell
(contact of level L1, or L3 from an impact on that may turn it), mostly without a reaction to slip;
`slip` says whether the object slides, as a detector can feel it (``as_felt``).
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, Literal, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Act, Metadata, Recording
from drivers.interfaces import PERIOD_S
from grasp.controller import GraspController
from grasp.loop import Tick
from grasp.settings import Layer, load
from grasp.states import OPEN_STATES
from scenarios.acquire.config import AcquireConfig, layout_file, with_values
from scenarios.acquire.datasets.disturbances import Disturbances, Done, GripTrials, Performer
from scenarios.acquire.datasets.drawn_objects import relaxed_n
from scenarios.acquire.labels import TURN_LEVER_M, Floats, moved, recording, slip_label
from scenarios.acquire.press import PressController, StrokeMotion
from scenarios.acquire.session import Script, Session, open_acquire_rig
from scenarios.lift.lift import LiftConfig
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
EAGER_COUNTS = 0.2  # threshold of a detector that takes anything for slip: the hand tightens
SILENT_COUNTS = 500.0  # of one that never detects slip
HOLDS_S, HOLDS_SHORTLY_S, HOLDS_LONG_S = 1.5, 0.2, 600.0  # at the top; the last, until it ends
LEAST_SLIP_M = 0.0005
FELT_SAMPLES = 8  # what a detector may take to be sure of a slip, however short
WATCHED_S = 0.4  # after an act is over, its object has come to rest
# These fingertips are drawn, unlike any that the plausibility checks were measured on, and none is
# broken: no check ends a recording, nor does what they make of a force.
TRUSTED = {
    "monitors.mode": "report", "monitors.jump_counts": 1023,
    "guard.measured_margin_n": 50.0, "controller.contact_n": 0.1,
    "tactile.rest_max_std_counts": 20.0,  # a drawn fingertip may be restless; a run would refuse it
}  # fmt: skip
NOTHING = {  # stands in for an object that is not drawn yet
    "name": "nothing", "grip_counts": [0, 0, 0], "mass_kg": 1.0, "friction_static": 1.0,
    "friction_kinetic": 1.0, "wall_stiffness_npm": 1e5, "half_width_m": 0.04,
}  # fmt: skip


def _config(body: dict[str, Any], layout: str) -> LiftConfig:
    held = Layer("drawn", {"object": body})
    return load(LiftConfig, trial_layers(held, "simulated", "energy", layout_file(layout)))


@cache
def bare_config(layout: str) -> LiftConfig:
    """Settings of a lift before any object or number is drawn."""
    return _config(NOTHING, layout)


def lift_config(metadata: Metadata, asked: Disturbances | None, turns: bool) -> LiftConfig:
    """A lift of the object that was drawn. An eager detector where the hand is to tighten, else one
    that never detects slip."""
    tightens = metadata.cause == "grasped_closing_and_tightening"
    fixed: dict[str, Any] = TRUSTED | {
        "energy.threshold_counts": EAGER_COUNTS if tightens else SILENT_COUNTS,
        "controller.hold_s": HOLDS_S if asked is None else HOLDS_LONG_S,
    }
    if metadata.cause == "grasped_set_down":
        fixed["controller.hold_s"] = HOLDS_SHORTLY_S
    if asked is not None and asked.firm:
        fixed |= {"controller.firm": True, "controller.reactions": False}
    fixed["world.impact_level"] = "L3" if turns else "L1"  # L4 costs more than it adds to a signal
    return with_values(_config(metadata.object, metadata.layout), fixed | metadata.parameters)


def make_grasped(
    metadata: Metadata, samples: int, asked: Disturbances | None, source: str
) -> Recording:
    """The last so many samples of a lift and of what is done on the way; fewer where it ends."""
    rng = np.random.default_rng([metadata.seed, 3])
    turns = asked is not None and bool(rng.random() < asked.turning)
    config = lift_config(metadata, asked, turns)
    seen: list[tuple[Tick, Truth]] = []
    with open_rig(config, metadata.seed, paced=False) as rig:
        performer = None
        if asked is not None and isinstance(rig.cell, SimulatedCell):
            performer = Performer(asked, _trials(config, asked, turns, rng), rig.cell, rng)

        def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
            if tick.frame is not None and truth is not None:
                seen.append((tick, truth))

        def follow(tick: Tick, truth: Truth | None) -> bool:
            return performer is not None and performer.take(tick, truth)

        run_trial(config, rig, make_guard(config), watch, follow)
    frames = PadFrames.at(math.radians(config.fingertip.slip_direction_deg))
    acts = _acts(performer.done if performer is not None else [], seen[-samples:])
    metadata = msgspec.structs.replace(metadata, acts=acts)
    return _of_lift(seen[-samples:], frames, metadata, source)


def _trials(
    config: LiftConfig, asked: Disturbances, turns: bool, rng: np.random.Generator
) -> GripTrials:
    grip_n = config.guard.full_grip_n
    if not asked.firm:
        grip_n = relaxed_n(
            config.object, config.contact, config.hand.m_per_count, config.object.grip_counts
        )
    return GripTrials(config.object, config.contact, grip_n, turns, rng)


def _acts(done: Sequence[Done], seen: Sequence[tuple[Tick, Truth]]) -> tuple[Act, ...]:
    """What came of each: where the object was before it, meanwhile, and at rest afterwards."""
    t_s = np.array([tick.t_ns * 1e-9 for tick, _ in seen])
    places = _places([truth for _, truth in seen])
    acts = []
    for act in done:
        first = int(np.searchsorted(t_s, act.from_s, side="right")) - 1
        last = int(np.searchsorted(t_s, act.until_s + WATCHED_S, side="right")) - 1
        if first < 0 or last <= first:
            continue
        way = np.linalg.norm(places[first : last + 1] - places[first], axis=1)
        acts.append(Act(
            t_s=float(act.from_s - t_s[0]), kind=act.kind, direction=act.direction,
            impulse_n_s=act.impulse_n_s, furthest_m=float(way.max()), moved_m=float(way[-1]),
        ))  # fmt: skip
    return tuple(acts)


def _places(truths: Sequence[Truth]) -> Floats:
    """Where the object is in the hand, (n, 3), m: down, across, and how far it has turned."""
    return np.array([
        (truth.slip_distance_m, truth.across_m, TURN_LEVER_M * truth.turn_rad) for truth in truths
    ])  # fmt: skip


def _of_lift(
    seen: Sequence[tuple[Tick, Truth]], frames: PadFrames, metadata: Metadata, source: str
) -> Recording:
    ticks = [tick for tick, _ in seen]
    t_s = np.array([(tick.t_ns - ticks[0].t_ns) * 1e-9 for tick in ticks])
    places = _places([truth for _, truth in seen])
    # a hand that has let go may graze what it leaves: the detector is off, and nothing is slip
    held = np.array([t.touched and tick.decision.state not in OPEN_STATES for tick, t in seen])
    steps = np.diff(places, axis=0, prepend=places[:1]) * held[:, None]
    steps /= np.diff(t_s, prepend=t_s[0] - PERIOD_S)[
        :, None
    ]  # an impact's slip lies between samples
    speed, turn = np.hypot(*steps[:, :2].T), abs(steps[:, 2]) / TURN_LEVER_M
    velocity, spin = _of_thumb(steps, frames)
    slides = slip_label(speed, turn)
    return Recording(
        t_s=t_s,
        counts=np.stack([tick.frame.counts for tick in ticks if tick.frame is not None]),
        slip=as_felt(slides, places), slip_true=slides, source=source, metadata=metadata,
        contact_speed_mps=speed.astype(np.float32), contact_turn_radps=turn.astype(np.float32),
        velocity_mps=velocity.astype(np.float32), spin_radps=spin.astype(np.float32),
        moved_m=moved(t_s, places, held).astype(np.float32),
    )  # fmt: skip


def _of_thumb(steps_mps: Floats, frames: PadFrames) -> tuple[Floats, Floats]:
    """Velocity (n, 2) along x and y of the thumb's fingertip, and spin (n,), of that fingertip over
    the object, whose own motion down, across and round the hand is ``steps_mps`` (n, 3).

    The other two face it: theirs is mirrored at the line that is upwards in the scene.
    """
    down, across, turn = steps_mps.T
    velocity = np.outer(down, frames.up[0]) - np.outer(across, frames.across[0])
    return velocity, -frames.turns[0] * turn / TURN_LEVER_M


def as_felt(slides: NDArray[np.bool_], places_m: Floats) -> NDArray[np.bool_]:
    """The label `slip` (n,) of an object with those places in the hand (n, d): what moves it less
    than half a millimetre for good is none (the pads give and swing back), and a short slip lasts
    until its traces have been read and felt.

    An impact lasts one or two samples, which reach the detector when the object is at rest.
    """
    label = np.zeros_like(slides)
    for first, end in _spans(slides):
        before, after = places_m[max(first - 1, 0)], places_m[min(end, len(places_m) - 1)]
        if np.linalg.norm(after - before) >= LEAST_SLIP_M:
            label[first : max(end, first + FELT_SAMPLES)] = True
    return label


def _spans(label: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First sample of each span of True, and the one after its last (spans, 2)."""
    return np.flatnonzero(np.diff(label, prepend=False, append=False)).reshape(-1, 2)


# Pressed on what is fixed

FixedCause = Literal[
    "contact_made_and_broken", "force_steps", "tap", "arm_vibration", "temperature_drift",
    "lost_samples", "steady",
]  # fmt: skip
SETTLED_S = 4.0  # of a session: rest, approach and settling are over before the first disturbance
MOST_LOST = 20  # samples in a row that do not end a session in which samples are lost

# Drawn evenly between these bounds; all assumed.
PAUSES_S = {  # from one act to the next
    "contact_made_and_broken": (2.0, 4.0),
    "force_steps": (0.4, 1.5),
    "tap": (0.4, 1.5),
    "arm_vibration": (0.5, 2.0),
}
STEPS_N = (1.2, 7.0)  # forces that are pressed with
KNOCKS_N_S = (0.005, 0.06)  # on a pressed pad
KNOCKS_S = (0.004, 0.015)


def make_pressed(
    bare: AcquireConfig, metadata: Metadata, samples: int, motion: StrokeMotion | None, source: str
) -> Recording:
    """So many samples of a pressed fingertip. ``bare``: before anything is drawn."""
    values = dict(metadata.parameters)
    if metadata.cause == "lost_samples":
        values["tactile.stale_after_missed"] = MOST_LOST
    config = with_values(bare, values)
    rng = np.random.default_rng([metadata.seed, 3])
    script = _script(metadata.cause, rng)
    with open_acquire_rig(config, metadata.seed, paced=False) as rig:
        session = Session(config, motion, metadata.seed, rig, script=script)
        session.run(samples, from_start=metadata.cause == "contact_made_and_broken")
    return _by_truth(recording(session.ticks, config, metadata, source))


def _script(cause: str, rng: np.random.Generator) -> Script:
    """What happens on the way; a cause that is all in the parameters has no script."""

    def act(controller: PressController, cell: PressedCell) -> None:
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
            act(controller, cell)

    return script


def _by_truth(made: Recording) -> Recording:
    """Static unless the contact truly moves, whatever the fingertip does: what slides less than
    LEAST_SLIP_M on end is a pad that is shaken where it is."""
    if made.slip_true is None or made.contact_speed_mps is None or made.contact_turn_radps is None:
        raise ValueError("a recording without truth cannot be labelled by it")
    speed_mps = np.hypot(made.contact_speed_mps, TURN_LEVER_M * made.contact_turn_radps)
    way_m = speed_mps * np.diff(made.t_s, prepend=made.t_s[0] - PERIOD_S)
    label = made.slip_true.copy()
    for first, end in _spans(made.slip_true):
        label[first:end] = way_m[first:end].sum() >= LEAST_SLIP_M
    return msgspec.structs.replace(made, slip=label)
