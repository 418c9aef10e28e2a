"""The slip monitor: arming, masking, registering, returning to nominal."""

import numpy as np

from detector.decision import DecisionRule, RuleSettings
from grasp.control.slip_monitor import SlipMonitor, SlipSettings, SlipStatus

TICK = 10_000_000


def monitor(**settings: float) -> SlipMonitor:
    return SlipMonitor(DecisionRule(RuleSettings(), 3), SlipSettings(**settings))  # type: ignore[arg-type]


def feed(m: SlipMonitor, *samples: tuple[float, float, float], start: int = 0) -> list[SlipStatus]:
    return [m.update((start + k) * TICK, np.array(p)) for k, p in enumerate(samples)]


HIGH, LOW, OTHER = (0.9, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.9, 0.0)


def test_nothing_is_registered_before_it_is_armed() -> None:
    m = monitor()
    assert not any(s.registered for s in feed(m, HIGH, HIGH, HIGH))
    assert m.first_detection_ns is None


def test_two_consecutive_samples_on_one_finger_register_slip_once() -> None:
    m = monitor()
    m.arm()
    statuses = feed(m, LOW, HIGH, HIGH, HIGH)
    assert [s.event for s in statuses] == [False, False, True, False]
    assert m.events == [(2 * TICK, 0)]
    assert m.first_detection_ns == TICK


def test_single_samples_on_two_fingers_in_turn_register_nothing() -> None:
    m = monitor()
    m.arm()
    assert not any(s.registered for s in feed(m, HIGH, OTHER, HIGH, OTHER))


def test_status_returns_to_nominal_after_enough_quiet_samples() -> None:
    m = monitor()
    m.arm()
    statuses = feed(m, HIGH, HIGH, LOW, LOW, LOW, LOW)
    assert [s.registered for s in statuses] == [False, True, True, True, False, False]
    assert [s.event for s in statuses] == [False, True, False, False, False, False]


def test_while_masked_nothing_is_decided_and_the_status_stays() -> None:
    m = monitor(mask_after_closing_s=0.05)
    m.arm()
    feed(m, HIGH, HIGH)
    m.closing(2 * TICK)
    masked = feed(m, LOW, LOW, LOW, LOW, start=2)
    assert all(s.masked and s.registered for s in masked)
    m.closing(6 * TICK)
    assert not any(s.event for s in feed(m, HIGH, HIGH, HIGH, start=6))


def test_evidence_from_before_the_mask_does_not_count_after_it() -> None:
    m = monitor(mask_after_closing_s=0.02)
    m.arm()
    feed(m, HIGH)
    m.closing(TICK)
    statuses = feed(m, LOW, LOW, HIGH, LOW, start=1)
    assert not any(s.registered for s in statuses)


def test_disarming_resets_the_status() -> None:
    m = monitor()
    m.arm()
    feed(m, HIGH, HIGH)
    m.disarm()
    assert not m.status.registered
    assert not m.update(5 * TICK, np.array(HIGH)).registered


def test_evidence_from_before_rearming_does_not_count() -> None:
    m = monitor()
    m.arm()
    feed(m, HIGH)
    m.disarm()
    m.arm()
    assert not any(s.registered for s in feed(m, HIGH, LOW, start=2))
