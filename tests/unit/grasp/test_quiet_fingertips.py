"""A sensor that is quiet in the air is no frozen one, which is told as soon as it can be."""

from typing import Any

import numpy as np
import pytest

from grasp.doubt_settings import DoubtSettings
from grasp.fingertip_doubt import FingertipDoubt
from grasp.states import State
from tests.unit.grasp.builders import Codes, codes, frame_of


def quiet(k: int, every: int) -> Codes:
    """Fingertips in the air, one code of each of which strays now and then, and comes back."""
    raw = np.full((3, 6), 450, np.int16)
    raw[:, k // every % 6] += k % every == 0
    return raw


def until_frozen(samples: list[Codes], still: Codes, **settings: Any) -> tuple[int, str]:
    """How many samples that stay as they are it takes after these."""
    doubt = FingertipDoubt(DoubtSettings(**settings))
    assert not any(doubt.see(frame_of(raw), State.BRACE) for raw in samples)
    for n in range(1000):
        if said := doubt.see(frame_of(still), State.BRACE):
            return n, said.partition(":")[0]
    return 1000, ""


@pytest.mark.parametrize("every", [4, 15, 40])
def test_a_quiet_sensor_in_the_air_is_not_taken_for_a_frozen_one(every: int) -> None:
    """Stretches without a change that came again and again prove nothing."""
    samples = [quiet(k, every) for k in range(1, 20 * every)]
    least = {4: 20, 15: 50, 40: 100}[every]
    n, said = until_frozen(samples, samples[-1])
    assert n >= least
    assert said.startswith("fingertip")


def test_one_that_never_changed_is_believed_until_it_is_pressed() -> None:
    rest = np.full((3, 6), 450, np.int16)
    assert until_frozen([rest], rest) == (1000, "")
    n, said = until_frozen([rest, rest - np.int16(35)], rest - np.int16(35))
    assert (n, said) == (7, "fingertips_frozen")


@pytest.mark.parametrize("lively", [5, 60])
def test_a_lively_one_that_freezes_in_the_air_is_doubted_no_later(lively: int) -> None:
    samples = [codes(k) + np.int16(50) for k in range(lively)]
    n, said = until_frozen(samples, samples[-1])
    assert (n, said) == (7, "fingertips_frozen")


@pytest.mark.parametrize(("every", "least", "most"), [(2, 30, 60), (20, 75, 85)])
def test_patience_with_a_loaded_fingertip_that_is_quiet_ends_when_none_of_its_taxels_could_tell(
    every: int, least: int, most: int
) -> None:
    """Thumb and C live, and B repeats itself for so long again and again in a firm grip, the last
    time just before it freezes."""

    def firm(k: int) -> Codes:
        raw = codes(k)
        raw[1] = quiet(k, every)[1] - np.int16(100)
        return raw

    doubt = FingertipDoubt(DoubtSettings())
    samples = 10 * every
    assert not any(doubt.see(frame_of(firm(k)), State.LIFT) for k in range(1, samples))

    def frozen(k: int) -> Codes:
        return np.stack([codes(k)[0], firm(samples - 1)[1], codes(k)[2]])

    after = [doubt.see(frame_of(frozen(k)), State.LIFT)[:24] for k in range(samples, samples + 150)]
    assert least <= after.index("fingertip_dead: finger B") + 1 <= most
