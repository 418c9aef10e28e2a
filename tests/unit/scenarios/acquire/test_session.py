"""Acquisition on the simulated rig: force held by the fingertip, strokes, and both labels."""

from typing import Any

import numpy as np
import pytest

from detector.recordings import Metadata, Recording
from drivers.errors import ConfigError, Refused, Stale
from scenarios.acquire.config import AcquireConfig, load_acquire_config
from scenarios.acquire.force_calibration import counts_per_newton
from scenarios.acquire.labels import recording
from scenarios.acquire.press import PressPhase, motion
from scenarios.acquire.session import Sample, Session, open_acquire_rig

METADATA = Metadata(
    set="slide", split="train", surface="planar", motion="primary", speed_mps=0.05,
    spin_radps=0.0, direction="0", seed=0,
)  # fmt: skip


def config(surface: str = "planar", *assignments: str) -> AcquireConfig:
    return load_acquire_config(surface, "simulated", None, assignments)


def session(
    direction: str = "0", *assignments: str, surface: str = "planar", seed: int = 0,
    samples: int = 700, **more: Any,
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


@pytest.mark.parametrize("surface", ["planar", "sphere", "cylinder-x", "cylinder-y"])
def test_the_fingertips_own_estimate_holds_the_force(surface: str) -> None:
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


def test_strokes_are_short_and_go_out_and_back(plain: tuple[Session, Recording]) -> None:
    made, r = plain
    x = np.array([tick.arm.position_m[0] for tick in made.ticks])
    assert x.max() - x.min() < 0.025
    assert speeds(r).max() <= 0.0501
    assert r.velocity_mps is not None
    assert r.velocity_mps[:, 0].min() < -0.04
    assert r.velocity_mps[:, 0].max() > 0.04
    assert abs(r.velocity_mps[:, 1]).max() < 1e-6


def test_the_contact_slides_later_than_the_fingertip_moves(
    plain: tuple[Session, Recording],
) -> None:
    """The pad is sheared first, and the mount dragged along: true slip begins after the label, by
    less than 150 ms."""
    _, r = plain
    assert r.slip_true is not None
    starts = np.flatnonzero(np.diff(r.slip.astype(int)) == 1) + 1
    delays = [int(np.argmax(r.slip_true[start:])) for start in starts[:-1]]
    assert all(0 < delay < 15 for delay in delays)
    assert (r.slip == r.slip_true).mean() > 0.85


def test_on_a_stiff_mount_the_contact_slides_as_fast_as_the_arm_moves_and_no_faster() -> None:
    _, r = session("0", "fingertip.lateral_npmm=0", "fingertip.sway_mm=0", samples=300)
    assert r.contact_speed_mps is not None
    assert r.contact_speed_mps.max() == pytest.approx(speeds(r).max(), rel=0.2)


def test_what_a_step_of_a_microsecond_adds_changes_no_true_speed() -> None:
    """A bristle that recoils in it by a hundredth of a millimetre is no slip of metres a second."""
    seen: list[tuple[float, ...]] = []
    settings = config()
    with open_acquire_rig(settings, 0, paced=False) as rig:

        def peek(sample: Sample) -> None:
            if rig.cell is not None and sample.truth and sample.truth.contact_speed_mps > 0.01:
                rig.cell.advance(rig.clock.now_ns + 1000)
                after = rig.cell.truth()
                seen.append((sample.truth.contact_speed_mps, after.contact_speed_mps))
                seen.append((sample.truth.contact_turn_radps, after.contact_turn_radps))

        Session(settings, motion("0", 0.05, 1.0), 0, rig, peek).run(300)
    assert len(seen) > 100
    assert all(before == after for before, after in seen)


@pytest.mark.parametrize(("direction", "sign"), [("ccw", 1.0), ("cw", -1.0)])
def test_a_rotation_turns_the_fingertip_in_place(direction: str, sign: float) -> None:
    _, r = session(direction)
    assert r.spin_radps is not None
    first = r.spin_radps[np.flatnonzero(abs(r.spin_radps) > 0.2)[0]]
    assert np.sign(first) == sign
    assert abs(r.spin_radps).max() == pytest.approx(1.0, abs=0.02)
    assert speeds(r).max() < 1e-6
    assert (r.slip == (abs(r.spin_radps) > 0.2)).all()


def test_an_oblique_stroke_runs_along_its_direction() -> None:
    _, r = session("135")
    assert r.velocity_mps is not None
    moving = r.velocity_mps[speeds(r) > 0.01]
    assert moving[:, 0] == pytest.approx(-moving[:, 1], abs=1e-6)


def test_the_finger_rests_before_it_touches_and_retreats_afterwards() -> None:
    seen: list[Sample] = []
    settings = config()
    with open_acquire_rig(settings, 0, paced=False) as rig:
        made = Session(settings, motion("0", 0.05, 1.0), 0, rig, seen.append)
        made.run(300)
        rig.arm.pump(rig.clock.now_ns)
        assert rig.arm.state is not None
        assert rig.arm.state.position_m == pytest.approx(settings.arm_model.start_m)
    assert seen[0].phase is PressPhase.APPROACH
    assert all(tick.phase is not PressPhase.APPROACH for tick in made.ticks)


def test_jitter_and_lost_samples_are_those_of_the_settings() -> None:
    made, r = session("0", "sampling.lost_share=0.05", samples=1500)
    assert np.diff(r.t_s).std() == pytest.approx(0.0007, rel=0.2)
    missed = [tick.frame.missed > 0 for tick in made.ticks]
    assert np.mean(missed) == pytest.approx(0.05, abs=0.02)
    again = np.flatnonzero(missed)
    assert (r.counts[again] == r.counts[again - 1]).all()
    steady, _ = session("0", "sampling.lost_share=0.0", "sampling.jitter_s=0.0", samples=300)
    assert not any(tick.frame.missed for tick in steady.ticks)


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
        assert not rig.cell.arm.moving(rig.clock.now_ns)


def test_a_finger_that_touches_nothing_is_stopped_by_the_workspace() -> None:
    settings = config("planar", "press.gap_m=0.05")
    with open_acquire_rig(settings, 0, paced=False) as rig:
        made = Session(settings, motion("0", 0.05, 1.0), 0, rig)
        with pytest.raises(Refused, match="workspace"):
            made.run(100)


def test_a_finger_that_touches_nothing_in_its_time_says_so() -> None:
    with pytest.raises(Stale, match="nothing was touched"):
        session("0", "session.touch_timeout_s=1")


@pytest.mark.parametrize("after_s", [0.3, 0.75])
def test_samples_are_kept_from_a_while_after_touch(after_s: float) -> None:
    seen: list[Sample] = []
    made, _ = session("0", f"session.kept_after_s={after_s}", samples=20, on_tick=seen.append)
    touched = next(sample for sample in seen if sample.phase is not PressPhase.APPROACH)
    assert (made.ticks[0].t_ns - touched.t_ns) * 1e-9 == pytest.approx(after_s, abs=0.03)


def test_saturated_taxels_do_not_press_the_finger_ever_deeper() -> None:
    settings = config("planar", "control.counts_per_newton=1000", "control.depth_m=0.002")
    with open_acquire_rig(settings, 0, paced=False) as rig:
        made = Session(settings, motion("0", 0.05, 1.0), 0, rig)
        made.run(700, from_start=True)
    pressed = [
        tick.arm.position_m[2] for tick in made.ticks if tick.phase is not PressPhase.APPROACH
    ]
    assert min(pressed) > pressed[0] - 0.0025


def test_a_rest_under_load_hides_that_load_from_the_counts() -> None:
    """The force is held all the same, and a pad that is unloaded reads above its rest."""
    air, _ = session(samples=300)
    loaded, r = session("0", "control.residual_n=5.0", samples=300)
    hidden = [abs(m.frame.counts[0].astype(int).sum()) for m in (*loaded.ticks, *air.ticks)]
    assert np.mean(hidden[:300]) < 0.5 * np.mean(hidden[300:])
    true = np.array([tick.truth.normal_n for tick in loaded.ticks if tick.truth])
    assert true.mean() == pytest.approx(5.0, rel=0.4)
    assert r.counts.max() > 20


def test_a_direction_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match="no direction"):
        motion("44", 0.05, 1.0)


def test_hardware_needs_a_calibration_of_its_own() -> None:
    hardware = load_acquire_config("planar", "hardware")
    with pytest.raises(ConfigError, match="counts_per_newton"):
        counts_per_newton(hardware, 0)
