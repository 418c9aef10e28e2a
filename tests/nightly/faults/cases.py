"""All injected faults, and a seeded sample of fault times.

Faults: every field of every device's state in every way that it can be wrong, every command, every
link, another client of the hand, the loop and the detector. A case injects one of them, or a pair,
at a time in a phase of a lift, permanently or for 0.3 s.
"""

import random
from collections.abc import Iterator, Sequence
from itertools import cycle, product

import msgspec

from grasp.control.states import State
from tests.nightly.faults.registers import COMMAND_FIELDS, IMAGES
from tests.nightly.faults.registers import FIELDS as HAND_FIELDS

STATE = ("frozen", "missing", "not a number", "out of range", "close")
LINK = ("cut", "blinking")
ARM_FIELDS = (
    "t_ns", "position_m", "velocity_mps", "moving", "protective_stop", "angle_rad", "spin_radps",
    "speed_fraction",
)  # fmt: skip
VECTORS, AXES = ("position_m", "velocity_mps"), "xyz"
OF_AN_AXIS = frozenset({"not a number", "out of range", "close"})  # others concern all three
TAXELS = tuple(f"taxel {finger}{i}" for finger in "ABC" for i in range(6))
TAXEL = "taxel"  # a random one of these
PADS = ("finger A", "finger B", "finger C", TAXEL)
# small or alternating errors
SUBTLE = (
    *(("gripper", f"gPO{finger}", "some off") for finger in "ABC"),
    *(("gripper", what, "flickers") for what in ("gDTA", "gDTB", "gDTC", "gGTO", "gIMC")),
    ("arm", "moving", "flickers"),
    *(("fingertips", what, "drifts") for what in PADS),
)
# change of a command flag by another client; the other value would be no change
TURNED = {"rACT": "cleared", "rMOD": "set", "rGTO": "cleared", "rATR": "set", "rICF": "cleared",
          "rICS": "set"}  # fmt: skip
COMMANDS = {"gripper": ("close", "open", "hold"), "arm": ("move", "stop")}
STANDSTILLS_S = {"stands still 0.1 s": 0.1, "stands still 0.3 s": 0.3, "stands still 3 s": 3.0}
DETECTOR = ("raises", "not a number", "late", "detects nothing", "detects slip")
NOT_INJECTED = frozenset({
    State.START, State.HOME, State.SET_DOWN, State.KEPT, State.LOST, State.STOPPED,
    State.FAULT,
})  # fmt: skip
SHARES = (0.0, 1 / 3, 2 / 3)  # time of the fault as a share of a phase
RECOVERS_NS = 300_000_000  # duration of a fault that ends
DELAYS_TICKS = (0, 1, 4, 15, 60)  # between the two of a pair
SCENES = (  # object and seed; the last two have a touch and a probe while lowering
    ("can", 0), ("box", 1), ("ball", 1), ("foam", 0), ("cardboard", 2), ("football", 0),
    ("box", 24), ("box", 6),
)  # fmt: skip
# phases in which the safe state commands a hold; elsewhere the hand already holds or closes
HOLDS_AGAIN = frozenset({
    State.SHAPE, State.TARE, State.BRACE, State.CLOSE, State.OPEN, State.RETREAT,
})  # fmt: skip


class Fault(msgspec.Struct, frozen=True):
    """One kind of fault."""

    device: str  # gripper, arm, fingertips, loop, detector
    part: str  # state, command, link, registers, whole
    what: str  # field with a vector's axis, or command; empty for a whole device
    kind: str

    def __str__(self) -> str:
        return " ".join(filter(None, (self.device, self.what, self.kind)))


class Stretch(msgspec.Struct, frozen=True):
    """One phase of a lift without faults, from its start to the next phase."""

    phase: State
    visit: int  # number of this visit of the phase, from 1
    ticks: int
    commands: tuple[tuple[str, int], ...]  # sent, and after which tick of the stretch


class Description(msgspec.Struct, frozen=True):
    """What is wrong with what the application is told of the cell: settings of the simulated world
    that differ, the order of the fingertips, and the share of a force that they read."""

    what: str
    world: tuple[str, ...] = ()
    order: tuple[int, int, int] = (0, 1, 2)
    gain: float = 1.0


class Case(msgspec.Struct, frozen=True):
    """One run: when and which faults are injected, and what is wrong with the description."""

    number: int
    object: str
    seed: int
    fault: Fault | None  # None: a plain lift
    phase: State | None = None
    visit: int = 1
    ticks: int = 0  # into it
    recovers: bool = False
    then: Fault | None = None  # second of a pair
    then_ticks: int = 0  # after the first
    then_recovers: bool = False
    safe: bool = False  # the first causes a safe state; the second suppresses its command
    description: Description | None = None  # None: the cell is as described

    def __str__(self) -> str:
        if self.description is not None:
            return f"{self.object} {self.seed}: {self.description}"
        end = "ends" if self.recovers else "stays"
        first = f"{self.object} {self.seed}: {self.phase} {self.visit} +{self.ticks}: {self.fault}"
        return f"{first}, {end}" + (f"; +{self.then_ticks}: {self.then}" if self.then else "")

    @property
    def faults(self) -> tuple[Fault, ...]:
        return tuple(fault for fault in (self.fault, self.then) if fault is not None)


