"""Weights and heads that are named pipes are refused: to open one may take for ever."""

import os
import shutil
from pathlib import Path

import pytest

from detector.heads import heads_path
from detector.network import NetworkSettings, load_network
from detector.network_file import weights_digest, weights_path
from drivers.errors import BadFile


def test_weights_that_are_a_named_pipe_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "lab.onnx"
    os.mkfifo(path)
    with pytest.raises(BadFile, match="a named pipe"):
        load_network(str(path), NetworkSettings(), 3)
    assert weights_digest(path) == str(path)


def test_heads_that_are_a_named_pipe_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "lab.onnx"
    shutil.copy(weights_path("gru"), path)
    os.mkfifo(heads_path(path))
    with pytest.raises(BadFile, match="a named pipe"):
        load_network(str(path), NetworkSettings(), 3)
