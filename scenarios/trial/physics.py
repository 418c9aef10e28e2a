"""The scene of a trial as the world's planner takes it, from the settings and what seeds draw."""

from drivers.errors import ConfigError
from scenarios.rigs.variation import CUT, wider
from scenarios.trial.config import TrialConfig
from scenarios.world.blow import Blow
from scenarios.world.ladder.runs import Ranges, RunScene, first_travel, plan_run
from scenarios.world.ladder.scene import ArmRise
from scenarios.world.world_settings import RunPlan


def run_scene(
    config: TrialConfig, blow: Blow | None = None, impulse: float = 0.0, offset_m: float = 0.0
) -> RunScene:
    """A lift, or a blow on what is held; ``impulse`` (relative) and ``offset_m``: the most that one
    blow differs from the next."""
    varied, controller, counts = config.variation, config.controller, config.object.grip_counts
    body = wider(config.object, varied)
    return RunScene(
        body=body,
        contact=config.contact,
        first_travel_m=first_travel(counts, config.hand.m_per_count, config.contact, body),
        full_grip_n=config.guard.full_grip_n,
        closing_mps=min(0.11, controller.closing_speed_mps),
        arm=ArmRise(
            speed_mps=controller.lift_speed_mps,
            acceleration_mps2=controller.lift_acceleration_mps2,
        ),
        ranges=Ranges(
            friction=CUT * varied.friction_cv,
            mass=CUT * varied.mass_cv,
            height_m=CUT * varied.start_height_m,
            aside_m=CUT * varied.aside_m,
            scatter_m=CUT * varied.finger_scatter_m,
            impulse=impulse,
            offset_m=offset_m,
        ),
        blow=blow,
        pull=config.pull,
    )


def planned(config: TrialConfig, scene: RunScene) -> RunPlan:
    """What the cell of such a trial is built at. Raises ConfigError for a level that cannot do
    it."""
    try:
        return plan_run(scene, config.world)
    except ValueError as error:
        raise ConfigError("world", "level", str(error), "auto, or L1 to L4") from None
