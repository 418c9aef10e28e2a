"""Does motion along the closing axis, or tilting, belong in the ladder? Each scene at L4 and in
MuJoCo: held in the ladder's plane, free along x, and free altogether (what the further freedom
adds). L4 is held against the one with its own freedom: a blow along x sets it free there. As in
docs/physics.md; MuJoCo is in the extra `dev`."""

import math
from concurrent.futures import ProcessPoolExecutor

import msgspec
import pytest

from grasp.settings import names
from scenarios.studies.physics import mujoco_hand
from scenarios.studies.physics.mujoco_hand import Assumed, Beyond, Freedom, Motion, Solver
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder import experiments
from scenarios.world.ladder.experiments import SceneSettings, World
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.scene import Scene
from scenarios.world.objects import GraspObject
from scenarios.world.world_settings import Level
from tests.unit.scenarios.conftest import config

LIMITS = 1.0, 2.0, 0.5  # slip, mm; rotation, deg; peak force, N: what a planner may be asked for
ALONG_N = 2.0  # of a blow along the closing axis: L4's peak force is off by no more
LIFT_S = 0.8  # the thumb has closed by 0.5 s
AIM_M = 7e-3  # a blow that moves an object this far by work against friction (tap.aim_m)
PADS = ContactSettings(relaxation_fraction=0.0)
SOFT = msgspec.structs.replace(
    PADS, mount_stiffness_npm=3e3, pad_stiffness_npm=12e3, shear_stiffness_npm=6e3,
    shear_damping_nspm=5.0,
)  # fmt: skip
STIFF = msgspec.structs.replace(
    PADS, mount_stiffness_npm=1e4, pad_stiffness_npm=2e4, shear_stiffness_npm=12e3,
    shear_damping_nspm=16.0,
)  # fmt: skip


class Case(msgspec.Struct, frozen=True):
    """A scene for any object."""

    name: str
    direction: str | None = None  # of a blow; None: a lift
    at_m: float = 0.0  # where it strikes: beside the grip's middle, or above it
    strength: float = 1.0  # of the blow
    pads: ContactSettings = PADS
    aside_m: float = 0.0
    reaction_s: float = 0.35
    beyond: Beyond = Beyond()


CASES = (
    Case("lift"),
    Case("lift, reaction after 0.15 s", reaction_s=0.15),
    Case("lift, soft hand", pads=SOFT),
    Case("lift, stiff hand", pads=STIFF),
    Case("lift, weight 15 mm aside (y)", aside_m=0.015),
    Case("lift, weight 15 mm towards the thumb (x)", beyond=Beyond(weight_x_m=0.015)),
    Case("top, through the middle", "top"),
    Case("top, 20 mm aside (y)", "top", 0.02),
    Case("top, 40 mm aside (y), half as hard again", "top", 0.04, 1.5),
    Case("top, 20 mm towards the thumb (x)", "top", beyond=Beyond(blow_x_m=0.02)),
    Case("side, 40 mm up", "side", 0.04),
    Case("side, 60 mm up, half as hard again", "side", 0.06, 1.5),
    Case("side, 60 mm up, soft hand", "side", 0.06, pads=SOFT),
    Case("side, 40 mm up, 10 mm towards the thumb (x)", "side", 0.04,
         beyond=Beyond(blow_x_m=0.01)),
    Case("closing axis, through the middle", "closing"),
    Case("closing axis, 40 mm up", "closing", beyond=Beyond(blow_z_m=0.04)),
)  # fmt: skip
USUAL = {"lift", "top, through the middle", "top, 20 mm aside (y)", "side, 40 mm up"}
SIDE = next(case for case in CASES if case.name == "side, 40 mm up")
SOLVERS = (  # step, ms; impratio; impedance
    (0.4, 1000, 0.9), (0.2, 1000, 0.9), (0.1, 1000, 0.9), (0.05, 1000, 0.9),
    (0.1, 1, 0.9), (0.1, 10, 0.9), (0.1, 100, 0.9), (0.1, 1000, 0.99), (0.1, 10, 0.9999),
)  # fmt: skip
VARIANTS: tuple[dict[str, float], ...] = (
    {}, {"finger_kg": 0.02}, {"finger_kg": 0.1}, {"pad_kg": 2e-3}, {"pad_kg": 9e-3},
    {"loss_s": 5e-4}, {"loss_s": 3e-3}, {"points": 4},
)  # fmt: skip


