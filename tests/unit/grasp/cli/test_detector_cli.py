"""`grasp detector` and `grasp chart detectors` on data sets: scores, tuning, tables, a chart."""

import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.network_file import weights_path
from detector.recordings import Recording, write
from detector.scores.cells import LEAST_RECORDINGS, ROWS, SURFACES
from drivers.errors import UsageError
from grasp.cli.detector import must_test
from grasp.cli.main import main
from scenarios.campaign.config import load_config
from tests.unit.detector.networks import write_network
from tests.unit.detector.toys import toy, toys


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("toys")
    for recording in [*toys("validation", 3, 0), *toys("test", 3, 50)]:
        write(folder / f"{recording.source}.npz", recording)
    return folder


def loud(recording: Recording) -> Recording:
    return msgspec.structs.replace(recording, counts=(recording.counts * 6).clip(-1000, 1000))


def answers(capsys: pytest.CaptureFixture[str], *words: str) -> list[dict[str, object]]:
    assert main(list(words)) == 0
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize("verb", ["evaluate", "tune"])
def test_names_and_weights_are_checked_before_any_data_are_read(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder of data is not there, and yet it is not what is told of."""
    fake = tmp_path / "fake.onnx"
    fake.write_text("no network")
    data = ["--data", str(tmp_path / "none")]
    for words, told in (
        (["nosuch"], "nosuch: unknown"),
        ([str(fake)], f"{fake}: no ONNX file, or a damaged one (give"),
        (["tcn", "--set", f"network.weights={fake}"], f"{fake}: no ONNX file"),
    ):
        assert main(["detector", verb, *words, *data]) == 2
        said = capsys.readouterr().err
        assert told in said and "ValueError" not in said


@pytest.mark.parametrize("verb", ["detector table2", "detector table3", "chart detectors"])
def test_studies_check_names_before_any_data_are_read(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    assert main([*verb.split(), "energy", "nosuch", "--data", str(tmp_path / "none")]) == 2
    assert "nosuch: unknown" in capsys.readouterr().err


def test_every_detector_gets_one_json_object(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = answers(
        capsys, "detector", "evaluate", "energy", "psd-fair", "--data", str(data), "--json"
    )
    assert [sheet["detector"] for sheet in found] == ["energy", "psd-fair"]
    for sheet in found:
        assert sheet["recordings"] == 3
        assert sheet["n_samples"] == 3 * 800
        assert set(sheet["false_events_per_min_by_cause"]) == {"slide"}  # type: ignore[arg-type]
        assert {"accuracy", "auc", "delay_ms_p50"} <= set(sheet["intervals"])  # type: ignore[arg-type]


def test_an_evaluation_says_which_weights_and_rule_it_is_of(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the result of a run with them does."""

    def hashed(name: str, *more: str) -> object:
        words = ["detector", "evaluate", name, "--data", str(data), "--json"]
        return answers(capsys, *words, *more)[0]["detector_hash"]

    weights = tmp_path / "other.onnx"
    weights.write_bytes(weights_path("gru").read_bytes())
    packaged = hashed("gru")
    assert packaged == load_config("can", "simulated", "gru").detector_hash()
    assert hashed("gru", "--set", f"network.weights={weights}") == packaged
    assert hashed("gru", "--set", "guard.force_limit_n=8") == packaged
    trained = write_network(tmp_path, "gru", "stream")
    others = {
        packaged,
        hashed("gru", "--set", "rule.release=9"),
        hashed(str(trained)),
        hashed("energy"),
        hashed("energy", "--set", "energy.threshold_counts=9"),
    }
    assert len(others) == 5


def test_label_and_split_are_chosen(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["detector", "evaluate", "energy", "--data", str(data), "--json"]
    (truth,) = answers(capsys, *words, "--label", "slip_true")
    (early,) = answers(capsys, *words, "--split", "validation")
    assert truth["label"] == "slip_true"
    assert truth["confusion"] != early["confusion"]
    assert main([*words[:-1], "--split", "train"]) == 2
    assert "no train recordings" in capsys.readouterr().err


def test_a_person_reads_intervals_and_the_slipping_finger_s_delay(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "evaluate", "energy", "--data", str(data)]) == 0
    text = capsys.readouterr().out
    assert "AUC 0." in text
    assert "[" in text
    assert "caught" in text


def test_a_tuned_rule_is_toml_that_the_next_run_takes(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "tune", "energy", "--data", str(data), "--budget", "12"]) == 0
    path = tmp_path / "tuned.toml"
    path.write_text(capsys.readouterr().out)
    told = rf"# {re.escape(str(data))}: \d+ of \d+ slips apart from blows, \d false in 5\.4 s of a"
    assert re.search(told, path.read_text())
    assert "that is little" in path.read_text()
    words = ["detector", "evaluate", "energy", "--data", str(data), "--split", "validation"]
    (sheet,) = answers(capsys, *words, "--config", str(path), "--json")
    assert sheet["false_events_per_min_hand"] <= 12.0  # type: ignore[operator]


