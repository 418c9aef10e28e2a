"""Input that makes no sense, generated: refused in one line with its exit code, nothing written."""

import contextlib
import csv
import io
import json
import shutil
import signal
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from detector import recordings
from detector.network_file import WEIGHTS
from detector.recordings import Recording
from grasp.cli.main import main
from scenarios.campaign.run import run
from scenarios.campaign.spec import CampaignSpec, Task
from scenarios.campaign.store import CampaignStore
from scenarios.lift import lift
from scenarios.rigs.workers import Workers, outcomes
from scenarios.trial.run_folder import open_trial
from tests.unit.grasp.cli.bad_inputs import (
    READERS_OF_RESULTS,
    READERS_OF_SETTINGS,
    Input,
    drawn,
)
from tests.unit.scenarios.campaign.test_campaign import judged_at_once
from tests.unit.scenarios.conftest import config

QUICK, ALL = 300, 5_300
LOTS = 20
SAMPLES = 300
MOST_TRIALS = 4  # of a campaign that turns out to be a good one
AT_WORK_S = 60  # who is at it for so long has not refused


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Good files of every kind that a verb reads."""
    folder = tmp_path_factory.mktemp("kept")
    result = lift.run(config("controller.lift_height_m=0.02"), 0, folder).result
    assert result is not None and result.recording is not None
    spec = CampaignSpec(name="two", objects=("can", "ball"), repetitions=2)
    run(spec, folder / "a.sqlite", Workers(0), work=judged_at_once)
    t_s = np.arange(SAMPLES) * 0.01
    counts = np.random.default_rng(0).integers(-50, 0, (SAMPLES, 1, 6)).astype(np.int16)
    recording = Recording(t_s, counts, np.zeros(SAMPLES, np.bool_), None, "a test")
    recordings.write(folder / "a.npz", recording)
    found = Path(result.recording).parent
    lines = ["t_s,p0,p1,p2,p3,p4,p5,slip", *(f"{t:.2f},1,2,3,4,5,6,{int(t > 2.0)}" for t in t_s)]
    (folder / "a.csv").write_text("\n".join(lines))
    scores, words = folder / "scores.json", ("detector", "evaluate", "energy", "--recording")
    assert main([*words, str(folder / "a.csv"), "--out", str(scores)]) == 0
    return {
        "a.mcap": (found / "recording.mcap").read_bytes(),
        "result.json": (found / "result.json").read_bytes(),
        "scores.json": scores.read_bytes(),
        "a.sqlite": (folder / "a.sqlite").read_bytes(),
        "a.npz": (folder / "a.npz").read_bytes(),
        "a.csv": (folder / "a.csv").read_bytes(),
        "a.onnx": (WEIGHTS / "tcn.onnx").read_bytes(),
        "a.heads.json": (WEIGHTS / "tcn.heads.json").read_bytes(),
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


@pytest.fixture(autouse=True)
def _begun_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is not refused: a campaign judges a few trials at once, a data set makes nothing."""

    def few(work: object, tasks: Sequence[Task], workers: Workers) -> object:
        return outcomes(judged_at_once, tasks[:MOST_TRIALS], Workers(0))

    monkeypatch.setattr("scenarios.campaign.run.outcomes", few)
    monkeypatch.setattr("scenarios.acquire.datasets.build.build", lambda *words: 0)


