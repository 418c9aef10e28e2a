"""Input that makes no sense, generated: refused in one line with its exit code, nothing written."""

import contextlib
import csv
import io
import json
import os
import re
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
from grasp.messages import CONTROL
from scenarios.campaign.run import run
from scenarios.campaign.spec import CampaignSpec, Task
from scenarios.campaign.store import CampaignStore, is_database
from scenarios.lift import lift
from scenarios.rigs.workers import Workers, outcomes
from scenarios.trial.run_folder import open_trial
from tests.unit.grasp.cli.bad_inputs import (
    READERS_OF_RESULTS,
    READERS_OF_SETTINGS,
    Input,
    drawn,
    packaged,
    settings,
    settings_of_acquisition,
    takes_values,
    title,
)
from tests.unit.scenarios.campaign.test_campaign import judged_at_once
from tests.unit.scenarios.conftest import config

QUICK, ALL = 300, 5_300
LOT, SLOW_LOT = 15, 50
SAMPLES = 300
MOST_TRIALS = 4  # of a campaign that turns out to be a good one
ASKED: list[int] = []  # how many trials a campaign has judged
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
        ASKED.append(len(tasks[:MOST_TRIALS]))
        return outcomes(judged_at_once, tasks[:MOST_TRIALS], Workers(0))

    monkeypatch.setattr("scenarios.campaign.run.outcomes", few)
    monkeypatch.setattr("scenarios.acquire.datasets.build.build", lambda *words: 0)


def found(given: Input, kept: Mapping[str, bytes], folder: Path) -> str:
    """What of the answer is not as it must be; empty if nothing is."""
    place, out, here = folder / "in", folder / "out", folder / "at" / "this" / "place"
    here.mkdir(parents=True)  # deep, so that what climbs up is seen
    files = {
        name: kept[which] if which in kept else packaged(which) for name, which in given.beside
    }
    if given.content is not None:
        files[given.name] = given.content
    for name, content in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(content)
    words = [placed(word, place, place / given.name, out) for word in given.words]
    said, told = io.StringIO(), io.StringIO()
    ASKED.clear()
    with contextlib.chdir(here), at_once():
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
            try:
                code = main(words)
            except BaseException as error:
                shutil.rmtree(folder)
                return f"{type(error).__name__}: {error}"
        left = sorted(str(p.relative_to(folder)) for p in written(folder))
        wrong = _of_answer(given, code, said.getvalue(), told.getvalue(), left)
        now = {str(p.relative_to(place)): p.read_bytes() for p in place.rglob("*") if p.is_file()}
        if now != files:
            names = now.keys() | files
            touched = sorted(name for name in names if now.get(name) != files.get(name))
            wrong = f"what was given is not what it was: {touched}"
        if not wrong and code != 2:
            wrong = half_written(words, code, folder)
    shutil.rmtree(folder)
    return wrong


def written(folder: Path) -> list[Path]:
    """Files and folders that are there and were not given; the working folder is there."""
    here = folder / "at" / "this" / "place"
    return [
        path for path in folder.rglob("*")
        if path != folder / "in" and folder / "in" not in path.parents
        and path not in (here, *here.parents)
    ]  # fmt: skip


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
OF_A_RUN = re.compile(r"recording\.mcap|result\.json")
OF_AN_ACQUISITION = re.compile(r"recording\.mcap|result\.json|samples(-\d+)?\.npz")


def option(words: Sequence[str], name: str) -> Path | None:
    """The path that it names, from the working folder; None where it is not there."""
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if word == name or word.startswith(f"{name}="):
            return Path(os.path.abspath(after if word == name else word[len(name) + 1 :]))
    return None


def half_written(words: Sequence[str], code: int, folder: Path) -> str:
    """What was written that should not be there, is not whole or lacks; empty if all is well. In
    the working folder of who wrote."""
    try:
        _check_written(words, code, folder)
    except Exception as error:  # whatever reads it says that it is none
        return f"wrote what is not whole: {type(error).__name__}: {error}"
    return ""


