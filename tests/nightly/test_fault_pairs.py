"""Two faults in one lift, drawn by a seed: the arm stands, nothing falls or is crushed unsaid."""

import random
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from grasp.loop import Tick
from grasp.phases import AIRBORNE_PHASES, END_PHASES, LOWERING_PHASES, SAFE_PHASES, Phase
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import Rig
from scenarios.trial.ending import End
from scenarios.trial.execution import FinishedTrial, make_guard, run_trial
from scenarios.world.truth import Truth
from tests.unit.scenarios.conftest import HAND_ALONE, config
from tests.unit.scenarios.lift import device_faults as fault

ALL = 60
OBJECTS = ("ball", "box", "can", "foam")
NOT_IN_EVERY_LIFT = {Phase.IDLE, Phase.HOME, Phase.SQUEEZE}
PHASES = tuple(p for p in Phase if p not in SAFE_PHASES | END_PHASES | NOT_IN_EVERY_LIFT)
# a ball that slips all the way stands before the arm is down, and tightens the grip
LANDING = (Phase.LAND, Phase.TOUCH, Phase.PROBE)
SLIDING = ("object.friction_static=0.35", "object.friction_kinetic=0.3",
           "controller.lift_height_m=0.03", HAND_ALONE)  # fmt: skip
SLIDING_SEEDS = 6  # in the first of which all three phases come
FAULTS: tuple[fault.Act, ...] = (
    *fault.LINKS, fault.freeze_fingertips, fault.freeze_thumb, fault.fingertips_read(0),
    fault.fingertips_read(1023), fault.shift_fingertips, fault.stick_one_taxel_at_the_rail,
    fault.replug_fingertips, fault.swallow_writes, fault.freeze_gripper_status, fault.jam_gripper,
    fault.power_cycle_gripper, fault.let_finger_b_leap, fault.let_thumb_leap,
    fault.lose_arm_position, fault.freeze_arm_values, fault.turn_arm_round, fault.push_arm,
    fault.let_arm_leap, fault.stand_still(0.1), fault.stand_still(0.3),
)  # fmt: skip
HARMLESS = ("stick_one_taxel_at_the_rail", "stand_still_0.1_s", "turn_arm_round")  # by themselves
DELAYS_TICKS = (0, 1, 4, 15, 60)
LATER_NS = 1_500_000_000  # all that was still under way has ended by then
LIMIT_N = 11.0  # and overshoot
GRIPPED_N = 7.0  # of a hand that is closed to the limit, though the object slipped since


class Pair(msgspec.Struct, frozen=True):
    """What goes wrong first, so many ticks into which phase, and what so much later."""

    number: int
    object: str
    seed: int
    phase: Phase
    ticks: int
    first: fault.Act
    later_ticks: int
    second: fault.Act

    @classmethod
    def drawn(cls, number: int) -> "Pair":
        chance = random.Random(number)
        first, second = chance.sample(FAULTS, 2)
        phase = PHASES[number % len(PHASES)]
        name = "ball" if phase in LANDING else chance.choice(OBJECTS)
        seed = chance.randrange(SLIDING_SEEDS if phase in LANDING else 20)
        return cls(
            number, name, seed, phase, chance.choice((0, 2, 10)), first,
            chance.choice(DELAYS_TICKS), second,
        )  # fmt: skip

    @property
    def config(self) -> LiftConfig:
        scene = SLIDING if self.phase in LANDING else ("controller.lift_height_m=0.1",)
        return config(*scene, object_name=self.object)

    def __str__(self) -> str:
        return (
            f"{self.number}-{self.object}-{self.phase}-{self.ticks}-{self.first.__name__}-"
            f"{self.later_ticks}-{self.second.__name__}"
        )


class Ended(msgspec.Struct, frozen=True):
    """What came of it: by what was said, and by what only the simulation knows."""

    trial: FinishedTrial
    outcome: str
    said: End | None
    failure: Any
    before: Truth  # at the first fault
    phase: Phase  # then
    at_end: Truth
    arm_mps: float  # at the end
    later: Truth
    later_arm_mps: float
    fingers_mps: float  # later
    struck: int


def run(pair: Pair) -> Ended:
    settings = pair.config
    acts, due = [pair.first, pair.second], [pair.ticks, pair.later_ticks]
    seen: list[tuple[Truth, Phase]] = []
    with open_rig(settings, pair.seed, paced=False) as rig:

        def watch(tick: Tick, truth: Truth | None, controller: Any) -> None:
            begun = len(acts) < 2 or tick.decision.phase is pair.phase
            while acts and begun and due[0] <= 0:
                assert truth is not None
                seen.append((truth, tick.decision.phase))
                due.pop(0)
                acts.pop(0)(rig)
            if acts and begun:
                due[0] -= 1

        trial = run_trial(settings, rig, make_guard(settings), watch)
        return _ended(pair, settings, rig, trial, seen)