def scene_of(case: Case, body: GraspObject) -> Scene:
    """One friction coefficient, the weight shared as the pads' stiffness shares it; no weights are
    added for a tap, and its strength is the trial's."""
    struck = case.direction is not None
    body = msgspec.structs.replace(
        body, friction_static=body.friction_kinetic, centre_aside_m=case.aside_m,
        added_mass_kg=0.0 if struck else body.added_mass_kg,
    )  # fmt: skip
    settings = SceneSettings(reaction_s=case.reaction_s)
    world = World(object=body, contact=case.pads, scene=settings)
    if not struck:
        return msgspec.structs.replace(experiments.lift(world), duration_s=LIFT_S)
    weight_n = body.total_kg * GRAVITY_MPS2 if case.direction == "top" else 0.0
    braking_n = 2 * settings.final_thumb_n * body.friction_kinetic - weight_n
    impulse = case.strength * math.sqrt(2 * body.total_kg * AIM_M * braking_n)
    scene = experiments.tap(world)
    blow = msgspec.structs.replace(
        scene.tap, direction=case.direction, offset_m=case.at_m, impulse_n_s=impulse
    )
    return msgspec.structs.replace(scene, tap=blow, sharing="equal")


def compare(job: tuple[Case, str]) -> tuple[Motion, dict[Freedom, Motion]]:
    """L4 and MuJoCo with each freedom."""
    case, name = job
    scene = scene_of(case, config(object_name=name).object)
    return ladder(scene), {f: mujoco_hand.run(scene, f, beyond=case.beyond) for f in Freedom}


def ladder(scene: Scene) -> Motion:
    """L4 at 0.1 ms."""
    o = simulate(scene, Level.BRUSH, 1e-4)
    return Motion(o.mark_m, o.turn_rad, 0.0, 0.0, o.peak_force_n, o.held)


def its_own(case: Case) -> Freedom:
    """What moves at L4."""
    return Freedom.CLOSING if case.direction == "closing" else Freedom.PLANE


def gap(a: Motion, b: Motion) -> tuple[float, float, float]:
    """Slip, mm; rotation, deg; peak force, N."""
    slip_mm = 1e3 * math.dist(a.mark_m, b.mark_m)
    return slip_mm, math.degrees(abs(a.turn_rad - b.turn_rad)), abs(a.peak_force_n - b.peak_force_n)


def verdict(m: Motion) -> str:
    """Whether it was held, and whether it moved (1 mm) or, in a lift, passed a mark (6 cm)."""
    return f"{'held' if m.held else 'lost'} {sum(m.slip_m > bound for bound in (1e-3, 0.06))}"


def line(m: Motion) -> str:
    return f"{m.slip_m * 1e3:.2f}, {math.degrees(m.turn_rad):.2f}, {m.peak_force_n:.2f}"


def show(gaps: tuple[float, float, float]) -> str:
    return "{:.2f}, {:.1f}, {:.2f}".format(*gaps)