def _check_written(words: Sequence[str], code: int, folder: Path) -> None:
    there = {path for path in written(folder) if not path.is_dir()}
    out = option(words, "--out") or option(words, "--write")
    runs = option(words, "--runs") if words[0] == "run" else None
    folders = [] if runs is None or not runs.is_dir() else [p for p in runs.iterdir() if p != out]
    rows = None
    if words[0] == "dataset":  # which makes nothing here
        out = None
    if out is not None and (list(words[:2]) == ["campaign", "run"] or runs is not None):
        there -= {out.with_name(f"{out.name}.lock")}
        rows = _rows_of(out) if out in there else None
    elif out is not None and out in there:
        _check_file(words, out)
    if out is not None and (code == 0 or rows is not None):
        assert out in there, f"nothing at {out.name[:40]}"
        there -= {out}
    for each in folders:
        there -= _of_a_run(each, OF_AN_ACQUISITION if words[1] == "acquire" else OF_A_RUN)
    assert not there, f"{sorted(str(path.relative_to(folder))[-80:] for path in there)} beside it"
    _check_count(words, code, len(folders), rows)


def _check_count(words: Sequence[str], code: int, folders: int, rows: int | None) -> None:
    """Whether all that was done is there."""
    if list(words[:2]) == ["campaign", "run"]:
        assert rows == sum(ASKED), f"{rows} rows of {sum(ASKED)}"
    if words[0] != "run":
        return
    trials = int(words[words.index("--trials") + 1]) if "--trials" in words else 1
    most = trials if code in (0, 1) else folders  # a safety stop ends a series
    assert folders == most <= trials, f"{folders} runs of {trials}"
    assert rows in (None, folders), f"{rows} rows of {folders}"


def _of_a_run(folder: Path, names: re.Pattern[str]) -> set[Path]:
    """All files of a run's folder, each of which is whole."""
    files = {path.name: path for path in folder.iterdir()}
    strays = sorted(name for name in files if not names.fullmatch(name))
    assert not strays, f"{strays} in the folder of a run"
    assert {"recording.mcap", "result.json"} <= files.keys(), f"only {sorted(files)} of a run"
    result = json.loads(files["result.json"].read_bytes())
    assert result["outcome"] and result["versions"]
    if "samples-1.npz" in files or "samples.npz" in files:
        assert [recordings.read(path) for name, path in files.items() if name.endswith(".npz")]
    else:
        assert open_trial(folder / "recording.mcap").complete
    return set(files.values())


def _rows_of(file: Path) -> int:
    with CampaignStore.open(file) as store:
        return len(store.rows())


def _check_file(words: Sequence[str], file: Path) -> None:
    """Whether it can be read, and a table has as many rows as what it tells of."""
    content = file.read_bytes()
    exported = words[0] == "report" and file.suffix == ".csv"
    READ[".csv" if exported else file.suffix](content)
    if not exported:
        return
    of = Path(next(word for word in words[1:] if Path(word).is_absolute()))
    told = _rows_of(of) if is_database(of) else len(list(open_trial(of).of(CONTROL)))
    rows = len(list(csv.reader(io.StringIO(content.decode(), newline="")))) - 1
    assert rows == told, f"{rows} rows of {told}"


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
    drawn_from = ((number, drawn(number, kept)) for number in numbers)
    answers = ((f"{number}: {given}", found(given, kept, folder)) for number, given in drawn_from)
    return {given: answer for given, answer in answers if answer}


@pytest.mark.parametrize("first", range(0, QUICK, LOT))
def test_input_that_makes_no_sense_is_refused_and_nothing_is_written(
    first: int, kept: dict[str, bytes], tmp_path: Path
) -> None:
    assert wrong(range(first, first + LOT), kept, tmp_path / "work") == {}


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("first", range(QUICK, ALL, SLOW_LOT))
def test_five_thousand_more(first: int, kept: dict[str, bytes], tmp_path: Path) -> None:
    """In lots, so that several can work on them and little is lost by who is interrupted:
    ``-k 'more[300]'`` is the first, and ``--last-failed`` what was left."""
    assert wrong(range(first, first + SLOW_LOT), kept, tmp_path / "work") == {}


