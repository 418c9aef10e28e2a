"""Acquisition on the simulated rig: force control, strokes, and both labels."""

from typing import Any

import numpy as np
import pytest

from detector.recordings import Metadata, Recording
from drivers.errors import ConfigError, Stale
from scenarios.acquire.config import AcquireConfig, load_acquire_config
from scenarios.acquire.labels import recording
from scenarios.acquire.press import motion
from scenarios.acquire.session import Session, counts_per_newton, open_acquire_rig

METADATA = Metadata(
    set="slide", split="train", surface="planar", motion="primary", speed_mps=0.05,
    spin_radps=0.0, direction="0", seed=0,
)  # fmt: skip


def config(surface: str = "planar", *assignments: str) -> AcquireConfig:
    return load_acquire_config(surface, "simulated", None, assignments)


def session(
    direction: str = "0", *assignments: str, surface: str = "planar", seed: int = 0,
    samples: int = 500, **more: Any,
) -> tuple[Session, Recording]:  # fmt: skip
    settings = config(surface, *assignments)
    with open_acquire_rig(settings, seed, paced=False) as rig:
        made = Session(settings, motion(direction, 0.05, 1.0), seed, rig, **more)
        made.run(samples)
    return made, recording(made.ticks, settings, METADATA, "here")


@pytest.fixture(scope="module")
def plain() -> tuple[Session, Recording]:
    return session()


def speeds(r: Recording) -> np.ndarray:
    assert r.velocity_mps is not None
    return np.hypot(r.velocity_mps[:, 0], r.velocity_mps[:, 1])


def edges(label: np.ndarray) -> int:
    return int(np.diff(label.astype(int)).clip(0).sum())


@pytest.mark.parametrize("surface", ["sphere", "cylinder-x"])
def test_force_is_controlled_by_the_estimate_of_the_fingertip(surface: str) -> None:
    made, _ = session(surface=surface)
    estimates = np.array([tick.force_n for tick in made.ticks])
    true = np.array([tick.truth.normal_n for tick in made.ticks if tick.truth])
    assert estimates.mean() == pytest.approx(5.0, rel=0.1)
    assert true.mean() == pytest.approx(5.0, rel=0.4)  # a calibration for one place on the pad
    assert true.min() > 1.0


def test_the_label_follows_the_fingertips_velocity(plain: tuple[Session, Recording]) -> None:
    _, r = plain
    assert (r.slip == (speeds(r) > 0.003)).all()
    assert 0.2 < r.slip.mean() < 0.8
    assert edges(r.slip) >= 3  # strokes with pauses between them


def test_the_contact_slides_later_than_the_fingertip_moves(
    plain: tuple[Session, Recording],
) -> None:
    """The pad is sheared first, so true slip starts after the label, by less than 150 ms."""
    _, r = plain
    assert r.slip_true is not None
    starts = np.flatnonzero(np.diff(r.slip.astype(int)) == 1) + 1
    delays = [int(np.argmax(r.slip_true[start:])) for start in starts[:-1]]
    assert all(0 < delay < 15 for delay in delays)
    assert (r.slip == r.slip_true).mean() > 0.85


def test_equal_seeds_give_equal_recordings_and_other_seeds_do_not() -> None:
    first, again, other = (session(samples=300, seed=seed)[1] for seed in (1, 1, 2))
    assert (first.counts == again.counts).all()
    assert (first.t_s == again.t_s).all()
    assert (first.counts != other.counts).any()


def test_the_arm_stops_when_the_fingertips_fall_silent() -> None:
    def fall_silent(t_s: float, controller: Any, cell: Any) -> None:
        if t_s > 4.0:
            cell.board.time_out(100)

    settings = config()
    with open_acquire_rig(settings, 0, paced=False) as rig:
        made = Session(settings, motion("0", 0.05, 1.0), 0, rig, script=fall_silent)
        with pytest.raises(Stale):
            made.run(10_000)
        rig.clock.sleep_until_ns(rig.clock.now_ns + 1_000_000_000)
        assert rig.cell is not None
        assert not rig.cell.arm.at(rig.clock.now_ns).moving


def test_hardware_needs_a_calibration() -> None:
    hardware = load_acquire_config("planar", "hardware")
    with pytest.raises(ConfigError, match="counts_per_newton"):
        counts_per_newton(hardware, 0)
