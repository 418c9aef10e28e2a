"""Which faults there are and when they strike: generated, nothing is picked by hand.

Every field of every device's state in every way that it can be wrong, every command, every link,
the loop, the detector; each at three moments of every phase of a lift, with and without recovery in
turn; then pairs drawn by a seed.
"""

import random
from collections.abc import Iterator
from itertools import product

import msgspec

from grasp.phases import Phase
from scenarios.studies.faults.registers import FIELDS as HAND_FIELDS

STATE = ("frozen", "late", "missing", "not a number", "out of range", "jump")
COMMAND = ("lost", "late", "repeated", "half done")
LINK = ("cut", "blinking", "slow")
ARM_FIELDS = (
    "t_ns", "position_m", "velocity_mps", "moving", "protective_stop", "angle_rad", "spin_radps",
)  # fmt: skip
PAD_FIELDS = ("finger A", "finger B", "finger C", "taxel A2", "temperatures")
COMMANDS = {"gripper": ("close", "open", "hold"), "arm": ("move", "stop")}
DEVICES = ("gripper", "arm", "fingertips")
STANDSTILLS_S = {"stands still 0.1 s": 0.1, "stands still 0.3 s": 0.3, "stands still 1 s": 1.0,
                 "stands still 3 s": 3.0}  # fmt: skip
DETECTOR = (
    "raises", "not a number", "wrong shape", "late", "frozen", "hears nothing", "hears slip",
)  # fmt: skip
PHASES = tuple(
    p for p in Phase
    if p not in {Phase.IDLE, Phase.HOME, Phase.SQUEEZE, Phase.DONE, Phase.KEPT, Phase.LOST,
                 Phase.STOPPED, Phase.FAULT}
)  # fmt: skip
MOMENTS = (0, 4, 20)  # ticks into the phase
RECOVERS_NS = 300_000_000  # a fault that ends by itself has lasted so long
DELAYS_TICKS = (0, 1, 4, 15, 60)  # between the two of a pair
PAIRS = 60
# scenes whose plain lift goes through every phase that is struck there
SCENES = (
    ("can", 0), ("box", 1), ("ball", 1), ("foam", 0), ("cardboard", 2), ("football", 0),
)  # fmt: skip
TOUCHING = (("can", 2), ("can", 4))  # the way down comes to a touch and a probe
LONG_APPROACH = tuple(scene for scene in SCENES if scene[0] != "ball")  # which is over in 10 ticks
STRUCK = {Phase.TOUCH: TOUCHING, Phase.PROBE: TOUCHING, Phase.APPROACH: LONG_APPROACH}


class Fault(msgspec.Struct, frozen=True):
    """One thing that goes wrong."""

    device: str  # gripper, arm, fingertips, loop, detector
    part: str  # state, command, link, whole
    what: str  # the field or the command; empty of a whole
    kind: str

    def __str__(self) -> str:
        return " ".join(filter(None, (self.device, self.what, self.kind)))


class Case(msgspec.Struct, frozen=True):
    """One run."""

    number: int
    object: str
    seed: int
    fault: Fault | None  # None: a plain lift, to compare with
    phase: Phase | None = None
    ticks: int = 0
    recovers: bool = False
    then: Fault | None = None  # of a pair
    then_ticks: int = 0  # after the first
    then_recovers: bool = False

    def __str__(self) -> str:
        if self.fault is None:
            return f"{self.object} {self.seed}: nothing fails"
        end = "ends" if self.recovers else "stays"
        first = f"{self.object} {self.seed}: {self.phase} +{self.ticks}: {self.fault}, {end}"
        return first if self.then is None else f"{first}; +{self.then_ticks}: {self.then}"

    @property
    def faults(self) -> tuple[Fault, ...]:
        return tuple(fault for fault in (self.fault, self.then) if fault is not None)


def of_state(device: str, what: str) -> Iterator[Fault]:
    """What can be said wrongly: an integer is never no number, and one of a bit or two that has a
    meaning for every value is never out of range."""
    integers = device != "arm" or what == "t_ns"
    flag = what in ("moving", "protective_stop")
    narrow = flag or (device == "gripper" and HAND_FIELDS[what].bits <= 2)
    for kind in STATE:
        impossible = {"not a number": integers or flag, "out of range": narrow}
        if not impossible.get(kind, False):
            yield Fault(device, "state", what, kind)


def faults() -> list[Fault]:
    """All of them."""
    fields = {"gripper": tuple(HAND_FIELDS), "arm": ARM_FIELDS, "fingertips": PAD_FIELDS}
    found = [f for device, names in fields.items() for n in names for f in of_state(device, n)]
    for device, names in COMMANDS.items():
        found += [Fault(device, "command", what, kind) for what in names for kind in COMMAND]
    found += [Fault(device, "link", "link", kind) for device, kind in product(DEVICES, LINK)]
    found += [Fault("loop", "whole", "", kind) for kind in STANDSTILLS_S]
    return found + [Fault("detector", "whole", "", kind) for kind in DETECTOR]


def plan() -> list[Case]:
    """Every run, numbered."""
    cases = [Case(0, name, seed, None) for name, seed in SCENES + TOUCHING]
    for i, fault in enumerate(faults()):
        for j, phase in enumerate(PHASES):
            cases += _alone(fault, phase, i + j)
    chance = random.Random(0)
    cases += [_pair(chance) for _ in range(PAIRS)]
    return [msgspec.structs.replace(case, number=n) for n, case in enumerate(cases)]


def _alone(fault: Fault, phase: Phase, turn: int) -> Iterator[Case]:
    """Recovery alternates from moment to moment, so that each phase has both."""
    for k, ticks in enumerate(MOMENTS):
        name, seed = _scene(phase, turn + k)
        yield Case(0, name, seed, fault, phase, ticks, recovers=bool((turn + k) % 2))


def _scene(phase: Phase, turn: int) -> tuple[str, int]:
    """With and without recovery before the scene changes."""
    scenes = STRUCK.get(phase, SCENES)
    return scenes[turn // 2 % len(scenes)]


def _pair(chance: random.Random) -> Case:
    first, second = chance.sample(faults(), 2)
    phase = chance.choice(PHASES)
    name, seed = _scene(phase, chance.randrange(1000))
    return Case(
        0, name, seed, first, phase, chance.choice(MOMENTS), chance.random() < 0.5,
        second, chance.choice(DELAYS_TICKS), chance.random() < 0.5,
    )  # fmt: skip


def in_turn(cases: list[Case], seed: int = 0) -> list[Case]:
    """The same in an order by which any part of them is a fair sample of all."""
    mixed = list(cases)
    random.Random(seed).shuffle(mixed)
    return mixed


def by_scene(cases: list[Case], most: int) -> list[list[Case]]:
    """In lots of one scene each, which share the lift up to their faults; in the same order."""
    lots: list[list[Case]] = []
    open_lots: dict[tuple[str, int], list[Case]] = {}
    for case in cases:
        lot = open_lots.get((case.object, case.seed))
        if lot is None or len(lot) == most:
            lot = open_lots[case.object, case.seed] = []
            lots.append(lot)
        lot.append(case)
    return lots
