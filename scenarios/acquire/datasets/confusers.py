"""What shakes a fingertip without slip: recordings that the paper's data set lacks.

Fixed objects are pressed as in the acquisition, without strokes, while a script disturbs them;
grasped ones are lifted by the lift's own cell (contact of level L1, one slip for all fingers), so
light that they are held. Both labels say whether the contact truly moves; `slip` as a detector can
feel it (`as_felt`).
"""

from collections.abc import Callable
from typing import Literal, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Metadata, Recording
from drivers.interfaces import PERIOD_S
from grasp.controller import GraspController
from grasp.loop import Tick
from grasp.phases import Phase
from grasp.settings import load
from scenarios.acquire.config import SamplingSettings, load_acquire_config
from scenarios.acquire.datasets.draws import layout_file, with_values
from scenarios.acquire.labels import recording, slip_label
from scenarios.acquire.press import PressController, StrokeMotion
from scenarios.acquire.rest import TURN_LEVER_M, moved
from scenarios.acquire.rig import open_acquire_rig
from scenarios.acquire.session import Script, Session
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.config import trial_layers
from scenarios.trial.execution import make_guard, run_trial
from scenarios.world.blow import Blow
from scenarios.world.cell import Truth
from scenarios.world.pressed_cell import PressedCell

FixedCause = Literal[
    "contact_made_and_broken", "force_steps", "tap", "arm_vibration", "temperature_drift",
    "lost_samples", "steady",
]  # fmt: skip
GraspedCause = Literal[
    "grasped_closing_and_tightening", "grasped_lift_acceleration", "grasped_tap",
    "grasped_blow", "grasped_arm_vibration", "grasped_uneven_load", "grasped_slip",
]  # fmt: skip
GRASPED: tuple[str, ...] = get_args(GraspedCause)
SETTLED_S = 4.0  # of a session: rest, approach and settling are over before the first disturbance
EAGER_COUNTS = 0.2  # threshold of a detector that hears slip in anything: the hand tightens
SILENT_COUNTS = 500.0  # of one that never speaks
LIGHT_KG = 0.03  # so light that every grip holds it
LEAST_SLIP_M = 0.0005
FELT_SAMPLES = 8  # what a detector may take to be sure of a slip, however short
MOST_LOST = 20  # samples in a row that do not end a session in which samples are lost

# Drawn evenly between these bounds; all assumed.
PAUSES_S = {  # from one act to the next
    "contact_made_and_broken": (2.0, 4.0),
    "force_steps": (0.4, 1.5),
    "tap": (0.4, 1.5),
    "arm_vibration": (0.5, 2.0),
}
STEPS_N = (1.5, 9.0)  # forces that are pressed with
KNOCKS_N_S = (0.005, 0.06)  # on a pressed pad
BLOWS_N_S = {"grasped_tap": (0.002, 0.02), "grasped_blow": (0.01, 0.3)}  # evenly in the logarithm
BLOW_PAUSES_S = (0.3, 1.0)
BLOW_LASTS_S = (0.004, 0.015)  # knocks too
TOP_SHARE = 0.5  # of the blows; the others come from the side
HOLDS_S, HOLDS_STRUCK_S = 1.5, 4.0  # at the top, and there under blows that may move the object


def make_confuser(
    metadata: Metadata, samples: int, motion: StrokeMotion | None, source: str
) -> Recording:
    """At most so many samples; a lift ends when it ends."""
    if metadata.cause in GRASPED:
        return _grasped(metadata, samples, source)
    return _pressed(metadata, samples, motion, source)


def _pressed(
    metadata: Metadata, samples: int, motion: StrokeMotion | None, source: str
) -> Recording:
    values = dict(metadata.parameters)
    if metadata.cause == "lost_samples":
        values["tactile.stale_after_missed"] = MOST_LOST
    config = with_values(
        load_acquire_config(metadata.surface, "simulated", layout_file(metadata.layout)), values
    )
    rng = np.random.default_rng([metadata.seed, 3])
    script = _script(metadata.cause, rng)
    with open_acquire_rig(config, metadata.seed, paced=False) as rig:
        session = Session(config, motion, metadata.seed, rig, script=script)
        session.run(samples, from_start=metadata.cause == "contact_made_and_broken")
    return _by_truth(recording(session.ticks, config, metadata, source))


