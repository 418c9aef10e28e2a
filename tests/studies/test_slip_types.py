"""Auxiliary outputs: how they are scored, and a tiny training of them."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.auxiliary_outputs import OutputsFile, input_width, read_outputs
from detector.network_file import read_network, weights_digest, weights_path
from detector.recordings import Recording, write
from studies import slip_types as study
from studies.runner import main
from tests.unit.detector.toy_recordings import toys


def samples(n: int = 600, seed: int = 0) -> study.Samples:
    """Energy grows with speed; the centre of pressure moves against the motion."""
    rng = np.random.default_rng(seed)
    angle, speed = rng.uniform(0, 2 * np.pi, n), np.exp(rng.normal(-3.5, 0.6, n))
    turns = rng.random(n) < 0.2
    motion = np.column_stack([speed * np.cos(angle), speed * np.sin(angle), np.zeros(n)])
    motion[turns] = np.column_stack([0.1 * motion[turns, :2], speed[turns]])
    return study.Samples(
        rng.normal(size=(n, 4)).astype(np.float32), motion,
        1000.0 * speed * np.where(turns, 3.0, 1.0), -motion[:, :2] / speed[:, None],
        np.arange(n) // 30, np.full(n, 3),
    )  # fmt: skip


def moving(split: str, n: int, first: int) -> list[Recording]:
    """Toys whose fingertip slides along y."""
    velocity = np.zeros((900, 2), np.float32)
    velocity[300:] = (0.0, 2 * study.LEAST_MPS)
    return [
        msgspec.structs.replace(r, velocity_mps=velocity, spin_radps=np.zeros(900, np.float32))
        for r in toys(split, n, first)  # type: ignore[arg-type]
    ]


def test_the_truth_scores_best_and_a_neighbouring_direction_counts_apart() -> None:
    made = samples()
    truth = study.Guess(study.log_speed(made.motion), study.turning_of(made.motion).astype(float),
                        study.sector_of(made.motion))  # fmt: skip
    assert study.score(truth, made) == tuple(5 * [pytest.approx((1.0, 1.0, 1.0))])
    beside = study.Guess(sector=(study.sector_of(made.motion) + 7) % 8)
    assert study.score(beside, made) == (None, None, (0.0,) * 3, (1.0,) * 3, None)


def test_motion_of_the_fingers_mirrors_that_of_the_thumb_at_the_line_upwards() -> None:
    (one,) = moving("test", 1, 0)
    about = msgspec.structs.replace(one.metadata, parameters={study.UPWARDS: 90.0})
    grasped = msgspec.structs.replace(
        one, counts=np.repeat(one.counts, 3, axis=1), metadata=about,
        velocity_mps=np.full((900, 2), 0.02, np.float32), spin_radps=np.full(900, 0.4, np.float32),
    )  # fmt: skip
    motion = study.motion_of(grasped)
    assert motion is not None
    turn = 0.4 * study.TURN_LEVER_M
    expected = [(0.02, 0.02, turn), (-0.02, 0.02, -turn), (-0.02, 0.02, -turn)]
    assert motion[-1] == pytest.approx(np.array(expected), abs=1e-6)
    assert study.motion_of(msgspec.structs.replace(grasped, velocity_mps=None)) is None
    assert study.sector_of(np.array([math.cos(-0.8), math.sin(-0.8)])) == 7


def test_samples_are_those_of_slip_in_motion_and_the_centre_follows_the_load() -> None:
    loaded = read_network(weights_path("gru"))
    made = moving("test", 2, 0)
    found = study.samples_of(loaded, made)
    slips = sum(int(r.slip[302:].sum()) for r in made)
    assert found.inputs.shape == (slips, input_width(loaded))
    assert set(study.sector_of(found.motion)) == {2}
    counts = np.zeros((200, 1, 6), np.int16)
    counts[:100, 0, 0] = counts[100:, 0, 2] = -200  # two columns to the right
    assert study.centre_shift(counts)[105, 0] == pytest.approx((2.0, 0.0))


def filled(folder: Path) -> Path:
    for recording in [*moving("train", 2, 0), *moving("test", 2, 50)]:
        write(folder / f"{recording.source}.npz", recording)
    return folder


def test_packaged_outputs_are_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["gru", "--data", str(filled(tmp_path)), "--jobs", "1", "--out", str(tmp_path)]
    assert main("slip_types", study.STUDY, words) == 0
    text = capsys.readouterr().out
    assert f"| {tmp_path.name}: auxiliary outputs | " in text and "centre of pressure" in text


@pytest.mark.train
def test_trained_outputs_are_read_with_their_network(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    words = ["gru", "--data", str(filled(tmp_path)), "--train", "--steps", "5"]
    assert main("slip_types", study.STUDY, [*words, "--jobs", "1", "--out", str(tmp_path)]) == 0
    weights = tmp_path / "gru.onnx"
    weights.write_bytes(weights_path("gru").read_bytes())
    assert read_outputs(weights, weights_digest(weights), read_network(weights)) is not None
    made = msgspec.json.decode((tmp_path / "gru.auxiliary.json").read_bytes(), type=OutputsFile)
    assert f"{tmp_path.name}: {study.NETWORK}, {study.FIGURES[0]}" in made.scores
