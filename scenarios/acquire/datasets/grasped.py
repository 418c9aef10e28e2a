"""What three fingers feel of an object that was drawn for the recording: in the lift's own cell
(contact of level L1, or L3 from a blow on that may turn it), nobody reacting unless it is said.

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
from grasp.phases import OPEN_PHASES
from grasp.settings import Layer, load
from scenarios.acquire.config import SamplingSettings
from scenarios.acquire.datasets.acts import Acts, Done, Performer
from scenarios.acquire.datasets.bench import Bench
from scenarios.acquire.datasets.bodies import relaxed_n
from scenarios.acquire.datasets.draws import layout_file, with_values
from scenarios.acquire.labels import slip_label
from scenarios.acquire.rest import TURN_LEVER_M, moved
from scenarios.lift.lift import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.execution import make_guard, run_trial
from scenarios.trial.layers import trial_layers
from scenarios.world.cell import SimulatedCell
from scenarios.world.contact import PadFrames
from scenarios.world.truth import Truth

GraspedCause = Literal[
    "grasped_closing_and_tightening", "grasped_lift_acceleration", "grasped_uneven_load",
    "grasped_set_down", "grasped_slip", "grasped_tap", "grasped_blow", "grasped_touch",
    "grasped_pull", "grasped_drag", "grasped_arm_vibration",
]  # fmt: skip
GRASPED: tuple[str, ...] = get_args(GraspedCause)
EAGER_COUNTS = 0.2  # threshold of a detector that hears slip in anything: the hand tightens
SILENT_COUNTS = 500.0  # of one that never speaks
HOLDS_S, HOLDS_SHORTLY_S, HOLDS_LONG_S = 1.5, 0.2, 600.0  # at the top; the last, until told
LEAST_SLIP_M = 0.0005
FELT_SAMPLES = 8  # what a detector may take to be sure of a slip, however short
WATCHED_S = 0.4  # after an act is over, its object has come to rest
# These fingertips are drawn, unlike any that the controller's doubts were measured on, and none is
# broken: nobody doubts them, and what they make of a force ends no recording.
TRUSTED = {
    "doubt.frozen_samples": 1000, "doubt.dead_samples": 10_000,
    "doubt.dead_unloaded_samples": 10_000, "doubt.rail_samples": 100, "doubt.jump_counts": 1023,
    "guard.measured_margin_n": 50.0, "controller.contact_n": 0.1,
    "tactile.rest_max_std_counts": 20.0,  # a drawn fingertip may be restless; a run would refuse it
}  # fmt: skip
NOTHING = {  # stands in for an object that is not drawn yet
    "name": "nothing", "grip_counts": [0, 0, 0], "mass_kg": 1.0, "friction_static": 1.0,
    "friction_kinetic": 1.0, "wall_stiffness_npm": 1e5, "half_width_m": 0.04,
}  # fmt: skip


@cache
def bare_config(layout: str) -> LiftConfig:
    """Settings of a lift before any object or number is drawn."""
    return _config(NOTHING, layout)


def _config(body: dict[str, Any], layout: str) -> LiftConfig:
    held = Layer("drawn", {"object": body})
    return load(LiftConfig, trial_layers(held, "simulated", "energy", layout_file(layout)))


def lift_config(metadata: Metadata, acts: Acts | None, turns: bool) -> LiftConfig:
    """A lift of the object that was drawn. An eager detector where the hand is to tighten, else one
    that never speaks."""
    tightens = metadata.cause == "grasped_closing_and_tightening"
    fixed: dict[str, Any] = TRUSTED | {
        "energy.threshold_counts": EAGER_COUNTS if tightens else SILENT_COUNTS,
        "controller.hold_s": HOLDS_S if acts is None else HOLDS_LONG_S,
    }
    if metadata.cause == "grasped_set_down":
        fixed["controller.hold_s"] = HOLDS_SHORTLY_S
    if acts is not None and acts.firm:
        fixed |= {"controller.firm": True, "controller.reactions": False}
    fixed["world.blow_level"] = "L3" if turns else "L1"  # L4 costs more than it adds to a signal
    return with_values(_config(metadata.object, metadata.layout), fixed | metadata.parameters)


def make_grasped(metadata: Metadata, samples: int, acts: Acts | None, source: str) -> Recording:
    """The last so many samples of a lift and of what is done on the way; fewer where it ends."""
    rng = np.random.default_rng([metadata.seed, 3])
    turns = acts is not None and bool(rng.random() < acts.turning)
    config = lift_config(metadata, acts, turns)
    seen: list[tuple[Tick, Truth]] = []
    with open_rig(config, metadata.seed, paced=False) as rig:
        performer = None
        if acts is not None and isinstance(rig.cell, SimulatedCell):
            performer = Performer(acts, _bench(config, acts, turns, rng), rig.cell, rng)

        def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
            if tick.frame is not None and truth is not None:
                seen.append((tick, truth))

        def follow(tick: Tick, truth: Truth | None) -> bool:
            return performer is not None and performer.take(tick, truth)

        run_trial(config, rig, make_guard(config), watch, follow)
    frames = PadFrames.at(math.radians(config.fingertip.slip_direction_deg))
    made = _of_lift(seen[-samples:], frames, metadata, source)
    done = performer.done if performer is not None else []
    return msgspec.structs.replace(
        made, metadata=msgspec.structs.replace(metadata, acts=_acts(done, seen[-samples:]))
    )


def _bench(config: LiftConfig, acts: Acts, turns: bool, rng: np.random.Generator) -> Bench:
    grip_n = config.guard.full_grip_n
    if not acts.firm:
        grip_n = relaxed_n(
            config.object, config.contact, config.hand.m_per_count, config.object.grip_counts
        )
    return Bench(config.object, config.contact, grip_n, turns, rng)


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


def _places(truths: Sequence[Truth]) -> NDArray[np.float64]:
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
    # a hand that has let go may graze what it leaves: nobody listens, and nothing is slip
    held = np.array([t.touched and tick.decision.phase not in OPEN_PHASES for tick, t in seen])
    steps = np.diff(places, axis=0, prepend=places[:1]) * held[:, None]
    steps /= np.diff(t_s, prepend=t_s[0] - PERIOD_S)[:, None]  # a blow's slip lies between samples
    speed, turn = np.hypot(*steps[:, :2].T), abs(steps[:, 2]) / TURN_LEVER_M
    velocity, spin = _of_thumb(steps, frames)
    slides = slip_label(speed, turn, SamplingSettings())
    return Recording(
        t_s=t_s,
        counts=np.stack([tick.frame.counts for tick in ticks if tick.frame is not None]),
        slip=as_felt(slides, places),
        slip_true=slides,
        source=source,
        metadata=metadata,
        contact_speed_mps=speed.astype(np.float32),
        contact_turn_radps=turn.astype(np.float32),
        velocity_mps=velocity.astype(np.float32),
        spin_radps=spin.astype(np.float32),
        moved_m=moved(t_s, places, held).astype(np.float32),
    )


def _of_thumb(
    steps_mps: NDArray[np.float64], frames: PadFrames
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocity (n, 2) along x and y of the thumb's fingertip, and spin (n,), of that fingertip over
    the object, whose own motion down, across and round the hand is ``steps_mps`` (n, 3).

    The other two face it: theirs is mirrored at the line that is upwards in the scene.
    """
    down, across, turn = steps_mps.T
    velocity = np.outer(down, frames.up[0]) - np.outer(across, frames.across[0])
    return velocity, -frames.turns[0] * turn / TURN_LEVER_M


def as_felt(slides: NDArray[np.bool_], places_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The label `slip` (n,) of an object with those places in the hand (n, d): what moves it less
    than half a millimetre for good is none (the pads give and swing back), and a short slip lasts
    until its traces have been read and felt.

    A blow is over within one or two samples, which reach the detector when the object is at rest.
    """
    label = np.zeros_like(slides)
    edges = np.flatnonzero(np.diff(slides, prepend=False, append=False))
    for first, end in edges.reshape(-1, 2):
        before, after = places_m[max(first - 1, 0)], places_m[min(end, len(places_m) - 1)]
        if np.linalg.norm(after - before) >= LEAST_SLIP_M:
            label[first : max(end, first + FELT_SAMPLES)] = True
    return label