@pytest.mark.bench
@pytest.mark.timeout(3600)
def test_motion_along_the_closing_axis_adds_less_than_the_tolerance_to_the_usual_scenes() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra `dev`)")
    objects = names("objects")
    jobs = [(case, name) for case in CASES for name in objects]
    with ProcessPoolExecutor(2) as pool:
        found = dict(zip(jobs, pool.map(compare, jobs), strict=True))
    print("\nslip, mm; rotation, deg; peak force, N")
    for (case, name), (l4, m) in found.items():
        each = " | ".join(f"{line(x)}, {verdict(x)}" for x in (l4, *m.values()))
        print(f"{case.name} | {name} | {each} | x {m[Freedom.ALL].closing_m * 1e3:.2f} mm, "
              f"tilt {math.degrees(m[Freedom.ALL].tilt_rad):.2f} deg")  # fmt: skip
    print("\n| scene | L4 against MuJoCo with its freedom | x free adds | x and tilts free add "
          "| x, mm | tilt, deg | verdicts that this changes |")  # fmt: skip
    print("|---" * 7 + "|")
    needs: dict[str, set[str]] = {"x": set(), "x and tilts": set(), "verdict": set()}
    for case in CASES:
        rows = [found[case, name] for name in objects]
        bias = [gap(l4, m[its_own(case)]) for l4, m in rows]
        one = [gap(m[Freedom.CLOSING], m[Freedom.PLANE]) for _, m in rows]
        both = [gap(m[Freedom.ALL], m[Freedom.PLANE]) for _, m in rows]
        worst = [tuple(map(max, zip(*gaps, strict=True))) for gaps in (bias, one, both)]
        changed = [name for name, (_, m) in zip(objects, rows, strict=True)
                   if verdict(m[Freedom.ALL]) != verdict(m[Freedom.PLANE])]  # fmt: skip
        free = [m[Freedom.ALL] for _, m in rows]
        print(f"| {case.name} | " + " | ".join(map(show, worst))
              + f" | {max(m.closing_m for m in free) * 1e3:.2f} "
              f"| {math.degrees(max(m.tilt_rad for m in free)):.1f} "
              f"| {', '.join(changed) or 'none'} |")  # fmt: skip
        for what, most in zip(("x", "x and tilts"), worst[1:], strict=True):
            if any(w > limit for w, limit in zip(most, LIMITS, strict=True)):
                needs[what].add(case.name)
        if changed:
            needs["verdict"].add(case.name)
        if case.direction == "closing":
            assert worst[0][2] < ALONG_N
    print("beyond {:g} mm, {:g} deg or {:g} N:".format(*LIMITS), needs)
    assert not USUAL & needs["x"]
    assert not USUAL & needs["verdict"]


@pytest.mark.bench
@pytest.mark.timeout(3600)
def test_answers_of_mujoco_do_not_depend_on_its_solver_or_on_what_is_assumed_besides() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra `dev`)")
    scene = scene_of(SIDE, config(object_name="can").object)
    still = msgspec.structs.replace(scene, tap=None)
    print("\nL4:", line(ladder(scene)))
    print("| step, ms | impratio | impedance | plane: slip, mm; rotation, deg; peak, N "
          "| x and tilts free: the same | creep, um/s |")  # fmt: skip
    found = {}
    for step_ms, ratio, impedance in SOLVERS:
        solver = Solver(step_s=1e-3 * step_ms, impratio=ratio, impedance=impedance)
        plane, free = (mujoco_hand.run(scene, f, solver) for f in (Freedom.PLANE, Freedom.ALL))
        found[step_ms, ratio, impedance] = free
        creep = mujoco_hand.run(still, Freedom.PLANE, solver).slip_m / still.duration_s
        print(f"| {step_ms} | {ratio} | {impedance} | {line(plane)} | {line(free)} "
              f"| {creep * 1e6:.2g} |")  # fmt: skip
    assert max(gap(found[SOLVERS[1]], found[SOLVERS[3]])) < 0.2
    plain = Assumed()
    for changes in VARIANTS:
        assumed = msgspec.structs.replace(plain, **changes)
        plane, free = (mujoco_hand.run(scene, f, assumed=assumed)
                       for f in (Freedom.PLANE, Freedom.ALL))  # fmt: skip
        print(f"| {changes} | {line(plane)} | {line(free)} | adds {show(gap(free, plane))} |")
