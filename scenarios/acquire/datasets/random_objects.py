"""Random objects for training data, all distinct from the objects of the experiments.

The distance of two objects is Euclidean in the space of normalised properties (``SCALES``): each
difference is divided by the span of its property, some on a logarithmic scale. Surfaces only have
the properties that a fingertip can measure. Training objects keep a distance of ``MARGIN`` from all
objects of config/objects and from those reserved for testing.
"""

import itertools
import math
from functools import cache
from typing import Any, Literal

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import Counts3
from grasp.settings import UNSEEN, item_layer, load, named_layer, names
from scenarios.lift.config import LiftConfig
from scenarios.world import contact, laws
from scenarios.world.objects import GraspObject, Name
from scenarios.world.settings import (
    HALF_APERTURE_M,
    WALL_STIFFNESS_NPM,
    FixedSurface,
)

Range = tuple[float, float]
Forces = tuple[float, float, float]  # of each finger, N
MARGIN = 0.35  # distance of can and box, the most similar pair of the six objects
# Span of each property, and whether it is logarithmic; curvatures 1/m, upwards and around.
SCALES = {
    "half_width_m": (0.02, 0.065, False),
    "mass_kg": (0.05, 1.0, True),
    "friction_kinetic": (0.4, 1.0, False),
    "wall_stiffness_npm": (1e3, 1e6, True),
    "texture_rms_m": (5e-5, 6e-4, True),
    "texture_length_m": (8e-4, 3.5e-3, True),
    "curved_up": (0.0, 30.0, False),
    "curved_around": (0.0, 30.0, False),
}
MASS = "mass_kg"
NEAR_COUNTS, ASIDE_COUNTS = 6, 1  # search range: past first contact; between two fingers
MIN_GRIP_N = (0.75, 0.3, 0.3)  # forces of a first grip, with a reserve for variation of trials
CARRIED = 1.5  # friction of a full grip over the weight, so that an impact does not eject it
MAX_TRIES = 1000
LOGARITHMIC = (MASS, "wall_stiffness_npm", "texture_rms_m", "texture_length_m")


