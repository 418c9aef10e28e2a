"""Auxiliary outputs of a network: values, unchanged slip probability, and refused files."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.auxiliary_outputs import (
    OUTPUTS,
    AuxiliaryOutputs,
    Dense,
    OutputsFile,
    input_width,
    inputs_of,
    outputs_path,
)
from detector.loading import load_detector, motion_reader
from detector.network import NetworkSettings, StreamingNetwork, load_network
from detector.network_file import read_network, weights_digest
from drivers.errors import BadFile
from tests.unit.detector.network_files import walk, write_network

HIDDEN = 7


def outputs_of(weights: Path, seed: int = 0, **changes: object) -> OutputsFile:
    """Random outputs of that network."""
    rng = np.random.default_rng(seed)

    def dense(width: int, out: int) -> Dense:
        return Dense(rng.normal(0, 0.3, (out, width)).tolist(), rng.normal(0, 0.3, out).tolist())

    fields: dict[str, object] = {
        "format": 1, "network": weights_digest(weights), "data_digest": "none", "seed": seed,
        "commit": "", "samples": 1, "scores": {},
        "layers": (dense(input_width(read_network(weights)), HIDDEN), dense(HIDDEN, OUTPUTS)),
    }  # fmt: skip
    return OutputsFile(**(fields | changes))  # type: ignore[arg-type]


@pytest.fixture(params=["gru", "tcn"])
def weights(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A network that streams, with auxiliary outputs beside it."""
    path = write_network(tmp_path, request.param)
    outputs_path(path).write_bytes(msgspec.json.encode(outputs_of(path)))
    return path


def loaded(weights: Path) -> StreamingNetwork:
    found = load_network(weights.stem, NetworkSettings(weights=str(weights)), 3)
    assert isinstance(found, StreamingNetwork)
    return found


def probabilities(detector: StreamingNetwork, counts: np.ndarray, ask: bool) -> np.ndarray:
    results = []
    for frame in counts:
        results.append(detector.update(frame))
        if ask:
            detector.motion()
    return np.array(results)


def test_probability_of_slip_is_the_same_with_outputs_bit_for_bit(weights: Path) -> None:
    counts = walk(300)
    with_outputs = loaded(weights)
    assert with_outputs.motion() is None  # no frame yet
    expected = probabilities(with_outputs, counts, ask=True)
    assert with_outputs.motion() is not None
    outputs_path(weights).unlink()
    without = loaded(weights)
    assert (expected == probabilities(without, counts, ask=False)).all()
    assert without.motion() is None


def test_motion_uses_the_latest_frame_and_the_state_after_it(weights: Path) -> None:
    counts = walk(40)
    detector = loaded(weights)
    for frame in counts:
        detector.update(frame)
    network = read_network(weights)
    states = {k: np.zeros((3, *shape), np.float32) for k, shape in network.states.items()}
    for t, frame in enumerate(counts.astype(np.float32)):
        fed = {"counts": frame, "previous": counts[max(t - 1, 0)].astype(np.float32), **states}
        found = network.session.run([f"next_{name}" for name in states], fed)
        states = dict(zip(states, found, strict=True))
    auxiliary = AuxiliaryOutputs(outputs_of(weights))
    out = auxiliary.outputs(inputs_of(states, counts[-1]))
    motion = detector.motion()
    assert motion is not None
    assert motion.speed_mps == pytest.approx(np.exp(out[:, 0]), rel=1e-5)
    assert motion.direction_deg == (45 * out[:, 2:].argmax(axis=1)).tolist()
    assert motion.turning == pytest.approx(1.0 / (1.0 + np.exp(-out[:, 1])), rel=1e-5)


def test_detector_without_auxiliary_outputs_has_no_motion() -> None:
    for name in ["freq-cnn-paper", "tcn-paper", "energy"]:
        detector = load_detector(name, {}, 3)
        read_motion = motion_reader(detector)
        for frame in walk(5):
            detector.update(frame)
        assert read_motion() is None, name


def test_motion_of_a_detector_with_auxiliary_outputs_is_read_until_reset(weights: Path) -> None:
    detector = load_detector(weights.stem.partition("-")[0], {"weights": str(weights)}, 3)
    read_motion = motion_reader(detector)
    detector.update(walk(1)[0])
    assert read_motion() is not None
    detector.reset()
    assert read_motion() is None


def test_outputs_of_another_network_are_refused(weights: Path) -> None:
    other = outputs_of(weights, network="0" * 64)
    outputs_path(weights).write_bytes(msgspec.json.encode(other))
    with pytest.raises(BadFile, match="other weights"):
        loaded(weights)


def test_damaged_outputs_file_is_refused(weights: Path) -> None:
    whole = outputs_path(weights).read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"{}", whole.replace(b"layers", b"lawyers")):
        outputs_path(weights).write_bytes(damaged)
        with pytest.raises(BadFile, match="no auxiliary outputs"):
            loaded(weights)


def test_layers_of_other_sizes_are_refused(weights: Path) -> None:
    first, last = outputs_of(weights).layers
    wrong = [
        (Dense([row[:-1] for row in first.weight], first.bias), last),
        (first, Dense(last.weight[:-1], last.bias[:-1])),
        (Dense(first.weight[:-1], first.bias), last),
        (first, Dense(last.weight, last.bias[:-1])),
    ]
    for layers in wrong:
        made = outputs_of(weights, layers=layers)
        outputs_path(weights).write_bytes(msgspec.json.encode(made))
        with pytest.raises(BadFile, match=r"has not \d+ inputs|holds no"):
            loaded(weights)
