"""The cell of the acquisition: an arm, a board, and one fingertip pressed on a fixed surface."""

import math
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGERS, PERIOD_NS
from drivers.takktile.model.board import BoardModel, BoardModelSettings
from drivers.ur.model import ArmModel, ArmModelSettings
from scenarios.world.fingertip_settings import FingertipSettings
from scenarios.world.press_settings import FixedSurface, PressSettings
from scenarios.world.pressed import PressedPad
from scenarios.world.truth import PressedTruth

STROKE_MPS, STROKE_RADPS = (
    0.001,
    0.02,
)  # from here on the arm's mode is excited: force control is not
SPAN_S = 0.005  # the least that a speed is the mean of: a step to a sample may take a microsecond
Codes = NDArray[np.int16]


class PressedCellSettings(msgspec.Struct, frozen=True, kw_only=True):
    """All that the cell is made of."""

    surface: FixedSurface
    press: PressSettings
    fingertip: FingertipSettings
    board: BoardModelSettings
    arm: ArmModelSettings
    finger: int  # which of the three is pressed


class PressedCell:
    """Arm, board and pad on one time line. The two fingertips that touch nothing are at rest."""

    def __init__(
        self, settings: PressedCellSettings, rng: np.random.Generator, start_ns: int = 0
    ) -> None:
        self.arm = ArmModel(settings.arm, start_ns)
        self.pad = PressedPad(
            settings.surface, settings.press, settings.fingertip, rng, settings.arm.start_m,
            start_ns * 1e-9,
        )  # fmt: skip
        self._rest = rng.integers(
            settings.fingertip.rest_low, settings.fingertip.rest_high,
            (FINGERS, self.pad.tips.rest.shape[1]), endpoint=True,
        ).astype(np.int16)  # fmt: skip
        self._finger = settings.finger
        self.shaken = False  # something shakes the arm that is not its own motion
        self._now_ns = self._since_ns = start_ns
        self._slid, self._sliding = np.zeros(3), np.zeros(3)
        self.board = BoardModel(settings.board, self._sample)

    def advance(self, now_ns: int) -> None:
        """Advance everything to now_ns."""
        self._now_ns = max(self._now_ns, now_ns)
        arm, t = self.arm, self._now_ns
        arm.go_on(t)
        arm.seen(t)
        x, y, _ = arm.velocity(t)
        strokes = math.hypot(x, y) > STROKE_MPS or abs(arm.spin(t)) > STROKE_RADPS
        self.pad.advance(t * 1e-9, arm.position(t), arm.angle(t), strokes or self.shaken)
        span_s = (t - self._since_ns) * 1e-9
        if span_s >= SPAN_S:
            slid = self.pad.tips.slid[0]
            self._sliding = (slid - self._slid) / span_s
            self._slid, self._since_ns = slid, t

    def _sample(self, t_ns: int) -> Callable[[], tuple[Codes, Codes]]:
        self.advance(t_ns)
        pressure, temperature = self.pad.tips.codes()
        codes = self._rest.copy()
        codes[self._finger] = pressure[0]
        felt = codes.ravel(), np.broadcast_to(temperature, codes.shape).ravel()
        return lambda: felt

    def compile(self) -> None:
        """Run every compiled function once, as ``SimulatedCell.compile``."""
        self._sample(self._now_ns + PERIOD_NS)

    def truth(self) -> PressedTruth:
        """The state of the contact at the time that it was last advanced to."""
        tips = self.pad.tips
        return PressedTruth(
            t_ns=self._now_ns,
            normal_n=self.pad.normal_n,
            contact_speed_mps=1e-3 * math.hypot(self._sliding[0], self._sliding[1]),
            contact_turn_radps=float(abs(self._sliding[2])),
            sliding_share=float(tips.sliding_share[0]),
        )
