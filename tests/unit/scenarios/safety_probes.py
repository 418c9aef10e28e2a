"""Where a setting takes effect in a run, in a verdict, or under one fingertip that presses."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import pytest

from drivers.errors import Stale
from drivers.interfaces import Arm, ArmState, TactileSensor, Vector3
from drivers.ur.driver import ArmDriver
from grasp.loop import ControlLoop, Tick
from grasp.phases import Phase
from scenarios.acquire import session as acquire_rig
from scenarios.acquire.config import AcquireConfig, load_acquire_config
from scenarios.acquire.press import PressController, PressControlSettings, PressPhase, motion
from scenarios.acquire.session import Session, open_acquire_rig
from scenarios.lift import lift
from scenarios.lift.scoring import LiftFacts, LiftOutcome, ScoringSettings, outcome
from scenarios.rigs.opening import open_rig
from scenarios.tap.result import Alarm
from scenarios.tap.scoring import ObjectMotion, TapFacts, TapOutcome, verdict
from scenarios.tap.settings import TapScoringSettings
from scenarios.trial.execution import grip_plan, make_step
from scenarios.world.truth import Truth
from tests.unit.grasp.builders import arm
from tests.unit.scenarios.conftest import Staged, config

ZERO = (0.0, 0.0, 0.0)


# Loop


def told_payload_kg(v: float) -> float:
    told: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ArmDriver, "set_payload", lambda _, mass_kg: told.append(mass_kg))
        with open_rig(config(f"arm.payload_kg={v}"), 0, paced=False):
            return told[0]


def margin_counts(v: int) -> int:
    plan = grip_plan(config(f"controller.preshape_margin_counts={v}"))
    _, b, c = (g - p for g, p in zip(plan.grip_counts, plan.preshape_counts, strict=True))
    assert b == c
    return b


def thumb_back_counts(v: int) -> int:
    plan = grip_plan(config(f"controller.thumb_back_counts={v}"))
    a, b, _ = (g - p for g, p in zip(plan.grip_counts, plan.preshape_counts, strict=True))
    return a - b


def first_ticks(*assignments: str) -> list[Tick]:
    """Of a lift that is interrupted."""

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    staged = Staged(*assignments)
    staged.run(lambda _: len(staged.ticks) > 20, interrupt)
    return staged.ticks


def period_s(v: float) -> float:
    first, second = first_ticks(f"loop.period_s={v}")[10:12]
    return (second.t_ns - first.t_ns) * 1e-9


def delay_s(v: float) -> float:
    """From the decision to the sending of the first command."""
    issued = [i for tick in first_ticks(f"loop.decision_delay_s={v}") for i in tick.issued]
    return (issued[0].sent_ns - issued[0].decided_ns) * 1e-9


class Fugitive:
    """An arm that is heard and moves on, whatever it is told."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self.stops = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arm, name)

    @property
    def state(self) -> ArmState:
        state = self._arm.state
        assert state is not None
        return msgspec.structs.replace(state, moving=True)

    def stop(self, deceleration_mps2: float) -> None:
        self.stops += 1


def ended(setting: str, end: Callable[[ControlLoop], object]) -> tuple[float, int]:
    """How long an end of a run takes where the arm never stands, and how many stops it sends."""
    patient = config("hand.activation_s=0.5", "controller.safe_state_s=30", "loop.stop_s=60")
    with open_rig(patient, 0, paced=False) as rig:
        arm = Fugitive(rig.devices.arm)
        devices = msgspec.structs.replace(rig.devices, arm=arm)
        loop = ControlLoop(devices, rig.clock, make_step(patient), config(setting).loop)
        loop.tick()
        began_ns = rig.clock.now_ns
        end(loop)
        return (rig.clock.now_ns - began_ns) * 1e-9, arm.stops


def stopping_s(v: float) -> float:
    return ended(f"loop.stop_s={v}", lambda loop: loop.stop("by hand"))[0]


def aborting_s(v: float) -> float:
    return ended(f"loop.abort_s={v}", lambda loop: loop.abort())[0]


def between_stops_of_an_abort_s(v: float) -> float:
    lasted_s, stops = ended(f"loop.abort_repeat_s={v}", lambda loop: loop.abort())
    return lasted_s / stops


def run_ended_after_s(v: float) -> float:
    """A run whose phases would go on."""
    ticks: list[Tick] = []
    lift.run(config("hand.activation_s=0.5", f"loop.deadline_s={v}"), 0, None, on_tick=ticks.append)
    stopped = next(tick for tick in ticks if tick.decision.phase is Phase.STOPPED)
    return (stopped.t_ns - ticks[0].t_ns) * 1e-9


# Acquisition


def acquiring(setting: str) -> AcquireConfig:
    return load_acquire_config("planar", "simulated", None, (f"session.{setting}",))


