"""What shakes a pressed fingertip without slip: recordings that the paper's data set lacks.

Fixed objects are pressed as in the acquisition, without strokes, while a script disturbs them. Both
labels of slip say whether the contact truly moves; `slip` leaves out what slides and goes nowhere.
"""

from typing import Literal

import msgspec
import numpy as np

from detector.recordings import Metadata, Recording
from drivers.interfaces import PERIOD_S
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.datasets.draws import with_values
from scenarios.acquire.datasets.grasped import LEAST_SLIP_M
from scenarios.acquire.labels import recording
from scenarios.acquire.press import PressController, StrokeMotion
from scenarios.acquire.rest import TURN_LEVER_M
from scenarios.acquire.session import Script, Session, open_acquire_rig
from scenarios.world.pressed_cell import PressedCell

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

    def lift_off(controller: PressController, cell: PressedCell) -> None:
        controller.lift_off()

    def step_force(controller: PressController, cell: PressedCell) -> None:
        controller.target_n = float(rng.uniform(*STEPS_N))

    def knock(controller: PressController, cell: PressedCell) -> None:
        cell.pad.knock(float(rng.uniform(*KNOCKS_N_S)), float(rng.uniform(*KNOCKS_S)))

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


def _by_truth(made: Recording) -> Recording:
    """Static unless the contact truly moves, whatever the fingertip does: what slides less than
    LEAST_SLIP_M on end is a pad that is shaken where it is."""
    if made.slip_true is None or made.contact_speed_mps is None or made.contact_turn_radps is None:
        raise ValueError("a recording without truth cannot be labelled by it")
    speed_mps = np.hypot(made.contact_speed_mps, TURN_LEVER_M * made.contact_turn_radps)
    way_m = speed_mps * np.diff(made.t_s, prepend=made.t_s[0] - PERIOD_S)
    label = made.slip_true.copy()
    edges = np.flatnonzero(np.diff(label, prepend=False, append=False))
    for first, end in edges.reshape(-1, 2):
        label[first:end] = way_m[first:end].sum() >= LEAST_SLIP_M
    return msgspec.structs.replace(made, slip=label)
