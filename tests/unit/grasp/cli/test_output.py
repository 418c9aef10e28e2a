"""Under --json standard output holds JSON alone, whoever else prints."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

import grasp.cli
from grasp.cli.main import main
from grasp.cli.output import json_line
from grasp.recording import RunRecording
from scenarios.trial import execution

NOISY = (
    "import os, sys, ctypes\n"
    "from grasp.cli import runs\n"
    "inner = runs.run\n"
    "def noisy(args):\n"
    "    print('EP Error: a library speaks'); print('3')\n"
    "    os.write(1, b'a library writes\\n')\n"
    "    os.system('echo a process writes')\n"
    "    return inner(args)\n"
    "runs.run = noisy\n"
    "from grasp.cli.main import main\n"
    "sys.exit(main(['runs', '--runs', sys.argv[1], '--json']))\n"
)


def test_whatever_prints_in_a_process_only_the_answer_is_on_standard_output(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", NOISY, str(tmp_path)], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])},
    )  # fmt: skip
    assert json.loads(done.stdout) == []
    assert done.stdout.count("\n") == 1
    for text in ("a library speaks", "a library writes", "a process writes"):
        assert text in done.stderr


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_streams_that_were_closed_lead_nowhere_and_into_no_file_of_ours(
    closed: str, tmp_path: Path
) -> None:
    program = (
        "import os, sys; from grasp.cli.main import main; code = main(sys.argv[1:]); "
        "os.system('echo noise; echo noise >&2'); sys.exit(code)"
    )
    words = ["run", "acquire", "--rig", "simulated", "--seconds", "1", "--runs", str(tmp_path)]
    shell = f'exec "$@" {closed}'
    done = subprocess.run(
        ["sh", "-c", shell, "sh", sys.executable, "-P", "-c", program, *words],
        capture_output=True, check=False,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])},
    )  # fmt: skip
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False)
    (recording,) = tmp_path.rglob("*.mcap")
    assert RunRecording.open(recording, {}).complete


def test_detector_that_prints_does_not_disturb_the_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    inner = execution.make_step

    def noisy(*args: object, **more: object) -> object:
        print("hello from a library")
        return inner(*args, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(execution, "make_step", noisy)
    code = main(
        ["run", "lift", "--rig", "simulated", "--runs", str(tmp_path), "--json",
         "--set", "controller.lift_height_m=0.05"]
    )  # fmt: skip
    out, err = capsys.readouterr()
    assert json.loads(out)["exit_code" if code > 1 else "outcome"]
    assert "hello" in err


def test_damaged_network_is_one_json_object(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = tmp_path / "bad.onnx"
    weights.write_bytes(b"\x08\x07" + bytes(500))
    code = main(
        ["run", "lift", "--rig", "simulated", "--detector", "gru", "--set",
         f"network.weights={weights}", "--runs", str(tmp_path), "--json"]
    )  # fmt: skip
    out, _ = capsys.readouterr()
    assert code == 2
    assert json.loads(out)["error"]["kind"] == "bad_file"


def test_a_number_that_is_none_is_null_wherever_it_stands() -> None:
    said = {"p90": math.inf, "all": [1, (float("nan"), 2.5)], "word": "Infinity"}
    assert json_line(said) == '{"p90": null, "all": [1, [null, 2.5]], "word": "Infinity"}'


def test_every_verb_writes_its_answer_in_that_one_way() -> None:
    """Or by msgspec, which knows no infinity either."""
    verbs = Path(grasp.cli.__file__).parent.glob("*.py")
    assert not [verb.name for verb in verbs if "print(json.dumps(" in verb.read_text()]


def test_a_series_with_misses_prints_json_that_any_reader_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "run lift --object can --rig simulated --trials 1 --detector psd --json --out"
    main([*words.split(), str(tmp_path / "series")])
    (line,) = capsys.readouterr().out.splitlines()
    said = json.loads(line, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    (cell,) = said["summary"]["variants"][0]["cells"]
    assert cell["nominal_again_ms"]["p50"] is None


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("how", [["--json"], []])
def test_a_disk_that_is_full_is_told_in_one_line(how: list[str]) -> None:
    start = "import sys; from grasp.cli.main import main; sys.exit(main(sys.argv[1:]))"
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", start, "config", "guard", *how], stdout=full,
            stderr=subprocess.PIPE, text=True, check=False,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])},
        )  # fmt: skip
    assert done.returncode == 5
    assert done.stderr.startswith("grasp: No space left on device")
    assert done.stderr.count("\n") == 1
