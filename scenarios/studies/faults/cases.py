"""Which faults there are and when they strike: generated, nothing is picked by hand.

Every field of every device's state that the driver sees, in every way that it can be wrong, every
link, the loop, the detector: each at three moments of every stretch of a lift, at each of them
either with recovery or without, in turn. Every command where it is really sent, and once more where
a safe state sends it. Then pairs drawn by a seed; and what is wrong by little, or by turns. How
long a stretch is and what it sends is the plain lift's schedule.
"""

import random
from collections.abc import Iterator
from itertools import product

import msgspec

from grasp.phases import Phase
from scenarios.studies.faults.registers import COMMAND_FIELDS, IMAGES
from scenarios.studies.faults.registers import FIELDS as HAND_FIELDS
from scenarios.studies.faults.schedule import SCHEDULE, Stretch

STATE = ("frozen", "late", "missing", "not a number", "out of range", "jump")
COMMAND = ("lost", "late", "repeated", "half done")
LINK = ("cut", "blinking", "slow")
ARM_FIELDS = (
    "t_ns", "position_m", "velocity_mps", "moving", "protective_stop", "angle_rad", "spin_radps",
    "speed_fraction",
)  # fmt: skip
VECTORS = ("position_m", "velocity_mps")
AXES = "xyz"
OF_AN_AXIS = frozenset({"not a number", "out of range", "jump"})  # the rest is said of all three
TAXELS = tuple(f"taxel {finger}{i}" for finger in "ABC" for i in range(6))
TAXEL = "taxel"  # any of these: which one is drawn by a seed
PAD_FIELDS = ("finger A", "finger B", "finger C", TAXEL, "temperatures")
# what is wrong by little, or by turns; a device that is watched for leaps says nothing of these
SUBTLE = (
    *(("gripper", f"gPO{finger}", "some off") for finger in "ABC"),
    *(("gripper", what, "flickers") for what in ("gDTA", "gDTB", "gDTC", "gGTO", "gIMC")),
    ("arm", "moving", "flickers"),
    *(("fingertips", what, "drifts") for what in ("finger A", "finger B", "finger C", TAXEL)),
)
# what another client of the hand makes of a command register: a flag is turned, for the rest is no
# change
ANOTHER = "by another client"
TURNED = {"rACT": "cleared", "rMOD": "set", "rGTO": "cleared", "rATR": "set", "rICF": "cleared",
          "rICS": "set"}  # fmt: skip
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
# of a lift that goes up twice, for what was felt on the first way is answered in between
SECOND_LIFT = (Phase.LIFT, 2)
STRETCHES = (*((phase, 1) for phase in PHASES), SECOND_LIFT)
SHARES = (0.0, 1 / 3, 2 / 3)  # of a stretch: when it is struck
RECOVERS_NS = 300_000_000  # a fault that ends by itself has lasted so long
DELAYS_TICKS = (0, 1, 4, 15, 60)  # between the two of a pair
PAIRS = 60
SCENES = (
    ("can", 0), ("box", 1), ("ball", 1), ("foam", 0), ("cardboard", 2), ("football", 0),
)  # fmt: skip
TOUCHING = (("box", 24), ("box", 6))  # the way down comes to a touch and a probe
DOWN = frozenset({Phase.TOUCH, Phase.PROBE})
# where a safe state tells the hand what it was not told before: elsewhere it holds or is closed to
# the limit already, and nothing is sent
HOLDS_ANEW = frozenset({
    Phase.APPROACH, Phase.REST, Phase.GRASP, Phase.OPPOSE, Phase.RELEASE, Phase.RETREAT,
})  # fmt: skip
CLOSES_ANEW = (Phase.LIFT, 1)
SITES = 2  # scenes in which a command is struck where it is sent


class Fault(msgspec.Struct, frozen=True):
    """One thing that goes wrong."""

    device: str  # gripper, arm, fingertips, loop, detector
    part: str  # state, command, link, registers, whole
    what: str  # the field, with a vector's axis, or the command; empty of a whole; ``TAXEL``: one
    # is to be drawn
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
    visit: int = 1  # how often the lift has come to this phase, this time included
    ticks: int = 0  # into it
    recovers: bool = False
    then: Fault | None = None  # of a pair
    then_ticks: int = 0  # after the first
    then_recovers: bool = False
    safe: bool = False  # the first leads to a safe state, whose own command the second takes

    def __str__(self) -> str:
        if self.fault is None:
            return f"{self.object} {self.seed}: nothing fails"
        end = "ends" if self.recovers else "stays"
        where = f"{self.phase}{f' {self.visit}' if self.visit > 1 else ''} +{self.ticks}"
        first = f"{self.object} {self.seed}: {where}: {self.fault}, {end}"
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


def commands() -> list[Fault]:
    """Every command of every device, in every way that it can go wrong."""
    return [
        Fault(device, "command", what, kind)
        for device, names in COMMANDS.items() for what in names for kind in COMMAND
    ]  # fmt: skip


def faults() -> list[Fault]:
    """All but those of commands."""
    fields = {"gripper": tuple(HAND_FIELDS), "arm": ARM_FIELDS, "fingertips": PAD_FIELDS}
    found = [f for device, names in fields.items() for n in names for f in of_state(device, n)]
    found += [Fault(device, "link", "link", kind) for device, kind in product(DEVICES, LINK)]
    found += [Fault("loop", "whole", "", kind) for kind in STANDSTILLS_S]
    return found + [Fault("detector", "whole", "", kind) for kind in DETECTOR]


def subtle() -> list[Fault]:
    """What is wrong by little, or by turns."""
    return [Fault(device, "state", what, kind) for device, what, kind in SUBTLE]


