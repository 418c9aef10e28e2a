"""Makes the reflex of `grasp.reflex` from settings."""

import msgspec

from drivers.interfaces import FINGERS
from grasp.control.monitors.checks import Monitors
from grasp.control.reflex_controller import ReflexController
from grasp.control.step import GraspStep
from grasp.policy_reflex import PolicyArmHistory, Reflex
from scenarios.rigs.calibration import calibration
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import controller_parts, make_step


def make_reflex(config: TrialConfig) -> Reflex:
    """The reflex for an unknown object: it closes by touch, and its contact is as stiff as the
    guard assumes until that is measured. By counts, the default with ``each_motor``, the force byte
    alone bounds the force.

    Raises ConfigError for a force limit that the hand cannot keep, BadFile for a damaged detector.
    """
    replace = msgspec.structs.replace
    unknown = replace(config.object, grip_counts=(0, 0, 0), contact_stiffness_npm=None)
    by_default = "touch" if config.guard.limit_mode == "every_finger" else "counts"
    first = config.controller.first_grasp or by_default
    controller = replace(config.controller, first_grasp=first, firm=False)
    config = replace(config, object=unknown, controller=controller)
    detector = config.make_detector(FINGERS)

    def parts() -> GraspStep[ReflexController]:
        monitors = Monitors(config.monitors)
        monitors.arm = PolicyArmHistory(config.monitors)
        controller = ReflexController(*controller_parts(config))
        return make_step(config, controller, monitors=monitors, detector=detector)

    least_n, taxels = calibration(config).least_force_n, config.tactile.taxels
    most_mps = config.arm.max_speed_mps
    return Reflex(config.controller, parts, config.guard, most_mps, least_n, taxels)
