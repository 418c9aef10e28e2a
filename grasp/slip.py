"""From slip probabilities to registered slip events: when to listen, when not, and what it means."""

from typing import Annotated, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray


class DecisionRule(Protocol):
    """Decides on a stream of probabilities; see ``detector.decision``."""

    threshold: float

    def reset(self) -> None: ...

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]: ...


class SlipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When the detector's output counts."""

    mask_after_closing_s: Annotated[
        float,
        Meta(ge=0.0, le=2.0, description="after our own closing has ended; the detector's memory "
             "plus the first relaxation of the rubber"),
    ] = 0.14
    nominal_samples: Annotated[
        int, Meta(ge=1, le=100, description="samples below threshold on all fingers to be nominal")
    ] = 3


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
        self._settings = settings
        self._armed = False
        self._masked_until_ns = 0
        self._quiet = 0
        self.status = DISARMED
        self.events: list[tuple[int, int]] = []  # (t_ns, finger) of every registration
        self.first_detection_ns: int | None = None  # first armed sample above threshold

    def arm(self) -> None:
        self._rule.reset()
        self._armed = True
        self._quiet = 0
        self.status = SlipStatus(True, False, False, False, -1)

    def disarm(self) -> None:
        self._armed = False
        self.status = DISARMED

    def closing(self, now_ns: int) -> None:
        """Our own fingers are moving: mask until a while after this."""
        self._masked_until_ns = now_ns + round(self._settings.mask_after_closing_s * 1e9)
        self._rule.reset()
        self._quiet = 0

    def update(self, now_ns: int, probabilities: NDArray[np.float64]) -> SlipStatus:
        """Take one sample (fingers,) of probabilities."""
        if not self._armed:
            return self.status
        before = self.status
        if now_ns < self._masked_until_ns:
            self.status = SlipStatus(True, True, before.registered, False, before.finger)
            return self.status
        above = bool(probabilities.max() > self._rule.threshold)
        if above and self.first_detection_ns is None:
            self.first_detection_ns = now_ns
        registering = self._rule.update(probabilities)
        self._quiet = 0 if above else self._quiet + 1
        if registering.any():
            finger = int(probabilities.argmax()) if registering.all() else int(registering.argmax())
            event = not before.registered
            if event:
                self.events.append((now_ns, finger))
            self.status = SlipStatus(True, False, True, event, finger)
        else:
            still = before.registered and self._quiet < self._settings.nominal_samples
            self.status = SlipStatus(True, False, still, False, before.finger if still else -1)
        return self.status
