"""Detector plugins: arguments, read-only inputs, and one message for every error."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from detector import plugins
from detector.interface import SlipDetector
from detector.loading import load_detector
from detector.plugins import PluginSettings, code_digest
from drivers.errors import BadFile

RAISING = """
class Evil(Exception):
    def __str__(self):
        raise self

class Mine:
    def reset(self): pass

    def update(self, counts): return [0.0] * 3

    @property
    def {0}(self): raise Evil
"""
WHOLE = """
import numpy as np

class Mine:
    threshold = 0.4
    memory = 3
    def __init__(self, fingers, gain=1.0):
        self.fingers, self.gain = fingers, gain
    def reset(self):
        self.n = 0
    def update(self, counts):
        self.n += 1
        self.buffer = np.full(self.fingers, min(1.0, self.gain * self.n / 100))
        return self.buffer

def factory(taxels, fingers):
    made = Mine(fingers)
    made.taxels = taxels
    return made
def anything(**given):
    return Mine(given["fingers"], given.get("gain", 1.0))
"""


def write(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def load(word: str, fingers: int = 3, **arguments: float) -> SlipDetector:
    return load_detector(word, PluginSettings(tuple(arguments.items())), fingers)


def test_a_class_and_a_factory_are_detectors(tmp_path: Path) -> None:
    for name in ["Mine", "factory", "anything"]:
        detector = load(f"{write(tmp_path, WHOLE)}:{name}")
        assert (detector.name, detector.threshold, detector.memory) == (name, 0.4, 3), name
        frame = np.zeros((3, 6), np.int16)
        assert detector.update(frame).tolist() == [0.01] * 3, name  # the test frames are forgotten
        assert detector.update(frame).tolist() == [0.02] * 3, name
        detector.reset()
        assert detector.update(frame).tolist() == [0.01] * 3, name


def test_plugin_gets_the_fingers_and_its_settings(tmp_path: Path) -> None:
    detector = load(f"{write(tmp_path, WHOLE)}:Mine", fingers=1, gain=10.0)
    assert detector.update(np.zeros((1, 6), np.int16)).tolist() == [0.1]


def test_plugin_cannot_change_the_counts(tmp_path: Path) -> None:
    text = WHOLE.replace("self.n += 1", "self.n += 1; counts[:] = 0")
    with pytest.raises(BadFile, match="read-only"):
        load(f"{write(tmp_path, text)}:Mine")


def test_every_error_is_one_line_with_the_file(tmp_path: Path) -> None:
    for text, name, problem in [
        (WHOLE, "Other", "has no class or function 'Other'"),
        ("x = = 1", "Mine", "mine.py, line 1: importing it raised SyntaxError"),
        ("import nothing_of_this_name", "Mine", "line 1: importing it raised ModuleNotFoundError"),
        ("import sys\nsys.exit(3)", "Mine", "line 2: importing it raised SystemExit"),
        ("class Mine:\n  def update(self, c): return c", "Mine", "has no reset"),
        ("Mine = 3", "Mine", "has no class"),
        (WHOLE.replace("gain=1.0", "gain"), "Mine", "raised TypeError"),
        (WHOLE.replace("self.n += 1", "1 / 0"), "Mine", "line 12: update raised ZeroDivisionError"),
        (WHOLE.replace("self.n = 0", "1 / 0"), "Mine", "line 10: reset raised ZeroDivisionError"),
        (WHOLE.replace("self.fingers, min", "2, min"), "Mine", r"shape \(2,\), not \(3,\)"),
        (WHOLE.replace("return self.buffer", "return None"), "Mine", "not a number per finger"),
        (WHOLE.replace("return self.buffer", "return self.buffer + 0j"), "Mine", "complex128"),
        (WHOLE.replace("return self.buffer", "return ['0.5'] * 3"), "Mine", "not a number"),
        (WHOLE.replace("self.n += 1", "raise SystemExit(0)"), "Mine", "update raised SystemExit"),
        (WHOLE.replace("return self.buffer", "return self.buffer * np.nan"), "Mine", "probabilit"),
        (WHOLE.replace("return self.buffer", "return self.buffer + 2"), "Mine", "probabilities"),
        (WHOLE.replace("threshold = 0.4", "threshold = 4"), "Mine", "threshold is 4"),
        (WHOLE.replace("memory = 3", "memory = None"), "Mine", "memory is None"),
        (RAISING.format("update"), "Mine", "update raised Evil: its text raises too"),
        (RAISING.format("reset"), "Mine", "reset raised Evil"),
        (
            WHOLE + RAISING.format("threshold").replace("class Mine:", "class Bad(Mine):"),
            "Bad",
            "threshold raised Evil",
        ),
        (WHOLE.replace("self.n += 1", "counts.setflags(write=True)"), "Mine", "WRITEABLE"),
        (WHOLE.replace("threshold = 0.4", "threshold = 10**400"), "Mine", "threshold raised Overf"),
        (
            "class Odd(float):\n  def __le__(self, other): 1 / 0\n"
            + WHOLE.replace("threshold = 0.4", "threshold = Odd(4)"),
            "Mine",
            "threshold is 4.0",
        ),
        ("def __getattr__(name): raise KeyError(name)", "Mine", "Mine raised KeyError"),
    ]:
        path = write(tmp_path, text)
        with pytest.raises(BadFile, match=problem) as raised:
            load(f"{path}:{name}")
        assert str(path) in raised.value.message, (text, name, problem)
        assert raised.value.message.isprintable(), (text, name, problem)
        assert raised.value.remedy, (text, name, problem)


def test_missing_file_and_unknown_setting_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=r"none\.py: cannot be read"):
        load(f"{tmp_path / 'none.py'}:Mine")
    with pytest.raises(BadFile, match=r"has no setting plugin\.window"):
        load(f"{write(tmp_path, WHOLE)}:Mine", window=3)
    with pytest.raises(BadFile, match=r"has no setting plugin\.window"):
        load(f"{write(tmp_path, WHOLE)}:Mine", window=3)


def test_changed_file_is_another_detector(tmp_path: Path) -> None:
    word = f"{write(tmp_path, WHOLE)}:Mine"
    before = code_digest(word)
    frame = np.zeros((3, 6), np.int16)
    assert load(word).update(frame).tolist() == [0.01] * 3
    write(tmp_path, WHOLE.replace("/ 100", "/ 10"))
    assert load(word).update(frame).tolist() == [0.1] * 3
    assert code_digest(word) != before


def test_entry_point_of_an_installed_package_is_found_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, WHOLE, "acme_slip.py")
    dist_info = tmp_path / "acme-1.0.dist-info"
    dist_info.mkdir()
    write(dist_info, "Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n", "METADATA")
    write(dist_info, "[grasp.detectors]\nacme = acme_slip:Mine\nbroken = acme_slip:None_of_it\n"
          "gone = acme_none.part:Mine\n"
          "energy = acme_slip:Mine\n", "entry_points.txt")  # fmt: skip
    monkeypatch.syspath_prepend(str(tmp_path))
    plugins.installed_plugins.cache_clear()
    try:
        assert load("acme").threshold == 0.4
        assert len(code_digest("acme")) == 64
        with pytest.raises(BadFile, match="broken: cannot be imported: AttributeError"):
            load("broken")
        with pytest.raises(BadFile, match="gone: cannot be imported: ModuleNotFoundError"):
            load("gone")
        assert code_digest("gone") == "gone"
        packaged = load_detector("energy", {}, 3)  # a plugin does not replace a packaged detector
        assert packaged.threshold == 0.5
    finally:
        plugins.installed_plugins.cache_clear()


# Weights without our card


def weights(path: Path, shape: list[int | str], last: str = "Sigmoid") -> Path:
    """A graph of the mean of counts of that shape, and an output operator."""
    counts = helper.make_tensor_value_info("counts", TensorProto.FLOAT, shape)
    p = helper.make_tensor_value_info("probability", TensorProto.FLOAT, [shape[0]])
    axes = list(range(1, len(shape)))
    nodes = [
        helper.make_node("ReduceMean", ["counts"], ["mean"], axes=axes, keepdims=0),
        helper.make_node(last, ["mean"], ["probability"]),
    ]
    model = helper.make_model(
        helper.make_graph(nodes, "g", [counts], [p]),
        opset_imports=[helper.make_opsetid("", 17)],
    )
    model.ir_version = 8
    onnx.save(model, path)
    return path


def test_mode_of_weights_without_a_card_follows_from_the_tensors(tmp_path: Path) -> None:
    for shape, memory in [(["n", 6], 0), (["batch", 20, 6], 20), (["fingers", 6], 0)]:
        path = weights(tmp_path / "lab.onnx", shape)
        detector = load_detector(str(path), {}, 3)
        assert (detector.name, detector.threshold, detector.memory) == (
            "lab.onnx",
            0.5,
            memory and 20,
        ), (shape, memory)
        assert detector.update(np.zeros((3, 6), np.int16)).tolist() == [0.5] * 3, (shape, memory)
        assert (detector.update(np.full((3, 6), -100, np.int16)) < 0.5).all(), (shape, memory)
        assert load_detector(str(path), {}, 1).update(np.zeros((1, 6), np.int16)).shape == (1,), (
            shape,
            memory,
        )


def test_unusable_weights_are_refused(tmp_path: Path) -> None:
    for shape, last, problem in [
        ([3, 6], "Sigmoid", "input 'counts' is"),
        (["n", "m"], "Sigmoid", "input 'counts' is"),
        (["n", 6], "Exp", "not a probability"),
    ]:
        path = weights(tmp_path / "lab.onnx", shape, "Identity" if last == "Exp" else last)
        if last == "Exp":  # cos 0 is a probability, its double is not
            model = onnx.load(path)
            model.graph.node[-1].op_type = "Cos"
            model.graph.node.append(
                helper.make_node("Add", ["probability", "probability"], ["sum"])
            )
            model.graph.output[0].name = "sum"
            model.graph.node[-1].output[0] = "probability"
            model.graph.node[-2].output[0] = "one"
            model.graph.node[-1].input[:] = ["one", "one"]
            model.graph.output[0].name = "probability"
            onnx.save(model, path)
        with pytest.raises(BadFile, match=problem):
            load_detector(str(path), {}, 3)


def test_weights_for_another_layout_are_refused(tmp_path: Path) -> None:
    from drivers.errors import UsageError

    path = weights(tmp_path / "lab.onnx", ["n", 8])
    with pytest.raises(UsageError, match="8 taxels, not of 6"):
        load_detector(str(path), {}, 3)
    assert load_detector(str(path), {}, 3, 8).update(np.zeros((3, 8), np.int16)).shape == (3,)
