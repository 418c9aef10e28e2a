"""Networks at run time: a stream is the window, a reset forgets, a bad file is refused."""

import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from detector.interface import load_detector
from detector.network import StreamingNetwork, WindowedNetwork, run_network
from detector.network_file import (
    CARD_KEY,
    Mode,
    packaged_networks,
    read_network,
    weights_path,
)
from detector.scores.evaluation import stream
from drivers.errors import BadFile, UsageError
from grasp.cli.main import main
from tests.unit.detector.networks import walk, write_network


@pytest.mark.parametrize("lost", [None, 150, 151])
def test_stream_and_window_of_the_tcn_agree_once_the_window_is_full(
    tmp_path: Path, lost: int | None
) -> None:
    counts = walk(260)
    if lost:
        counts[lost] = counts[lost - 1]  # a missed sample is repeated
    streamed = run_network(read_network(write_network(tmp_path, "tcn", "stream")), 3)
    windowed = run_network(read_network(write_network(tmp_path, "tcn", "window")), 3)
    assert isinstance(streamed, StreamingNetwork)
    assert isinstance(windowed, WindowedNetwork)
    difference = stream(streamed, counts)[0] - stream(windowed, counts)[0]
    assert np.abs(difference[100:]).max() < 1e-5
    assert np.ptp(stream(streamed, counts)[0]) > 0.1


@pytest.mark.parametrize("name", ["tcn", "gru"])
def test_a_reset_forgets_everything(tmp_path: Path, name: str) -> None:
    detector = run_network(read_network(write_network(tmp_path, name, "stream")), 3)
    first = stream(detector, walk(151))[0]
    assert not np.allclose(stream(detector, walk(60, seed=2))[0], first[:60])
    assert np.array_equal(stream(detector, walk(151))[0], first)


@pytest.mark.parametrize(
    ("name", "mode"), [("tcn", "stream"), ("gru", "stream"), ("tcn", "window")]
)
def test_fingers_do_not_know_one_another(tmp_path: Path, name: str, mode: str) -> None:
    loaded = read_network(write_network(tmp_path, name, mode))  # type: ignore[arg-type]
    counts = walk(150)
    together = stream(run_network(loaded, 3), counts)[0]
    for finger in range(3):
        alone = stream(run_network(loaded, 1), counts[:, finger : finger + 1])[0]
        assert np.abs(alone[:, 0] - together[:, finger]).max() < 1e-6


def test_to_load_a_network_leaves_nothing_in_home_cache_or_temporary_folder(
    tmp_path: Path,
) -> None:
    path = write_network(tmp_path, "tcn", "stream")
    places = {name: tmp_path / name for name in ("HOME", "XDG_CACHE_HOME", "TMPDIR")}
    for place in places.values():
        place.mkdir()
    silent = {"CI", "ORT_DISABLE_TELEMETRY", "ORT_RUNNING_UNIT_TESTS"}  # without us as well
    kept = {name: value for name, value in os.environ.items() if name not in silent}
    code = (
        "import sys; from pathlib import Path; from detector.network_file import read_network; "
        "read_network(Path(sys.argv[1]))"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(path)], check=True,
        env=kept | {name: str(place) for name, place in places.items()},
    )  # fmt: skip
    assert [file for place in places.values() for file in place.rglob("*")] == []


def test_a_result_outlives_the_next_update(tmp_path: Path) -> None:
    detector = run_network(read_network(write_network(tmp_path, "tcn", "stream")), 3)
    counts = walk(40)
    kept = [detector.update(frame) for frame in counts]
    assert np.array_equal(np.array(kept), stream(detector, counts)[0])


@pytest.mark.parametrize("mode", ["stream", "window"])
def test_a_frame_of_another_shape_is_refused(tmp_path: Path, mode: str) -> None:
    detector = run_network(read_network(write_network(tmp_path, "tcn", mode)), 3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"\(1, 6\), not \(3, 6\)"):
        detector.update(np.zeros((1, 6), np.int16))


