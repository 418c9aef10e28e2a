"""Impact along the closing axis: the object is a mass between three springs that only push."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.world import laws
from scenarios.world.contact import (
    Contact,
    Floats,
    finger_stiffness,
    free_along_closing_axis,
    initial_state,
    parameters,
)
from scenarios.world.settings import ContactSettings, Impact, Level
from tests.unit.scenarios.world.test_contact import body, grip_travel

MASS_KG = 0.4
CAN = body(mass_kg=MASS_KG)
GRIP_N = 10.0  # of the thumb
STEP_S = 1e-5


class MassBetweenFingers:
    """Object in a firm grip, advanced by the law along the closing axis alone."""

    def __init__(self, loss_s: float = 0.0, impulse_n_s: float = 0.0, **fields: float) -> None:
        pads = ContactSettings(normal_loss_s=loss_s, relaxation_fraction=0.0, **fields)
        self.p, self.s, self.n = parameters(pads, CAN), initial_state(), np.zeros(3)
        self.s[laws.HEIGHT] = 1.0
        self.k = finger_stiffness(CAN)
        self.travel = np.array(grip_travel(CAN, 0.5 * GRIP_N, 0.5 * GRIP_N))
        laws.normal_forces(self.p, CAN.half_width_m, self.travel, self.s, self.n)
        self.from_m = float(self.s[laws.LATERAL])
        free_along_closing_axis(self.p, self.s, self.n)
        self.s[laws.LATERAL_SPEED] = impulse_n_s / MASS_KG

    def step(self, h: float = STEP_S, push_n: float = 0.0) -> Floats:
        laws.inertial_normal_forces(
            self.p, self.s, h, CAN.half_width_m, self.travel, push_n, self.n
        )
        return self.n

    def go(self, seconds: float, h: float = STEP_S) -> Floats:
        """Force of each finger after every step, (n, 3)."""
        return np.array([self.step(h).copy() for _ in range(round(seconds / h))])

    @property
    def x_m(self) -> float:
        return float(self.s[laws.LATERAL]) - self.from_m

    def energy_j(self) -> float:
        compression = self.s[laws.COMPRESSION : laws.COMPRESSION + 3]
        springs = 0.5 * self.k * float(compression @ compression)
        return springs + 0.5 * MASS_KG * float(self.s[laws.LATERAL_SPEED]) ** 2


@given(
    impulse=st.floats(-1.0, 1.0), loss_s=st.floats(0.0, 5e-3),
    h=st.sampled_from([1e-5, 1e-4, 1e-3, 0.05]),
)  # fmt: skip
def test_fingers_only_push_and_energy_never_increases_at_any_step_length(
    impulse: float, loss_s: float, h: float
) -> None:
    scene = MassBetweenFingers(loss_s, impulse)
    for _ in range(50):
        before_j, before_mps = scene.energy_j(), float(scene.s[laws.LATERAL_SPEED])
        n = scene.step(h)
        assert n.min() >= 0.0
        assert scene.energy_j() <= before_j * (1 + 1e-12)
        gained = MASS_KG * (float(scene.s[laws.LATERAL_SPEED]) - before_mps)
        assert gained == pytest.approx((n[1] + n[2] - n[0]) * h, rel=1e-6, abs=1e-12)


PADS = ContactSettings()
ALONG = Impact(impulse_n_s=0.2, duration_s=0.008, direction="closing")


def held(level: Level) -> tuple[Contact, Floats]:
    contact = Contact(PADS, CAN, level)
    contact.place()
    contact.state[laws.HEIGHT] = 1.0
    grip = np.array(grip_travel(CAN, 5.0, 5.0))
    contact.advance(0.0, 0.3, 0.0, 0.0, 0.0, grip, grip)
    return contact, grip


def test_every_level_models_the_inertia_along_the_closing_axis() -> None:
    peak = []
    for level in Level:
        contact, grip = held(level)
        contact.strike(ALONG, 0.3)
        contact.advance(0.3, 0.1, 0.0, 0.0, 0.0, grip, grip)
        peak.append(contact.state[laws.PEAK : laws.PEAK + 3].tolist())
    assert all(each == pytest.approx(peak[0], rel=1e-3) for each in peak)
    pulse_n = math.pi * 0.2 / (2 * 0.008)  # of the mallet, at most
    assert 12.0 < peak[0][0] < 0.8 * pulse_n