class ShapeRanges(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Ranges of one object shape, from config/object_shapes: log-uniform for ``LOGARITHMIC``
    properties, uniform for the others."""

    name: Name
    shape: Literal["straight", "ellipsoid"]
    half_width_m: Range
    mass_kg: Range
    thumb_n: Range
    friction_static: Range
    kinetic_share: Range
    wall_stiffness_npm: Range
    texture_rms_m: Range
    texture_length_m: Range
    radius_of_gyration_m: Range
    centre_above_m: Range
    half_height_m: Range = (0.1, 0.1)
    grip_height_m: Range = (0.0, 0.0)
    body_above_grip_m: Range = (0.15, 0.15)

    def ranges(self) -> dict[str, Range]:
        return {k: v for k, v in msgspec.structs.asdict(self).items() if isinstance(v, tuple)}

    def __post_init__(self) -> None:
        for name, (low, high) in self.ranges().items():
            if low > high or (name in (*LOGARITHMIC, "thumb_n") and low <= 0.0):
                raise ValueError(f"{name}: {low:g} to {high:g} is not a range, or has no logarithm")


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    shape: ShapeRanges


class _Objects(msgspec.Struct, frozen=True):
    object: GraspObject


@cache
def shape_ranges(name: str) -> ShapeRanges:
    """Ranges by the name in config/object_shapes, or the path of a file. Raises ConfigError."""
    return load(_File, [item_layer("object_shapes", "shape", name)]).shape


@cache
def excluded_objects() -> tuple[GraspObject, ...]:
    """All objects of the experiments, and those reserved for testing."""
    every = [*names("objects"), *names(f"objects/{UNSEEN}")]
    return tuple(load(_Objects, [named_layer("objects", name)]).object for name in every)


def distance(one: dict[str, Range], other: dict[str, Range]) -> float:
    """Distance in the common properties; overlapping ranges have distance 0."""
    squares = 0.0
    for name in one.keys() & other.keys():
        low, high, logarithmic = SCALES[name]
        of = math.log if logarithmic else float
        (a, b), (c, d) = one[name], other[name]
        apart = max(0.0, of(c) - of(b), of(a) - of(d))
        squares += (apart / (of(high) - of(low))) ** 2
    return math.sqrt(squares)


def object_properties(body: GraspObject) -> dict[str, Range]:
    """Properties of an object; its mass is the range up to that with added weights."""
    up, around = 0.0, 0.0
    if body.shape == "ellipsoid":
        up, around = body.half_width_m / body.half_height_m**2, 1.0 / body.half_width_m
    found = {name: getattr(body, name) for name in SCALES if hasattr(body, name)}
    found |= {"curved_up": up, "curved_around": around}
    return _points(found) | {MASS: (body.mass_kg, body.total_kg)}


def surface_properties(surface: FixedSurface) -> dict[str, Range]:
    """Properties of a fixed surface; upwards is along the fingertip's x."""
    found = {name: getattr(surface, name) for name in SCALES if hasattr(surface, name)}
    radii = {"curved_up": surface.radius_x_m, "curved_around": surface.radius_y_m}
    found["wall_stiffness_npm"] = WALL_STIFFNESS_NPM
    return _points(found | {name: 1.0 / r if r else 0.0 for name, r in radii.items()})


def _points(values: dict[str, float]) -> dict[str, Range]:
    return {name: (value, value) for name, value in values.items()}


def is_distinct(properties: dict[str, Range]) -> bool:
    """Whether the distance to every object of the experiments is at least MARGIN."""
    others = map(object_properties, excluded_objects())
    return all(distance(properties, other) >= MARGIN for other in others)


def random_object(
    shape: str, load_share: Range | None, config: LiftConfig, rng: np.random.Generator
) -> GraspObject:
    """Random object of a shape for that hand, distinct from those of the experiments. Its weight
    is a ``load_share`` of the friction of its first grip; if None, a full grip carries it. Raises
    ConfigError."""
    ranges, full_grip_n = shape_ranges(shape), sum(config.guard.full_grip_n)
    for _ in range(MAX_TRIES):
        body = _sampled(ranges, rng)
        grip = first_grip(body, config, _random(ranges.thumb_n, rng, True))
        if grip is None:
            continue
        counts, pressed_n = grip
        mass_kg = body.mass_kg
        if load_share is not None:
            carries_n = body.friction_static * sum(pressed_n)
            mass_kg = _random(load_share, rng) * carries_n / contact.GRAVITY_MPS2
        body = msgspec.structs.replace(body, grip_counts=counts, mass_kg=mass_kg)
        firm = full_grip_n * body.friction_kinetic >= CARRIED * mass_kg * contact.GRAVITY_MPS2
        if (firm or load_share is not None) and is_distinct(object_properties(body)):
            return body
    raise ConfigError(
        "config/object_shapes", ranges.name,
        "no object found that differs from those of the experiments and has a grip that holds it",
        "wider ranges",
    )  # fmt: skip


def _sampled(ranges: ShapeRanges, rng: np.random.Generator) -> GraspObject:
    values: dict[str, Any] = {
        name: _random(bounds, rng, name in LOGARITHMIC) for name, bounds in ranges.ranges().items()
    }
    values["friction_kinetic"] = values["friction_static"] * values.pop("kinetic_share")
    del values["thumb_n"]
    return GraspObject(name=ranges.name, shape=ranges.shape, grip_counts=(0, 0, 0), **values)


def _random(bounds: Range, rng: np.random.Generator, logarithmic: bool = False) -> float:
    low, high = np.log(bounds) if logarithmic else bounds
    value = float(rng.uniform(low, high))
    return math.exp(value) if logarithmic else value


def first_grip_n(config: LiftConfig) -> Forces:
    """Forces of the pads in the first grip of the configured object, after relaxation, N."""
    return _relaxed_n(config.object, config, config.object.grip_counts)


def _relaxed_n(body: GraspObject, config: LiftConfig, counts: Counts3) -> Forces:
    p, pressed = contact.parameters(config.contact, body), np.zeros(contact.FINGERS)
    width_m, _ = laws.width_and_slope(p, 0.0)
    travel = config.hand.m_per_count * np.array(counts, float)
    laws.normal_forces(p, width_m, travel, contact.initial_state(), pressed)
    a, b, c = ((1 - config.contact.relaxation_fraction) * pressed).tolist()
    return a, b, c


def first_grip(
    body: GraspObject, config: LiftConfig, thumb_n: float
) -> tuple[Counts3, Forces] | None:
    """Finger positions in whole counts that give the thumb's force nearest to ``thumb_n``, and the
    relaxed forces. None if no positions reach MIN_GRIP_N."""
    width_m, _ = laws.width_and_slope(contact.parameters(config.contact, body), 0.0)
    first = int((HALF_APERTURE_M - width_m) / config.hand.m_per_count)
    near = range(max(0, first - 1), min(255, first + NEAR_COUNTS) + 1)
    least_error, best = math.inf, None
    for a, b, c in itertools.product(near, near, near):
        if not c <= b <= c + ASIDE_COUNTS or abs(2 * a - b - c) > 2:
            continue
        relaxed = _relaxed_n(body, config, (a, b, c))
        error = abs(relaxed[0] - thumb_n)
        if min(np.subtract(relaxed, MIN_GRIP_N)) >= 0.0 and error < least_error:
            least_error, best = error, ((a, b, c), relaxed)
    return best
