"""A reflex and the states that it gets, changed step by step."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp
from drivers.interfaces import PERIOD_NS, ArmState, Counts3, Detection, TactileFrame, Vector3
from grasp.control.commands import HoldFingers, MoveFingers, OpenFingers
from grasp.policy_reflex import AT_REST, Admitted, PolicyCommand
from scenarios.trial.config import TrialConfig
from tests.unit.grasp.builders import gripper

REST, MOVES, TOUCHES = Detection.AT_TARGET, Detection.MOVING, Detection.CONTACT_CLOSING
ALL_REST, THUMB_MOVES, THUMB_LATCHED = (REST,) * 3, (MOVES, REST, REST), (TOUCHES, REST, REST)
GRIP: Vector3 = (2.0, 1.0, 1.0)  # N
UP, DOWN, ASIDE = (0.0, 0.0, 0.1), (0.0, 0.0, -0.1), (0.1, 0.0, 0.1)
READ = 7  # steps at rest after which the force is read
HOLDS = 62  # steps at rest after which an object is held
COUNTS_PER_NEWTON, TAXELS = 160, 6


def move(*targets: int, force_n: float = 10.0) -> MoveFingers:
    a, b, c = targets
    return MoveFingers((a, b, c), 0.022, force_n)


class Scene:
    """A reflex, and the states that it gets: changed by the arguments of ``step``."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, force_n: Vector3 = GRIP, limit_n: float = 10.0
    ) -> None:
        self.slip, self.resets = 0.0, list[int]()  # of the detector, at these times, ns
        detector = SimpleNamespace(
            name="scripted", threshold=0.5, memory=1, reset=lambda: self.resets.append(self.t_ns),
            update=lambda counts: np.full(3, self.slip),
        )  # fmt: skip
        monkeypatch.setattr(TrialConfig, "make_detector", lambda *_: detector)
        self.t_ns, self.height_m, self.sign = 0, 0.0, -1.0
        self.reflex = grasp.reflex(detector="energy", force_limit_n=limit_n)
        self.positions: Counts3 = (55, 55, 55)
        self.requested: Counts3 | None = None  # None: the positions
        self.detections, self.force_n, self.fresh = ALL_REST, force_n, True

    def counts(self) -> NDArray[np.int16]:
        """The force as counts, of which each changes from sample to sample."""
        each = self.sign * COUNTS_PER_NEWTON * np.array(self.force_n) / TAXELS
        jitter = (self.t_ns // PERIOD_NS + np.arange(3 * TAXELS)).reshape(3, TAXELS) % 3 - 1
        return np.rint(each[:, None] + jitter).astype(np.int16)

    def step(
        self, hand: MoveFingers | OpenFingers | None = None, arm: Vector3 = AT_REST, steps: int = 1,
        **changes: Any,
    ) -> Admitted:  # fmt: skip
        """The last of some steps with a command, after changes of the states."""
        for name, value in changes.items():
            assert hasattr(self, name)
            setattr(self, name, value)
        wanted = PolicyCommand(hand=hand or HoldFingers(), arm_velocity_mps=arm)
        for _ in range(steps):
            admitted = self.send(wanted)
        return admitted

    def send(self, wanted: PolicyCommand) -> Admitted:
        """One step with any command."""
        self.t_ns += PERIOD_NS
        counts, zero = self.counts(), np.zeros((3, TAXELS), np.int16)
        raw = counts + np.int16(511)
        frame = TactileFrame(self.t_ns, self.t_ns, 0, counts, raw, zero, zero)
        at = gripper(
            self.t_ns, self.positions, self.detections, self.fresh, requested=self.requested
        )
        place: Vector3 = (0.0, 0.0, self.height_m)
        state = ArmState(self.t_ns, 0, place, AT_REST, False)
        self.last = self.reflex.step(frame, at, state, wanted)
        return self.last

    def close_thumb(self, count: int, force_n: float) -> None:
        """Move the thumb there; its force rises by 1 N a step."""
        self.step(positions=(count, 55, 55), detections=THUMB_MOVES)
        while self.force_n[0] < force_n:
            a, b, c = self.force_n
            self.step(force_n=(a + 1.0, b + 0.5, c + 0.5))
        self.step(detections=ALL_REST)
