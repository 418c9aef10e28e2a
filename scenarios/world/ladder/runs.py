"""How much physics a run gets: the worst corner of its trials decides, once for all of them.

A run's scene is what its settings say of object, hand and path, and the ranges that seeds draw
from. Its corners are scenes of the planner with the same body and the same contact that the cell is
built from; verdict (held or lost), slip distance, rotation and peak force are asked.
"""

import itertools
from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from scenarios.world.blow import Blow
from scenarios.world.contact import GRAVITY_MPS2, finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.planner import MODEL_SHARE, Plan, Tolerance, choose, gap
from scenarios.world.ladder.scene import ArmRise, Closing, Grip, Scene, Three, Vibration, squeeze
from scenarios.world.objects import GraspObject
from scenarios.world.scene_terms import PullSettings
from scenarios.world.world_settings import Level, RunPlan, WorldSettings

LIFT_S, FIRM_S, TAP_S, STRUCK_S, SETTLES_S, SHAKEN_S = 1.6, 0.6, 0.4, 0.02, 0.1, 1.0
DECIDED_S = 1.0  # after so long a pull the object is lost, or stands
NEARLY = (1.02, 1.1)  # a pull that the pads just bear decides whether the object slips; assumed
LEAST_STEP_S = 1e-5
REACTION_S = (0.1, 0.6)  # start of the rise to first closing; assumed


class Ranges(msgspec.Struct, frozen=True, kw_only=True):
    """How far trials may be from what the settings say: the furthest that a seed draws."""

    friction: Annotated[float, Meta(description="relative")] = 0.0
    mass: Annotated[float, Meta(description="relative")] = 0.0
    height_m: float = 0.0
    aside_m: float = 0.0
    scatter_m: Annotated[float, Meta(description="of where a finger stops")] = 0.0
    impulse: Annotated[float, Meta(description="relative")] = 0.0
    offset_m: Annotated[float, Meta(description="of where a blow lands")] = 0.0


