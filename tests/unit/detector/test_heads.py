"""Heads beside a network: what they tell, what they leave as it is, and what is refused."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.heads import (
    HELD,
    OUTPUTS,
    Dense,
    Heads,
    Teller,
    heads_path,
    inputs_of,
    made_of,
    width_of,
)
from detector.interface import load_detector, motion_told_by
from detector.network import NetworkSettings, StreamingNetwork, load_network
from detector.network_file import read_network, weights_digest, weights_path
from detector.training.architecture import ARCHITECTURES
from drivers.errors import BadFile, UsageError
from tests.unit.detector.networks import walk, write_network

HIDDEN = 7
PACKAGED = ("gru", "tcn")  # that come with heads


def heads_of(weights: Path, seed: int = 0, **changes: object) -> Heads:
    """Random heads of that network."""
    rng = np.random.default_rng(seed)

    def dense(width: int, out: int) -> Dense:
        return Dense(rng.normal(0, 0.3, (out, width)).tolist(), rng.normal(0, 0.3, out).tolist())

    fields: dict[str, object] = {
        "format": 1, "network": weights_digest(weights), "data_digest": "none", "seed": seed,
        "commit": "", "samples": 1, "scores": {},
        "layers": (dense(width_of(read_network(weights)), HIDDEN), dense(HIDDEN, OUTPUTS)),
    }  # fmt: skip
    return Heads(**(fields | changes))  # type: ignore[arg-type]


@pytest.fixture(params=["gru", "tcn"])
def weights(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A network that streams, with heads beside it."""
    path = write_network(tmp_path, request.param, "stream")
    heads_path(path).write_bytes(msgspec.json.encode(heads_of(path)))
    return path


def loaded(weights: Path) -> StreamingNetwork:
    found = load_network(weights.stem, NetworkSettings(weights=str(weights)), 3)
    assert isinstance(found, StreamingNetwork)
    return found


def probabilities(detector: StreamingNetwork, counts: np.ndarray, ask: bool) -> np.ndarray:
    said = []
    for frame in counts:
        said.append(detector.update(frame))
        if ask:
            detector.motion()
    return np.array(said)


def test_probability_of_slip_is_the_same_with_heads_bit_for_bit(weights: Path) -> None:
    counts = walk(300)
    with_heads = loaded(weights)
    assert with_heads.motion() is None  # nothing has been felt yet
    said = probabilities(with_heads, counts, ask=True)
    assert with_heads.motion() is not None
    heads_path(weights).unlink()
    without = loaded(weights)
    assert (said == probabilities(without, counts, ask=False)).all()
    assert without.motion() is None


def test_motion_is_that_of_the_latest_frame_and_of_the_state_it_led_to(weights: Path) -> None:
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
    teller = Teller(heads_of(weights))
    assert detector.motion() == teller.tell(states, counts[-1])
    out = teller.outputs(inputs_of(states, counts[-1]))
    motion = detector.motion()
    assert motion is not None
    assert motion.speed_mps == pytest.approx(np.exp(out[:, 0]))
    assert motion.direction_deg == (45 * out[:, 2:].argmax(axis=1)).tolist()
    assert motion.turning == pytest.approx(1.0 / (1.0 + np.exp(-out[:, 1])))


@pytest.mark.parametrize("name", ["freq-cnn-paper", "tcn-paper", "energy"])
def test_detector_without_heads_goes_on_and_tells_nothing(name: str) -> None:
    detector = load_detector(name, {}, 3)
    tell = motion_told_by(detector)
    for frame in walk(5):
        detector.update(frame)
    assert tell() is None


def test_heads_of_a_gated_tcn_read_what_its_head_hears_of_now_and_of_late() -> None:
    held = np.random.default_rng(0).normal(size=(3, HELD, 17)).astype(np.float32)
    states = {
        "state0": np.zeros((3, 1360), np.float32), "state1": np.zeros((3, 222), np.float32),
        "state2": held.reshape(3, -1),
    }  # fmt: skip
    found = inputs_of(states, np.zeros((3, 6), np.int16))
    assert found.shape == (3, 41)
    assert (found[:, :17] == held[:, -1]).all()
    assert (found[:, 17:34] == held.max(axis=1)).all()
    assert ARCHITECTURES["tcn"].held == HELD + 1  # which the next sample is one of


