"""What a run is computed by is decided at the worst corner of its trials, once."""

import msgspec
import numpy as np
import pytest

from scenarios.trial.physics import run_scene
from scenarios.world import laws
from scenarios.world.blow import Blow
from scenarios.world.contact import initial_state
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.drive import drive, pull_force
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.runs import Ranges, RunScene, asked_of, plan_run
from scenarios.world.ladder.scene import ArmRise, squeeze
from scenarios.world.scene_terms import PullSettings
from scenarios.world.world_settings import Level, WorldSettings
from tests.unit.scenarios.conftest import config as trial_config
from tests.unit.scenarios.world.ladder.ladder_scenes import body

PADS = ContactSettings()
CAN = body(mass_kg=0.6, friction_static=0.8, friction_kinetic=0.7)
RANGES = Ranges(friction=0.2, mass=0.05, aside_m=0.005, scatter_m=0.0002, impulse=0.3)
LIFT = RunScene(
    body=CAN, contact=PADS, first_travel_m=squeeze(CAN, PADS, 1.0, 1.0),
    full_grip_n=(10.0, 5.0, 5.0), closing_mps=0.06,
    arm=ArmRise(speed_mps=0.1, acceleration_mps2=0.5), ranges=RANGES,
)  # fmt: skip


def tapped(**fields: object) -> RunScene:
    what = Blow(**{"impulse_n_s": 0.15, "duration_s": 0.008, **fields})  # type: ignore[arg-type]
    return msgspec.structs.replace(LIFT, body=body(mass_kg=0.35), blow=what)


def told(**fields: object) -> WorldSettings:
    return WorldSettings(**fields)  # type: ignore[arg-type]


def test_lift_runs_on_sliders_and_a_blow_beside_the_middle_on_what_can_turn() -> None:
    assert plan_run(LIFT, told()).level == "L1"
    struck = plan_run(tapped(direction="side", offset_m=0.04), told())
    assert struck.level == "L1"  # up to the blow
    assert struck.blow_level in ("L3", "L4")
    heads = [line for line in struck.why if "asks for most" in line]
    assert [head[-2:] for head in heads] == [struck.level, struck.blow_level]
    assert "L1 and L3 do not agree" in "".join(struck.why)


def test_blow_through_the_middle_of_an_even_grip_needs_no_rotation() -> None:
    even = msgspec.structs.replace(tapped(), ranges=Ranges(friction=0.2, impulse=0.3))
    assert plan_run(even, told()).blow_level == "L1"


def test_tighter_tolerance_takes_no_lesser_level_and_no_larger_step() -> None:
    scene = tapped(direction="side", offset_m=0.02)
    loose, tight = (plan_run(scene, told(tolerance=t)) for t in (5e-2, 1e-4))
    assert tight.blow_level > loose.blow_level
    assert tight.blow_step_s < loose.blow_step_s


def test_step_of_a_blow_along_the_closing_axis_is_as_short_as_the_peak_force_asks() -> None:
    loose, tight = (
        plan_run(tapped(direction="closing"), told(force_tolerance_n=n)) for n in (5.0, 0.1)
    )
    assert tight.blow_step_s < loose.blow_step_s


def test_level_that_is_told_is_taken_without_a_plan() -> None:
    found = plan_run(LIFT, told(level="L4"))
    assert (found.level, found.blow_level, found.why) == ("L4", "L4", ())
    mixed = plan_run(tapped(), told(level="L1", blow_level="L2"))
    assert (mixed.level, mixed.blow_level) == ("L1", "L2")


def test_level_of_a_blow_that_is_told_is_taken_whatever_comes_before_it() -> None:
    found = plan_run(tapped(direction="side", offset_m=0.04), told(blow_level="L2"))
    assert (found.level, found.blow_level, found.blow_asked) == ("L1", "L2", "L2")
    assert not any("tap (side)" in line for line in found.why)
    assert plan_run(tapped(direction="side"), told(level="L0", blow_level="L3")).level == "L0"


def test_rigid_level_is_refused_where_a_blow_comes_from_the_side() -> None:
    with pytest.raises(ValueError, match="no blow from the side"):
        plan_run(tapped(direction="side"), told(level="L0"))


def test_corners_have_the_run_s_own_contact_and_bodies_within_its_ranges() -> None:
    corners = LIFT.lifts()
    assert {id(c.contact) for c in corners} == {id(PADS)}
    ratios = {round(c.body.friction_static / CAN.friction_static, 9) for c in corners}
    assert ratios == {0.8, 1.0, 1.2}
    assert len(corners) == 5  # either side is the mirror image of the other; one in the middle
    aside = msgspec.structs.replace(LIFT, body=body(centre_aside_m=0.01))
    assert {round(c.body.centre_aside_m, 9) for c in aside.lifts()} == {0.005, 0.015}
    assert len({c.grip.closing.start_s for c in corners if c.grip.closing}) == 3
    assert all(c.on_table and c.tap is None for c in corners)
    strong = max(c.tap.impulse_n_s for c in tapped().blows() if c.tap)
    assert strong == pytest.approx(1.3 * 0.15)


