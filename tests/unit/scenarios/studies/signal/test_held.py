"""What the mechanics of a held object leave of the arm's restlessness."""

import msgspec
import numpy as np
import pytest

from grasp.settings import load, named_layer
from scenarios.studies.signal.held import share, transfer, wander_share
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.fingertip_settings import FingertipSettings
from scenarios.world.ladder.experiments import World


def test_far_below_its_own_frequency_an_object_rides_along_and_far_above_it_stays_behind() -> None:
    slow, fast = transfer(np.array([1.0, 1000.0]), 30.0, 0.1)
    assert slow == pytest.approx(1 / 900, rel=0.01)
    assert fast == pytest.approx(1.0, rel=0.01)


def test_at_its_own_frequency_only_damping_bounds_the_motion() -> None:
    assert transfer(np.array([30.0]), 30.0, 0.1)[0] == pytest.approx(5.0)


def test_slow_wander_is_carried_along_and_fast_wander_is_not() -> None:
    slow, fast = (wander_share((s,), 30.0, 0.2) for s in (0.5, 0.01))
    assert slow < 0.05 < 0.3 < fast


def test_a_heavier_object_leaves_more_of_it() -> None:
    body = load(World, [named_layer("objects", "can")]).object
    light, heavy = (
        share(msgspec.structs.replace(body, mass_kg=m), ContactSettings(), FingertipSettings(), 0.2)
        for m in (0.1, 1.0)
    )
    assert light.held_hz > 1.5 * heavy.held_hz
    assert light.wander < heavy.wander
