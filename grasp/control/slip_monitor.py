"""SlipMonitor: from slip probabilities to registered slip events, masked while the hand closes."""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.decision import DecisionRule, highest


class SlipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When the detector's output is used."""

    # the detector's memory, and the first relaxation of the rubber
    mask_after_closing_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=2.0,
            description="time after the hand has closed in which slip is not decided",
        ),
    ] = 0.14


class SlipStatus(msgspec.Struct, frozen=True):
    """The monitor's result after one sample."""

    armed: bool  # slip is monitored
    masked: bool = False  # the hand closes or has just closed: nothing is decided
    registered: bool = False  # slip has been registered and has not ended yet
    event: bool = False  # a slip event begins with this sample
    finger: int = -1  # finger that registered last; -1: none


DISARMED = SlipStatus(armed=False)
ARMED = SlipStatus(armed=True)


class SlipMonitor:
    """Arms, disarms and masks the decision rule.

    While masked, nothing is decided and the status does not change: the hand's own closing makes
    the pads vibrate, which is evidence neither of slip nor of its end.
    """

    def __init__(self, rule: DecisionRule, settings: SlipSettings) -> None:
        self._rule = rule
        self._mask_ns = round(settings.mask_after_closing_s * 1e9)
        self.masked_until_ns = 0
        self.status = DISARMED
        self.events: list[tuple[int, int]] = []  # (t_ns, finger) of every registration
        self.first_detection_ns: int | None = None  # first armed sample above threshold

    def arm(self) -> None:
        self._rule.reset()
        self.status = ARMED

    def disarm(self) -> None:
        self.status = DISARMED

    def closing(self, now_ns: int) -> None:
        """Note that the fingers move now: mask until ``mask_after_closing_s`` after ``now_ns``."""
        self.masked_until_ns = now_ns + self._mask_ns
        self._rule.interrupt()

    def update(self, now_ns: int, probabilities: NDArray[np.float64]) -> SlipStatus:
        """Take one sample of probabilities (fingers,); returns the new status."""
        before = self.status
        if before.armed and now_ns < self.masked_until_ns:
            self.status = SlipStatus(True, True, before.registered, False, before.finger)
        elif before.armed:
            self.status = self._decide(now_ns, probabilities.tolist())
        return self.status

    def _decide(self, now_ns: int, probabilities: list[float]) -> SlipStatus:
        before = self.status
        if self.first_detection_ns is None and max(probabilities) > self._rule.threshold:
            self.first_detection_ns = now_ns
        registering = self._rule.update(probabilities)
        if not self._rule.registered:
            return ARMED
        if not any(registering):
            return SlipStatus(True, False, True, False, before.finger)
        finger = highest(
            [p if now else -1.0 for p, now in zip(probabilities, registering, strict=True)]
        )
        event = not before.registered
        if event:
            self.events.append((now_ns, finger))
        return SlipStatus(True, False, True, event, finger)
