"""`grasp benchmark`: its files, its output, and what it refuses before it runs."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from detector.recordings import write
from drivers.errors import GraspError
from grasp.cli.main import main
from grasp.files import locked
from scenarios.benchmark import protocol, run, streams
from scenarios.benchmark.score_file import read_scores
from scenarios.report.score_page import score_page
from scenarios.rigs.workers import Workers
from tests.unit.detector.toy_recordings import toy
from tests.unit.scenarios.benchmark.conftest import HERE, Plugin, Recordings

Run = Callable[..., int]
SCORES = "validation/benchmark.json"


@pytest.fixture
def benchmark(
    small: protocol.Protocol, recordings: Recordings, monkeypatch: pytest.MonkeyPatch
) -> Run:
    """`grasp benchmark` with the small protocol, in this process."""

    def built(_: object, __: str, folder: Path, *___: object) -> Recordings:
        folder.mkdir(exist_ok=True)
        return recordings

    monkeypatch.setattr(protocol, "load_protocol", lambda: small)
    monkeypatch.setattr(streams, "ensure_recordings", built)
    monkeypatch.setattr("grasp.cli.benchmark.workers", lambda args: HERE)
    return lambda *words: main(["benchmark", "--split", "validation", *words])


def test_a_repeated_benchmark_gives_the_same_bytes_a_page_and_a_table(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.npz"
    write(clip, toy(1, "test"))
    words = ("energy", "--recording", str(clip), "--out")
    assert benchmark(*words, str(tmp_path / "one")) == 0
    captured = capsys.readouterr()
    heading, row, oracle, silence, *_ = captured.out.splitlines()
    assert heading.split()[:2] == ["detector", "score"] and "AUC, clip.npz" in heading
    assert row.startswith("1. energy own rule and best threshold 0.")
    assert oracle.split()[:2] == ["oracle", "100.0"] and silence.split()[2] == "0.0"
    assert "energy: of 8 lifts" in captured.out and "0 of 0 resolved pairs" in captured.out
    assert "energy, lifts: 8 of 8, 0 s left" in captured.err
    assert benchmark(*words, str(tmp_path / "two"), "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["update_us"]["energy"] > 0.0
    first, second = ((tmp_path / each / SCORES).read_bytes() for each in ("one", "two"))
    assert first == second
    page = (tmp_path / "one" / SCORES).with_suffix(".html")
    assert "score (0: silence" in page.with_suffix(".svg").read_text()
    text = page.read_text()
    for expected in (
        "<h1>energy, own rule and",
        "Everything is simulated",
        "AUC, clip.npz",
    ):
        assert expected in text
    assert main(["report", str(page.parent)]) == 0
    assert page.read_text() == text


def test_what_was_missed_or_not_measured_is_said_in_words(
    benchmark: Run, tmp_path: Path, plugin: Plugin
) -> None:
    silent = plugin("return np.zeros(self.fingers)").detector_name
    assert benchmark(silent, "--out", str(tmp_path)) == 0
    path = tmp_path / SCORES
    text = score_page(path)
    assert "never / never" in text and "None" not in text
    path.with_name("cost.json").write_text("{")
    assert "–" in score_page(path)
    path.write_text(path.read_text().replace('"validation"', '"other"'))
    assert main(["report", str(path)]) == 2


def test_an_interrupted_benchmark_continues_with_the_detectors_that_are_missing(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    measure = run.Benchmark.detector

    stop = ["psd"]
    begun = []

    def interrupted(self: run.Benchmark, config: Any, *more: Any) -> Any:
        if config.detector_name in stop:
            raise KeyboardInterrupt
        begun.append(config.detector_name)
        return measure(self, config, *more)

    monkeypatch.setattr(run.Benchmark, "detector", interrupted)
    words = ("energy", "psd", "--out", str(tmp_path))
    assert benchmark(*words) == 130
    assert f"were measured are in {tmp_path / SCORES}" in capsys.readouterr().err
    assert measured(tmp_path) == ["energy"]
    stop.clear()
    assert benchmark(*words) == 0
    assert begun == ["energy", "psd"] and measured(tmp_path) == begun
    assert "energy is already in " in capsys.readouterr().err


def measured(folder: Path) -> list[str]:
    file, costs = read_scores(folder / SCORES)
    names = [each.detector for each in file.detectors]
    assert set(names) <= costs.keys()
    return names


def test_a_folder_keeps_the_detectors_of_earlier_benchmarks_of_the_same_protocol(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (("energy",), ("psd-fair",), ("energy", "--set", "rule.threshold=0.6")):
        assert benchmark(*words, "--out", str(tmp_path)) == 0
    assert measured(tmp_path) == ["psd-fair", "energy"]
    path = tmp_path / SCORES
    ranks, lifts, *_ = score_page(path).split("<tbody>")[1:]
    assert "Right: the object is held and whole" in lifts
    first = min(("psd-fair", "energy"), key=ranks.index)
    assert min(("psd-fair", "energy"), key=lifts.index) == first
    path.write_text(path.read_text().replace('"version":3', '"version":2', 1))
    with locked(tmp_path / ".lock", 0o600, lambda _: GraspError("held")):
        assert benchmark("energy", "--out", str(tmp_path)) == 2
    assert "another benchmark writes to this folder (process " in capsys.readouterr().err
    for content, said in (
        (None, "has results of version 2"),
        ("{", "is no file of scores"),
    ):
        path.write_text(content or path.read_text())
        before = path.read_bytes()
        assert benchmark("energy", "--out", str(tmp_path)) == 2
        assert said in capsys.readouterr().err and path.read_bytes() == before


def test_the_split_test_takes_the_threshold_that_validation_has_chosen(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    test = ("energy", "--split", "test", "--out", str(tmp_path))
    assert benchmark(*test) == 2
    assert "first run the same with --split validation" in capsys.readouterr().err
    assert benchmark("energy", "--out", str(tmp_path)) == 0
    best = read_scores(tmp_path / SCORES)[0].detectors[0].best
    monkeypatch.setattr(run, "within_budget", lambda _: pytest.fail("test has chosen"))
    assert benchmark(*test) == 0
    found = read_scores(tmp_path / "test" / "benchmark.json")[0].detectors[0].best
    assert best and found and found.threshold == best.threshold


def test_a_quick_run_has_a_quarter_of_the_trials_and_its_own_file(
    benchmark: Run, tmp_path: Path
) -> None:
    assert benchmark("energy", "--quick", "--out", str(tmp_path)) == 0
    path = tmp_path / "validation-quick" / "benchmark.json"
    assert len(read_scores(path)[0].detectors[0].rows[0].trials.lifts) == 2
    assert "not comparable with a full run" in score_page(path)


def test_impossible_requests_are_refused_before_anything_runs(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], plugin: Plugin
) -> None:
    good, eight, bare = toy(1, "test"), tmp_path / "eight.npz", tmp_path / "bare.npz"
    wider = np.concatenate([good.counts, good.counts[:, :, :2]], axis=2)
    write(eight, msgspec.structs.replace(good, counts=wider))
    write(bare, msgspec.structs.replace(good, labelled=False))
    raises = plugin("return 1 / 0").detector_name
    out = ("--out", str(tmp_path / "out"))
    for words, said in (
        (("tcm", *out), "did you mean 'tcn'"),
        ((raises, *out), "mine.py, line 15: update raised ZeroDivisionError"),
        (("tcn", "--recording", str(bare), *out), "slip"),
        (("tcn", "--recording", str(eight), *out), "eight.npz: detector 'tcn' was made for"),
        (("tcn", "--layout", "eight", *out), "taxels"),
        (("tcn", "--set", "guard.force_limit_n=8", *out), "sets guard, which the protocol"),
        (("tcn", "--out", "/proc/none"), "'/proc/none': cannot be written"),
    ):
        assert benchmark(*words) == 2, words
        error = capsys.readouterr().err
        assert said in error and "(" in error, error
    assert not (tmp_path / "out").exists()


def test_a_detector_that_never_returns_is_ended_and_named(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], plugin: Plugin,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    name = plugin("import threading", "threading.Event().wait()").detector_name
    waited: list[float] = []

    def wait(futures: Any, timeout_s: float, _: str) -> SimpleNamespace:
        waited.append(timeout_s)
        return SimpleNamespace(done=set())

    monkeypatch.setattr("scenarios.rigs.workers.wait", wait)
    monkeypatch.setattr("grasp.cli.benchmark.workers", lambda args: Workers(1))
    assert benchmark(name, "--out", str(tmp_path)) == 2
    assert f"{name}: no result for 5 minutes" in capsys.readouterr().err
    assert sum(waited) == 300.0
