"""A pad pressed on a fixed surface: load, geometry of the contact, frames."""

import math

import numpy as np
import pytest

from scenarios.world.fingertip import FingertipSettings
from scenarios.world.pressed import FixedSurface, PressedPad, PressSettings

START = (0.5, 0.1, 0.3)
QUIET = FingertipSettings(crown_radius_mm=100.0)
RIGID = PressSettings(gap_m=0.005)
STIFFNESS = 1 / (1 / 15000 + 1 / 5000 + 1 / 40000 + 1 / 1e6)


class Pressing:
    """A pad, and what it is told to feel."""

    def __init__(self, **surface: float) -> None:
        made = FixedSurface(name="test", **surface)
        self.pad = PressedPad(made, RIGID, QUIET, np.random.default_rng(0), START, 0.0)
        self.felt: list[tuple[np.ndarray, ...]] = []
        self.pad.tips.advance = self._feel  # type: ignore[method-assign]
        self.t_s = 0.0

    def _feel(self, t_s, normal_n, motion_mm, turn_rad, centre_mm, moves):  # type: ignore[no-untyped-def]
        self.felt.append((normal_n, motion_mm, turn_rad, centre_mm))

    def go(self, x: float = 0.0, y: float = 0.0, down: float = 0.006, angle: float = 0.0) -> float:
        self.t_s += 0.01
        at = (START[0] + x, START[1] + y, START[2] - down)
        self.pad.advance(self.t_s, at, angle, moving=True)
        return self.pad.normal_n

    @property
    def motion_mm(self) -> np.ndarray:
        return self.felt[-1][1][0]

    @property
    def centre_mm(self) -> np.ndarray:
        return self.felt[-1][3][0]


def test_there_is_no_load_above_the_surface_and_a_spring_below_it() -> None:
    pressing = Pressing()
    assert pressing.go(down=0.0049) == 0.0
    assert pressing.go(down=0.006) == pytest.approx(STIFFNESS * 0.001)


@pytest.mark.parametrize("off_mm", [3.0, 8.0])
def test_two_spheres_touch_where_their_normals_agree(off_mm: float) -> None:
    """Against exact geometry: the height of two spheres in touch, and the point between them."""
    pressing = Pressing(radius_x_m=0.0381, radius_y_m=0.0381)
    top = pressing.go(down=0.008)
    side = pressing.go(x=off_mm * 1e-3, down=0.008)
    both = 38.1 + 100.0
    drop_mm = both - math.sqrt(both**2 - off_mm**2)
    assert top - side == pytest.approx(STIFFNESS * drop_mm * 1e-3, rel=0.01)
    assert pressing.centre_mm == pytest.approx([-off_mm * 100.0 / both, 0.0], rel=0.01)


def test_along_a_cylinder_nothing_changes() -> None:
    pressing = Pressing(radius_y_m=0.0508)  # its axis along x
    assert pressing.go(x=0.01) == pytest.approx(pressing.go())
    assert pressing.go(y=0.01) < pressing.go()
    assert pressing.centre_mm == pytest.approx([0.0, 0.0])


def test_the_surface_moves_against_the_tool_whose_y_is_the_bases_mirrored() -> None:
    pressing = Pressing()
    pressing.go()
    pressing.go(x=0.002, y=0.001)
    assert pressing.motion_mm == pytest.approx([-2.0, 1.0])


def test_a_turned_pad_feels_the_motion_in_its_own_frame() -> None:
    pressing = Pressing(radius_x_m=0.0381, radius_y_m=0.0381)
    pressing.go()
    pressing.go(angle=math.pi / 2)
    before = pressing.motion_mm.copy()
    pressing.go(x=0.002, angle=math.pi / 2)
    assert pressing.motion_mm - before == pytest.approx([0.0, 2.0])
    assert pressing.felt[-1][2] == pytest.approx([-math.pi / 2])
    on_pad = -2.0 * 100.0 / 138.1
    assert pressing.centre_mm == pytest.approx([0.0, -on_pad], abs=1e-3)


def test_a_knock_carries_its_impulse_and_moves_nothing() -> None:
    pressing = Pressing()
    still = pressing.go()
    pressing.pad.knock(0.02, 0.012)
    loads = []
    for _ in range(5):
        begun = len(pressing.felt)
        pressing.go()
        loads += [normal[0] - still for normal, *_ in pressing.felt[begun:]]
    assert sum(loads) * 0.001 == pytest.approx(0.02, rel=0.05)
    assert loads[-1] == 0.0
    assert pressing.motion_mm == pytest.approx([0.0, 0.0])
