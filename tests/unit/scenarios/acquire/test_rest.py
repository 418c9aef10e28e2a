"""Distance from the last position at rest: strokes, creep, and elastic motion."""

import numpy as np

from scenarios.acquire.labels import REST_S, distance_moved

STILL = round(REST_S / 0.01) + 1  # samples after which a constant position is at rest


def along(*x_mm: np.ndarray) -> np.ndarray:
    """Distance moved, mm, along these positions, 10 ms each."""
    x = np.concatenate(x_mm)
    places = np.stack([x, np.zeros(len(x)), np.zeros(len(x))], axis=1) * 1e-3
    return distance_moved(np.arange(len(x)) * 0.01, places, np.ones(len(x), bool)) * 1e3


def test_stroke_counts_from_its_start_until_rest() -> None:
    found = along(np.zeros(50), np.linspace(0.0, 10.0, 51), np.full(50, 10.0))
    assert found[:50].max() == 0.0
    np.testing.assert_allclose(found[50:101], np.linspace(0.0, 10.0, 51), atol=0.15)
    after = found[101:]
    assert after[: STILL - 3].min() > 9.9
    assert after[STILL:].max() == 0.0


def test_creep_slower_than_the_bound_is_rest_and_slip_is_not() -> None:
    t = np.arange(200) * 0.01
    slow, fast = (along(speed * t) for speed in (0.5, 3.0))
    assert slow.max() == 0.0
    np.testing.assert_allclose(fast[20:], 3.0 * t[20:], atol=0.2)


def test_object_without_contact_has_not_moved() -> None:
    n = 60
    places = np.zeros((n, 3))
    places[:, 0] = np.linspace(0.0, 0.05, n)
    touched = np.arange(n) < 20
    found = distance_moved(np.arange(n) * 0.01, places, touched)
    assert found[19] > 0.01
    assert found[20:].max() == 0.0