def found(given: Input, kept: Mapping[str, bytes], folder: Path) -> str:
    """What of the answer is not as it must be; empty if nothing is."""
    place, out = folder / "in", folder / "out"
    files = {name: kept[which] for name, which in given.beside}
    if given.content is not None:
        files[given.name] = given.content
    for name, content in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(content)
    words = [placed(word, place, place / given.name, out) for word in given.words]
    said, told = io.StringIO(), io.StringIO()
    with at_once(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
        try:
            code = main(words)
        except BaseException as error:
            return f"{type(error).__name__}: {error}"
    left = sorted(path.name for path in folder.iterdir() if path != place)
    now = {str(p.relative_to(place)): p.read_bytes() for p in place.rglob("*") if p.is_file()}
    wrong = _of_answer(given, code, said.getvalue(), told.getvalue(), left)
    if now != files:
        touched = sorted(name for name in now.keys() | files if now.get(name) != files.get(name))
        wrong = f"what was given is not what it was: {touched}"
    if not wrong and code != 2:
        wrong = half_written(given, code, folder)
    for path in folder.iterdir():
        path.unlink() if path.is_file() else shutil.rmtree(path)
    return wrong


def placed(word: str, place: Path, file: Path, out: Path) -> str:
    """A word with the paths that it stands for."""
    if word == "OUT" or word.startswith("OUT."):
        return word.replace("OUT", str(out))
    if word == "IN" or word.startswith("IN/"):
        return word.replace("IN", str(place), 1)
    return word.replace("FILE", str(file)) if word in ("FILE", OF_CALIBRATION) else word


OF_CALIBRATION = "gripper.calibration=FILE"


def a_page(content: bytes) -> None:
    assert content.rstrip().endswith(b"</html>")


def a_table(content: bytes) -> None:
    head, *rows = csv.reader(io.StringIO(content.decode(), newline=""))
    assert head and all(len(row) == len(head) for row in rows)


READ: dict[str, Callable[[bytes], object]] = {
    ".html": a_page, ".svg": ElementTree.fromstring, ".json": json.loads, ".csv": a_table,
    ".toml": lambda content: tomllib.loads(content.decode()),
}  # fmt: skip


def half_written(given: Input, code: int, folder: Path) -> str:
    """What is there of that which was to be written and cannot be read; empty if all can."""
    wanted = {f"out{word[3:]}" for word in given.words if word.startswith("OUT.")}
    there = {path.name for path in folder.iterdir()} - {"in", "out", "out.sqlite.lock"}
    if not there <= wanted or (code == 0 and there != wanted):
        return f"wrote {sorted(there)}, not {sorted(wanted)}"
    try:
        for name in there - {"out.sqlite"}:
            READ[Path(name).suffix]((folder / name).read_bytes())
        if "out.sqlite" in there:
            with CampaignStore.open(folder / "out.sqlite") as store:
                store.rows()
        for path in (folder / "out").rglob("*"):
            if path.suffix == ".json":
                json.loads(path.read_bytes())
            if path.suffix == ".mcap":
                assert open_trial(path) is not None
    except Exception as error:  # whatever reads it says that it is none
        return f"wrote what cannot be read: {type(error).__name__}: {error}"
    return ""


# without being refused: a replay of a recording that tells of another run, and a run, as it went
MAY_END = {"replay": (0, 1), "run": (0, 1, 4)}


def _of_answer(given: Input, code: int, said: str, told: str, left: list[str]) -> str:
    if not given.sure and code in MAY_END.get(given.words[0], (0,)):
        return "" if "Traceback" not in told else told
    if code != 2:
        return f"exit code {code}: {told[-400:]}"
    if given.words[0] == "doctor" and said:  # tells of this machine all the same
        return "" if "fail" in said.lower() and not told else f"told {told[-400:]!r}"
    if given.words[0] == "runs":  # lists the others all the same
        said = "" if said == "[]\n" else said
    if "--json" in given.words and not told:
        answer = json.loads(said)
        is_one = said.count("\n") == 1 and answer["exit_code"] == 2 and answer["error"]["message"]
        return (f"left {left}" if left else "") if is_one else f"said {said[:400]!r}"
    if said or not told.startswith("grasp: ") or not told.endswith(")\n") or told.count("\n") != 1:
        return f"said {said[:200]!r}, told {told[-400:]!r}"
    if not all(c.isprintable() for c in told[:-1]) or len(told) > 4_000:
        return f"not fit for a terminal: {told[:400]!r}"
    return f"left {left}" if left else ""


def wrong(numbers: range, kept: dict[str, bytes], folder: Path) -> dict[str, str]:
    folder.mkdir(exist_ok=True)
    drawn_from = ((number, drawn(number, kept)) for number in numbers)
    answers = ((f"{number}: {given}", found(given, kept, folder)) for number, given in drawn_from)
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
    assert {"runs", "export", "grip-search", "emulate", "dataset", "world"} <= verbs
    assert sum(given.words[:2] == ("config", "show") for given in inputs) < QUICK / 5
    assert sum(given.sure for given in inputs) > QUICK / 3


def test_every_reader_of_a_file_is_drawn(kept: dict[str, bytes]) -> None:
    readers = {words for _, each in READERS_OF_SETTINGS for words in each}
    readers |= {words for each in READERS_OF_RESULTS.values() for words, _, _ in each}
    assert readers <= {drawn(number, kept).words for number in range(ALL)}


def test_a_command_that_spoils_what_it_was_given_is_caught(
    kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def empties(words: list[str]) -> int:
        Path(words[-1]).write_bytes(b"")
        print("grasp: it is none (give another)", file=sys.stderr)
        return 2

    monkeypatch.setattr(f"{__name__}.main", empties)
    assert "not what it was" in found(Input(("replay", "FILE"), b"x"), kept, tmp_path)


def test_a_command_that_leaves_half_a_page_is_caught(
    kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def halves(words: list[str]) -> int:
        Path(words[-1]).write_bytes(b"<html>")
        return 0

    monkeypatch.setattr(f"{__name__}.main", halves)
    given = Input(("report", "FILE", "--out", "OUT.html"), b"x", sure=False)
    assert "cannot be read" in found(given, kept, tmp_path)


def test_settings_from_a_good_file_of_one_s_own_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[guard]\nforce_limit_n = 9.0\n", encoding="utf-8")
    assert main(["config", "show", "--config", str(file)]) == 0
    out, err = capsys.readouterr()
    assert "force_limit_n = 9.0" in out and "lab.toml" in out and err == ""