class Overheard:
    """An arm that does as it is told; what it was told last."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self.stopped_mps2 = self.moved_mps = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arm, name)

    def stop(self, deceleration_mps2: float) -> None:
        self.stopped_mps2 = deceleration_mps2
        self._arm.stop(deceleration_mps2)

    def move_to(self, position_m: Vector3, speed_mps: float, acceleration_mps2: float) -> None:
        self.moved_mps = speed_mps
        self._arm.move_to(position_m, speed_mps, acceleration_mps2)


def told_on_leaving(setting: str) -> Overheard:
    """When an acquisition ends."""
    settings = acquiring(setting)
    with open_acquire_rig(settings, 0, paced=False) as rig:
        arm = Overheard(rig.arm)
        heard = msgspec.structs.replace(rig, arm=arm)
        Session(settings, motion("0", 0.05, 1.0), 0, heard).run(1, from_start=True)
    return arm


def asked_to_stand_s(v: float) -> float:
    """How long an arm that never stands is asked to."""
    settings = acquiring(f"stand_s={v}")
    with open_acquire_rig(settings, 0, paced=False) as rig:
        moving = msgspec.structs.replace(rig, arm=Fugitive(rig.arm))
        made = Session(settings, motion("0", 0.05, 1.0), 0, moving)
        rig.arm.pump(rig.clock.now_ns)
        began_ns = rig.clock.now_ns
        assert made.stand() == "the arm is still moving"
        return (rig.clock.now_ns - began_ns) * 1e-9


class Unrested:
    """Fingertips that never have their rest counts."""

    rest_taken = False

    def __init__(self, tactile: TactileSensor) -> None:
        self._tactile = tactile

    def __getattr__(self, name: str) -> Any:
        return getattr(self._tactile, name)


def rest_awaited_s(v: float) -> float:
    settings = acquiring(f"rest_timeout_s={v}")
    with open_acquire_rig(settings, 0, paced=False) as rig:
        silent = msgspec.structs.replace(rig, tactile=Unrested(rig.tactile))
        made = Session(settings, motion("0", 0.05, 1.0), 0, silent)
        began_ns = rig.clock.now_ns
        with pytest.raises(Stale):
            made.run(1, from_start=True)
        return (rig.clock.now_ns - began_ns) * 1e-9


def unsteady_rest_under_load_counts(v: float) -> float:
    """What the fingertips' driver is told to bear, where they are zeroed under load."""
    settings = acquiring(f"loaded_rest_max_std_counts={v}")
    loaded = msgspec.structs.replace(
        settings, control=msgspec.structs.replace(settings.control, residual_n=5.0)
    )
    told: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(acquire_rig, "open_press_rig", lambda config, *_: opened(config, told))
        with open_acquire_rig(loaded, 0, paced=False):
            return told[0]


@contextmanager
def opened(config: AcquireConfig, told: list[float]) -> Iterator[None]:
    told.append(config.tactile.rest_max_std_counts)
    yield


# Verdicts


HELD = Truth(
    t_ns=0, height_m=0.2, speed_mps=0.0, slip_distance_m=0.02, slip_speed_mps=0.0,
    normal_n=(10.0, 5.0, 5.0), shear_n=ZERO, peak_n=(10.0, 5.0, 5.0), slip_onset_s=1.0,
    force_rise_s=1.1, flank_slope=0.0,
)  # fmt: skip
FACTS = LiftFacts(
    end=HELD, felt_n=5.0, had_compensated=True, registered_s=1.1, onset_s=1.0, twin_onset_s=1.0,
    peak_force_n=10.0, force_bound_n=11.0, cap_reached=False, alarm_stayed=False, fault="",
)  # fmt: skip


def lift_verdict(
    settings: dict[str, float], end: dict[str, float] | None, **facts: Any
) -> LiftOutcome:
    """Of a long object that was held, but for what is named; ``end`` None: no simulation."""
    truth = None if end is None else msgspec.structs.replace(HELD, **end)
    changed = msgspec.structs.replace(FACTS, end=truth, **facts)
    body = msgspec.structs.replace(config().object, long_body=True)
    return outcome(changed, body, ScoringSettings(**settings))


MOVED = ObjectMotion(struck_s=9.99, from_s=10.0, until_s=10.02, displacement_m=0.006)


def tap_verdict(
    settings: dict[str, float],
    alarms: list[Alarm],
    moved_m: float = 0.006,
    turned_rad: float | None = None,
) -> TapOutcome:
    motion = msgspec.structs.replace(MOVED, displacement_m=moved_m, turned_rad=turned_rad)
    facts = TapFacts(
        motion=motion, alarms=alarms, watched_until_s=30.0, own_peak_n=10.5, force_bound_n=11.0
    )
    return verdict(facts, TapScoringSettings(**settings))


# One fingertip that presses


def presser(**settings: Any) -> PressController:
    made = PressControlSettings(**settings)
    return PressController(made, 100.0, None, np.random.default_rng(0))


def pressing_mps(felt_n: float, below_m: float = 0.0, **settings: Any) -> float:
    """Speed downwards at a measured force, so far below where it touched (at 100 counts a N)."""
    p = presser(derivative_m_per_n=0.0, integral_mps_per_n_s=0.0, **settings)
    p.step(0.0, np.array([-1000] + [0] * 5, dtype=np.int16), arm())
    counts = np.array([round(-100 * felt_n)] + [0] * 5, dtype=np.int16)
    return -p.step(0.01, counts, arm(height_m=-below_m)).velocity_mps[2]


def touched(value: float, felt_n: float) -> bool:
    p = presser(touch_n=value)
    p.step(0.0, np.array([round(-100 * felt_n)] + [0] * 5, dtype=np.int16), arm())
    return p.phase is not PressPhase.APPROACH
