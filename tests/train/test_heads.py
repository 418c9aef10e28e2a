"""Heads learn what their inputs hold, and what is written is what was learnt."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from detector.heads import Heads, Teller  # noqa: E402
from detector.scores.heads import Felt, score, told_by_heads  # noqa: E402
from detector.training.heads import HeadSettings, train_heads, write_heads  # noqa: E402

pytestmark = pytest.mark.train


def samples(seed: int, n: int = 2000) -> Felt:
    """The inputs hold speed, direction and kind, and noise beside them."""
    rng = np.random.default_rng(seed)
    angle, log_speed = rng.uniform(0, 2 * np.pi, n), rng.normal(-3.5, 0.5, n)
    turns = rng.random(n) < 0.1
    ways = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    ways[turns] = (0.0, 0.0, 1.0)
    known = np.column_stack([ways[:, :2], log_speed, turns, rng.normal(size=(n, 3))])
    zeros = np.zeros((n, 2))
    return Felt(
        (5.0 * known + 3.0).astype(np.float32), np.exp(log_speed)[:, None] * ways, zeros[:, 0],
        zeros, np.arange(n) // 50, np.full(n, -1),
    )  # fmt: skip


def test_heads_learn_what_their_inputs_hold_and_a_file_has_it(tmp_path: Path) -> None:
    made = train_heads([samples(0), samples(1)], HeadSettings(steps=800), "network", "data", "here")
    write_heads(made, tmp_path / "x.heads.json")
    read = msgspec.json.decode((tmp_path / "x.heads.json").read_bytes(), type=Heads)
    assert read == made
    asked = samples(2)
    told = told_by_heads(Teller(read), asked)
    found = score(told, asked)
    assert found.speed_factor is not None and found.speed_factor[0] < 1.1
    assert found.direction is not None and found.direction[0] > 0.85
    assert found.turning_auc is not None and found.turning_auc[0] > 0.99
    assert told.turning is not None  # a probability that is true of the data, where turns are rare
    assert (1.0 / (1.0 + np.exp(-told.turning))).mean() == pytest.approx(0.1, abs=0.03)


def test_equal_data_and_seed_give_equal_heads() -> None:
    settings = HeadSettings(seed=3, steps=20)
    one, other = (train_heads([samples(0)], settings, "n", "d", "c") for _ in range(2))
    assert one == other
    assert one != train_heads([samples(0)], HeadSettings(seed=4, steps=20), "n", "d", "c")
