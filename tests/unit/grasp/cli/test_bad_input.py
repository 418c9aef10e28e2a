"""Whatever makes no sense to a verb: one line, a remedy, exit code 2, no traceback."""

import json
import shutil
from pathlib import Path

import pytest

from detector.network_file import WEIGHTS
from grasp.cli.main import main

DEEP = 5_000
BAD_TOML = {
    "nested arrays": f"a = {'[' * DEEP}{']' * DEEP}",
    "nested arrays that can be read": f"[guard]\nx = {'[' * 40}{']' * 40}",
    "dotted keys": f"{'a.' * DEEP}a = 1",
    "dotted tables": f"[{'a.' * DEEP}a]\nx = 1",
    "inline tables": f"a = {'{a = ' * DEEP}1{'}' * DEEP}",
    "a whole number of thousands of digits": f"[guard]\nforce_limit_n = {'9' * 5_000}",
    "a whole number of hundreds of digits": f"[object]\ngrip_counts = [{'9' * 400}, 1, 1]",
    "a number beyond all": "[guard]\nforce_limit_n = 1e999",
    "a control character": "[guard]\nforce_limit_n = '\x01'",
    "an escaped control character": '[gripper]\ncalibration = "a\\u0000.toml"',
    "a key of control characters": '["a\\u001b[2J"]\nx = 1',
    "a huge file": "# nothing\n" * 200_000,
    "no text": b"\xff\xfe\x00\x00",
    "nothing but zeros": b"\0" * 100,
    "a date": "[guard]\nforce_limit_n = 1979-05-27",
    "a table for a number": "[guard.force_limit_n]\nx = 1",
    "a number for a table": "guard = 1",
    "a profile": 'profile = "zzz"',
    "a rig": 'rig = "emulated"',
    "a detector": 'detector_name = "psd"',
    "twice the same": "[guard]\n[guard]\n",
}
BAD_SETTINGS = [
    f"{'a.' * DEEP}a=1",
    f"guard.force_limit_n={'[' * DEEP}",
    f"guard.force_limit_n={'9' * 5_000}",
    f"controller.preshape_margin_counts={'9' * 400}",
    "guard.force_limit_n=inf",
    "guard.force_limit_n=nan",
    "guard.force_limit_n=\x1b[2J",
    "profile=zzz",
    "detector_name=zzz",
    "rig=emulated",
    "object.grip_counts=[300,0,0]",
    "object.grip_counts=[-1,0,0]",
    "object.name=../../../out",
    "object.name=a/b",
    "object.name=a..b",
    "object.name=.hidden",
    'object.name="a\\nb"',
    'object.name="can\\n"',
    "object.name=",
    f"object.name={'a' * 300}",
    "hand.offset_counts=[0,0,9]",
    "tactile.cells=[[9]]",
    "arm.max_payload_kg=1.0",
    "tactile.rest_min_counts=1023",
    "gripper.calibration=/dev/zero",
    "gripper.calibration=/",
    "a\nb=1",
    "=",
    "",
]
# of every verb, words that it must refuse; FILE is a path that does not exist, DIR an empty folder
BAD_WORDS = [
    "",
    "nonsense",
    "run",
    "run fly",
    "run lift --object",
    "run lift --seed 99999999999999999999999",
    f"run lift --seed {'9' * 5_000}",
    "run lift --detector=",
    "run lift --object=",
    "run lift --profile=",
    "run lift --profile zzz",
    "run lift --rig=",
    "run lift --config=",
    "run lift --config DIR",
    "run lift --config /dev/zero",
    "run tap --taps -1",
    "run acquire --surface=",
    "run acquire --surface moon",
    "run acquire --direction=",
    "run acquire --direction 44",
    "run acquire --speed nan",
    "run acquire --rig emulated --set surface.name=../x",
    "campaign run FILE.toml",
    "campaign run nonsense",
    "campaign run paper --detector=",
    "campaign run paper --detector zzz",
    "campaign run paper --jobs 0",
    "campaign run paper --repetitions 0",
    "campaign summary FILE",
    "campaign summary DIR",
    "campaign summary /dev/null",
    "replay",
    "replay FILE",
    "replay DIR",
    "replay --tactile FILE",
    "replay --tactile FILE --detector=",
    "runs --runs FILE --json=1",
    "export FILE --to svg",
    "dataset build FILE.toml --out DIR",
    "dataset build FILE.toml --out DIR --share 2",
    "dataset describe DIR",
    "dataset describe FILE",
    "detector evaluate energy --recording FILE",
    "detector evaluate zzz --recording FILE",
    "detector evaluate energy --data DIR",
    "detector tune zzz --lifts 1",
    "detector tune energy --budget -1",
    "detector compare --data DIR",
    "detector card zzz",
    "detector card FILE.onnx",
    "detector card /dev/zero.onnx",
    "detector train zzz --data DIR",
    "tactile identify --url nonsense --seconds 1",
    "tactile identify --seconds nan",
    "world calibrate --recording FILE",
    "config show zzz",
    "config show --object zzz",
    "emulate --object zzz",
    "emulate --gripper-port 70000",
    "emulate --host nonsense",
    "release --rig zzz",
]


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line; the same words give one JSON object where the verb knows --json."""
    code = main(words)
    out, err = capsys.readouterr()
    assert code == 2, err[-500:]
    assert out == ""
    assert err.startswith("grasp: ") and err.endswith(")\n"), err  # with a remedy
    assert err.count("\n") == 1
    assert all(c.isprintable() for c in err[:-1])
    assert len(err) < 4_000
    return err


@pytest.mark.parametrize("what", BAD_TOML)
def test_a_file_of_settings_that_cannot_be_used_is_refused_by_name(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.toml"
    content = BAD_TOML[what]
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    for words in (["config", "show", "--config"], ["dataset", "build", "--out", "x"],
                  ["campaign", "run", "--out", str(tmp_path / "x")]):  # fmt: skip
        assert "lab.toml" in refused([*words, str(file)], capsys)
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("text", BAD_SETTINGS, ids=lambda text: ascii(text)[:40])
def test_a_setting_that_cannot_be_is_refused_before_anything_moves(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "lift", "--rig", "simulated", "--runs", str(tmp_path / "in")]
    refused([*words, "--set", text], capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", BAD_WORDS, ids=lambda text: text[:60] or "nothing")
def test_every_verb_refuses_what_it_cannot_do_in_one_line(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    work, empty = tmp_path / "work", tmp_path / "empty"
    work.mkdir()
    empty.mkdir()
    monkeypatch.chdir(work)
    named = text.replace("FILE", str(tmp_path / "none")).replace("DIR", str(empty)).split()
    refused(named, capsys)
    assert list(work.iterdir()) == list(empty.iterdir()) == []


def test_a_refusal_in_json_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["config", "show", "--json", "--set", f"{'a.' * DEEP}a=1"])
    out, err = capsys.readouterr()
    answer = json.loads(out)
    assert (code, err, out.count("\n")) == (2, "", 1)
    assert set(answer["error"]) == {"kind", "message", "remedy"}


def test_json_that_is_no_text_is_refused_by_whoever_reads_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scores.json").write_bytes(b'{"format":"\xdf"}')
    (tmp_path / "a.heads.json").write_bytes(b'{"network":"\xdf"}')
    shutil.copy(WEIGHTS / "tcn.onnx", tmp_path / "a.onnx")
    (tmp_path / "dataset.json").write_bytes(b'{"digest":"\xdf"}')
    for words in (
        ["report", str(tmp_path / "scores.json")],
        ["detector", "card", str(tmp_path / "a.onnx")],
        ["dataset", "build", "observer", "--share", "0.01", "--out", str(tmp_path)],
    ):
        assert main(words) == 2, words
        assert capsys.readouterr().err.startswith("grasp: "), words


@pytest.mark.parametrize(
    "words",
    [
        ("replay", "NAME"), ("report", "NAME"), ("export", "NAME"),
        ("campaign", "summary", "NAME"), ("runs", "--runs=NAME"), ("run", "lift", "--runs=NAME"),
        ("run", "lift", "--rig", "simulated", "--trials", "2", "--out=NAME"),
    ],
    ids=" ".join,
)  # fmt: skip
@pytest.mark.parametrize("name", ["a" * 300, "\0", "\ud83d", "\udcff"], ids=ascii)
def test_what_no_file_can_be_called_is_refused_as_usage(
    words: tuple[str, ...], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main([word.replace("NAME", name) for word in words]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("grasp: ") and err.count("\n") == 1
    assert "disk" not in err and list(tmp_path.iterdir()) == []


def test_a_name_beside_which_nothing_longer_can_lie_is_refused_as_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "lift", "--rig", "simulated", "--trials", "2", "--runs", str(tmp_path / "runs")]
    assert main([*words, "--out", str(tmp_path / ("a" * 250))]) == 2
    assert "File name too long" in capsys.readouterr().err and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words", [("run", "tap", "--taps=\x1b[2Jx\ny"), ("runs", "--runs=\x1b[2J\n")]
)
def test_words_that_are_told_back_do_nothing_to_a_terminal(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    main(list(words))
    told = "".join(capsys.readouterr())
    assert told.count("\n") == 1 and told[:-1].isprintable() and r"\x1b[2J" in told
