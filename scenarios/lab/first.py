"""A lab's first lift: closed in free air, then a soft object, at half speed and least force."""

from typing import TypeVar

import msgspec

from drivers.errors import Refused
from scenarios.lab.hand import TOUCH_N, Moved, Say, open_hand
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import calibration
from scenarios.trial.config import TrialConfig

ConfigT = TypeVar("ConfigT", bound=TrialConfig)

SOFT = "foam"  # of config/objects: the softest
GENTLE_STOP_MPS2 = 1.0  # docs/hardware.md, "How hard the arm may stop"
# of controller, with their least values
HALVED = {
    "lift_speed_mps": 0.005, "lower_speed_mps": 0.005, "approach_speed_mps": 0.022,
    "closing_speed_mps": 0.022,
}  # fmt: skip

WHAT_TO_DO = (
    "protective stop: the arm stands and the hand keeps its grip. Look for the cause at the teach "
    "pendant, wait 5 s, clear it there; then let go as the message says",
    "emergency stop: press it whenever in doubt. The arm brakes, the hand keeps its grip. Release "
    "the button, power the robot on and release its brakes at the teach pendant, then let go",
    "loss of remote control (somebody turned the pendant to Local): the program ends and the arm "
    "stands. Turn it to Remote, then start again",
    "Ctrl-C: the arm stands, the grip is kept, and the command that opens the hand is printed",
)


def gently(config: ConfigT) -> ConfigT:
    """Half as fast, no stronger than the hand's least, the arm stopped softly."""
    replace, controller = msgspec.structs.replace, config.controller
    slow = {name: max(least, getattr(controller, name) / 2) for name, least in HALVED.items()}
    least_n = calibration(config).least_force_n
    limit_n = min(config.guard.force_limit_n, least_n)
    grip_n = min(controller.grip_force_n, limit_n)
    stop_mps2 = min(controller.answer_stop_mps2, GENTLE_STOP_MPS2)
    if "answer_stop_mps2" not in controller.unread:
        slow["answer_stop_mps2"] = stop_mps2
    return replace(
        config,
        controller=replace(controller, grip_force_n=grip_n, **slow),
        guard=replace(config.guard, force_limit_n=limit_n),
    )


def close_in_free_air(config: TrialConfig, permit: MotionPermit | None, say: Say) -> Moved:
    """To where the object would be grasped, and open again; the arm stands. That nothing is touched
    is what is expected: raises Refused where something was."""
    with open_hand(config, permit, closing=True) as hand:
        moved = hand.close(config.object.grip_counts, say)
        hand.move((0, 0, 0), say)
    felt = moved.force_n is not None and max(moved.force_n) >= TOUCH_N
    if moved.met or moved.stopped_by or felt:
        raise Refused(f"in free air, {moved.in_words()}", "empty the hand, look at its fingers")
    return moved