def written_by_another() -> list[Fault]:
    """Every command register, and all of them at once."""
    values = {name: (TURNED[name],) if name in TURNED else ("cleared", "set")
              for name in COMMAND_FIELDS}  # fmt: skip
    made = [(name, what) for name, whats in values.items() for what in whats]
    made += [("all fingers", what) for what in IMAGES]
    return [Fault("gripper", "registers", name, f"{what} {ANOTHER}") for name, what in made]


def plan() -> list[Case]:
    """Every run, numbered."""
    cases = [Case(0, name, seed, None) for name, seed in SCENES + TOUCHING]
    for i, fault in enumerate(faults()):
        for j, stretch in enumerate(STRETCHES):
            cases += _alone(fault, stretch, i + j)
    cases += _commanded()
    cases += _in_safe_states()
    chance = random.Random(0)
    cases += [_pair(chance) for _ in range(PAIRS)]
    for i, fault in enumerate(subtle() + written_by_another()):
        for j, stretch in enumerate(STRETCHES):
            cases += _alone(fault, stretch, i + j)
    taxels, axes = random.Random(1), random.Random(2)
    drawn = (_drawn(case, taxels, axes) for case in cases)
    return [msgspec.structs.replace(case, number=n) for n, case in enumerate(drawn)]


def scheduled(scene: tuple[str, int], phase: Phase, visit: int) -> Stretch | None:
    """This stretch of a plain lift; None where the lift does not come to it."""
    return next((s for s in SCHEDULE[scene] if (s.phase, s.visit) == (phase, visit)), None)


def _alone(fault: Fault, stretch: tuple[Phase, int], turn: int) -> Iterator[Case]:
    """Recovery alternates from moment to moment, so that each stretch has both."""
    for k, share in enumerate(SHARES):
        name, seed, ticks = _struck(stretch, turn + k, share)
        recovers = bool((turn + k) % 2)
        yield Case(0, name, seed, fault, *stretch, ticks, recovers)


def _struck(stretch: tuple[Phase, int], turn: int, share: float) -> tuple[str, int, int]:
    """Scene and tick; with and without recovery before the scene changes."""
    scenes = [scene for scene in _scenes(stretch[0]) if scheduled(scene, *stretch) is not None]
    scene = scenes[turn // 2 % len(scenes)]
    found = scheduled(scene, *stretch)
    return (*scene, 0 if found is None else int(share * found.ticks))


def _scenes(phase: Phase) -> tuple[tuple[str, int], ...]:
    return TOUCHING if phase in DOWN else SCENES


def sites() -> dict[tuple[str, tuple[Phase, int], int], list[tuple[str, int, int]]]:
    """By command, stretch and how many of this command the stretch had sent: scenes in which a
    plain lift sends it, and after which tick."""
    found: dict[tuple[str, tuple[Phase, int], int], list[tuple[str, int, int]]] = {}
    for scene, stretches in SCHEDULE.items():
        for s in stretches:
            sent: dict[str, int] = {}
            for what, tick in s.commands:
                key = what, (s.phase, s.visit), sent.setdefault(what, 0)
                found.setdefault(key, []).append((*scene, tick))
                sent[what] += 1
    return found


def _commanded() -> Iterator[Case]:
    """Every command is struck just before it is sent."""
    for (what, stretch, _), places in sites().items():
        for i, fault in enumerate(f for f in commands() if f.what == what):
            for k in range(SITES):
                name, seed, tick = places[(i + k) % len(places)]
                for recovers in (False, True):
                    yield Case(0, name, seed, fault, *stretch, tick, recovers)


def _in_safe_states() -> Iterator[Case]:
    """What a safe state tells arm and hand, where that is sent."""
    for turn, stretch in enumerate(STRETCHES):
        told = {"stop"}
        if stretch == CLOSES_ANEW or stretch[0] in HOLDS_ANEW:
            told.add("close" if stretch == CLOSES_ANEW else "hold")
        for i, fault in enumerate(f for f in commands() if f.what in told):
            for recovers in (False, True):
                name, seed, ticks = _struck(stretch, turn + i, SHARES[1])
                yield Case(
                    0, name, seed, _leading(stretch[0]), *stretch, ticks, False, fault, 0, recovers,
                    safe=True,
                )  # fmt: skip


def _leading(phase: Phase) -> Fault:
    """What leads to the safe state at once and takes neither arm nor hand: fingertips are gone, or
    where nobody has to feel, the arm says no place."""
    if phase in {Phase.APPROACH, Phase.RELEASE, Phase.RETREAT}:
        return Fault("arm", "state", "position_m", "not a number")
    return Fault("fingertips", "link", "link", "cut")


def _pair(chance: random.Random) -> Case:
    first, second = chance.sample(faults() + commands(), 2)
    stretch = chance.choice(STRETCHES)
    name, seed, ticks = _struck(stretch, chance.randrange(1000), chance.choice(SHARES))
    return Case(
        0, name, seed, first, *stretch, ticks, chance.random() < 0.5,
        second, chance.choice(DELAYS_TICKS), chance.random() < 0.5,
    )  # fmt: skip


def _drawn(case: Case, taxels: random.Random, axes: random.Random) -> Case:
    """One of the eighteen taxels in place of any, and one axis of a vector's three."""

    def drawn(fault: Fault | None) -> Fault | None:
        if fault is None or fault.part != "state":
            return fault
        what = fault.what
        if what == TAXEL:
            what = taxels.choice(TAXELS)
        elif what in VECTORS and fault.kind in OF_AN_AXIS:
            what = f"{what} {axes.choice(AXES)}"
        return msgspec.structs.replace(fault, what=what)

    return msgspec.structs.replace(case, fault=drawn(case.fault), then=drawn(case.then))


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
