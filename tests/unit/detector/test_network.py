"""Networks at run time: reset, independent fingers, and refused files."""

import random
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from detector import network_file
from detector.loading import load_detector
from detector.network import run_network
from detector.network_file import read_network
from detector.scores.evaluation import stream
from drivers.errors import BadFile, UsageError
from grasp.cli.main import main
from tests.unit.detector.network_files import walk, write_network


def test_reset_clears_all_state(tmp_path: Path) -> None:
    for name in ["tcn", "gru"]:
        detector = run_network(read_network(write_network(tmp_path, name)), 3)
        first = stream(detector, walk(151))[0]
        assert not np.allclose(stream(detector, walk(60, seed=2))[0], first[:60]), name
        assert np.array_equal(stream(detector, walk(151))[0], first), name


def test_output_of_a_finger_does_not_depend_on_the_others(tmp_path: Path) -> None:
    for name in ["tcn", "gru", "tcn-paper"]:
        loaded = read_network(write_network(tmp_path, name))
        counts = walk(150)
        together = stream(run_network(loaded, 3), counts)[0]
        for finger in range(3):
            alone = stream(run_network(loaded, 1), counts[:, finger : finger + 1])[0]
            assert np.abs(alone[:, 0] - together[:, finger]).max() < 1e-6, name


def test_weights_of_another_network_are_refused_for_a_packaged_name(
    tmp_path: Path,
) -> None:
    for name, of in [("tcn", "tcn-paper"), ("gru", "tcn")]:
        path = write_network(tmp_path, of)
        for weights in (str(path), of):
            with pytest.raises(
                UsageError, match=f"holds a network '{of}', not '{name}'"
            ) as refused:
                load_detector(name, {"weights": weights}, 3)
            assert f"`--detector {of}`" in refused.value.remedy, (name, of)
        load_detector(of, {"weights": str(path)}, 3)
        load_detector(str(path), {}, 3)


