"""Chooses the cheapest level of the contact ladder, and a step, that answers within a tolerance.

Three questions, asked separately. A structural indicator says which terms a scene could do without
(no lever and no side load: nothing turns). Agreement with a fuller level says whether it can here.
Halving the step bounds what the integration adds; results are extrapolated from two steps.
"""

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from scenarios.world.contact import (
    BRUSH_POINTS,
    FINGERS,
    GRAVITY_MPS2,
    SQUARE_SPIN,
    Floats,
    finger_places,
    parameters,
)
from scenarios.world.ladder.drive import UP, tap_wrench
from scenarios.world.ladder.levels import SceneOutcome, admits_rigid, simulate
from scenarios.world.ladder.rigid import press
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level

# The first four from 160 random scenes (seed 7) that no figure of docs/physics.md comes from.
COARSE_POINTS = 3  # brush points a side that confirm L3
COARSE_SHARE = 0.3  # of the gap between L3 and that brush is what the brush itself is off
MODEL_SHARE = 1 / 3  # of the tolerance: errors were up to 1.7 x the gap to the next level
SKIP_SHARE = 1 / 2  # of it, where the fuller one is two levels up: most of the way to the brush
HOPELESS = 3.0  # tolerances between L2 and L3: then L3 is off too, by a third of it
STEP_SHARE = 1 / 2  # of the tolerance, for the difference of a step and its half
SLOW_VIBRATION = 0.25  # of the pads' resonance: amplified by 1 / (1 - 0.25^2), 7 %
NEAR_CONE = 0.9
STEPS_A_PULSE = 4
STEPS_A_PERIOD = 16
LARGEST_STEP_S, LEAST_STEP_S = 2e-3, 1e-5
NO_LEVER = 1e-9
THUMB = np.array([1.0, 0.0, 0.0])


