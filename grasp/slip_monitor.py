"""From slip probabilities to registered slip events: when to listen, and when not."""

from typing import Annotated, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray


class DecisionRule(Protocol):
    """Decides on a stream of probabilities; see ``detector.decision``."""

    threshold: float

    @property
    def registered(self) -> bool: ...

    def reset(self) -> None: ...

    def interrupt(self) -> None: ...

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]: ...


class SlipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When the detector's output counts."""

    mask_after_closing_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=2.0,
            description="after our own closing has ended; the detector's memory plus the first "
            "relaxation of the rubber",
        ),
    ] = 0.14


class SlipStatus(msgspec.Struct, frozen=True):
    """What the monitor says after one sample."""

    armed: bool
    masked: bool
    registered: bool  # the status shown to people: REGISTERED or nominal
    event: bool  # slip was registered by this very sample
    finger: int  # that registered last, -1 = none


DISARMED = SlipStatus(False, False, False, False, -1)


class SlipMonitor:
    """Arms, disarms and masks the decision rule.

    While masked nothing is decided and the status stays what it was: our own closing shakes the
    pads, and what they say then is no evidence of slip, nor of its end.
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
        self.status = SlipStatus(True, False, False, False, -1)

    def disarm(self) -> None:
        self.status = DISARMED

    def closing(self, now_ns: int) -> None:
        """Our own fingers are moving: mask until a while after this."""
        self.masked_until_ns = now_ns + self._mask_ns
        self._rule.interrupt()

    def update(self, now_ns: int, probabilities: NDArray[np.float64]) -> SlipStatus:
        """Take one sample (fingers,) of probabilities."""
        before = self.status
        if not before.armed:
            return before
        if now_ns < self.masked_until_ns:
            self.status = SlipStatus(True, True, before.registered, False, before.finger)
        else:
            self.status = self._decide(now_ns, probabilities, before)
        return self.status

    def _decide(
        self, now_ns: int, probabilities: NDArray[np.float64], before: SlipStatus
    ) -> SlipStatus:
        if self.first_detection_ns is None and probabilities.max() > self._rule.threshold:
            self.first_detection_ns = now_ns
        registering = self._rule.update(probabilities)
        if not self._rule.registered:
            return SlipStatus(True, False, False, False, -1)
        if not registering.any():
            return SlipStatus(True, False, True, False, before.finger)
        finger = int(np.where(registering, probabilities, -1.0).argmax())
        event = not before.registered
        if event:
            self.events.append((now_ns, finger))
        return SlipStatus(True, False, True, event, finger)
