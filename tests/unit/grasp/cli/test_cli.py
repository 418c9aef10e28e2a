"""The command line: output, exit codes, errors with their remedy."""

import json
import re
import resource
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from grasp.cli.main import main

HEAVY = {"numpy", "numba", "torch", "pydantic", "msgspec", "transitions", "mcap", "rich"}
GRASP = [sys.executable, "-c", "import sys; from grasp.cli.main import main; sys.exit(main())"]


def call(*words: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Run a command in this process; lifts on the simulated rig unless they say otherwise."""
    if words[:2] in (("run", "lift"), ("run", "tap")) and not {"--rig", "--help"} & set(words):
        words = (*words, "--rig", "simulated")
    try:
        code = main(list(words))
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else 2
    out, err = capsys.readouterr()
    return code, out, err


def run_json(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, Any]]:
    code, out, err = call(*words, "--json", capsys=capsys)
    assert err == ""
    assert out.count("\n") == 1
    return code, json.loads(out)


def test_help_imports_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "from grasp.cli.main import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        f"print(sorted({HEAVY!r} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"
    assert "run" in done.stdout


def test_taps_are_displayed_counted_and_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = call(
        "run", "tap", "--trials", "2", "--runs", str(tmp_path), "--detector", "energy", "--set",
        "energy.threshold_counts=12", capsys=capsys,
    )  # fmt: skip
    assert code == 0
    assert "100% (34-100)  n 2" in out
    assert "REGISTERED" in out
    folders = sorted(tmp_path.iterdir())
    assert [sorted(p.name for p in f.iterdir()) for f in folders] == [
        ["recording.mcap", "result.json"]
    ] * 2
    assert {json.loads((f / "result.json").read_text())["direction"] for f in folders} == {
        "top", "side",
    }  # fmt: skip
    assert call("replay", str(folders[0]), "--check", capsys=capsys)[0] == 0
    assert "registered" in call("runs", "--runs", str(tmp_path), capsys=capsys)[1]
    if find_spec("matplotlib"):
        assert call("export", str(folders[1]), "--to", "svg", capsys=capsys)[0] == 0


def test_safety_stop_exits_with_4_and_reports_the_result_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, result = run_json(
        capsys, "run", "lift", "--runs", str(tmp_path), "--set", "object.grip_counts=[60,60,60]",
        "--set", "controller.first_grasp=counts",
    )  # fmt: skip
    assert code == result["exit_code"] == 4
    assert result["error"]["kind"] == "safety_stop"
    assert "stopped on contact" in result["error"]["message"]
    assert result["result"]["outcome"] == "fault"


def test_folder_that_cannot_be_made_is_refused_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    code, result = run_json(capsys, "run", "lift", "--runs", str(tmp_path / "file"))
    assert code == 2
    assert result["error"]["kind"] == "usage"
    assert "--runs" in result["error"]["message"]


def test_full_disk_does_not_stop_the_lift_and_leaves_no_partial_file(tmp_path: Path) -> None:
    def small_files() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    done = subprocess.run(
        [*GRASP, "run", "lift", "--rig", "simulated", "--runs", str(tmp_path / "runs")],
        capture_output=True, text=True, preexec_fn=small_files, check=False,
    )  # fmt: skip
    assert done.returncode == 5
    assert "SUCCESS: held within 6 cm" in done.stdout
    assert "could not be recorded" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list((tmp_path / "runs").iterdir()) == []


def test_ctrl_c_stops_the_arm_keeps_the_grip_and_reports_their_final_state(tmp_path: Path) -> None:
    with subprocess.Popen(
        [*GRASP, "run", "lift", "--rig", "simulated", "--runs", str(tmp_path), "--pace", "real"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            if " lift " in line:
                break
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    happened, left = err.splitlines()
    assert happened == "grasp: stopped by hand in phase lift"
    found = re.fullmatch(
        r"in phase lift, \d+ mm above the grasp: the arm is stationary; the hand is closed "
        r"with its previous grip, at \(\d+, \d+, \d+\) counts, \d+\.\d N measured at finger [ABC]",
        left.strip(),
    )
    assert found is not None
    assert "Traceback" not in err


def test_settings_are_printed_with_their_source(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[rule]\nrelease = 9\n", encoding="utf-8")
    words = ("config", "rule", "--detector", "gru", "--config", str(mine))
    words += ("--set", "rule.threshold=0.8")
    output = call(*words, capsys=capsys)[1].splitlines()
    ends = {line.split(" = ")[0]: line.rpartition("; ")[2] for line in output if " = " in line}
    assert ends["fusion"] == f"from {Path('detectors') / 'gru.toml'}"
    assert ends["release"] == f"from {mine}"
    assert ends["threshold"] == "from --set"
    assert ends["drift"] == "default"


def test_invalid_options_are_refused_with_a_remedy_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, expected in (
        ("tap --taps 3", "`grasp run tap` does not take --taps 3"),
        ("lift --direction top", "`grasp run lift` does not take --direction top"),
        ("tap --trials 0", "out of range"),
        ("tap --set controller.keep=true", "only one trial is possible"),
        ("tap --set object.mass_kg=2.9", "leaves it in the hand"),
        ("lift --object cann", "did you mean 'can'"),
        ("lift --detector oracle", "energy"),
        ("lift --rig moon", "simulated"),
        ("lift --set guard.force_limit=9", "force_limit_n"),
        ("lift --set gripper.calibration=guess", "manual, paper"),
        ("lift --config /no/such/file.toml", "no such file"),
    ):
        code, _, err = call("run", *words.split(), "--runs", str(tmp_path), capsys=capsys)
        assert (code, err.count("\n")) == (2, 1) and expected in err, words
        assert list(tmp_path.iterdir()) == []


def test_a_lift_leaves_a_run_that_can_be_listed_and_plotted_with_a_complete_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "no runs" in call("runs", "--runs", str(tmp_path), capsys=capsys)[1]
    code, result = run_json(capsys, "run", "lift", "--runs", str(tmp_path), "--seed", "2")
    assert code == 0
    assert {
        "scenario", "object", "rig", "detector", "seed", "success", "outcome", "slip_registered_s",
        "detection_latency_ms", "peak_force_n", "peak_estimated_n", "force_limit_n", "limit_mode",
        "phases", "timing", "recording", "versions", "config_hash", "detector_hash", "end", "bug",
    } <= set(result)  # fmt: skip
    assert result["engine"] == "compiled"
    assert result["seed"] == 2 and set(result["peak_force_n"]) == {"A", "B", "C"}
    assert set(result["phases"][0]) == {"phase", "t_s", "cause"}
    assert result["timing"]["decision_to_ack_us"] is None  # there is no wire in virtual time
    folder = Path(result["recording"]).parent
    assert sorted(p.name for p in folder.iterdir()) == ["recording.mcap", "result.json"]
    assert json.loads((folder / "result.json").read_text())["success"] is True
    assert "held_within_6cm" in call("runs", "--runs", str(tmp_path), capsys=capsys)[1]
    if find_spec("matplotlib"):
        assert call("export", str(folder), "--to", "svg", capsys=capsys)[0] == 0
        assert (folder / "run.svg").read_text().startswith("<?xml")
        monkeypatch.setattr("scenarios.report.animation.AFTER_S", -0.17)  # few frames
        assert call("export", str(folder), "--to", "gif", capsys=capsys)[0] == 0
        assert (folder / "run.gif").read_bytes().startswith(b"GIF89a")
    (tmp_path / "damaged").mkdir()
    damaged = tmp_path / "damaged" / "result.json"
    for content in (b"", b"[" * 100_000, b"\xff\xfe", b"{}", b'{"seed": [], "outcome": "held"}'):
        damaged.write_bytes(content)
        code, out, err = call("runs", "--runs", str(tmp_path), capsys=capsys)
        assert code == 2 and "held_within_6cm" in out
        assert err.count("\n") == 1 and str(damaged) in err


def test_failed_trial_exits_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("run", "lift", "--runs", str(tmp_path), "--set", "object.mass_kg=2.5")
    code, out, _ = call(*words, capsys=capsys)
    assert code == 1 and "FAILED: limit reached" in out


def test_settings_are_printed_with_their_allowed_values(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call("config", "guard", capsys=capsys)
    assert code == 0 and "force_limit_n = 10.0  # float" in out
    _, table = run_json(capsys, "config", "--set", "guard.tip_mass_kg=0.3")
    assert table["guard"]["tip_mass_kg"] == 0.3
    code, _, error = call("config", "lab.tml", capsys=capsys)
    assert code == 2 and "no such file or section: 'lab.tml'" in error
    out = call("config", capsys=capsys)[1]
    assert "grip_counts = [55, 55, 55]  # 3 x int" in out and "tuple[" not in out


def test_doctor_ends_with_its_failures(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call("doctor", "--rig", "hardware", capsys=capsys)
    *rows, end = out.splitlines()
    marks = [row[:4] for row in rows if row[:4].strip()]
    assert code in (2, 3) and marks == sorted(marks, key="FAIL".__eq__) and marks[-1] == "FAIL"
    assert end.startswith("failed checks: ") and "; fix first: " in end