def _of_state(device: str, what: str) -> Iterator[Fault]:
    """Faults of a state's field. An integer is always a number, and a field of one or two bits has
    no value out of range."""
    integers = device != "arm" or what == "t_ns"
    flag = what in ("moving", "protective_stop")
    narrow = flag or (device == "gripper" and HAND_FIELDS[what].bits <= 2)
    impossible = {"not a number": integers or flag, "out of range": narrow}
    return (Fault(device, "state", what, kind) for kind in STATE if not impossible.get(kind))


def commands() -> list[Fault]:
    return [
        Fault(device, "command", what, "lost")
        for device, names in COMMANDS.items() for what in names
    ]  # fmt: skip


def faults() -> list[Fault]:
    """All faults except those of commands."""
    fields = {
        "gripper": tuple(HAND_FIELDS),
        "arm": ARM_FIELDS,
        "fingertips": (*PADS, "temperatures"),
    }
    found = [f for device, names in fields.items() for n in names for f in _of_state(device, n)]
    found += [Fault(device, "link", "link", kind) for device, kind in product(fields, LINK)]
    found += [Fault("loop", "whole", "", kind) for kind in STANDSTILLS_S]
    found += [Fault("detector", "whole", "", kind) for kind in DETECTOR]
    found += [Fault(device, "state", what, kind) for device, what, kind in SUBTLE]
    return found + written_by_another()


def written_by_another() -> list[Fault]:
    """Another client of the hand writes one command register, or all of them."""
    made = [(name, what) for name in COMMAND_FIELDS
            for what in ((TURNED[name],) if name in TURNED else ("cleared", "set"))]  # fmt: skip
    made += [("all fingers", what) for what in IMAGES]
    return [Fault("gripper", "registers", name, f"{what} by another client") for name, what in made]


def sample(
    scene: tuple[str, int], stretches: Sequence[Stretch], count: int, seed: int
) -> list[Case]:
    """Random cases of one scene: two in three single faults, the others lost commands, lost
    commands of a safe state, and pairs. Every fault is used once before any is used again."""
    chance = random.Random(f"{scene} {seed}")
    injected = [s for s in stretches if s.phase not in NOT_INJECTED]
    single = faults()
    chance.shuffle(single)
    in_turn, found = cycle(single), []
    for number in range(count):
        turn = number % 9
        if turn == 2:
            case = _commanded(injected, chance)
        elif turn == 5:
            case = _in_safe_state(injected, chance)
        else:
            case = _alone(_specific(next(in_turn), chance), chance.choice(injected), chance)
        if turn == 8:
            then = _specific(chance.choice(faults() + commands()), chance)
            case = msgspec.structs.replace(
                case, then=then, then_ticks=chance.choice(DELAYS_TICKS),
                then_recovers=chance.random() < 0.5,
            )  # fmt: skip
        found.append(msgspec.structs.replace(case, number=number, object=scene[0], seed=scene[1]))
    return found


def _alone(fault: Fault, stretch: Stretch, chance: random.Random) -> Case:
    ticks = int(chance.choice(SHARES) * stretch.ticks)
    return Case(0, "", 0, fault, stretch.phase, stretch.visit, ticks, chance.random() < 0.5)


def _commanded(stretches: Sequence[Stretch], chance: random.Random) -> Case:
    """A case with a lost command."""
    what, tick, s = chance.choice([(w, t, s) for s in stretches for w, t in s.commands])
    fault = chance.choice([f for f in commands() if f.what == what])
    return Case(0, "", 0, fault, s.phase, s.visit, tick, chance.random() < 0.5)


def _in_safe_state(stretches: Sequence[Stretch], chance: random.Random) -> Case:
    """A case with a lost command of a safe state, whose cause is a fault of the fingertips, or of
    the arm's position in phases without fingertips."""
    s = chance.choice(stretches)
    closes = (s.phase, s.visit) == (State.LIFT, 1)
    sent = {"stop", *(["close"] if closes else ["hold"] if s.phase in HOLDS_AGAIN else [])}
    cause = Fault("fingertips", "link", "link", "cut")
    if s.phase in {State.SHAPE, State.OPEN, State.RETREAT}:
        cause = Fault("arm", "state", "position_m x", "not a number")
    then = chance.choice([f for f in commands() if f.what in sent])
    return Case(0, "", 0, cause, s.phase, s.visit, int(SHARES[1] * s.ticks), False, then, 0,
                chance.random() < 0.5, safe=True)  # fmt: skip


def _specific(fault: Fault, chance: random.Random) -> Fault:
    """The fault with a random taxel, or a random axis of a vector, filled in."""
    what = fault.what
    if what == TAXEL:
        what = chance.choice(TAXELS)
    elif what in VECTORS and fault.kind in OF_AN_AXIS:
        what = f"{what} {chance.choice(AXES)}"
    return msgspec.structs.replace(fault, what=what)