def _ended(
    pair: Pair, settings: LiftConfig, rig: Rig, trial: FinishedTrial,
    seen: list[tuple[Truth, Phase]],
) -> Ended:  # fmt: skip
    cell = fault.cell(rig)
    at_end, arm_mps = cell.truth(), _speed(cell.arm.velocity(rig.clock.now_ns))
    end_ns = rig.clock.now_ns + LATER_NS
    rig.clock.sleep_until_ns(end_ns)
    cell.advance(end_ns)
    result = lift.judge(settings, pair.seed, trial, None)
    before, phase = seen[0] if seen else (at_end, Phase.IDLE)
    return Ended(
        trial, result.outcome, trial.end(settings), trial.failure(settings),
        before, phase, at_end, arm_mps, cell.truth(), _speed(cell.arm.velocity(end_ns)),
        float(np.abs(cell.gripper.velocity_mps).max()), len(seen),
    )  # fmt: skip


def _speed(velocity_mps: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(velocity_mps))


Check = Callable[[Pair, Ended], str]


def the_arm_stands(pair: Pair, end: Ended) -> str:
    return "" if end.later_arm_mps == 0.0 else f"the arm moves at {end.later_arm_mps:.3f} m/s"


def the_fingers_rest(pair: Pair, end: Ended) -> str:
    return "" if end.fingers_mps == 0.0 else f"a finger moves at {end.fingers_mps:.3f} m/s"


def no_force_passes_the_limit(pair: Pair, end: Ended) -> str:
    most_n = max(end.later.peak_n)
    return "" if most_n < LIMIT_N else f"{most_n:.1f} N"


def what_hung_still_hangs_still(pair: Pair, end: Ended) -> str:
    """An object that was held in the air is neither dropped nor left slipping, unless it was set
    down or said to be lost."""
    held = end.phase in LOWERING_PHASES | {Phase.HOLD} and end.before.touched
    if not held or end.trial.controller.phase is Phase.DONE:
        return ""
    safe = end.later.touched and abs(end.later.slip_speed_mps) < 1e-3
    lost = end.said is not None and "feels nothing" in end.said.hand
    return "" if safe or lost or end.later.height_m < 1e-3 else f"not held: {end.said}"


def the_end_has_a_name(pair: Pair, end: Ended) -> str:
    controller = end.trial.controller
    if not controller.finished:
        return f"not finished: {controller.phase}"
    if controller.phase is Phase.FAULT:
        named = end.outcome == "fault" and end.failure is not None and end.failure.message
        return "" if named and end.said is not None else f"{end.outcome}, {end.failure}"
    return "" if end.outcome != "fault" else "a fault outside the safe state"


def what_is_said_is_so(pair: Pair, end: Ended) -> str:
    """The last line says of arm and hand nothing that is not so."""
    if end.said is None:
        return ""
    arm, hand = end.said.arm, end.said.hand
    wrong = {
        "the arm moves": arm == "the arm stands" and end.arm_mps > 0.0,
        "the hand is not open": hand == "the hand is open" and end.at_end.touched,
        "it is not closed to the limit": "the hand is closed to the limit" in hand
        and end.phase in AIRBORNE_PHASES
        and max(end.at_end.normal_n) < GRIPPED_N,
        "it feels something": "feels nothing" in hand and max(end.at_end.normal_n) > 1.0,
        "nothing was missed": "the arm still moves" in end.said.unreached and end.arm_mps == 0.0
        and end.later_arm_mps == 0.0 and "is still moving" not in arm,
    }  # fmt: skip
    found = [text for text, is_wrong in wrong.items() if is_wrong]
    return f"{'; '.join(found)}, but: {end.said}" if found else ""


CHECKS: tuple[Check, ...] = (
    the_arm_stands, the_fingers_rest, no_force_passes_the_limit, what_hung_still_hangs_still,
    the_end_has_a_name, what_is_said_is_so,
)  # fmt: skip


def wrong(pair: Pair) -> list[str]:
    """What was not as it must be."""
    end = run(pair)
    return [f"{pair}: {check.__name__}: {text}" for check in CHECKS if (text := check(pair, end))]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_sixty_pairs_of_faults_end_in_a_safe_state_that_is_told_as_it_is() -> None:
    found = [text for number in range(ALL) for text in wrong(Pair.drawn(number))]
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.parametrize("phase", LANDING)
def test_pairs_of_faults_strike_the_landing(phase: Phase) -> None:
    numbers = (number for number in range(10 * ALL) if Pair.drawn(number).phase is phase)
    pair = Pair.drawn(next(numbers))
    end = run(pair)
    assert end.struck and end.phase is phase
    assert not [text for check in CHECKS if (text := check(pair, end))]