class RunScene(msgspec.Struct, frozen=True, kw_only=True):
    """What all trials of one object and scenario do to it: a lift, or a blow on what is held; a
    pull besides, where there is one. ``mark_height_m``: of the tape mark, above the grip."""

    body: GraspObject
    contact: ContactSettings
    first_travel_m: Three  # of the first grasp
    full_grip_n: Three
    closing_mps: float
    arm: ArmRise
    ranges: Ranges = Ranges()
    reaction_s: tuple[float, float] = REACTION_S  # the first and the last
    blow: Blow | None = None
    pull: PullSettings = PullSettings()
    mark_height_m: float = 0.05

    def lifts(self) -> list[Scene]:
        """Corners of what goes on without a blow: weak and firm, the weight and the uneven grip on
        either side, early and late answers; of a tap the rise in a firm grip. With a pull also
        that, on what is held firmly: weak, firm, and where the pads just bear it."""
        if self.blow is not None:
            return [self._firm(grip) for grip in (-1.0, 1.0)] + self._pulls()
        return self._pulls() + [self.lift(*signs) for signs in self._signs()]

    def _pulls(self) -> list[Scene]:
        if self.pull.force_n == 0.0:
            return []
        grips = (*map(self._grip_that_bears, NEARLY), -1.0, 1.0)
        sides = (1.0,) if self._mirrored else (-1.0, 1.0)
        return [self._pulled(a, b) for a in grips for b in sides]

    def _grip_that_bears(self, share: float) -> float:
        """From weak (-1) to firm (1): in which relaxed pads bear so much of weight and pull; the
        nearer end where none does."""
        kept = 1 - self.contact.relaxation_fraction
        weight_n, r = self.body.total_kg * GRAVITY_MPS2, self.ranges
        bears_n = 2 * kept * self.body.friction_static * sum(self.full_grip_n[1:])
        change_n = r.friction * bears_n + share * r.mass * weight_n  # to the firm end
        lacks_n = share * (weight_n + self.pull.force_n) - bears_n
        return max(-1.0, min(1.0, lacks_n / change_n)) if change_n > 0.0 else 0.0

    def blows(self) -> list[Scene]:
        """Likewise of a blow: weak and firm grips, either side, strong and weak blows."""
        if self.blow is None:
            return []
        return [self.tap(self.blow, *signs) for signs in self._signs()]

    def _signs(self) -> Iterable[tuple[float, float, float]]:
        """Grip, side and path of each corner, the worst first, and at last the middle of grip and
        path: what loses the object at one end of its ranges and leaves it still at the other, tells
        of neither how far it slips. Where either side is the mirror image of the other, one of
        them."""
        sides = (1.0,) if self._mirrored else (-1.0, 1.0)
        corners = itertools.product((-1.0, 1.0), sides, (1.0, -1.0))
        return [*corners, *((0.0, side, 0.0) for side in sides)]

    @property
    def _mirrored(self) -> bool:
        blow = self.blow
        even = blow is None or (blow.direction == "top" and blow.offset_m == 0.0)
        return even and self.body.centre_aside_m == 0.0

    def _body(self, grip: float, aside: float) -> GraspObject:
        body, r = self.body, self.ranges
        rub, weight = 1 + grip * r.friction, 1 - grip * r.mass
        return msgspec.structs.replace(
            body,
            friction_static=body.friction_static * rub,
            friction_kinetic=body.friction_kinetic * rub,
            mass_kg=body.mass_kg * weight,
            added_mass_kg=body.added_mass_kg * weight,
            grip_height_m=body.grip_height_m - grip * r.height_m,
            body_above_grip_m=body.body_above_grip_m + grip * r.height_m,
            centre_aside_m=body.centre_aside_m + aside * r.aside_m,
        )

    def _uneven(self, travel: Three, side: float) -> Grip:
        """The finger on the weight's other side stops first."""
        a, b, c = travel
        off = side * self.ranges.scatter_m
        return Grip(travel_m=(a, b + off, c - off))

    def lift(self, grip: float = 0.0, aside: float = 0.0, path: float = 0.0) -> Scene:
        """A corner of a lift; as it stands, the middle of its ranges."""
        (a_n, b_n, c_n), (early, late) = self.full_grip_n, self.reaction_s
        closing = Closing(
            start_s=early + 0.5 * (1 + path) * (late - early), speed_mps=self.closing_mps,
            force_stop_n=a_n, fingers="all" if a_n > b_n + c_n else "thumb",
        )  # fmt: skip
        first = msgspec.structs.replace(self._uneven(self.first_travel_m, aside), closing=closing)
        return self._scene(
            "lift", LIFT_S, self._body(grip, aside), grip=first, on_table=True, arm=self.arm
        )

    def _firm(self, grip: float) -> Scene:
        return self._held("firm lift", FIRM_S, grip, 1.0, on_table=True, arm=self.arm)

    def tap(self, blow: Blow, grip: float = 0.0, aside: float = 0.0, path: float = 0.0) -> Scene:
        """A corner of a blow on what is held."""
        share, r = 1 + path * self.ranges.impulse, self.ranges
        struck = msgspec.structs.replace(
            blow, impulse_n_s=max(0.0, share * blow.impulse_n_s), delay_s=STRUCK_S,
            follow_n_s=max(0.0, share * blow.follow_n_s),
            offset_m=blow.offset_m + aside * r.offset_m,
        )  # fmt: skip
        return self._held(f"tap ({blow.direction})", TAP_S, grip, aside, tap=struck)

    def _pulled(self, grip: float, aside: float) -> Scene:
        lasts_s = min(self.pull.lasts_s, DECIDED_S)
        pull = msgspec.structs.replace(self.pull, after_s=STRUCK_S, lasts_s=lasts_s)
        seconds = 2 * (STRUCK_S + pull.ramp_s) + pull.lasts_s + SETTLES_S
        return self._held("pull", seconds, grip, aside, pull=pull)

    def shaken(self, shake: Vibration) -> Scene:
        """What is held, in a hand that shakes."""
        return self._held("hold", SHAKEN_S, 0.0, 0.0, vibration=shake)

    def _held(self, name: str, seconds: float, grip: float, aside: float, **terms: Any) -> Scene:
        """In the firm grip."""
        _, b_n, c_n = self.full_grip_n
        body = self._body(grip, aside)
        fingers = self._uneven(squeeze(body, self.contact, b_n, c_n), aside)
        return self._scene(name, seconds, body, grip=fingers, **terms)

    def _scene(self, name: str, seconds: float, body: GraspObject, **terms: Any) -> Scene:
        return Scene(
            name=name, duration_s=seconds, body=body, contact=self.contact,
            mark_height_m=self.mark_height_m, **terms,
        )  # fmt: skip