def _script(cause: str, rng: np.random.Generator) -> Script:
    """What happens on the way; a cause that is all in the parameters has no script."""

    def lift_off(controller: PressController, cell: PressedCell) -> None:
        controller.lift_off()

    def step_force(controller: PressController, cell: PressedCell) -> None:
        controller.target_n = float(rng.uniform(*STEPS_N))

    def knock(controller: PressController, cell: PressedCell) -> None:
        cell.pad.knock(float(rng.uniform(*KNOCKS_N_S)), float(rng.uniform(*BLOW_LASTS_S)))

    def shake(controller: PressController, cell: PressedCell) -> None:
        cell.shaken = not cell.shaken

    acts = {
        "contact_made_and_broken": lift_off,
        "force_steps": step_force,
        "tap": knock,
        "arm_vibration": shake,
    }
    if cause not in acts:
        return lambda t_s, controller, cell: None
    act, pauses_s = acts[cause], PAUSES_S[cause]
    due_s = SETTLED_S

    def script(t_s: float, controller: PressController, cell: PressedCell | None) -> None:
        nonlocal due_s
        if t_s >= due_s and cell is not None:
            due_s = t_s + float(rng.uniform(*pauses_s))
            act(controller, cell)

    return script


def _grasped(metadata: Metadata, samples: int, source: str) -> Recording:
    config = lift_config(metadata)
    seen: list[tuple[Tick, Truth]] = []
    rng = np.random.default_rng([metadata.seed, 3])
    with open_rig(config, metadata.seed, paced=False) as rig:
        strength = BLOWS_N_S.get(metadata.cause)
        disturb = None if strength is None else _taps(rng, rig.tap, strength)

        def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
            if tick.frame is not None and truth is not None:
                seen.append((tick, truth))
            if disturb is not None:
                disturb(tick)

        run_trial(config, rig, make_guard(config), watch)
    return _of_lift(seen[-samples:], config, metadata, source)


def lift_config(metadata: Metadata) -> LiftConfig:
    """A lift of something so light that it is held; for `grasped_slip` as heavy as it is told to
    be, for `grasped_blow` of its own weight and as firmly as in the tap. An eager detector where
    the hand is to tighten, else one that never speaks."""
    config = load(
        LiftConfig,
        trial_layers(metadata.surface, "simulated", "energy", layout_file(metadata.layout)),
    )
    tightens = metadata.cause == "grasped_closing_and_tightening"
    threshold = EAGER_COUNTS if tightens else SILENT_COUNTS
    fixed: dict[str, float] = {"energy.threshold_counts": threshold}
    if metadata.cause == "grasped_blow":
        fixed |= {"object.added_mass_kg": 0.0, "controller.hold_s": HOLDS_STRUCK_S}
        fixed |= {"controller.firm": True, "controller.reactions": False}
    elif metadata.cause != "grasped_slip":
        fixed |= {"object.mass_kg": LIGHT_KG, "object.added_mass_kg": 0.0}
        fixed |= {"controller.hold_s": HOLDS_S}
    return with_values(config, fixed | metadata.parameters)


def _taps(
    rng: np.random.Generator, tap: Callable[[Blow], None] | None, impulse_n_s: tuple[float, float]
) -> Callable[[Tick], None]:
    """Blows on top and on the side while the object is lifted and held; weak ones are the most."""
    due_ns = 0

    def disturb(tick: Tick) -> None:
        nonlocal due_ns
        if tick.decision.phase not in (Phase.LIFT, Phase.HOLD) or tick.t_ns < due_ns:
            return
        due_ns = tick.t_ns + round(float(rng.uniform(*BLOW_PAUSES_S)) * 1e9)
        if tap is not None:
            blow = Blow(
                impulse_n_s=float(np.exp(rng.uniform(*np.log(impulse_n_s)))),
                duration_s=float(rng.uniform(*BLOW_LASTS_S)),
                direction="top" if rng.random() < TOP_SHARE else "side",
            )
            tap(blow)

    return disturb


def _of_lift(
    seen: list[tuple[Tick, Truth]], config: LiftConfig, metadata: Metadata, source: str
) -> Recording:
    ticks = [tick for tick, _ in seen]
    t_s = np.array([(tick.t_ns - ticks[0].t_ns) * 1e-9 for tick in ticks])
    places = np.array([
        (truth.slip_distance_m, truth.across_m, TURN_LEVER_M * truth.turn_rad) for _, truth in seen
    ])  # fmt: skip
    held = np.array([truth.touched for _, truth in seen])  # afterwards the hand leaves the object
    steps = abs(np.diff(places, axis=0, prepend=places[:1])) * held[:, None]
    steps /= np.diff(t_s, prepend=t_s[0] - PERIOD_S)[:, None]  # a blow's slip lies between samples
    speed, turn = np.hypot(*steps[:, :2].T), steps[:, 2] / TURN_LEVER_M
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
        moved_m=moved(t_s, places, held).astype(np.float32),
    )


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


def _by_truth(made: Recording) -> Recording:
    """Static unless the contact truly moves, whatever the fingertip does."""
    if made.slip_true is None:
        raise ValueError("a recording without truth cannot be labelled by it")
    return msgspec.structs.replace(made, slip=made.slip_true)