def test_the_same_number_is_the_same_input(kept: dict[str, bytes]) -> None:
    inputs = [drawn(number, kept) for number in range(QUICK)]
    assert [drawn(number, kept) for number in range(QUICK)] == inputs
    verbs = {given.words[0] for given in inputs}
    assert {"config", "run", "campaign", "replay", "detector", "report"} <= verbs
    assert {"runs", "emulate", "dataset", "calibrate"} <= verbs
    assert sum(given.words[0] == "config" for given in inputs) < QUICK / 5
    assert sum(given.sure for given in inputs) > QUICK / 3


def test_every_reader_of_a_file_is_drawn(kept: dict[str, bytes]) -> None:
    readers = {words for _, each in READERS_OF_SETTINGS for words in each}
    readers |= {words for each in READERS_OF_RESULTS.values() for words, _, _ in each}
    assert readers <= {drawn(number, kept).words for number in range(ALL)}


def test_every_setting_and_every_value_of_every_verb_is_drawn(kept: dict[str, bytes]) -> None:
    tried = {drawn(number, kept).tries for number in range(ALL)}
    leaves = (*settings(), *settings_of_acquisition())
    assert {".".join(leaf.way) for leaf in leaves} <= tried
    assert {title(verb, action) for verb, action in takes_values()} <= tried


def answers(
    monkeypatch: pytest.MonkeyPatch, code: int, told: str = "", **files: bytes | None
) -> None:
    """A command that says and leaves this. A file's name is its path, with __ for /; where there
    is no content a folder."""

    def pretends(words: list[str]) -> int:
        folder = Path.cwd().parents[2]
        for name, content in files.items():
            path = folder / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.mkdir() if content is None else path.write_bytes(content)
        print(told, end="", file=sys.stderr)
        return code

    monkeypatch.setattr(f"{__name__}.main", pretends)


REFUSED = "grasp: it is none (give another)\n"
A_RUN = {"recording.mcap": "a.mcap", "result.json": "result.json"}
ONE_RUN = ("run", "lift", "--rig", "simulated", "--runs", "OUT")