def test_temperature_and_shift_are_part_of_the_graph(tmp_path: Path) -> None:
    counts = walk(120)
    odds = []
    for changes in ({"temperature": 1.0, "shift": 0.0}, {"temperature": 2.0, "shift": 0.5}):
        path = write_network(tmp_path, "gru", "stream", **changes)
        p = stream(run_network(read_network(path), 3), counts)[0]
        odds.append(np.log(p / (1 - p)))
    assert np.allclose(odds[1], (odds[0] + 0.5) / 2.0, atol=1e-4)


def test_own_weights_are_loaded_by_path(tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn", "stream")
    assert load_detector("mine", {"weights": str(path)}, 3).name == "tcn-stream.onnx"


@pytest.mark.parametrize(("name", "of"), [("tcn", "tcn-paper"), ("gru", "tcn")])
def test_weights_of_another_network_do_not_run_under_a_packaged_one_s_name_and_rule(
    name: str, of: str, tmp_path: Path
) -> None:
    path = write_network(tmp_path, of, "window")
    for weights in (str(path), of):
        with pytest.raises(UsageError, match=f"holds a network '{of}', not '{name}'") as refused:
            load_detector(name, {"weights": weights}, 3)
        assert f"`--detector {of}`" in refused.value.remedy
    load_detector(of, {"weights": str(path)}, 3)
    load_detector(str(path), {}, 3)


def test_a_file_of_ours_that_lost_its_card_is_told_by_its_tensors(tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn", "stream")
    whole = stream(run_network(read_network(path), 3), walk(50))[0]
    model = onnx.load(path)
    del model.metadata_props[:]
    onnx.save(model, path)
    assert np.array_equal(stream(run_network(read_network(path), 3), walk(50))[0], whole)


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


@pytest.mark.parametrize(
    "how",
    ["cut", "empty", "pickle", "huge", "bad card", "format", "mode", "lost state",
     "taxels"],
)  # fmt: skip
def test_a_damaged_or_foreign_file_is_refused_with_its_name(tmp_path: Path, how: str) -> None:
    path = damaged(write_network(tmp_path, "tcn", "stream"), how)
    with pytest.raises(BadFile) as caught:
        read_network(path)
    assert str(path) in caught.value.message
    assert "grasp detector train" in caught.value.remedy


@pytest.mark.parametrize("harm", ["anywhere", "the checksum", "its name"])
def test_one_flipped_byte_is_noticed(harm: str, tmp_path: Path) -> None:
    path = write_network(tmp_path, "tcn", "stream")
    whole, rng = path.read_bytes(), random.Random(7)
    places = [rng.randrange(len(whole)) for _ in range(30)]
    if harm != "anywhere":
        at = whole.index(b'"sha256":"')
        places = [at + (10 + k if harm == "the checksum" else 1 + k % 6) for k in range(12)]
    assert run_network(read_network(path), 3).card.sha256
    for at in places:
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with pytest.raises(BadFile):
            read_network(path)


@pytest.mark.parametrize("name", packaged_networks())
def test_one_flipped_byte_of_a_packaged_network_is_noticed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = bytearray(weights_path(name).read_bytes())
    monkeypatch.setattr("detector.network_file.WEIGHTS", tmp_path)
    path = weights_path(name)
    path.write_bytes(whole)
    read_network(path)
    torn = whole[:20_000]
    whole[len(whole) // 2] ^= 1
    for damaged in (whole, torn):
        path.write_bytes(damaged)
        with pytest.raises(BadFile, match="not as it was packaged"):
            read_network(path)


@pytest.mark.parametrize("words", [["detector", "card"], ["run", "lift", "--detector"]])
def test_a_packaged_network_that_has_gone_is_to_be_installed_again(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr("detector.network_file.WEIGHTS", tmp_path)
    assert main([*words, "gru"]) == 2
    told = capsys.readouterr().err
    assert f"{tmp_path / 'gru.onnx'}: cannot be read" in told
    assert "install `grasp` again" in told and "detector train" not in told


def outside(model: onnx.ModelProto, where: str, location: str) -> None:
    """Take one tensor out of the file."""
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


@pytest.mark.parametrize("where", ["initializer", "attribute", "subgraph", "sparse"])
@pytest.mark.parametrize("location", ["w.bin", "./w.bin", "a/w.bin", "/tmp/w.bin", "../w.bin"])
def test_a_graph_that_points_to_other_files_is_refused_before_it_is_run(
    where: str, location: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_network(tmp_path, "tcn", "stream")
    model = onnx.load(path)
    outside(model, where, location)
    path.write_bytes(model.SerializeToString())
    (tmp_path / "a").mkdir()
    for name in ("w.bin", "a/w.bin"):
        (tmp_path / name).write_bytes(bytes(100_000))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("onnxruntime.InferenceSession", None)  # nobody may ask for it
    with pytest.raises(BadFile, match="other files"):
        read_network(path)


def test_nothing_is_loaded_from_the_current_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network(tmp_path, "tcn", "stream").rename(tmp_path / "mine.onnx")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="unknown detector"):
        load_detector("mine", {}, 3)
    with pytest.raises(BadFile, match="mine"):
        load_detector("tcn", {"weights": "mine"}, 3)  # a packaged name, as it does not end in .onnx


def test_a_file_is_not_read_beyond_the_largest_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "huge.onnx"
    with path.open("wb") as file:
        file.truncate(10**12)  # a hole: nothing of it is on the disk
    with pytest.raises(BadFile, match="more than 4000000 bytes"):
        read_network(path)
    link = tmp_path / "zero.onnx"
    link.symlink_to("/dev/zero")
    with pytest.raises(BadFile, match="more than 4000000 bytes"):
        read_network(link)


def harmed(content: bytes, rng: random.Random) -> bytes:
    """Some bits, a run of bytes, a part left out, put in, or exchanged, or a broken card."""
    data = bytearray(content)
    at, size = rng.randrange(len(data)), rng.choice((1, 8, 200))
    kind = rng.choice(("bits", "bytes", "left out", "put in", "cut", "card", "card", "ends"))
    if kind == "bits":
        for _ in range(rng.choice((1, 4, 40))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == "bytes":
        data[at : at + size] = rng.randbytes(size)
    elif kind == "left out":
        del data[at : at + size]
    elif kind == "put in":
        data[at:at] = rng.randbytes(size)
    elif kind == "cut":
        del data[at:]
    elif kind == "card":
        card = data.rfind(b'{"format"')
        at = rng.randrange(card, len(data))
        data[at] = rng.choice((0xFF, 0xC3, 0x00, 0x0A, 0x1B, rng.randrange(256)))
    else:  # names and shapes of what goes in and out stand beside the card
        for _ in range(3):
            data[rng.randrange(len(data) - 3_000, len(data))] = rng.randrange(256)
    return bytes(data)


@pytest.mark.parametrize(
    ("name", "mode", "seed", "count"),
    [
        ("tcn", "stream", 1, 25),
        ("gru", "stream", 2, 25),
        ("tcn", "window", 3, 10),
        *(
            pytest.param(name, mode, seed, 100, marks=pytest.mark.slow)
            for name, mode, seed in (
                ("tcn", "stream", 4), ("gru", "stream", 5), ("tcn", "window", 6),
            )
        ),
    ],
)  # fmt: skip
def test_every_damaged_file_is_one_line_or_a_network_that_runs(
    name: str, mode: Mode, seed: int, count: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_network(tmp_path, name, mode)
    content, rng = path.read_bytes(), random.Random(seed)
    refused = 0
    for _ in range(count):
        path.write_bytes(harmed(content, rng))
        try:
            detector = run_network(read_network(path), 3)
        except BadFile as error:
            refused += 1
            assert error.message.startswith(str(path)) and error.message.isprintable()
            continue
        p = detector.update(walk(2)[0])
        assert p.shape == (3,)
    assert refused > count // 4
    assert capfd.readouterr() == ("", "")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="No such file"):
        read_network(tmp_path / "none.onnx")


def test_someone_else_s_network_is_refused(tmp_path: Path) -> None:
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 3]) for n in ("x", "y")]
    graph = helper.make_graph([helper.make_node("Relu", ["x"], ["y"])], "g", ends[:1], ends[1:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    path = tmp_path / "other.onnx"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(BadFile, match="no input `counts`"):
        read_network(path)
    assert CARD_KEY == "grasp"
