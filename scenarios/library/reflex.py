"""Makes the reflex of `grasp.reflex` from settings."""

import msgspec

from detector.decision import DecisionRule
from drivers.interfaces import FINGERS
from grasp.contact_estimator import Stiffness
from grasp.controller_settings import GripPlan
from grasp.guard import ForceGuard
from grasp.monitors.checks import Monitors
from grasp.policy_reflex import PolicyArmHistory, Reflex, ReflexController
from grasp.slip_monitor import SlipMonitor
from grasp.step import GraspStep
from scenarios.rigs.calibration import calibration
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard, patience_s


def make_reflex(config: TrialConfig) -> Reflex:
    """The reflex. The object is unknown: its contact is as stiff as the guard assumes at most.

    Raises ConfigError for a force limit that the hand cannot keep, BadFile for a damaged detector.
    """
    make_guard(config)  # makes the checks
    known, detector = calibration(config), config.make_detector(FINGERS)
    stiffness = Stiffness(config.guard.contact_stiffness_npm * known.m_per_count)
    plan = GripPlan((0, 0, 0), (0, 0, 0), config.guard.force_limit_n, stiffness)
    settings = msgspec.structs.replace(config.controller, cap_patience_s=patience_s(config))

    def make_step() -> GraspStep:
        monitors = Monitors(config.monitors)
        monitors.arm = PolicyArmHistory(config.monitors)
        controller = ReflexController(
            settings, plan, SlipMonitor(DecisionRule(config.rule, FINGERS), config.slip)
        )
        guard = ForceGuard(config.guard, known.least_force_n, stiffness, known.least_speed_mps)
        return GraspStep(detector, controller, guard, monitors)

    return Reflex(settings, make_step, config.guard.force_limit_n)