class Tolerance(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a scene is asked for, and how exactly; None: not asked."""

    slip_m: Annotated[float, Meta(gt=0.0, description="of the tape mark")] = 1e-3
    rotation_rad: Annotated[float, Meta(gt=0.0)] | None = None
    peak_force_n: Annotated[float, Meta(gt=0.0)] | None = None

    def words(self) -> str:
        """As a person reads it."""
        asked = [f"{self.slip_m * 1e3:.4g} mm"]
        if self.rotation_rad is not None:
            asked.append(f"{math.degrees(self.rotation_rad):.3g} deg")
        if self.peak_force_n is not None:
            asked.append(f"{self.peak_force_n:.3g} N")
        return ", ".join(asked)


class Indicators(msgspec.Struct, frozen=True):
    """Dimensionless numbers of a scene that say which terms it could do without."""

    load_ratio: float  # peak load along the pads over the static cone at the final grip
    eccentricity: float  # torque about the middle of the friction, over what the pads can bear
    sideways: bool
    frequency_ratio: float  # of a vibration to the object on its pads
    pulse_ratio: float  # of a tap's length to that period; inf without a tap
    coupled: bool  # flanks or relaxation: forces depend on the motion

    @property
    def turns(self) -> bool:
        """True when something may move the object out of the line of L0 and L1."""
        return self.sideways or self.eccentricity > NO_LEVER

    @property
    def rings(self) -> bool:
        """True when a vibration is amplified by the pads, or comes so near the cone that a little
        of that decides: L0 and L1 would agree by chance at best."""
        near = self.frequency_ratio > 0.0 and self.load_ratio > NEAR_CONE
        return near or self.frequency_ratio > SLOW_VIBRATION


class Answer(msgspec.Struct, frozen=True):
    """Quantities of one level, extrapolated from two steps, and the difference of those steps."""

    level: Level
    points: int  # brush points a side; of L4 only
    step_s: float  # the finer one
    mark_m: tuple[float, float]
    turn_rad: float
    peak_force_n: float
    step_error: float  # of the two steps, in tolerances
    held: bool

    @property
    def slip_m(self) -> float:
        return math.hypot(*self.mark_m)


class Comparison(msgspec.Struct, frozen=True):
    """A level against the next fuller one; the gap in tolerances."""

    level: Level
    against: Level
    gap: float

    @property
    def allowed(self) -> float:
        """Share of the tolerance that the gap may be."""
        return SKIP_SHARE if self.against - self.level > 1 else MODEL_SHARE

    @property
    def agree(self) -> bool:
        return self.gap <= self.allowed


class Plan(msgspec.Struct, frozen=True):
    """The choice, its answer, and why."""

    scene: str
    tolerance: Tolerance
    indicators: Indicators
    comparisons: tuple[Comparison, ...]
    answer: Answer

    @property
    def level(self) -> Level:
        return self.answer.level

    def reasons(self) -> list[str]:
        """Why that level, in a few lines."""
        return _reasons(self)

    def lines(self) -> list[str]:
        """The same, and the choice with its answer."""
        return [*_reasons(self), *_choice(self.answer, self.tolerance)]


def indicators(scene: Scene) -> Indicators:
    """Indicators from the scene's terms alone: nothing is simulated."""
    normal = press(parameters(scene.contact, scene.body), _final_travel(scene))
    total_n, mass = float(normal.sum()), scene.mass_kg
    cone_n = scene.body.friction_static * total_n
    places = finger_places(scene.contact)
    middle = normal @ places / total_n if total_n > 0.0 else np.zeros(2)
    weight_n = mass * (GRAVITY_MPS2 + _acceleration(scene))
    loads = [np.array([0.0, -weight_n, 0.0, -weight_n * scene.body.centre_aside_m])]
    period_s = 2 * math.pi * math.sqrt(mass / (3 * scene.contact.shear_stiffness_npm))
    pulse = math.inf
    if scene.tap is not None:
        peak_n = 0.5 * math.pi * scene.tap.impulse_n_s / scene.tap.duration_s
        loads.append(peak_n * tap_wrench(scene.tap))
        pulse = scene.tap.duration_s / period_s
    if scene.pull is not None:
        loads.append(-scene.pull.force_n * UP)
    force = np.hypot(*np.sum(loads, axis=0)[:2])
    torque = max(abs(w[3] - middle[0] * w[1] + middle[1] * w[0]) for w in loads)
    return Indicators(
        load_ratio=float(force / cone_n) if cone_n > 0.0 else math.inf,
        eccentricity=float(torque / (cone_n * _reach(scene))) if cone_n > 0.0 else math.inf,
        sideways=any(w[0] != 0.0 for w in loads),
        frequency_ratio=scene.vibration.frequency_hz * period_s if scene.vibration else 0.0,
        pulse_ratio=pulse,
        coupled=not admits_rigid(scene),
    )


def _reach(scene: Scene) -> float:
    """Lever at which the pads bear torque: their distance from the middle and their own spin."""
    distance = 2 / FINGERS * 0.5 * scene.contact.finger_spacing_m  # the thumb is in the middle
    reach: float = max(distance + SQUARE_SPIN * scene.contact.pad_half_length_m, 1e-6)
    return reach


def _acceleration(scene: Scene) -> float:
    shake = scene.vibration.acceleration_mps2 if scene.vibration is not None else 0.0
    return shake + (scene.arm.acceleration_mps2 if scene.arm is not None else 0.0)


def _final_travel(scene: Scene) -> Floats:
    """Finger travel (3,) at which a closing thumb meets its force stop; else as it is."""
    travel, closing = np.array(scene.grip.travel_m), scene.grip.closing
    if closing is None:
        return travel
    p = parameters(scene.contact, scene.body)
    low, high = 0.0, scene.contact.half_aperture_m
    for _ in range(40):  # monotone: more travel, more force
        middle = 0.5 * (low + high)
        pressed = press(p, travel + middle * THUMB)[0]
        low, high = (middle, high) if pressed < closing.force_stop_n else (low, middle)
    return travel + low * THUMB


def first_step_s(scene: Scene) -> float:
    """Largest step that still sees the scene's fastest term."""
    step = LARGEST_STEP_S
    if scene.tap is not None:
        step = min(step, scene.tap.duration_s / STEPS_A_PULSE)
    if scene.pull is not None:
        step = min(step, scene.pull.ramp_s / STEPS_A_PULSE)
    if scene.vibration is not None:
        step = min(step, 1.0 / (STEPS_A_PERIOD * scene.vibration.frequency_hz))
    return step


def answer(
    scene: Scene, level: Level, tolerance: Tolerance, step_s: float,
    points: int = BRUSH_POINTS,
) -> Answer:  # fmt: skip
    """Two runs, at step_s and half of it, extrapolated: backward Euler is of first order."""
    coarse = simulate(scene, level, step_s, points)
    if level is Level.RIGID:
        return _extrapolate(coarse, coarse, points, tolerance)
    return _extrapolate(coarse, simulate(scene, level, 0.5 * step_s, points), points, tolerance)


def _extrapolate(
    coarse: SceneOutcome, fine: SceneOutcome, points: int, tolerance: Tolerance
) -> Answer:
    mark = 2 * np.array(fine.mark_m) - np.array(coarse.mark_m)
    bare = Answer(
        level=fine.level, points=points, step_s=fine.step_s,
        mark_m=(float(mark[0]), float(mark[1])), turn_rad=2 * fine.turn_rad - coarse.turn_rad,
        peak_force_n=fine.peak_force_n, step_error=0.0, held=fine.held,
    )  # fmt: skip
    return msgspec.structs.replace(bare, step_error=gap(coarse, fine, tolerance))


def gap(a: SceneOutcome | Answer, b: SceneOutcome | Answer, tolerance: Tolerance) -> float:
    """Largest difference of what is asked, in tolerances. The verdict is always asked, and of an
    object that is lost nothing else."""
    if not (a.held and b.held):
        return 0.0 if a.held == b.held else math.inf
    apart = math.dist(a.mark_m, b.mark_m) / tolerance.slip_m
    if tolerance.rotation_rad is not None:
        apart = max(apart, abs(a.turn_rad - b.turn_rad) / tolerance.rotation_rad)
    if tolerance.peak_force_n is not None:
        apart = max(apart, abs(a.peak_force_n - b.peak_force_n) / tolerance.peak_force_n)
    return apart


def refined(scene: Scene, first: Answer, tolerance: Tolerance) -> Answer:
    """Halve the step until that changes the result by less than its share of the tolerance."""
    found = first
    while found.step_error > STEP_SHARE and found.step_s > LEAST_STEP_S:
        fine = simulate(scene, found.level, found.step_s, found.points)
        finer = simulate(scene, found.level, 0.5 * found.step_s, found.points)
        found = _extrapolate(fine, finer, found.points, tolerance)
    return found


def reference(scene: Scene, tolerance: Tolerance) -> Answer:
    """The fullest level whatever the scene, its step halved as for a plan."""
    return refined(scene, answer(scene, Level.BRUSH, tolerance, first_step_s(scene)), tolerance)


def plan(scene: Scene, tolerance: Tolerance) -> Plan:
    """Cheapest level that a fuller one confirms, and a step."""
    found = choose(scene, tolerance)
    return msgspec.structs.replace(found, answer=refined(scene, found.answer, tolerance))


def choose(scene: Scene, tolerance: Tolerance, least: Level = Level.RIGID) -> Plan:
    """That level from ``least`` on, answered by the first step. Always ends: the last one is the
    brush."""
    facts = indicators(scene)
    step_s = first_step_s(scene)
    compared: list[Comparison] = []

    def agree(here: Answer, fuller: Answer) -> bool:
        compared.append(Comparison(here.level, fuller.level, gap(here, fuller, tolerance)))
        return compared[-1].agree

    def at(level: Level, points: int = BRUSH_POINTS) -> Answer:
        return answer(scene, level, tolerance, step_s, points)

    def found(here: Answer) -> Plan:
        return Plan(scene.name, tolerance, facts, tuple(compared), here)

    if not facts.turns:
        slider = at(Level.SLIDER)
        rigid_admitted = least is Level.RIGID and not (facts.coupled or facts.rings)
        if rigid_admitted and agree(rigid := at(Level.RIGID), slider):
            return found(rigid)
        return found(slider)
    # L0 and L1 omit the rotation, would agree and both be wrong: L1 is held against L3, which has
    # it, and has the patches that keep it small
    spin = at(Level.SPIN)
    if agree(slider := at(Level.SLIDER), spin):
        return found(slider)
    # L2 is never the choice: it costs what L3 does. Where it agrees, patches hardly matter
    if agree(at(Level.POINTS), spin):
        return found(spin)
    if compared[-1].gap <= HOPELESS:
        coarse = at(Level.BRUSH, COARSE_POINTS)
        if agree(spin, coarse):
            return found(spin)
        if compared[-1].gap * COARSE_SHARE <= MODEL_SHARE:
            return found(coarse)
    return found(at(Level.BRUSH))


_MEANING = {
    Level.RIGID: "rigid Coulomb, exact",
    Level.SLIDER: "compliant sliders along the lift",
    Level.POINTS: "planar, a point a finger",
    Level.SPIN: "planar, a limit surface with spin a finger",
    Level.BRUSH: "planar, brush points",
}


def _reasons(found: Plan) -> list[str]:
    facts = found.indicators
    turning = "nothing turns the object: L2 to L4 would move as L1 does"
    if facts.turns:
        side = "a side load" if facts.sideways else "a lever"
        turning = f"{side}, eccentricity {facts.eccentricity:.2g}: L0 is not admitted"
    lines = [f"load {facts.load_ratio:.2f} of the static cone; {turning}"]
    if facts.coupled:
        lines.append("flanks, relaxing pads or a pull: L0 is not admitted")
    if facts.rings:
        lines.append(f"vibration at {facts.frequency_ratio:.2f} of the pads' resonance or near the "
                     "cone: L0 is not admitted")  # fmt: skip
    if math.isfinite(facts.pulse_ratio):
        lines.append(f"the tap lasts {facts.pulse_ratio:.2f} periods of the object on its pads")
    for c in found.comparisons:
        verdict = "agree" if c.agree else "do not agree"
        lines.append(
            f"L{int(c.level)} and L{int(c.against)} {verdict}: {c.gap:.2g} tolerances apart "
            f"({c.allowed:.2g} allowed)"
        )
    return lines


def _choice(a: Answer, tolerance: Tolerance) -> list[str]:
    step = "no step" if a.level is Level.RIGID else f"step {a.step_s * 1e3:.3g} ms"
    meaning = _MEANING[a.level]
    if a.level is Level.BRUSH:
        meaning += f" {a.points} x {a.points} a finger"
    lines = [f"choice: L{int(a.level)} ({meaning}), {step}, two steps "
             f"{a.step_error:.2g} tolerances apart ({STEP_SHARE:.2g} allowed)"]  # fmt: skip
    if a.step_error > STEP_SHARE:
        least_ms = LEAST_STEP_S * 1e3
        lines.append(f"TOLERANCE NOT KEPT: no step below {least_ms:.2g} ms is halved further")
    turn_deg, slip_mm = math.degrees(a.turn_rad), a.slip_m * 1e3
    lost = "" if a.held else "the object is lost: "
    lines.append(f"{lost}slip {slip_mm:.3f} mm at the mark, rotation {turn_deg:.2f} deg, peak "
                 f"force {a.peak_force_n:.2f} N; asked within {tolerance.words()}")  # fmt: skip
    return lines
