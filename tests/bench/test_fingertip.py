"""Speed of one simulated fingertip relative to real time, with and without a compliant mount."""

import time

import numpy as np
import pytest

from scenarios.world.fingertip import Fingertips
from scenarios.world.settings import FingertipSettings, Surface

pytestmark = pytest.mark.bench

AIM = 60.0  # times real time
SAMPLES, PERIOD_S = 3000, 0.01
RIGID = {  # without the terms of the mount
    "lever_x": 0.0, "lateral_npmm": 0.0, "shift_mm": 0.0, "rock_rad": 0.0,
    "relaxation_slow_share": 0.0, "spring_mm": 2.0,
}  # fmt: skip


@pytest.mark.parametrize(("name", "settings"), [("rigid", RIGID), ("of a run", {"lever_y": 0.3})])
def test_a_fingertip_is_sixty_times_faster_than_real_time(
    name: str, settings: dict[str, float]
) -> None:
    tips = Fingertips(
        FingertipSettings(**settings), [Surface(texture_rms_mm=0.3)], np.random.default_rng(1)
    )  # type: ignore[arg-type]
    mount, still, middle = np.array([4.0]), np.zeros(1), np.zeros((1, 2))
    x_mm = 0.0
    for k in range(2 * SAMPLES):  # the first half compiles and warms up
        if k == SAMPLES:
            start_s = time.process_time()
        speed = 0.4 * np.sin(k / 30.0) ** 3
        x_mm += speed if abs(speed) > 0.03 else 0.0
        at = np.array([[x_mm, 0.0]])
        tips.advance((k + 1) * PERIOD_S, mount * 1.0, at, still, middle, True, mount)
        tips.codes()
    factor = SAMPLES * PERIOD_S / (time.process_time() - start_s)
    print(f"\n{name}: {factor:.0f} times real time")
    assert factor > AIM
