"""The command as a user meets it: output, exit codes, errors with their remedy."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from grasp.cli.main import main
from grasp.cli.options import OBJECT_HELP
from grasp.settings import UNSEEN, names

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


@pytest.mark.parametrize(
    "verb",
    ["run", "campaign", "replay", "runs", "report", "detector", "config", "release"],
)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(verb, "--help", capsys=capsys)
    assert code == 0
    assert "usage: grasp" in out


def test_lift_succeeds_and_leaves_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call("run", "lift", "--object", "can", "--runs", str(tmp_path), capsys=capsys)
    assert code == 0
    assert "SUCCESS: held within 6 cm" in out
    assert "REGISTERED" in out
    folder = next(tmp_path.iterdir())
    assert sorted(p.name for p in folder.iterdir()) == ["recording.mcap", "result.json"]
    assert json.loads((folder / "result.json").read_text())["success"] is True


def test_json_verdict_has_every_promised_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, result = run_json(capsys, "run", "lift", "--runs", str(tmp_path), "--seed", "2")
    assert code == 0
    assert list(result) == [
        "scenario", "object", "rig", "detector", "seed", "success", "outcome", "slip_onset_s",
        "slip_registered_s", "detection_latency_ms", "peak_force_n", "peak_measured_n",
        "commanded_force_n", "force_limit_n", "cap_mode", "paused_s", "phases", "timing",
        "recording", "versions", "config_hash",
        "detector_hash", "files", "end", "bug", "home_m", "physics", "taxels_at_rail",
        "first_detection_s", "reaction_latency_ms", "slip_distance_m", "turned_rad",
        "settled_force_n",
        "alarm_stayed",
    ]  # fmt: skip
    assert result["seed"] == 2
    assert set(result["peak_force_n"]) == {"A", "B", "C"}
    assert set(result["phases"][0]) == {"phase", "t_s", "cause"}
    timing = result["timing"]
    assert timing["decision_to_ack_us"] is None  # there is no wire in virtual time
    for name in ("frame_to_decision_us", "frame_age_ms"):
        assert {"count", "p50", "p99", "max"} <= set(timing[name])
    assert timing["missed_periods"] == timing["repeated_frames"] == 0
    assert Path(result["recording"]).is_file()


def test_taps_are_shown_counted_and_left_as_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = call(
        "run", "tap", "--trials", "2", "--runs", str(tmp_path), "--detector", "energy", "--set",
        "energy.threshold_counts=12", capsys=capsys,
    )  # fmt: skip
    assert code == 0
    assert "all       2 of 2 taps that moved it (100 %)" in out
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
        assert call("report", str(folders[1]), "--to", "svg", capsys=capsys)[0] == 0


def test_verbose_tap_says_its_levels_and_how_far_the_object_turned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "run", "tap", "--trials", "1", "--direction", "side", "--runs", str(tmp_path)
    _, out, _ = call(*words, "-v", capsys=capsys)
    assert "contact level L1, step 0.5 ms; L4, step 0.1 ms, while a blow moves the object" in out
    assert re.search(r"moved +[\d.]+ mm  turned [\d.]+ deg", out)
    two = ("run", "tap", "--trials", "2", "--direction", "top", "--runs", str(tmp_path / "two"))
    assert call(*two, "-v", capsys=capsys)[1].count("contact level ") == 1


def test_json_of_a_series_has_every_tap_and_the_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = call(
        "run", "tap", "--trials", "2", "--direction", "side", "--seed", "4", "--runs",
        str(tmp_path), "--set", "tap.impulse_n_s=0.02", "--json", capsys=capsys,
    )  # fmt: skip
    series = json.loads(out)
    assert [line.split()[:2] for line in err.splitlines()] == [["seed", "4"], ["seed", "5"]]
    assert code == 0  # nothing moved, which is a result
    assert list(series) == ["scenario", "object", "rig", "detector", "seed", "summary", "taps"]
    assert {series["detector"], *(t["detector"] for t in series["taps"])} == {"tcn"}, "unasked"
    assert series["summary"]["total"]["unmoved"] == 2
    assert [t["seed"] for t in series["taps"]] == [4, 5]
    assert {t["direction"] for t in series["taps"]} == {"side"}
    assert list(series["taps"][0]) == [
        "scenario", "object", "rig", "detector", "seed", "success", "outcome", "slip_onset_s",
        "slip_registered_s", "detection_latency_ms", "peak_force_n", "peak_measured_n",
        "commanded_force_n", "force_limit_n", "cap_mode", "paused_s", "phases", "timing",
        "recording", "versions", "config_hash",
        "detector_hash", "files", "end", "bug", "home_m", "physics", "taxels_at_rail",
        "direction", "moved", "displacement_m", "down_m", "across_m", "turned_rad", "impulse_n_s",
        "mallet_mps", "struck_s",
        "slip_end_s", "slip_duration_ms", "nominal_again_s", "nominal_again_ms", "alarms",
        "watched_until_s", "grip_force_n",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["tap", "--taps", "3"], "--taps 3: it is called --trials"),
        (["lift", "--direction", "top"], "`grasp run lift` does not take --direction top"),
        (["tap", "--keep"], "`grasp run tap` does not take --keep"),
        (["tap", "--trials", "0"], "a whole number"),
        (["tap", "--set", "controller.keep=true"], "holds one object and ends"),
        (["lift", "--trials", "2", "--set", "controller.keep=true"], "holds one object and ends"),
        (["tap", "--direction", "up"], "top"),
        (["tap", "--set", "tap.watch_s=1"], "too short to judge"),
        (["tap", "--set", "tap.spread=3"], "<= 0.5"),
        (["tap", "--set", "object.mass_kg=2.9"], "leaves it in the hand"),
    ],
)
def test_options_that_do_not_fit_are_told_before_anything_moves(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = call("run", *words, "--runs", str(tmp_path), capsys=capsys)
    assert code == 2
    assert says in err
    assert list(tmp_path.iterdir()) == []


def test_failed_trial_exits_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, result = run_json(
        capsys, "run", "lift", "--runs", str(tmp_path), "--set", "object.mass_kg=2.5"
    )
    assert code == 1
    assert result["outcome"] == "cap_reached"


def test_safety_stop_exits_with_4_and_reports_the_result_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, answer = run_json(
        capsys, "run", "lift", "--runs", str(tmp_path), "--set", "object.grip_counts=[75,75,75]",
        "--set", "controller.preshape_margin_counts=30",
    )  # fmt: skip
    assert code == answer["exit_code"] == 4
    assert answer["error"]["kind"] == "safety_stop"
    assert "latched" in answer["error"]["message"]
    assert answer["result"]["outcome"] == "fault"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--object", "cann"], "did you mean 'can'"),
        (["--object", "orage"], "did you mean 'orange'"),
        (["--object", "moon"], "kept for testing: book, bottle, jar, mug, orange, sponge"),
        (["--set", "controller.answer=jumpp"], "did you mean 'jump'"),
        (["--detector", "oracle"], "energy"),
        (["--rig", "moon"], "simulated"),
        (["--seed", "-1"], "a whole number"),
        (["--seed", "two"], "a whole number"),
        (["--set", "guard.force_limit_n=900"], "<= 60"),
        (["--set", "guard.force_limit=9"], "force_limit_n"),
        (["--set", "nonsense"], "section.key=value"),
        (["--set", "gripper.calibration=manual"], "calibration"),
        (["--set", "gripper.calibration=guess"], "manual, paper"),
        (["--config", "/no/such/file.toml"], "no such file"),
    ],
)
def test_bad_input_is_one_line_with_its_remedy_and_exit_code_2(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = call("run", "lift", "--runs", str(tmp_path), *words, capsys=capsys)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert says in err
    assert list(tmp_path.iterdir()) == []
    code, answer = run_json(capsys, "run", "lift", "--runs", str(tmp_path), *words)
    assert code == answer["exit_code"] == 2
    assert set(answer["error"]) == {"kind", "message", "remedy"}


def test_folder_that_cannot_be_made_is_told_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    code, answer = run_json(capsys, "run", "lift", "--runs", str(tmp_path / "file"))
    assert code == 2
    assert answer["error"]["kind"] == "usage"
    assert "--runs" in answer["error"]["message"]


def test_full_disk_does_not_stop_the_lift_and_leaves_nothing_half_written(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("rig", ["simulated", "emulated"])
def test_too_few_open_files_are_refused_before_anything_is_begun(rig: str, tmp_path: Path) -> None:
    def few_files() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (24, 24))

    done = subprocess.run(
        [*GRASP, "run", "lift", "--rig", rig, "--runs", str(tmp_path / "runs")],
        capture_output=True, text=True, preexec_fn=few_files, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    happened, *more = done.stderr.splitlines()
    assert more == [] and "too few open files allowed: 24" in happened and "ulimit -n" in happened
    assert not list((tmp_path / "runs").glob("*/*"))


def test_a_low_limit_of_open_files_is_raised_where_the_system_lets_it(tmp_path: Path) -> None:
    def few_at_first() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (24, 1024))

    subprocess.run(
        [*GRASP, "run", "lift", "--rig", "simulated", "--pace", "max", "--runs", str(tmp_path)],
        capture_output=True, preexec_fn=few_at_first, check=True,
    )  # fmt: skip


def test_open_files_that_run_out_in_a_lift_end_it_no_sooner_and_are_told(tmp_path: Path) -> None:
    with subprocess.Popen(
        [*GRASP, "run", "lift", "--rig", "simulated", "--runs", str(tmp_path), "--pace", "real"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            if " lift " in line:
                break
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (3, 3))
        out, err = process.communicate(timeout=60)
    assert process.returncode == 5
    assert " retreat " in out and " done " in out  # the object stands, and the hand is away
    assert err.count("\n") == 1
    assert "Too many open files" in err and "ulimit -n" in err


def test_ctrl_c_stops_the_arm_keeps_the_grip_and_says_how_both_were_left(tmp_path: Path) -> None:
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
        r"in phase lift, \d+ mm above the grasp: the arm stands; the hand is closed with the "
        r"grip that it had, at \(\d+, \d+, \d+\) counts, \d+\.\d N measured at finger [ABC]",
        left.strip(),
    )
    assert found is not None
    assert "Traceback" not in err


def test_runs_are_listed_with_their_verdicts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no runs" in call("runs", "--runs", str(tmp_path), capsys=capsys)[1]
    call("run", "lift", "--runs", str(tmp_path), capsys=capsys)
    assert "held_within_6cm" in call("runs", "--runs", str(tmp_path), capsys=capsys)[1]


@pytest.mark.parametrize(
    "damaged",
    [b"", b"[" * 100_000, b"\xff\xfe", b"[]", b"{}", b'{"seed": 0, "outcome": null}',
     b'{"seed": [], "outcome": "held"}', b'{"seed": 0, "outcome": "held", "slip_distance_m": "x"}'],
)  # fmt: skip
def test_damaged_result_is_one_line_and_hides_no_other(
    damaged: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in {"a": damaged, "b": b'{"seed": 7, "outcome": "held"}'}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_bytes(text)
    code, out, err = call("runs", "--runs", str(tmp_path), capsys=capsys)
    assert code == 2
    assert out.split() == ["b", "held", "seed", "7"]
    assert err.count("\n") == 1 and str(tmp_path / "a" / "result.json") in err
    code, out, _ = call("runs", "--runs", str(tmp_path), "--json", capsys=capsys)
    assert code == 2
    assert json.loads(out) == [{"seed": 7, "outcome": "held"}]


def test_settings_are_shown_with_what_is_allowed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call("config", "guard", capsys=capsys)
    assert code == 0
    assert "force_limit_n = 10.0  # float" in out
    code, table = run_json(capsys, "config", "--set", "guard.tip_mass_kg=0.3")
    assert table["guard"]["tip_mass_kg"] == 0.3
    assert call("config", "nothing", capsys=capsys)[0] == 2
    rule = call("config", "rule", capsys=capsys)[1]
    assert 'fusion = "mean"' in rule and rule.count("or of the mean") == 4
    out = call("config", capsys=capsys)[1]
    assert "grip_counts = [55, 55, 55]  # 3 x int (motor counts" in out
    assert "  # 3 x n x 2 x int (" in out and "  # n x 2 x int (" in out
    assert "  # 3 x n x int | None (" in out
    assert "tuple[" not in out


def test_settings_are_shown_with_where_they_are_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[rule]\nrelease = 9\n", encoding="utf-8")
    words = ("config", "rule", "--config", str(mine), "--set", "rule.threshold=0.8")
    said = call(*words, capsys=capsys)[1].splitlines()
    ends = {line.split(" = ")[0]: line.rpartition("; ")[2] for line in said if " = " in line}
    assert ends["fusion"] == f"from {Path('detectors') / 'tcn.toml'}"
    assert ends["release"] == f"from {mine}"
    assert ends["threshold"] == "from --set"
    assert ends["drift"] == "default"


def test_picture_of_a_run_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call("run", "lift", "--runs", str(tmp_path), capsys=capsys)
    folder = next(tmp_path.iterdir())
    code, out, _ = call("report", str(folder), "--to", "svg", capsys=capsys)
    assert code == 0
    assert (folder / "run.svg").read_text().startswith("<?xml")
    assert str(folder / "run.svg") in out


def test_keep_is_a_setting_of_the_controller(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, result = run_json(capsys, "run", "lift", "--keep", "--runs", str(tmp_path))
    assert result["phases"][-1]["phase"] == "kept"


def test_command_works_from_any_folder(tmp_path: Path) -> None:
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "__init__.py").write_text("raise SystemExit('wrong config')")
    checkout = Path(__file__).parents[4]
    done = subprocess.run(
        [*GRASP, "run", "lift", "--rig", "simulated", "--json"], cwd=tmp_path,
        capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(checkout)}, check=True,
    )  # fmt: skip
    assert json.loads(done.stdout)["success"]


def test_pacing_follows_the_wall_and_changes_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start = time.monotonic()
    _, paced = run_json(
        capsys, "run", "lift", "--pace", "real", "--runs", str(tmp_path / "a"),
        "--set", "controller.hold_s=0", "--set", "controller.lower_speed_mps=0.5",
        "--set", "controller.lift_height_m=0.05", "--set", "arm.max_speed_mps=0.6",
    )  # fmt: skip
    assert time.monotonic() - start > paced["phases"][-1]["t_s"] - paced["phases"][0]["t_s"] - 0.1
    _, fast = run_json(
        capsys, "run", "lift", "--pace", "max", "--runs", str(tmp_path / "b"),
        "--set", "controller.hold_s=0", "--set", "controller.lower_speed_mps=0.5",
        "--set", "controller.lift_height_m=0.05", "--set", "arm.max_speed_mps=0.6",
    )  # fmt: skip
    assert Path(paced["recording"]).read_bytes() == Path(fast["recording"]).read_bytes()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("config", "contoller"), "did you mean 'controller'"),
    ],
    ids=["section"],
)
def test_word_that_is_nearly_a_known_one_is_told_that_one(
    words: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = call(*words, capsys=capsys)
    assert code == 2
    assert says in err


def test_help_names_every_packaged_object() -> None:
    for kind in ("objects", f"objects/{UNSEEN}"):
        assert ", ".join(names(kind)) in OBJECT_HELP


def test_lift_ends_with_who_listened_and_how_slip_was_answered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", "lift", "--runs", str(tmp_path), "--detector", "energy")
    _, out, _ = call(*words, capsys=capsys)
    assert out.splitlines()[-1] == (
        "  detector energy, profile default, answer to slip: stop_and_jump"
    )


def test_verbose_acquisition_leaves_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", "acquire", "--rig", "simulated", "--seconds", "3", "--runs", str(tmp_path))
    code, _, err = call(*words, "-v", capsys=capsys)
    assert code == 0, err
    (log,) = tmp_path.glob("*-acquire-planar.log")
    assert f"log: {log}" in err
    told = log.read_text()
    assert " phase stroke, " in told
    assert "seed 0: complete: " in told.splitlines()[-1]