class _Chosen(msgspec.Struct, frozen=True):
    """A level and a step; ``why`` is empty where it was told."""

    level: Level
    step_s: float
    why: tuple[str, ...] = ()


def asked_of(world: WorldSettings, contact: ContactSettings) -> Tolerance:
    """What a run must answer, and how exactly."""
    return Tolerance(
        slip_m=world.tolerance, rotation_rad=world.tolerance / contact.turn_lever_m,
        peak_force_n=world.force_tolerance_n,
    )  # fmt: skip


@cache
def plan_run(scene: RunScene, world: WorldSettings) -> RunPlan:
    """Level and steps for all trials of a scene. Raises ValueError where one was told that cannot
    do it."""
    contact, asked = scene.contact, asked_of(world, scene.contact)
    before = _chosen(world.forced, scene.lifts(), contact.step_s, asked)
    struck = _Chosen(before.level, contact.blow_step_s)
    if scene.blow is not None:
        told = world.forced if world.from_blow_on is None else world.from_blow_on
        struck = _chosen(told, scene.blows(), contact.blow_step_s, asked)
        if told is None and struck.level < before.level:
            struck = msgspec.structs.replace(struck, level=before.level)
        if struck.level is Level.RIGID and scene.blow.direction == "side":
            raise ValueError("L0 moves up and down only: no blow from the side")
        if struck.level < before.level:
            raise ValueError(
                f"{before.level.label} before the blow, and {struck.level.label} is less"
            )
    return RunPlan(
        level=before.level.label, step_s=before.step_s, blow_level=struck.level.label,
        blow_step_s=struck.step_s, asked=world.level, blow_asked=world.blow_level,
        tolerance_m=asked.slip_m, tolerance_rad=asked.rotation_rad or 0.0,
        tolerance_n=world.force_tolerance_n, why=before.why + struck.why,
    )  # fmt: skip


def _chosen(
    told: Level | None, scenes: list[Scene], largest_s: float, asked: Tolerance
) -> _Chosen:  # fmt: skip
    """What the corner that asks for most needs, and a step that does there and in the middle. L0 is
    left out: a run that has it is no faster, and its fingertips feel no pad give before it
    slides."""
    if told is not None:
        return _Chosen(told, largest_s)
    plans = []
    for scene in scenes:
        plans.append((choose(scene, asked, Level.SLIDER), scene))
        if plans[-1][0].level is Level.BRUSH:  # none asks for more
            break
    found, corner = max(plans, key=lambda pair: _demand(pair[0]))
    why = f"{corner.name}, in the corner that asks for most: {found.level.label}", *found.reasons()
    steps = [_step_s(scene, found.level, largest_s, asked) for scene in (corner, scenes[-1])]
    return _Chosen(found.level, min(steps), why)


def _demand(found: Plan) -> tuple[int, float]:
    """The fullest level, and of those the one that came nearest to needing more."""
    last = found.comparisons[-1].gap if found.comparisons else 0.0
    return int(found.level), last


def _step_s(scene: Scene, level: Level, largest_s: float, asked: Tolerance) -> float:
    """Largest step whose own error, twice what half of it changes, keeps its share."""
    step_s, coarse = largest_s, simulate(scene, level, largest_s)
    while step_s > LEAST_STEP_S:
        fine = simulate(scene, level, 0.5 * step_s)
        if 2 * gap(coarse, fine, asked) <= MODEL_SHARE:
            break
        step_s, coarse = 0.5 * step_s, fine
    return step_s


def first_travel(
    counts: tuple[int, int, int], m_per_count: float, contact: ContactSettings, body: GraspObject
) -> Three:
    """Finger travel of a first grasp at those motor counts, no further than ten newtons deep."""
    most = contact.half_aperture_m - body.half_width_m + 10.0 / finger_stiffness(contact, body)
    a, b, c = (min(n * m_per_count, most) for n in counts)
    return a, b, c
