"""Input that makes no sense, generated: refused in one line with its exit code, nothing written."""

import contextlib
import io
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from detector import recordings
from detector.network_file import WEIGHTS
from detector.recordings import Recording
from grasp.cli.main import main
from scenarios.campaign.run import run
from scenarios.campaign.spec import CampaignSpec
from scenarios.lift import lift
from scenarios.rigs.workers import Workers
from tests.unit.grasp.cli.bad_inputs import Input, drawn
from tests.unit.scenarios.campaign.test_campaign import judged_at_once
from tests.unit.scenarios.conftest import config

QUICK, ALL = 300, 5_300
LOTS = 20
AT_WORK_S = 20  # who is at it for so long has not refused


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Good files of every kind that a verb reads."""
    folder = tmp_path_factory.mktemp("kept")
    result = lift.run(config("controller.lift_height_m=0.02"), 0, folder).result
    assert result is not None and result.recording is not None
    spec = CampaignSpec(name="two", objects=("can", "ball"), repetitions=2)
    run(spec, folder / "a.sqlite", Workers(0), work=judged_at_once)
    t_s = np.arange(50) * 0.01
    counts = np.random.default_rng(0).integers(-50, 0, (50, 1, 6)).astype(np.int16)
    recording = Recording(t_s, counts, np.zeros(50, np.bool_), None, "a test")
    recordings.write(folder / "a.npz", recording)
    lines = ["t_s,p0,p1,p2,p3,p4,p5,slip", *(f"{t:.2f},1,2,3,4,5,6,0" for t in t_s)]
    return {
        "a.mcap": Path(result.recording).read_bytes(),
        "a.sqlite": (folder / "a.sqlite").read_bytes(),
        "a.npz": (folder / "a.npz").read_bytes(),
        "a.csv": "\n".join(lines).encode(),
        "a.onnx": (WEIGHTS / "tcn.onnx").read_bytes(),
    }


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """Whoever begins to work in place of refusing is stopped."""

    def stop(*_: object) -> None:
        raise AssertionError("it began to work")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(AT_WORK_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def found(given: Input, folder: Path) -> str:
    """What of the answer is not as it must be; empty if nothing is."""
    file, out = folder / f"in{given.suffix}", folder / "out"
    if given.content is not None:
        file.write_bytes(given.content)
    names = {"FILE": str(file), "OUT": str(out), "OUT.html": f"{out}.html", "OUT.svg": f"{out}.svg"}
    words = [names.get(word, word) for word in given.words]
    said, told = io.StringIO(), io.StringIO()
    with at_once(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
        try:
            code = main(words)
        except BaseException as error:
            return f"{type(error).__name__}: {error}"
    left = sorted(path.name for path in folder.iterdir() if path != file)
    wrong = _of_answer(given, code, said.getvalue(), told.getvalue(), left)
    for path in folder.iterdir():
        path.unlink() if path.is_file() else shutil.rmtree(path)
    return wrong


def _of_answer(given: Input, code: int, said: str, told: str, left: list[str]) -> str:
    if code == 0 and not given.sure:
        return "" if "Traceback" not in told else told
    if code == 1 and given.words[0] == "replay":  # a recording that tells of another run
        return "" if "Traceback" not in told else told
    if code != 2:
        return f"exit code {code}: {told[-400:]}"
    if given.words[0] == "doctor" and said:  # tells of this machine all the same
        return "" if "fail" in said.lower() and not told else f"told {told[-400:]!r}"
    if said or not told.startswith("grasp: ") or not told.endswith(")\n") or told.count("\n") != 1:
        return f"said {said[:200]!r}, told {told[-400:]!r}"
    if not all(c.isprintable() for c in told[:-1]) or len(told) > 4_000:
        return f"not fit for a terminal: {told[:400]!r}"
    return f"left {left}" if left else ""


def wrong(numbers: range, kept: dict[str, bytes], folder: Path) -> dict[str, str]:
    folder.mkdir(exist_ok=True)
    drawn_from = ((number, drawn(number, kept)) for number in numbers)
    answers = ((f"{number}: {given}", found(given, folder)) for number, given in drawn_from)
    return {given: answer for given, answer in answers if answer}


@pytest.mark.parametrize("first", range(0, QUICK, QUICK // LOTS))
def test_input_that_makes_no_sense_is_refused_and_nothing_is_written(
    first: int, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert wrong(range(first, first + QUICK // LOTS), kept, tmp_path / "work") == {}
    assert [path.name for path in tmp_path.iterdir()] == ["work"]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_five_thousand_more(
    kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert wrong(range(QUICK, ALL), kept, tmp_path / "work") == {}


def test_the_same_number_is_the_same_input(kept: dict[str, bytes]) -> None:
    inputs = [drawn(number, kept) for number in range(QUICK)]
    assert [drawn(number, kept) for number in range(QUICK)] == inputs
    verbs = {given.words[0] for given in inputs}
    assert {"config", "run", "campaign", "replay", "detector", "report", "chart"} <= verbs
    assert sum(given.sure for given in inputs) > QUICK / 2


def test_settings_from_a_good_file_of_one_s_own_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[guard]\nforce_limit_n = 9.0\n", encoding="utf-8")
    assert main(["config", "show", "--config", str(file)]) == 0
    out, err = capsys.readouterr()
    assert "force_limit_n = 9.0" in out and "lab.toml" in out and err == ""