def test_network_file_without_its_card_still_runs(tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn")
    whole = stream(run_network(read_network(path), 3), walk(50))[0]
    model = onnx.load(path)
    del model.metadata_props[:]
    onnx.save(model, path)
    assert np.array_equal(stream(run_network(read_network(path), 3), walk(50))[0], whole)


def test_network_file_whose_metadata_has_a_key_without_value(tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn")
    model = onnx.load(path)
    del model.metadata_props[:]
    model.metadata_props.add(key="author")
    path.write_bytes(model.SerializeToString())
    assert read_network(path).inputs["counts"] == (6,)


def damaged(path: Path, how: str) -> Path:
    content = path.read_bytes()
    if how == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "pickle":
        path.write_bytes(b"\x80\x04cos\nsystem\n(S'true'\ntR.")
    elif how == "huge":
        path.write_bytes(b"\0" * 5_000_000)
    else:
        model = onnx.load(path)
        change(model, how)
        path.write_bytes(model.SerializeToString())
    return path


def change(model: onnx.ModelProto, how: str) -> None:
    if how == "bad card":
        model.metadata_props[0].value = '{"format": 1}'
    elif how == "format":
        text = model.metadata_props[0].value
        model.metadata_props[0].value = text.replace('"format":2', '"format":99')
    elif how == "mode":
        text = model.metadata_props[0].value
        model.metadata_props[0].value = text.replace('"mode":"stream"', '"mode":"window"')
    elif how == "lost state":
        outputs = [o for o in model.graph.output if o.name != "next_state0"]
        del model.graph.output[:]
        model.graph.output.extend(outputs)
    elif how == "taxels":
        model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 5


def test_damaged_or_foreign_file_is_refused_with_its_path(tmp_path: Path) -> None:
    for how in [
        "cut",
        "empty",
        "pickle",
        "huge",
        "bad card",
        "format",
        "mode",
        "lost state",
        "taxels",
    ]:
        path = damaged(write_network(tmp_path, "tcn"), how)
        with pytest.raises(BadFile) as caught:
            read_network(path)
        assert str(path) in caught.value.message, how
        assert "grasp detector train" in caught.value.remedy, how


@pytest.mark.parametrize(
    ("how", "named", "remedy"),
    [
        ("ir", r"has IR version 99; ONNX Runtime here reads up to \d+", "IR version"),
        ("opset", r"has opset version 99; ONNX Runtime here reads up to \d+", "opset version"),
        ("operator", "cannot run it: .*No Op registered for Unknown", "docs/extending.md"),
        ("output", "no output 'probability'; its outputs are .'slip', 'next_state0'", "extending"),
        ("loop", "has a Loop, which may never end", "docs/extending.md"),
        ("input", "input 'counts' has 1099511627776 numbers", "docs/extending.md"),
        ("memory", "cannot run it: .*alloc", "docs/extending.md"),
    ],
)
def test_a_foreign_graph_is_refused_with_its_cause(
    tmp_path: Path, how: str, named: str, remedy: str
) -> None:
    path = write_network(tmp_path, "tcn")
    model = onnx.load(path)
    del model.metadata_props[:]
    nodes = model.graph.node
    if how == "ir":
        model.ir_version = 99
    elif how == "opset":
        model.opset_import[0].version = 99
    elif how == "operator":
        nodes[0].op_type = "Unknown"
    elif how == "output":
        model.graph.output[0].name = "slip"
        nodes.append(helper.make_node("Identity", ["probability"], ["slip"]))
    elif how == "input":
        model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 2**40
    elif how == "loop":
        nodes.append(helper.make_node("Loop", ["", ""], []))
    else:
        nodes.append(helper.make_node("ConstantOfShape", ["shape"], ["zeros"]))
        nodes.append(helper.make_node("ReduceMax", ["zeros"], ["largest"], keepdims=0))
        model.graph.initializer.append(numpy_helper.from_array(np.full(3, 3000), "shape"))
        model.graph.output.append(helper.make_empty_tensor_value_info("largest"))
    path.write_bytes(model.SerializeToString())
    with pytest.raises(BadFile, match=named) as caught:
        read_network(path)
    assert remedy in caught.value.remedy


def test_the_first_run_of_a_foreign_graph_has_a_time_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_network(tmp_path, "tcn")
    model = onnx.load(path)
    del model.metadata_props[:]
    model.graph.node.append(helper.make_node("Cos", ["counts"], ["unused"]))
    path.write_bytes(model.SerializeToString())
    assert read_network(path).inputs["counts"] == (6,)
    network_file.problem_in_a_child.cache_clear()
    monkeypatch.setattr(network_file, "MOST_RUN_S", 1e-3)
    with pytest.raises(BadFile, match=r"a run takes more than 0\.001 s"):
        read_network(path)


def test_one_changed_byte_is_detected(tmp_path: Path) -> None:
    for harm in ["anywhere", "the checksum", "its name"]:
        path = write_network(tmp_path, "tcn")
        whole, rng = path.read_bytes(), random.Random(7)
        places = [rng.randrange(len(whole)) for _ in range(12)]
        if harm != "anywhere":
            at = whole.index(b'"sha256":"')
            places = [at + (10 + k if harm == "the checksum" else 1 + k % 6) for k in range(12)]
        assert run_network(read_network(path), 3).card.sha256, harm
        for at in places:
            path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
            with pytest.raises(BadFile):
                read_network(path)


def test_missing_packaged_network_has_the_remedy_to_reinstall(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in [["detector", "card"], ["run", "lift", "--detector"]]:
        monkeypatch.setattr("detector.network_file.WEIGHTS", tmp_path)
        assert main([*words, "gru"]) == 2, words
        message = capsys.readouterr().err
        assert f"{tmp_path / 'gru.onnx'}: cannot be read" in message, words
        assert "install `grasp` again" in message and "detector train" not in message, words


def outside(model: onnx.ModelProto, where: str, location: str) -> None:
    """Move one tensor to an external file."""
    tensor = model.graph.initializer[0]
    if where == "attribute":
        node = model.graph.node.add(op_type="Constant", output=["unused"])
        node.attribute.append(helper.make_attribute("value", tensor))
        tensor = node.attribute[0].t
    elif where == "subgraph":
        graph = helper.make_graph([], "g", [], [], [tensor])
        node = model.graph.node.add(op_type="If", input=["counts"], output=["unused"])
        node.attribute.append(helper.make_attribute("then_branch", graph))
        tensor = node.attribute[0].g.initializer[0]
    elif where == "sparse":
        tensor = model.graph.sparse_initializer.add().values
    tensor.ClearField("raw_data")
    tensor.ClearField("float_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", location), ("offset", "0")):
        tensor.external_data.add(key=key, value=value)


def test_graph_with_external_data_is_refused_before_it_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_network(tmp_path, "tcn")
    whole = path.read_bytes()
    for where in ["initializer", "attribute", "subgraph", "sparse"]:
        for location in ["w.bin", "./w.bin", "a/w.bin", "/tmp/w.bin", "../w.bin"]:
            model = onnx.load_from_string(whole)
            outside(model, where, location)
            path.write_bytes(model.SerializeToString())
            (tmp_path / "a").mkdir(exist_ok=True)
            for name in ("w.bin", "a/w.bin"):
                (tmp_path / name).write_bytes(bytes(100_000))
            monkeypatch.chdir(tmp_path)
            monkeypatch.setattr("onnxruntime.InferenceSession", None)  # must not be called
            with pytest.raises(BadFile, match="other files"):
                read_network(path)


def test_file_is_not_read_beyond_the_maximum_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "huge.onnx"
    with path.open("wb") as file:
        file.truncate(10**12)  # a sparse file
    with pytest.raises(BadFile, match="more than 4000000 bytes"):
        read_network(path)
    link = tmp_path / "zero.onnx"
    link.symlink_to("/dev/zero")
    with pytest.raises(BadFile, match="more than 4000000 bytes"):
        read_network(link)
