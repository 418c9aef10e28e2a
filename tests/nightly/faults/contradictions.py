"""Seeded samples of wrong descriptions, and of pairs of signals that contradict each other.

A description is what the application is told of the cell: the simulated world differs from it.
A pair concerns signals by which one fault could be told from the truth, at the same moment.
"""

import random
from collections.abc import Sequence
from itertools import cycle

from grasp.control.states import State
from tests.nightly.faults.cases import NOT_INJECTED, SHARES, Case, Description, Fault, Stretch

OBJECTS = ("can", "box", "ball", "foam", "cardboard", "football")
WIDER_MM = {"ball": 11.0}  # a side, at most, where the open hand is the limit; else 15
# settings of the world alone, with their bounds
STIFFNESS_SHARE, MASS_SHARE, FRICTION_SHARE, GAIN = (0.5, 2.0), (0.5, 1.6), (0.6, 1.2), (0.5, 2.0)
LEAST_FORCE_N, TIP_KG, LATENCY_S = (1.0, 15.0), (0.05, 1.0), (0.01, 0.08)
MOUNTED_DEG = 20.0  # about the closing axis


def descriptions(name: str, told: dict[str, float], chance: random.Random) -> list[Description]:
    """One wrong description of each kind, and one that is wrong in all. ``told``: settings of that
    object by their names."""
    width_mm = chance.uniform(-15.0, min(15.0, WIDER_MM.get(name, 15.0)))
    gain = chance.uniform(*GAIN)
    friction = chance.uniform(*FRICTION_SHARE)
    clamp = chance.random() < 0.5
    mounted_deg = chance.uniform(-MOUNTED_DEG, MOUNTED_DEG)
    parts = {
        "width": [f"variation.width_error_m={width_mm * 1e-3:.5f}"],
        "mass": _shares(told, ("mass_kg", "added_mass_kg"), chance.uniform(*MASS_SHARE)),
        "stiffness": _shares(told, ("wall_stiffness_npm",), chance.uniform(*STIFFNESS_SHARE)),
        "friction": _shares(told, ("friction_static", "friction_kinetic"), friction),
        "calibration of the hand": [
            f"hand.least_force_n={chance.uniform(*LEAST_FORCE_N):.2f}",
            f"hand.tip_mass_kg={chance.uniform(*TIP_KG):.3f}",
            f"hand.command_latency_s={chance.uniform(*LATENCY_S):.3f}",
            *([] if clamp else ["hand.current_clamp=false"]),
            *(["hand.override_s=0.1"] if chance.random() < 0.5 else []),
        ],
        "mounting": [f"fingertip.slip_direction_deg={90.0 + mounted_deg:.1f}"],
    }  # fmt: skip
    found = [Description(what, tuple(world)) for what, world in parts.items()]
    order = chance.choice([(1, 0, 2), (2, 1, 0), (0, 2, 1), (1, 2, 0), (2, 0, 1)])
    found += [Description("gain", gain=gain), Description("order of the fingertips", order=order)]
    everything = tuple(setting for world in parts.values() for setting in world)
    return [*found, Description("all", everything, gain=chance.uniform(0.8, 1.25))]


def _shares(told: dict[str, float], names: Sequence[str], share: float) -> list[str]:
    return [f"object.{name}={told[name] * share:.6g}" for name in names]


def pairs() -> list[tuple[Fault, Fault]]:
    """Pairs of wrong signals of which each makes the other one plausible."""
    found = []
    for finger, other in ("AB", "AC", "BA", "BC", "CA", "CB"):
        found += [
            (hand(f"gPR{finger}", "close"), hand(f"gPO{finger}", "some off")),
            (hand(f"gPR{finger}", "frozen"), hand(f"gPO{finger}", "close")),
            (hand(f"gPO{finger}", "frozen"), hand(f"gDT{finger}", "missing")),
            (hand(f"gDT{finger}", "frozen"), pad(finger, "sticks high")),
            (hand(f"gPO{finger}", "some off"), pad(finger, "frozen")),
            (pad(finger, "sticks high"), pad(other, "frozen")),
            (pad(finger, "sticks high"), pad(other, "close")),
            (pad(finger, "drifts"), pad(other, "sticks high")),
            (pad(finger, "sticks high"), hand(f"gPO{other}", "some off")),
        ]
    return found


def sample_descriptions(name: str, told: dict[str, float], rounds: int, seed: int) -> list[Case]:
    """Cases of one object with every kind of wrong description in each round."""
    chance = random.Random(f"descriptions {name} {seed}")
    found = [d for _ in range(rounds) for d in descriptions(name, told, chance)]
    return [
        Case(k, name, chance.randrange(10_000), None, description=d) for k, d in enumerate(found)
    ]


def hand(what: str, kind: str) -> Fault:
    return Fault("gripper", "state", what, kind)


def pad(finger: str, kind: str) -> Fault:
    return Fault("fingertips", "state", f"finger {finger}", kind)


def sample_pairs(
    scene: tuple[str, int], stretches: Sequence[Stretch], count: int, seed: int
) -> list[Case]:
    """Random cases of one scene with a pair at one moment; every pair is used once before any is
    used again."""
    chance = random.Random(f"pairs {scene} {seed}")
    injected = [s for s in stretches if s.phase not in NOT_INJECTED and s.phase is not State.TARE]
    made = pairs()
    chance.shuffle(made)
    found = []
    for number, faults in zip(range(count), cycle(made), strict=False):
        s, recovers = chance.choice(injected), chance.random() < 0.5
        first, second = faults
        found.append(Case(
            number, *scene, first, s.phase, s.visit, int(chance.choice(SHARES) * s.ticks),
            recovers, second, 0, recovers,
        ))  # fmt: skip
    return found