def test_a_budget_of_which_the_rest_at_hand_cannot_hold_one_event_gives_no_rule(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slips = toy(1, "train")
    still = tmp_path / "still.npz"
    write(still, msgspec.structs.replace(slips, slip=np.zeros_like(slips.slip)))
    for source, seconds, event, looser in (
        (["energy", "--data", str(data)], "5.4", "11.2", "12"),
        (["--static", str(still)], "9.0", "6.67", "7"),
    ):
        capsys.readouterr()
        assert main(["detector", "tune", *source, "--budget", "2"]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert f"a budget of 2 a minute cannot be tested: {seconds} s of a hand" in said.err
        assert f"one false event would be {event} a minute" in said.err
        assert f"or --budget {looser})" in said.err
        assert main(["detector", "tune", *source, "--budget", looser]) == 0


@pytest.mark.parametrize("seconds", range(1, 400))
def test_the_looser_budget_that_is_named_is_one_that_can_be_tested(seconds: int) -> None:
    minutes = 1.0 / seconds
    with pytest.raises(UsageError) as refused:
        must_test(minutes, 0.9 * seconds, "more")
    named = int(refused.value.remedy.rpartition(" ")[2])
    must_test(minutes, named, "more")
    assert named <= seconds + 1


def test_recordings_without_any_rest_cannot_test_a_budget_however_loose(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slips = toy(1, "validation")
    write(tmp_path / "a.npz", msgspec.structs.replace(slips, slip=np.ones_like(slips.slip)))
    assert main(["detector", "tune", "energy", "--data", str(tmp_path), "--budget", "600"]) == 2
    said = capsys.readouterr().err
    assert "cannot be tested: 0.0 s of a hand at rest (give more" in said and "--budget" not in said


def test_a_threshold_is_swept_on_the_split_train_and_the_next_run_takes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for recording in toys("train", 4, 20):
        write(tmp_path / f"{recording.source}.npz", recording)
    words = ["detector", "tune", "psd-fair", "--by", "accuracy", "--data", str(tmp_path)]
    (found,) = answers(capsys, *words, "--json")
    assert main(words) == 0
    path = tmp_path / "swept.toml"
    path.write_text(capsys.readouterr().out)
    scored = ["detector", "evaluate", "psd-fair", "--data", str(tmp_path), "--split", "train"]
    (sheet,) = answers(capsys, *scored, "--config", str(path), "--json")
    assert sheet["balanced_accuracy"] == pytest.approx(found["balanced_accuracy"], abs=0.002)
    for worse in ("30", "600"):
        other = ("--set", f"psd_fair.threshold_counts={worse}", "--json")
        (sheet,) = answers(capsys, *scored, *other)
        assert sheet["balanced_accuracy"] < found["balanced_accuracy"]  # type: ignore[operator]


def test_a_network_has_no_threshold_to_sweep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "one.npz", toy(0, "train"))
    words = ["detector", "tune", "gru", "--by", "accuracy", "--data", str(tmp_path)]
    assert main(words) == 2
    assert "one of: energy, psd, psd-fair, forte" in capsys.readouterr().err


def test_a_network_is_not_tuned_without_data(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["detector", "tune", "psd"]) == 2
    assert "--data" in capsys.readouterr().err


def test_the_tables_name_every_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for recording in [*toys("train", 3, 0), *toys("test", 3, 50)]:
        write(tmp_path / f"{recording.source}.npz", recording)
    network = write_network(tmp_path, "gru", "stream")
    words = ["psd", "energy", str(network)]
    assert main(["detector", "table2", *words, "--data", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "| `psd` | 57.4 / " in text
    assert "| `energy` | – / " in text
    assert "| `gru-stream.onnx` | – / " in text
    assert "static: called static" in text
    assert "variance within a label" in text


def test_the_table_of_methods_sweeps_thresholds_on_the_split_train(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recordings in which rest is as loud as slip elsewhere: the packaged threshold hears all."""
    for recording in [
        *(toy(k, "train", loudness=60.0) for k in range(3)),
        *(toy(50 + k, "test", loudness=60.0) for k in range(3)),
    ]:
        write(tmp_path / f"{recording.source}.npz", loud(recording))
    words = ["--data", str(tmp_path)]
    (sheet,) = answers(capsys, "detector", "evaluate", "energy", *words, "--json")
    assert main(["detector", "table2", "energy", *words]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "`energy`" in line)
    swept = float(row.split("|")[2].split("/")[1])
    assert swept > 100 * sheet["accuracy"] + 5  # type: ignore[operator]


def test_cells_without_enough_recordings_are_refused_with_what_to_build(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "table3", "energy", "--data", str(data)]) == 2
    assert "grasp dataset build paper --seed N" in capsys.readouterr().err


def test_the_table_of_cells_sweeps_thresholds_on_other_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rest is as loud as slip elsewhere: the packaged threshold takes all of it for slip."""
    train, cells = tmp_path / "train", tmp_path / "cells"
    train.mkdir(), cells.mkdir()
    write(train / "toy.npz", loud(toy(0, "train", loudness=60.0)))
    keys = [(*row, surface) for row in ROWS for surface in SURFACES]
    for k, (motion, speed, surface) in enumerate(LEAST_RECORDINGS * keys):
        made = loud(toy(k % 7, "test", loudness=60.0))
        told = msgspec.structs.replace(
            made.metadata, motion=motion, speed_mps=speed, surface=surface
        )
        write(cells / f"{k}.npz", msgspec.structs.replace(made, metadata=told))
    words = ["detector", "table3", "energy", "--data", str(cells), "--json"]
    (packaged,), (swept,) = (answers(capsys, *words, *more) for more in
                             ([], ["--swept-on", str(train)]))  # fmt: skip
    means = [np.mean([c["f1"]["value"] for c in found["cells"]]) for found in (packaged, swept)]  # type: ignore[attr-defined]
    assert means[1] > means[0] + 0.05


def test_scores_on_what_packaged_networks_have_learnt_from_are_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = [(*row, surface) for row in ROWS for surface in SURFACES]
    for split, warned in (("train", "140 of 140 recordings are of those"), ("test", "")):
        folder = tmp_path / split
        folder.mkdir()
        for k, (motion, speed, surface) in enumerate(LEAST_RECORDINGS * keys):
            made = toy(k % 7, "test", n=400)
            told = msgspec.structs.replace(
                made.metadata, motion=motion, speed_mps=speed, surface=surface,
                seed=1_000_000 + k, split=split,
            )  # fmt: skip
            write(folder / f"{k}.npz", msgspec.structs.replace(made, metadata=told))
        assert main(["detector", "table3", "energy", "--data", str(folder)]) == 0
        said = capsys.readouterr().err
        assert warned in said if warned else "have learnt" not in said


def test_the_table_of_cells_does_not_sweep_on_what_it_scores(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detector", "table3", "energy", "--data", str(data), "--swept-on", str(data)]
    assert main(words) == 2
    assert "its split train would be swept on and scored" in capsys.readouterr().err


def test_the_chart_leaves_its_numbers_beside_the_picture(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "chart.svg"
    assert (
        main(["chart", "detectors", "energy", "psd", "--data", str(data), "--out", str(out)]) == 0
    )
    drawn = out.read_text()
    assert "human grip reflex" in drawn and f"at what cost: {data.name}, test" in drawn
    assert drawn.count("<!-- psd -->") + drawn.count("<!-- psd (later than 300 ms) -->") == 2
    numbers = json.loads(out.with_suffix(".json").read_text())
    assert set(numbers) == {"energy", "psd"}
    rates = [p["false_per_min"] for p in numbers["energy"]["points"]]
    assert rates == sorted(rates)


def test_a_card_says_what_the_weights_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_network(tmp_path, "gru", "stream", seed=7)
    (found,) = answers(capsys, "detector", "card", str(path), "--json")
    assert (found["name"], found["seed"], found["mode"]) == ("gru", 7, "stream")
    assert main(["detector", "card", "tcm"]) == 2
    told = capsys.readouterr().err
    assert "'tcm' is no network of this project (did you mean 'tcn'?)" in told
    assert "one of freq-cnn-paper, gru, tcn, tcn-paper, or a file that ends in .onnx" in told
    for verb in ("heads", "train-heads"):
        assert main(["detector", verb, "nosuch", "--data", str(tmp_path)]) == 2


@pytest.mark.parametrize(
    ("name", "window", "samples", "shown"),
    [("tcn", 98, 99, "window: 98 samples before the newest\n"),
     ("tcn-paper", 100, 100, "window: 100 samples, the newest among them\n"),
     ("gru", 0, None, "samples: null (all, in a state that fades)\n")],
)  # fmt: skip
def test_a_card_says_which_samples_it_counts(
    name: str, window: int, samples: int | None, shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = answers(capsys, "detector", "card", name, "--json")
    assert (found["window"], found["samples"]) == (window, samples)
    assert main(["detector", "card", name]) == 0
    assert shown in capsys.readouterr().out


def test_a_card_tells_the_threshold_of_scores_from_the_rule_that_is_packaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = answers(capsys, "detector", "card", "tcn", "--json")
    assert (found["threshold"], found["rule"]["threshold"]) == (0.5, 0.7471)
    assert main(["detector", "card", "tcn"]) == 0
    told = capsys.readouterr().out
    assert "threshold: 0.5 (above it a sample reads as slip in scores" in told
    assert "log-odds stays above 0.7471 for 2 samples in a row" in told
    path = write_network(tmp_path, "tcn", "stream")
    assert "rule" not in answers(capsys, "detector", "card", str(path), "--json")[0]


def test_a_card_without_a_name_tells_the_detectors_the_default_and_the_rule_of_each(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["detector", "card"]) == 0
    told = capsys.readouterr().out
    assert "energy: formula; slip is registered when a finger" in told
    assert "tcn (default): network; slip is registered when the probability by the mean" in told
    assert told.count("(default)") == 1
    found = answers(capsys, "detector", "card", "--json")
    assert [sheet["name"] for sheet in found if sheet["default"]] == ["tcn"]
    assert len(found) == len(told.splitlines()) == 7


def test_where_a_formula_and_the_detector_have_their_settings_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words, told in (
        (["detector", "card", "psd-fair"], "`grasp config show psd_fair --detector psd-fair`"),
        (["config", "show", "detector"], "tcn is chosen: its settings are in [network] and [rule]"),
    ):
        assert main(words) == 2
        assert told in capsys.readouterr().err
    assert main(["config", "show", "psd_fair", "--detector", "psd-fair"]) == 0


def test_a_recording_too_short_to_be_scored_is_refused_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "short.npz"
    write(path, toy(0, "test", 100))
    assert main(["detector", "evaluate", "energy", "--recording", str(path)]) == 2
    assert "short.npz has 100 samples" in capsys.readouterr().err.replace(": ", " ")


def test_false_events_are_counted_on_recordings_at_rest_and_one_slip_in_them_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slips = toy(1, "train")
    rest = msgspec.structs.replace(slips, slip=np.zeros_like(slips.slip))
    files = {}
    for name, recording in {"rest": rest, "slips": slips}.items():
        files[name] = tmp_path / f"{name}.npz"
        write(files[name], recording)
    words = ["detector", "tune", "--budget", "7", "--static"]
    assert main([*words, str(files["rest"])]) == 0
    printed = tmp_path / "own.toml"
    printed.write_text(capsys.readouterr().out)
    assert "that is little" in printed.read_text()
    tuned = load_config("can", "simulated", "energy", [printed])
    (found,) = answers(capsys, *words, str(files["rest"]), "--json")
    assert found["minutes"] == pytest.approx(len(rest.t_s) / 6000)
    assert tuned.energy.threshold_counts == pytest.approx(found["threshold_counts"], rel=0.01)
    assert main([*words, str(files["slips"])]) == 2
    assert "holds samples labelled slip" in capsys.readouterr().err
