"""Compiled networks: outputs equal to those of ONNX Runtime, and ONNX Runtime in their place."""

import sys
from pathlib import Path

import numpy as np
import onnx
import pytest

from detector.compiled import CompiledNetwork
from detector.interface import SlipDetector
from detector.network import RuntimeNetwork, StreamingNetwork, engine_of, run_network
from detector.network_file import log_runtime, packaged_networks, read_network, weights_path
from tests.unit.detector.network_files import walk, write_network

# Both are about as far from exact arithmetic as from each other: rounding to float32.
MOST = {"tcn": 2e-6, "gru": 2e-6, "tcn-paper": 1e-5, "freq-cnn-paper": 1e-5}


def in_onnx_runtime(name: str, monkeypatch: pytest.MonkeyPatch) -> SlipDetector:
    """The network where nothing can be compiled."""
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "numba", None)  # its import raises
        patch.delitem(sys.modules, "detector.compiled")
        return run_network(read_network(weights_path(name)), 3)


def test_a_packaged_network_that_is_not_compiled_is_logged_once_and_a_bug_is_not_hidden(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    log_runtime.cache_clear()
    for _ in range(2):
        in_onnx_runtime("gru", monkeypatch)
    (line,) = caplog.messages
    assert line.startswith("network gru runs in ONNX Runtime, not compiled: ")
    monkeypatch.setattr("detector.compiled.execute", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        engine_of(read_network(weights_path("gru")), 3)


@pytest.mark.parametrize("name", packaged_networks())
def test_packaged_network_equals_onnx_runtime(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = run_network(read_network(weights_path(name)), 3)
    other = in_onnx_runtime(name, monkeypatch)
    assert isinstance(compiled.engine, CompiledNetwork)
    assert isinstance(other.engine, RuntimeNetwork)
    assert (compiled.engine.name, other.engine.name) == ("compiled", "onnxruntime")
    for seed in range(4):
        for each in (compiled, other):
            each.reset()
        frames = walk(600 if isinstance(compiled, StreamingNetwork) else 150, seed=seed)
        frames[70:100] = np.random.default_rng(seed).integers(-500, 200, (30, 3, 6))
        for frame in frames:
            assert np.abs(compiled.update(frame) - other.update(frame)).max() <= MOST[name]


def test_file_with_another_operator_runs_in_onnx_runtime(tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn")
    assert isinstance(engine_of(read_network(path), 3), CompiledNetwork)
    model = onnx.load(path)
    sigmoid = model.graph.node[-1]
    sigmoid.op_type = "HardSigmoid"
    del model.metadata_props[:]
    onnx.save(model, path)
    assert isinstance(engine_of(read_network(path), 3), RuntimeNetwork)


def test_file_whose_attribute_is_unknown_or_changes_the_output(tmp_path: Path) -> None:
    path = write_network(tmp_path, "gru")
    whole = onnx.load(path)
    del whole.metadata_props[:]
    (gru,) = (node for node in whole.graph.node if node.op_type == "GRU")
    gru.attribute.append(onnx.helper.make_attribute("clip", 0.01))
    onnx.save(whole, path)
    assert isinstance(engine_of(read_network(path), 3), RuntimeNetwork)


def test_file_that_computes_with_integers(tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn")
    whole = onnx.load(path)
    del whole.metadata_props[:]
    whole.graph.initializer.append(onnx.numpy_helper.from_array(np.array([2**50]), "many"))
    whole.graph.node.insert(0, onnx.helper.make_node("Add", ["many", "many"], ["more"]))
    onnx.save(whole, path)
    assert isinstance(engine_of(read_network(path), 3), RuntimeNetwork)


def test_large_network_runs_in_onnx_runtime() -> None:
    loaded = read_network(weights_path("tcn-paper"))
    assert isinstance(engine_of(loaded, 3), CompiledNetwork)
    assert isinstance(engine_of(loaded, 30), RuntimeNetwork)