def test_pull_that_the_pads_just_bear_asks_for_what_can_turn() -> None:
    pull = PullSettings(force_n=9.0)
    pulled = msgspec.structs.replace(LIFT, pull=pull)
    assert plan_run(LIFT, told()).level == "L1"
    found = plan_run(pulled, told())
    assert found.level in ("L3", "L4")  # L1 holds it where the weight beside the middle turns it
    assert "pull, in the corner that asks for most" in found.why[0]
    assert plan_run(msgspec.structs.replace(LIFT, pull=PullSettings()), told()).level == "L1"
    lesser = PullSettings(force_n=5.0)  # it is more slippery
    tap = plan_run(msgspec.structs.replace(tapped(), pull=lesser), told())
    assert tap.level in ("L3", "L4")


def test_pulled_corners_bear_just_more_than_weight_and_pull() -> None:
    pull = PullSettings(force_n=9.0)
    pulled = msgspec.structs.replace(LIFT, pull=pull)
    just, nearly, weak, firm = (c for c in pulled.lifts() if c.pull)
    for corner, share in ((just, 1.02), (nearly, 1.1)):
        kept_n = 2 * (1 - PADS.relaxation_fraction) * 10.0
        load_n = corner.mass_kg * 9.81 + pull.force_n
        assert corner.body.friction_static * kept_n == pytest.approx(share * load_n)
    frictions = [c.body.friction_static for c in (weak, just, nearly, firm)]
    assert frictions == sorted(frictions)
    assert all(c.pull and c.pull.force_n == 9.0 and not c.on_table for c in (weak, firm))
    beyond = msgspec.structs.replace(LIFT, pull=PullSettings(force_n=90.0))
    assert {c.body.friction_static for c in beyond.lifts() if c.pull} == {
        weak.body.friction_static, firm.body.friction_static,
    }  # fmt: skip


def test_scene_of_a_trial_has_its_pull_and_the_width_that_is_built() -> None:
    config = trial_config("pull.force_n=5", "variation.width_error_m=0.002")
    scene = run_scene(config)
    assert scene.pull == config.pull
    assert scene.body.half_width_m == pytest.approx(config.object.half_width_m + 0.002)


def test_pull_of_a_stated_scene_is_that_of_a_cell() -> None:
    pull = PullSettings(force_n=4.0, ramp_s=0.1, lasts_s=0.3, after_s=0.05)
    state = initial_state()
    state[laws.PULL_START_S], state[laws.PULL_N] = 0.05, 4.0
    state[laws.PULL_RAMP_S], state[laws.PULL_S] = 0.1, 0.3
    times_s = np.linspace(0.0, 0.8, 81)
    assert pull_force(pull, times_s) == pytest.approx([laws.pull_force(state, t) for t in times_s])
    load = drive(msgspec.structs.replace(LIFT.lifts()[0], pull=pull), 1e-3).load
    assert load[:, 1].min() == pytest.approx(-4.0)
    assert not load[:, [0, 2, 3]].any()


def test_rotation_is_asked_for_by_the_lever_of_the_paper_s_label() -> None:
    asked = asked_of(told(tolerance=1e-3), PADS)
    assert asked.rotation_rad == pytest.approx(1e-3 / 0.015)
    assert told(level="L3").forced is Level.SPIN
    assert told().forced is None


def test_blow_that_the_worst_corner_loses_and_the_best_does_not_feel_is_planned_in_between() -> (
    None
):
    # so unsure a hand that in every corner the object is lost or all but still
    unsure = Ranges(friction=0.2, impulse=0.9, aside_m=0.006)
    short = body(mass_kg=0.2, friction_static=0.7, friction_kinetic=0.6, body_above_grip_m=0.05)
    scene = msgspec.structs.replace(tapped(impulse_n_s=0.4), body=short, ranges=unsure)
    *corners, middle = (simulate(c, Level.SLIDER, 1e-4) for c in scene.blows())
    assert all(not c.held or c.slip_m < 2e-4 for c in corners)
    assert middle.held
    assert plan_run(scene, told()).blow_level == "L3"


def test_mark_of_a_tap_is_where_its_settings_say() -> None:
    high = msgspec.structs.replace(tapped(), mark_height_m=0.2, pull=PullSettings(force_n=1.0))
    assert {c.mark_height_m for c in (*high.lifts(), *high.blows())} == {0.2}


def test_lesser_level_from_a_blow_on_is_refused() -> None:
    with pytest.raises(ValueError, match="L1 is less than level, L4"):
        told(level="L4", blow_level="L1")
    for level in ("L1", "auto"):
        with pytest.raises(ValueError, match=f"L0 is less than level, {level}"):
            told(level=level, blow_level="L0")
    assert plan_run(tapped(), told(level="L0", blow_level="L0")).blow_level == "L0"
    aside = msgspec.structs.replace(tapped(), ranges=Ranges(aside_m=0.05, scatter_m=5e-4))
    assert plan_run(aside, told()).level in ("L3", "L4")
    with pytest.raises(ValueError, match="L1 is less"):
        plan_run(aside, told(blow_level="L1"))


def test_step_is_small_enough_for_what_is_held_though_the_worst_corner_loses_it() -> None:
    # lost at any step in the weakest corner: nothing there tells how far a step is off
    coarse = msgspec.structs.replace(PADS, step_s=0.05)
    low = body(mass_kg=0.6, friction_static=0.8, friction_kinetic=0.7, body_above_grip_m=0.03)
    scene = msgspec.structs.replace(LIFT, body=low, contact=coarse)
    assert not simulate(scene.lifts()[0], Level.SLIDER, 5e-4).held
    assert plan_run(scene, told()).step_s < 0.05
