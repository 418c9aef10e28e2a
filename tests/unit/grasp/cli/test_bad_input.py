"""Invalid input gives one line with a remedy and exit code 2, and nothing is written."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import inspect

from grasp.cli.main import main
from scenarios.campaign.config import RunConfig

Capture = pytest.CaptureFixture[str]
DEEP = 5_000
BAD_TOML = [
    f"a = {'[' * DEEP}{']' * DEEP}", f"[{'a.' * DEEP}a]\nx = 1",
    f"a = {'{a = ' * DEEP}1{'}' * DEEP}", f"[guard]\nforce_limit_n = {'9' * 5_000}",
    "[guard]\nforce_limit_n = '\x01'", '[gripper]\ncalibration = "a\\u0000.toml"',
    '["a\\u001b[2J"]\nx = 1', "# nothing\n" * 200_000, b"\xff\xfe\x00\x00", b"\0" * 100,
    "[guard.force_limit_n]\nx = 1", "guard = 1", 'profile = "zzz"', "[guard]\n[guard]\n",
]  # fmt: skip
BAD_SETTINGS = [
    f"{'a.' * DEEP}a=1", f"guard.force_limit_n={'[' * DEEP}", "guard.force_limit_n=nan",
    "guard.force_limit_n=inf", "guard.force_limit_n=\x1b[2J", "guard.force_limit_n=900",
    f"controller.margin_steps={'9' * 400}", "rig=emulated", "profile=zzz",
    "object.grip_counts=[300,0,0]", "object.name=../../../out", "object.name=.hidden",
    'object.name="can\\n"', f"object.name={'a' * 300}", "hand.least_force_n=99",
    "tactile.cells=[[9]]", "arm.payload_kg=11.0", "gripper.calibration=/dev/zero",
    "gripper.calibration=/", "a\nb=1", "=", "",
]  # fmt: skip
# FILE is a path that does not exist, DIR an empty folder
BAD_WORDS = """
nonsense | run | run fly | run lift --object | run lift --seed -1 | run lift --detector=
run lift --object= | run lift --config= | dataset import FILE --out DIR --columns=
arm step --x -1e1 | gripper step --mm -1e-3
run lift --config DIR | run lift --config /dev/zero | run tap --taps -1 | run acquire --speed nan
run acquire --surface moon | campaign run FILE.toml | campaign run paper --jobs 0 | replay
runs DIR | runs /dev/null | export FILE --to csv | replay FILE | replay DIR
replay --tactile FILE | replay --tactile FILE --check | runs --runs FILE --json=1
export FILE --to svg
dataset build FILE.toml --out DIR | detector evaluate energy --data DIR
detector evaluate zzz --recording FILE | detector card /dev/zero.onnx | detector train zzz
tactile identify --url nonsense --seconds 1 | tactile identify --seconds nan
config zzz | emulate --gripper-port 70000
release --rig zzz
"""


def refused(words: list[str], capsys: Capture) -> str:
    """The single line on standard error."""
    code = main(words)
    out, err = capsys.readouterr()
    assert (code, out) == (2, ""), (words, err[-500:])
    assert err.startswith("grasp: ") and err.endswith(")\n") and err.count("\n") == 1, err
    assert all(c.isprintable() for c in err[:-1]) and len(err) < 4_000, err
    return err


def leaves(kind: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """All settings of a type, with their declarations."""
    if isinstance(kind, inspect.Metadata):
        yield from leaves(kind.type, path)
    elif isinstance(kind, inspect.UnionType):
        for part in kind.types:
            if isinstance(part, inspect.StructType):
                yield from leaves(part, path)
    elif isinstance(kind, inspect.StructType):
        for field in kind.fields:
            yield from leaves(field.type, (*path, field.encode_name))
    elif not isinstance(kind, inspect.DictType) and len(path) > 1:
        yield ".".join(path), kind


def wrong(kind: Any) -> list[str]:
    """Invalid values of a setting as TOML: another type, NaN, a number out of bounds."""
    found = ["{ a = 1 }", "[[[]]]", "1979-05-27", "nan"]
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        step = 1 if isinstance(kind, inspect.IntType) else 1e-3
        found += ["inf", "-inf", "true", '"1"', "9" * 400]
        found += [str(kind.ge - step)] if kind.ge is not None else []
        found += [str(kind.gt)] if kind.gt is not None else []
        found += [str(kind.le + step)] if kind.le is not None else []
        found += [str(kind.lt)] if kind.lt is not None else []
    elif isinstance(kind, inspect.BoolType):
        found += ["0", '"true"']
    return found


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_an_invalid_setting_is_refused_in_one_line(
    data: st.DataObject, tmp_path: Path, capsys: Capture
) -> None:
    path, kind = data.draw(st.sampled_from(list(leaves(inspect.type_info(RunConfig)))))
    value = data.draw(st.sampled_from(wrong(kind)))
    if data.draw(st.booleans()):
        words = ["--set", f"{path}={value}"]
    else:
        (tmp_path / "lab.toml").write_text(f"{path} = {value}\n")
        words = ["--config", str(tmp_path / "lab.toml")]
    refused(["config", *words], capsys)


def test_invalid_files_settings_and_arguments_are_refused_before_anything_is_written(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, empty, file = tmp_path / "work", tmp_path / "empty", tmp_path / "lab.toml"
    work.mkdir(), empty.mkdir()
    monkeypatch.chdir(work)
    for content in BAD_TOML:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        for words in (["config", "--config"], ["campaign", "run", "--out", "x"]):
            assert "lab.toml" in refused([*words, str(file)], capsys)
    for text in BAD_SETTINGS:
        refused(["run", "lift", "--rig", "simulated", "--runs", "in", "--set", text], capsys)
    for text in BAD_WORDS.strip().replace("\n", "|").split("|"):
        named = text.replace("FILE", str(tmp_path / "none")).replace("DIR", str(empty))
        refused(named.split(), capsys)
    assert list(work.iterdir()) == list(empty.iterdir()) == []


def test_a_refusal_in_json_is_one_object(capsys: Capture) -> None:
    code = main(["config", "--json", "--set", f"{'a.' * DEEP}a=1"])
    out, err = capsys.readouterr()
    assert (code, err, out.count("\n")) == (2, "", 1)
    assert set(json.loads(out)["error"]) == {"kind", "message", "remedy"}


def test_invalid_file_names_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    for words in ("replay NAME", "report NAME", "runs NAME", "run lift --runs=NAME"):
        for name in ("a" * 300, "\0", "\ud83d", "\udcff"):
            refused([word.replace("NAME", name) for word in words.split()], capsys)
    assert list(tmp_path.iterdir()) == []