@pytest.mark.parametrize(
    ("told", "code"),
    [
        (REFUSED, 0), (REFUSED, 1), (REFUSED, 5), ("", 2), ("grasp: it is none\n", 2),
        (REFUSED * 2, 2), (f"working\n{REFUSED}", 2), ("grasp: \x1b[2J (x)\n", 2),
        (f"grasp: {'x' * 5_000} (x)\n", 2), ("Traceback (most recent call last):\n", 2),
    ],
)  # fmt: skip
def test_an_answer_that_does_not_refuse_in_one_line_is_caught(
    told: str, code: int, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = Input(("replay", "FILE"), b"x")
    answers(monkeypatch, 2, REFUSED)
    assert found(given, kept, tmp_path / "work") == ""
    answers(monkeypatch, code, told)
    assert found(given, kept, tmp_path / "work") != ""


@pytest.mark.parametrize("name", ["in__in.toml", "in__more", "at__this__place__x", "at__x", "out"])
def test_a_command_that_refuses_and_writes_is_caught(
    name: str, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, 2, REFUSED, **{name: b""})
    assert found(Input(("replay", "FILE"), b"x"), kept, tmp_path / "work") != ""


@pytest.mark.parametrize("sure", [True, False])
def test_an_empty_folder_that_a_refused_command_leaves_is_caught(
    sure: bool, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, 2, REFUSED, out=None)
    assert "left ['out']" in found(Input(ONE_RUN, sure=sure), kept, tmp_path / "work")


@pytest.mark.parametrize("code", [0, 1])
@pytest.mark.parametrize(
    "broken",
    [
        {"out__a__result.json.tmp": b"{}"}, {"out__a__recording.mcap.part": b""},
        {"out__a__samples.npz": b""}, {"out__b": None}, {"out__b__result.json": b"{}"},
        {"out__a__result.json": b"{"}, {"out__a__result.json": b"{}"},
        {"out__a__recording.mcap": b""}, {"out__x": b""}, {"at__this__place__x": b""},
        {"at__x": b""}, {"out__a__x": None},
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_run_that_leaves_a_part_or_more_than_a_run_is_caught(
    code: int, broken: dict[str, bytes | None], kept: dict[str, bytes], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    whole: dict[str, bytes | None] = {f"out__a__{name}": kept[of] for name, of in A_RUN.items()}
    given = Input(ONE_RUN, sure=False)
    answers(monkeypatch, code, **whole)
    assert found(given, kept, tmp_path / "work") == ""
    answers(monkeypatch, code, **whole | broken)
    assert "not whole" in found(given, kept, tmp_path / "work")


@pytest.mark.parametrize("cut", [0.2, 0.5, 0.9])
def test_a_run_whose_recording_was_cut_off_is_caught(
    cut: float, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = kept["a.mcap"][: int(cut * len(kept["a.mcap"]))]
    files = {"out__a__recording.mcap": part, "out__a__result.json": kept["result.json"]}
    answers(monkeypatch, 0, **files)
    assert "not whole" in found(Input(ONE_RUN, sure=False), kept, tmp_path / "work")


@pytest.mark.parametrize(
    ("words", "given"),
    [
        (ONE_RUN, ()), ((*ONE_RUN, "--trials", "2", "--out", "OUT.sqlite"), ()),
        (("campaign", "run", "FILE", "--out", "OUT.sqlite"), ()),
        (("report", "IN/a.sqlite", "--out", "OUT.html"), ("a.sqlite",)),
        (("report", "IN/a.mcap", "--out", "OUT.csv"), ("a.mcap",)),
    ],
)  # fmt: skip
def test_a_command_that_ends_well_and_leaves_nothing_is_caught(
    words: tuple[str, ...], given: tuple[str, ...], kept: dict[str, bytes], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    answers(monkeypatch, 0)
    monkeypatch.setattr(f"{__name__}.ASKED", [2])
    of = Input(words, b"x", sure=False, beside=tuple((name, name) for name in given))
    assert found(of, kept, tmp_path / "work") != ""


@pytest.mark.parametrize(
    ("name", "half"),
    [
        ("out.html", b"<html>"), ("out.svg", b"<svg><g>"), ("out.json", b'{"a": 1'),
        ("out.toml", b"a = "), ("out.csv", b"a,b\n1\n"),
    ],
)  # fmt: skip
def test_half_a_page_picture_or_file_is_caught(
    name: str, half: bytes, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = Input(("report", "FILE", "--out", f"OUT{name[3:]}"), b"x", sure=False)
    answers(monkeypatch, 0, **{name: half})
    assert "not whole" in found(given, kept, tmp_path / "work")


@pytest.mark.parametrize("which", ["a.mcap", "a.sqlite"])
def test_a_table_cut_at_the_end_of_a_line_is_caught(
    which: str, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / which).write_bytes(kept[which])
    assert main(["report", str(tmp_path / which), "--out", str(tmp_path / "out.csv")]) == 0
    lines = (tmp_path / "out.csv").read_bytes().splitlines(keepends=True)
    words = ("report", f"IN/{which}", "--out", "OUT.csv")
    given = Input(words, sure=False, beside=((which, which),))
    answers(monkeypatch, 0, **{"out.csv": b"".join(lines)})
    assert found(given, kept, tmp_path / "work") == ""
    answers(monkeypatch, 0, **{"out.csv": b"".join(lines[:-1])})
    assert "rows of" in found(given, kept, tmp_path / "work")


@pytest.mark.parametrize("trials", ["1", "3"])
def test_a_series_with_other_rows_than_trials_is_caught(
    trials: str, kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (*ONE_RUN, "--trials", trials, "--out", "OUT.sqlite")
    runs = {f"out__{k}__{name}": kept[of] for k in range(int(trials)) for name, of in A_RUN.items()}
    answers(monkeypatch, 0, **{"out.sqlite": kept["a.sqlite"]}, **runs)
    assert "rows of" in found(Input(words, sure=False), kept, tmp_path / "work")


def test_settings_from_a_good_file_of_one_s_own_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[guard]\nforce_limit_n = 9.0\n", encoding="utf-8")
    assert main(["config", "--config", str(file)]) == 0
    out, err = capsys.readouterr()
    assert "force_limit_n = 9.0" in out and "lab.toml" in out and err == ""
