"""Six ways to make a lift harder: what each changes, and the bound of what 10 N can hold."""

import msgspec
import numpy as np
import pytest

from drivers.errors import ConfigError
from scenarios.campaign.axes import AXES
from scenarios.campaign.config import RunConfig, load_config
from scenarios.campaign.spec import AT, MOVED, CampaignSpec, combinations
from scenarios.world import contact, laws
from scenarios.world.scene_terms import PullSettings

# something harder on each axis
HARDER = {
    "friction": 0.5, "mass": 0.9, "speed": 0.3, "pull": 6.0, "wider": 0.5, "narrower": 0.3,
    "taxels": 0.5, "gain": 0.4,
}  # fmt: skip


def base(name: str = "can", *words: str) -> RunConfig:
    return load_config(name, "simulated", "energy", None, words)


def at(axis: str, value: float, name: str = "can") -> RunConfig:
    return base(name, *AXES[axis].moved(base(name), value))


@pytest.mark.parametrize("axis", AXES)
def test_moving_along_an_axis_leads_to_the_value_and_changes_no_other_axis(axis: str) -> None:
    plain, moved = base(), at(axis, HARDER[axis])
    assert AXES[axis].here(moved) == pytest.approx(HARDER[axis])
    for name, other in AXES.items():
        if name != axis:
            assert other.here(moved) == pytest.approx(other.here(plain)), name


@pytest.mark.parametrize("axis", AXES)
def test_share_of_the_bound_rises_as_a_lift_gets_harder_and_is_one_at_the_bound(axis: str) -> None:
    plain = base()
    assert AXES[axis].share(plain, AXES[axis].bound(plain)) == pytest.approx(1.0)
    here = AXES[axis].here(plain)
    assert AXES[axis].share(plain, here) < AXES[axis].share(plain, HARDER[axis])


def slides(config: RunConfig, pull_n: float = 0.0, rise_mps2: float = 0.0) -> bool:
    """Whether an object in the air slides in a grip of 10 N at the thumb, or has slid out."""
    kinetic = config.object.friction_kinetic  # what sliding friction alone can hold
    body = msgspec.structs.replace(config.object, friction_static=kinetic)
    held = contact.Contact(config.contact, body)
    held.place()
    held.state[laws.HEIGHT] = 1.0
    kept = 1 - config.contact.relaxation_fraction
    pressed_m = np.array([10.0, 5.0, 5.0]) / kept / contact.finger_stiffness(config.contact, body)
    travel = config.contact.half_aperture_m - body.half_width_m + pressed_m
    held.advance(0.0, 3.0, 0.0, 0.0, 0.0, travel, travel)
    held.pull(PullSettings(force_n=pull_n, ramp_s=0.001, lasts_s=10.0), 3.0)
    held.advance(3.0, 0.3, 0.5 * rise_mps2 * 0.3**2, 0.0, 0.3 * rise_mps2, travel, travel)
    return bool(held.normal_n[0] == 0.0 or held.state[laws.SLIP_SPEED] > 0.0)


@pytest.mark.parametrize("name", ["can", "box", "foam"])
@pytest.mark.parametrize("share, lost", [(0.93, False), (1.07, True)])
def test_bound_is_where_the_contact_law_itself_begins_to_slide(
    name: str, share: float, lost: bool
) -> None:
    plain = base(name)
    bound = {axis: AXES[axis].bound(plain) for axis in ("friction", "mass", "pull", "speed")}
    assert slides(at("friction", bound["friction"] / share, name)) is lost
    assert slides(at("mass", bound["mass"] * share, name)) is lost
    assert slides(plain, pull_n=bound["pull"] * share) is lost
    per_speed = plain.controller.lift_acceleration_mps2 / plain.controller.lift_speed_mps
    assert slides(plain, rise_mps2=bound["speed"] * share * per_speed) is lost


def test_bounds_of_width_are_where_the_first_grasp_is_all_or_nothing() -> None:
    plain = base()
    wider, narrower = AXES["wider"].bound(plain), AXES["narrower"].bound(plain)
    travel = plain.hand.m_per_count * np.array(plain.object.grip_counts, float)
    forces = np.zeros(3)
    for more_mm, thumb_n in ((wider, 10.0), (-narrower, 0.0)):
        p = contact.parameters(plain.contact, plain.object)
        width = plain.object.half_width_m + 1e-3 * more_mm
        laws.normal_forces(p, width, travel, contact.initial_state(), forces)
        assert forces[0] == pytest.approx(thumb_n, abs=0.01)


def test_grid_has_each_axis_moved_alone_and_the_settings_as_they_are_once() -> None:
    spec = CampaignSpec(
        name="x", objects=("can", "ball"), axes={"mass": (1.0, 1.2), "gain": (0.5,)}
    )
    places = combinations(spec)
    assert [place.swept[MOVED] for place in places] == ["", "mass", "mass", "gain"] * 2
    assert set(places[0].swept[AT]) == {"mass", "gain"}
    value, share = places[1].swept[AT]["mass"]
    assert value == 1.0 and share == pytest.approx(1.0 / AXES["mass"].bound(base()))
    moved = places[1].config.object
    assert moved.mass_kg + moved.added_mass_kg == pytest.approx(1.0)
    assert len({place.config.digest() for place in places}) == len(places)


@pytest.mark.parametrize(
    "wrong, named",
    [
        ({"axes": {"weight": (1.0,)}}, "axes.weight"),
        ({"axes": {"mass": (1.0, 1.0)}}, "axes.mass"),
        ({"axes": {"mass": ()}}, "axes.mass"),
        ({"axes": {"mass": (9.0,)}}, "added_mass_kg"),
        ({"axes": {"mass": (1.0,)}, "scenarios": ("tap",)}, "axes"),
        ({"draws": 4}, "draws"),
    ],
)
def test_axes_that_cannot_be_are_refused(wrong: dict[str, object], named: str) -> None:
    spec = CampaignSpec(name="x", objects=("can",), **wrong)  # type: ignore[arg-type]
    with pytest.raises(ConfigError) as error:
        combinations(spec)
    assert named in error.value.message
