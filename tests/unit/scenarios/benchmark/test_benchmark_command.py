"""`grasp benchmark`: its files, its output, and what it refuses before it runs."""

import json
from collections.abc import Callable
from importlib.util import find_spec
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
    return lambda *words: main(["benchmark", *words, "--split", "validation"])


def test_a_repeated_benchmark_gives_the_same_bytes_a_page_and_a_table(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.npz"
    write(clip, toy(1, "test"))
    words = ("energy", "--recording", str(clip), "--out")
    assert benchmark(*words, str(tmp_path / "one")) == 0
    captured = capsys.readouterr()
    heading, row, oracle, *_ = captured.out.splitlines()
    assert heading.startswith("detector  right, %") and row.startswith("energy    ")
    assert oracle.startswith("oracle    100.0") and heading.endswith("AUC, clip.npz")
    assert "energy: of 8 lifts" in captured.out
    assert "energy, lifts: 8 of 8, 0 s left" in captured.err
    assert benchmark(*words, str(tmp_path / "two"), "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["cost"]["energy"]["update_us"] > 0.0
    first, second = ((tmp_path / each / "benchmark.json").read_bytes() for each in ("one", "two"))
    assert first == second
    page = tmp_path / "one" / "benchmark.html"
    assert page.with_suffix(".svg").exists() == bool(find_spec("matplotlib"))
    text = page.read_text()
    for expected in ("energy does", "Everything is simulated", "AUC on clip.npz", "split test: "):
        assert expected in text
    assert main(["report", str(page.parent)]) == 0
    assert page.read_text() == text


def test_what_was_missed_or_not_measured_is_said_in_words(
    benchmark: Run, tmp_path: Path, plugin: Plugin
) -> None:
    silent = plugin("return np.zeros(self.fingers)").detector_name
    assert benchmark(silent, "--out", str(tmp_path)) == 0
    path = tmp_path / "benchmark.json"
    text = score_page(path)
    assert "never / never" in text and "Not given" in text and "None" not in text
    (tmp_path / "cost.json").write_text("{")
    assert "–" in score_page(path)
    path.write_text(path.read_text().replace('"validation"', '"other"'))
    assert main(["report", str(path)]) == 2


def test_an_interrupted_benchmark_keeps_the_detectors_that_ended(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    measure = run.Benchmark.detector

    def interrupted(self: run.Benchmark, config: Any) -> Any:
        if config.detector_name == "psd":
            raise KeyboardInterrupt
        return measure(self, config)

    monkeypatch.setattr(run.Benchmark, "detector", interrupted)
    assert benchmark("energy", "psd", "--out", str(tmp_path)) == 130
    assert f"; 1 of 2 detectors are in {tmp_path}/benchmark.json" in capsys.readouterr().err
    assert measured(tmp_path) == ["energy"]


def measured(folder: Path) -> list[str]:
    file, costs = read_scores(folder / "benchmark.json")
    names = [each.detector for each in file.detectors]
    assert set(names) <= costs.keys()
    return names


def test_a_folder_keeps_the_detectors_of_earlier_benchmarks_of_the_same_protocol(
    benchmark: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("energy", "psd-fair", "energy"):
        assert benchmark(name, "--out", str(tmp_path)) == 0
    assert measured(tmp_path) == ["psd-fair", "energy"]
    path = tmp_path / "benchmark.json"
    path.write_text(path.read_text().replace('"layout": ""', '"layout": "eight"'))
    with locked(tmp_path / ".lock", 0o600, lambda _: GraspError("held")):
        assert benchmark("energy", "--out", str(tmp_path)) == 2
    assert "another benchmark writes to this folder (process " in capsys.readouterr().err
    for content, said in (
        (None, "has results of version 2, split validation, layout eight"),
        ("{", "is no file of scores"),
    ):
        path.write_text(content or path.read_text())
        before = path.read_bytes()
        assert benchmark("energy", "--out", str(tmp_path)) == 2
        assert said in capsys.readouterr().err and path.read_bytes() == before


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
