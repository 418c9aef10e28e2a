"""The fuller model that the ladder is compared with: held to the plane it must agree with it."""

import math
from typing import Any

import pytest

from scenarios.studies.physics import mujoco_hand
from scenarios.studies.physics.mujoco_hand import Beyond, Freedom
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.scene import Scene, Vibration
from scenarios.world.world_settings import Level
from tests.unit.scenarios.world.ladder.ladder_scenes import held, tap

pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra `dev`)")


def struck(**blow: Any) -> Scene:
    return held(tap=tap(**blow), sharing="equal", duration_s=0.25)


def test_held_in_the_plane_it_moves_as_the_ladder_does() -> None:
    scene = struck(offset_m=0.02)
    ours = simulate(scene, Level.BRUSH, 1e-4)
    theirs = mujoco_hand.run(scene, Freedom.PLANE)
    assert ours.slip_m > 3e-3
    assert math.dist(theirs.mark_m, ours.mark_m) < 0.03 * ours.slip_m
    assert theirs.turn_rad == pytest.approx(ours.turn_rad, rel=0.05)
    assert theirs.peak_force_n == pytest.approx(ours.peak_force_n, abs=0.3)


def test_object_that_nothing_strikes_stays_where_it_is() -> None:
    still = mujoco_hand.run(held(sharing="equal"), Freedom.ALL)
    assert still.held
    assert still.slip_m < 5e-6
    assert still.tilt_rad < 1e-3


def test_blow_along_the_closing_axis_loads_the_thumb_and_tilts_only_what_is_free_to_tilt() -> None:
    blow, scene = Beyond(blow_z_m=0.04), struck(direction="closing")
    free = mujoco_hand.run(scene, Freedom.CLOSING, beyond=blow)
    tilting = mujoco_hand.run(scene, Freedom.ALL, beyond=blow)
    assert free.closing_m > 1e-3
    assert free.peak_force_n > 15.0
    assert free.tilt_rad == 0.0
    assert tilting.tilt_rad > 0.01


def test_scene_that_vibrates_is_refused() -> None:
    shaken = held(vibration=Vibration(acceleration_mps2=1.0, frequency_hz=20.0))
    with pytest.raises(ValueError, match="vibration"):
        mujoco_hand.run(shaken, Freedom.ALL)
