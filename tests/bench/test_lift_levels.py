"""Would a fuller contact level change the verdict of a lift? The hand and finger motions of real
closed-loop lifts, replayed through L1 to L4; as run, and with the weight beside the grip."""

from typing import Any

import numpy as np
import pytest

from grasp.settings import names
from scenarios.lift import lift
from scenarios.world import contact
from scenarios.world.ladder import compliant
from scenarios.world.ladder.experiments import SceneSettings
from scenarios.world.ladder.levels import Level, elements
from scenarios.world.ladder.scene import Scene
from tests.unit.scenarios.conftest import config
from tests.unit.scenarios.world.ladder import ladder_scenes

SEEDS = range(10)
LEVELS = (Level.SLIDER, Level.POINTS, Level.SPIN, Level.BRUSH)
ASIDE_M = (0.0, 0.005, 0.015)
IDLE = np.array([np.inf, *[0.0] * 7])


def motions(monkeypatch: pytest.MonkeyPatch, name: str, seed: int) -> tuple[Any, list[Any], Any]:
    """Parameters and moves of one lift up to its highest point; the production's state there."""
    moves: list[Any] = []
    inner = contact.advance

    def spy(p: Any, s: Any, t: float, dt: float, step: float, rise: float, v0: float, v1: float,
            before: Any, after: Any) -> None:  # fmt: skip
        inner(p, s, t, dt, step, rise, v0, v1, before, after)
        if s[contact.PRESENT] == 1.0:
            moves.append((p.copy(), dt, rise, after.copy(), s.copy()))

    with monkeypatch.context() as patch:
        patch.setattr(contact, "advance", spy)
        lift.run(config(object_name=name), seed, None)
    heights = np.cumsum([move[2] for move in moves])
    top = int(np.argmax(heights >= heights.max() - 1e-9))
    return moves[0][0], moves[: top + 1], moves[top][4]


def replay(
    parameters: Any, moves: list[Any], level: Level, aside_m: float
) -> tuple[float, float, float]:
    """Slip distance at the grip, m, rotation, rad, and 1 where the fingers still press, at the
    highest point."""
    inertia = parameters[contact.P_MASS] * SceneSettings().radius_of_gyration_m ** 2
    p = np.concatenate((parameters, [inertia, aside_m, 0.0]))
    scene: Scene = ladder_scenes.lift()
    half = float(parameters[contact.P_PAD_HALF])
    pads = ladder_scenes.changed(scene.contact, pad_half_length_m=half)
    finger, places = elements(ladder_scenes.changed(scene, contact=pads), level, 6)
    s = np.zeros(compliant.STATE_SIZE)
    stretch, sliding = np.zeros((len(finger), 3)), np.zeros(len(finger))
    for _, dt, rise, travel, _ in moves:
        steps = max(1, round(dt / 5e-4))
        s[compliant.TRAVEL : compliant.TRAVEL + 3] = travel
        tables = p, s, steps, dt / steps, np.array([rise / dt]), np.zeros((1, 3)), IDLE.copy(), True
        if level is Level.SLIDER:
            compliant.follow_line(*tables, stretch, sliding)
        else:
            compliant.follow(*tables, finger, places, stretch, sliding)
    slip_m = s[compliant.HAND] - s[compliant.POSE + 1]
    return slip_m, s[compliant.POSE + 2], float(s[compliant.NORMAL] > 0.0)


@pytest.mark.bench
@pytest.mark.timeout(1800)
def test_verdicts_of_lifts_at_fuller_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    print("\n| object | weight aside, mm | held as run | held at L1, L2, L3, L4 | slip, median mm "
          "| most that slip changes to L2, L3, L4, mm | most turned, L4, deg |")  # fmt: skip
    print("|---" * 7 + "|")
    for name in names("objects"):
        runs = [motions(monkeypatch, name, seed) for seed in SEEDS]
        held = sum(bool(s[contact.NORMAL] > 0.0) for _, _, s in runs)
        slip_mm = np.median([s[contact.SLIP] for _, _, s in runs]) * 1e3
        for aside_m in ASIDE_M:
            table = np.array(
                [[replay(p, m, level, aside_m) for level in LEVELS] for p, m, _ in runs]
            )
            kept, slips = table[:, :, 2].sum(axis=0).astype(int), table[:, :, 0]
            both = (table[:, :, 2] > 0).all(axis=1)  # slips of lost objects compare nothing
            change = np.abs(slips[both, 1:] - slips[both, :1]).max(axis=0, initial=0.0) * 1e3
            turned = np.degrees(np.abs(table[both, -1, 1]).max(initial=0.0))
            counts, changes = ", ".join(map(str, kept)), ", ".join(f"{c:.2f}" for c in change)
            print(f"| {name} | {aside_m * 1e3:g} | {held} of {len(runs)} | {counts} "
                  f"| {slip_mm:.1f} | {changes} | {turned:.1f} |")  # fmt: skip