def test_packaged_tcn_says_slip_by_a_line_through_what_its_heads_read() -> None:
    """So they read the features themselves: the line of the packaged weights is found anew."""
    network = read_network(weights_path("tcn"))
    counts = walk(2000, 1).astype(np.float32)
    states = {k: np.zeros((1, *shape), np.float32) for k, shape in network.states.items()}
    seen, said = [], []
    for t, frame in enumerate(counts):
        fed = {"counts": frame, "previous": counts[max(t - 1, 0)], **states}
        oldest = states["state2"][:, :17]
        p, *found = network.session.run(["probability", *(f"next_{k}" for k in states)], fed)
        states = dict(zip(states, found, strict=True))
        now, late = made_of(states)
        seen.append(np.concatenate([now[0], np.maximum(late, oldest)[0], [1.0]]))
        said.append(np.log(p[0] / (1.0 - p[0])))
    x, y = np.array(seen, np.float64), np.array(said, np.float64)
    line = np.linalg.lstsq(x, y, rcond=None)[0]
    assert x @ line == pytest.approx(y, abs=1e-3)


def test_network_that_holds_other_samples_has_no_heads() -> None:
    network = read_network(weights_path("tcn"))
    other = msgspec.structs.replace(network, states=network.states | {"state2": (17 * 13,)})
    with pytest.raises(UsageError, match="other samples"):
        width_of(other)


def test_heads_are_told_by_the_detector_that_has_them(weights: Path) -> None:
    detector = load_detector(weights.stem.partition("-")[0], {"weights": str(weights)}, 3)
    tell = motion_told_by(detector)
    detector.update(walk(1)[0])
    assert tell() is not None
    detector.reset()
    assert tell() is None


def test_heads_of_another_network_are_refused(weights: Path) -> None:
    other = heads_of(weights, network="0" * 64)
    heads_path(weights).write_bytes(msgspec.json.encode(other))
    with pytest.raises(BadFile, match="another network"):
        loaded(weights)


def test_a_file_that_holds_no_heads_is_refused(weights: Path) -> None:
    whole = heads_path(weights).read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"{}", whole.replace(b"layers", b"lawyers")):
        heads_path(weights).write_bytes(damaged)
        with pytest.raises(BadFile, match="no heads"):
            loaded(weights)


def test_damaged_or_missing_heads_of_a_packaged_network_are_to_be_installed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = weights_path("gru").read_bytes()
    monkeypatch.setattr("detector.network_file.WEIGHTS", tmp_path)
    path = weights_path("gru")
    path.write_bytes(whole)
    with pytest.raises(BadFile, match="is missing") as refused:
        load_network("gru", NetworkSettings(), 3)
    assert refused.value.remedy == "install `grasp` again"
    heads_path(path).symlink_to(heads_path(path))
    with pytest.raises(BadFile, match="no heads"):
        load_network("gru", NetworkSettings(), 3)
    heads_path(path).unlink()
    heads_path(path).write_text("{}")
    with pytest.raises(BadFile, match="no heads") as refused:
        load_network("gru", NetworkSettings(), 3)
    assert refused.value.remedy == "install `grasp` again"


def test_layers_of_other_sizes_and_what_is_no_number_are_refused(weights: Path) -> None:
    first, last = heads_of(weights).layers
    wrong = [
        (Dense([row[:-1] for row in first.weight], first.bias), last),
        (first, Dense(last.weight[:-1], last.bias[:-1])),
        (Dense(first.weight[:-1], first.bias), last),
        (first, Dense(last.weight, last.bias[:-1])),
    ]
    for layers in wrong:
        made = heads_of(weights, layers=layers)
        heads_path(weights).write_bytes(msgspec.json.encode(made))
        with pytest.raises(BadFile, match="do not lead"):
            loaded(weights)


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_network_says_the_same_as_a_copy_of_its_weights_without_heads(
    name: str, tmp_path: Path
) -> None:
    alone = tmp_path / f"{name}.onnx"
    shutil.copy(weights_path(name), alone)
    packaged = loaded(weights_path(name))
    counts = walk(300)
    said = probabilities(packaged, counts, ask=True)
    assert packaged.motion() is not None
    assert (said == probabilities(loaded(alone), counts, ask=False)).all()


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_heads_say_on_what_they_were_scored(name: str) -> None:
    content = heads_path(weights_path(name)).read_bytes()
    heads = msgspec.json.decode(content, type=Heads)
    assert heads.network == weights_digest(weights_path(name))
    assert heads.commit and heads.data_digest and heads.samples > 10_000
    assert all(low <= value <= high for value, low, high in heads.scores.values())
    assert any("direction" in name for name in heads.scores)
