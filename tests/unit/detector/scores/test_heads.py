"""How heads are scored, beside what can be told without them."""

import msgspec
import numpy as np
import pytest

from detector.heads import OUTPUTS, Dense, Teller, width_of
from detector.network_file import read_network, weights_path
from detector.scores.heads import (
    FIRST,
    LEAST_MPS,
    Felt,
    Told,
    centre_shift,
    felt,
    score,
    told_by_heads,
    told_without,
)
from detector.scores.motion import sector_of, speed_of, turning_of
from drivers.errors import BadFile
from tests.unit.detector.networks import walk
from tests.unit.detector.test_heads import heads_of
from tests.unit.detector.toys import toys


def samples(n: int = 600, seed: int = 0) -> Felt:
    """Energy goes with speed, the pressure's centre against the motion."""
    rng = np.random.default_rng(seed)
    angle, speed = rng.uniform(0, 2 * np.pi, n), np.exp(rng.normal(-3.5, 0.6, n))
    turns = rng.random(n) < 0.2
    motion = np.zeros((n, 3))
    motion[:, 0], motion[:, 1] = speed * np.cos(angle), speed * np.sin(angle)
    motion[turns] = np.column_stack([0.1 * motion[turns, :2], speed[turns]])
    return Felt(
        rng.normal(size=(n, 4)).astype(np.float32), motion,
        1000.0 * speed * np.where(turns, 3.0, 1.0), -motion[:, :2] / speed[:, None],
        np.arange(n) // 30, np.full(n, 3),
    )  # fmt: skip


def test_who_tells_the_truth_is_always_right() -> None:
    made = samples()
    truth = Told(
        np.log(speed_of(made.motion)), turning_of(made.motion).astype(float), sector_of(made.motion)
    )
    found = score(truth, made)
    assert found.speed_factor == pytest.approx((1.0, 1.0, 1.0))
    assert found.direction == found.beside == found.turning_auc == (1.0, 1.0, 1.0)


def test_a_direction_beside_the_right_one_is_counted_apart_and_round_the_corner() -> None:
    made = samples()
    found = score(Told(None, None, (sector_of(made.motion) + 7) % 8), made)
    assert found.direction == (0.0, 0.0, 0.0)
    assert found.beside == (1.0, 1.0, 1.0)
    assert found.speed_factor is None and found.turning_auc is None


def test_what_always_says_the_same_is_bettered_by_energy_and_the_pressures_centre() -> None:
    asked = samples(seed=1)
    told = {by: score(each, asked) for by, each in told_without(samples(), asked).items()}
    same, energy, centre = (told[by] for by in ("always the same", "energy", "pressure's centre"))
    assert same.speed_r2 is not None and energy.speed_r2 is not None
    assert energy.speed_r2[1] > same.speed_r2[2]
    assert energy.turning_auc is not None and energy.turning_auc[0] > 0.6  # either way round
    assert same.direction is not None and centre.direction is not None
    assert centre.direction[1] > 0.9 > same.direction[2]
    down = told["down, by the mount"].direction
    slid = sector_of(asked.motion[asked.slides])
    assert down is not None and down[0] == (slid == 3).mean()
    unknown = msgspec.structs.replace(asked, mount=np.full(600, -1))
    assert "down, by the mount" not in told_without(samples(), unknown)


def test_recordings_are_drawn_for_an_interval_and_not_samples() -> None:
    made = samples()
    right = Told(None, None, np.where(made.recording < 10, sector_of(made.motion), -4))
    alike = score(right, made).direction
    spread = score(right, msgspec.structs.replace(made, recording=np.arange(600))).direction
    assert alike is not None and spread is not None
    assert alike[2] - alike[1] > 2 * (spread[2] - spread[1])


def test_centre_of_pressure_moves_with_the_load_and_its_own_past_is_taken_away() -> None:
    counts = np.zeros((200, 1, 6), np.int16)
    counts[:, 0, 0] = -200
    counts[100:, 0] = 0
    counts[100:, 0, 2] = -200  # two columns to the right
    shift = centre_shift(counts)
    assert shift[99, 0] == pytest.approx((0.0, 0.0))
    assert shift[105, 0] == pytest.approx((2.0, 0.0))
    assert shift[150, 0] == pytest.approx((0.0, 0.0))


def test_samples_are_those_of_slip_in_which_a_fingertip_moves_after_the_first_second() -> None:
    loaded = read_network(weights_path("gru"))
    velocity = np.zeros((900, 2), np.float32)
    velocity[300:] = (0.0, 2 * LEAST_MPS)
    made = [
        msgspec.structs.replace(r, velocity_mps=velocity, spin_radps=np.zeros(900, np.float32))
        for r in toys("test", 3, 0)
    ]
    found = felt(loaded, made)
    slips = sum(int(r.slip[302:].sum()) for r in made)  # the mean is fast enough by then
    assert len(found.recording) == slips and FIRST < 300
    assert set(found.recording.tolist()) == {0, 1, 2}
    assert found.inputs.shape == (slips, width_of(loaded))
    assert sector_of(found.motion).tolist() == [2] * slips
    with pytest.raises(BadFile, match="velocity"):
        felt(loaded, toys("test", 2, 0))


def test_inputs_of_recordings_side_by_side_are_those_of_a_stream() -> None:
    loaded = read_network(weights_path("gru"))
    teller = Teller(heads_of(weights_path("gru")))
    long, short = (
        msgspec.structs.replace(
            toys("test", 1, 0)[0], counts=walk(n, 1, n), t_s=np.arange(n) * 0.01,
            slip=np.ones(n, bool), slip_true=None, velocity_mps=np.full((n, 2), 0.02, np.float32),
            spin_radps=np.zeros(n, np.float32),
        )
        for n in (260, 190)
    )  # fmt: skip
    both, alone = felt(loaded, [long, short]), felt(loaded, [short])
    mine = both.recording == 1
    assert both.inputs[mine] == pytest.approx(alone.inputs, abs=1e-4)
    assert told_by_heads(teller, alone).sector is not None


def test_layers_that_are_all_zero_say_the_same_of_everything() -> None:
    made = samples()
    zero = Dense([[0.0] * 4] * 3, [0.0] * 3), Dense([[0.0] * 3] * OUTPUTS, [0.0] * OUTPUTS)
    told = told_by_heads(Teller(heads_of(weights_path("gru"), layers=zero)), made)
    assert told.log_speed is not None and not told.log_speed.any()
