"""Training learns, repeats, resumes as if never interrupted, and writes what the runtime reads."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from detector.decision import RuleSettings  # noqa: E402
from detector.network import run_network  # noqa: E402
from detector.network_file import read_network  # noqa: E402
from detector.recordings import write  # noqa: E402
from detector.scores.evaluation import evaluate_streams, stream, stream_recordings  # noqa: E402
from detector.training.augment import augment, symmetries  # noqa: E402
from detector.training.export import export  # noqa: E402
from detector.training.fit import Training, TrainingProgress  # noqa: E402
from detector.training.sequences import Windows, crops, digest, fingers_of  # noqa: E402
from detector.training.settings import DEFAULTS, TrainSettings  # noqa: E402
from detector.training.validation import calibration, likelihood, odds_of  # noqa: E402
from drivers.errors import BadFile  # noqa: E402
from grasp.cli.main import main  # noqa: E402
from tests.unit.detector.toys import toys  # noqa: E402

pytestmark = pytest.mark.train

TRAIN, VALIDATION = toys("train", 6, 0), toys("validation", 2, 100)
QUICK = TrainSettings(steps=30, batch=4, crop=60, validations=3)


def training(name: str = "tcn", **changes: object) -> Training:
    settings = msgspec.structs.replace(QUICK, **changes)
    if name not in ("tcn", "gru"):
        settings = msgspec.structs.replace(settings, dense=False, balance="undersample", batch=32)
    return Training(name, settings, TRAIN, VALIDATION, digest(TRAIN))


def ignore(progress: TrainingProgress) -> None:
    """No one watches."""


@pytest.mark.parametrize("name", ["tcn", "gru"])
def test_a_network_learns_to_hear_bursts(name: str, tmp_path: Path) -> None:
    t = training(name, steps=250, batch=8, validations=2)
    t.run(5.0, None, ignore)
    export(t, VALIDATION, tmp_path / "n.onnx", "here")
    loaded = read_network(tmp_path / "n.onnx")
    unseen = toys("test", 2, 200)
    streams = stream_recordings(lambda fingers, taxels: run_network(loaded, fingers), unseen)
    sheet = evaluate_streams(run_network(loaded, 1), RuleSettings(), streams, "toys")
    assert sheet.auc is not None
    assert sheet.auc > 0.9
    assert sheet.ece < 0.15
    assert loaded.card.commit == "here"


def test_a_network_learns_what_has_moved_if_it_is_told_to() -> None:
    moved = [
        msgspec.structs.replace(r, moved_m=np.where(r.slip, 0.002, 0.0).astype(np.float32))
        for r in (*TRAIN, *VALIDATION)
    ]
    for bound_m, share in ((0.001, TRAIN[0].slip.mean()), (0.003, 0.0)):
        settings = msgspec.structs.replace(QUICK, label="moved", moved_m=bound_m)
        learnt = fingers_of(moved[:1], settings.label, settings.moved_m)
        assert learnt.slip_share == pytest.approx(share)
    told = msgspec.structs.replace(QUICK, label="moved", steps=40, validations=1)
    t = Training("tcn", told, moved[: len(TRAIN)], moved[len(TRAIN) :], digest(moved))
    t.run(5.0, None, ignore)
    assert t.best is not None and t.best.accuracy > 0.5


@pytest.mark.parametrize("name", ["tcn", "tcn-paper", "freq-cnn-paper"])
def test_an_interrupted_training_ends_as_one_that_was_not(name: str, tmp_path: Path) -> None:
    whole = training(name)
    whole.run(5.0, None, ignore)

    def interrupt(progress: TrainingProgress) -> None:
        if progress.step == 17:
            raise KeyboardInterrupt

    first = training(name)
    with pytest.raises(KeyboardInterrupt):
        first.run(5.0, tmp_path / "c", interrupt)
    second = training(name)
    second.resume(tmp_path / "c")
    assert second.step == 17
    second.run(5.0, None, ignore)
    assert second.best == whole.best
    for key, value in whole.network.state_dict().items():
        assert torch.equal(value, second.network.state_dict()[key]), key


def test_another_seed_gives_another_network() -> None:
    networks = [training(seed=seed).network.state_dict() for seed in (0, 0, 1)]
    key = "out.weight"
    assert torch.equal(networks[0][key], networks[1][key])
    assert not torch.equal(networks[0][key], networks[2][key])


def test_a_checkpoint_that_is_foreign_or_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c"
    training().save(path)
    with pytest.raises(BadFile, match="another training: seed: 0, now 3") as told:
        training(seed=3).resume(path)
    assert "--force" in told.value.remedy
    with pytest.raises(BadFile, match="another network: tcn, now gru"):
        training("gru").resume(path)
    other = Training("tcn", QUICK, TRAIN, VALIDATION, "others")
    with pytest.raises(BadFile, match="another training: other recordings in --data"):
        other.resume(path)
    torch.save({"identity": "of long ago"}, path)
    with pytest.raises(BadFile, match="other settings, data or another network"):
        training().resume(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(BadFile, match="cannot be read"):
        training().resume(path)
    with pytest.raises(BadFile, match="no such file"):
        training().resume(tmp_path / "none")


def test_a_checkpoint_for_which_there_is_no_room_leaves_nothing_and_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> int:
        path.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space") as told:
        training().save(tmp_path / "mine.checkpoint")
    assert told.value.filename == str(tmp_path / "mine.checkpoint")
    assert list(tmp_path.iterdir()) == []


def test_a_training_cut_off_in_its_last_validation_ends_with_weights_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut(_: Training) -> None:
        raise KeyboardInterrupt

    first = training(steps=2, validations=1)
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Training, "_validate", cut)
        first.run(5.0, tmp_path / "c", ignore)
    second = training(steps=2, validations=1)
    second.resume(tmp_path / "c")
    second.run(5.0, None, ignore)
    assert second.step == 2 and second.best is not None


def test_a_checkpoint_that_would_run_code_is_refused(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> object:
            return (Path.touch, (tmp_path / "ran",))

    torch.save({"identity": Evil()}, tmp_path / "c")
    with pytest.raises(BadFile):
        training().resume(tmp_path / "c")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["tcn", "gru", "tcn-paper", "freq-cnn-paper"])
def test_what_is_exported_streams_what_validation_saw(name: str, tmp_path: Path) -> None:
    t = training(name, steps=4, validations=1)
    t.run(5.0, None, ignore)
    card = export(t, VALIDATION, tmp_path / "n.onnx", "")
    odds = odds_of(t.network, t.arch, VALIDATION[:1])[0]
    expected = 1 / (1 + np.exp(-(odds + card.shift) / card.temperature))
    streamed = stream(run_network(read_network(tmp_path / "n.onnx"), 1), VALIDATION[0].counts)[0]
    assert np.abs(streamed - expected).max() < 1e-5


def test_out_of_time_ends_with_a_usable_network(tmp_path: Path) -> None:
    t = training(steps=10_000, validations=1)
    t.run(0.002, None, ignore)
    assert 0 < t.step < 10_000
    assert t.best is not None


def test_crops_are_learnt_from_after_their_warm_up_or_from_a_reset() -> None:
    fingers = fingers_of(TRAIN, "slip")
    rng = np.random.default_rng(0)
    warm = crops(fingers, rng, 8, 40, 20, fresh=0.0)
    assert warm.counts.shape == (8, 60, 6)
    assert np.all(warm.weights[:, :20] == 0)
    assert np.all(warm.weights[:, 20:] == 1)
    assert np.all(crops(fingers, rng, 8, 40, 20, fresh=1.0).weights == 1)


def test_an_undersampled_epoch_has_as_many_windows_of_each_kind() -> None:
    windows = Windows(fingers_of(TRAIN, "slip"), 100)
    chosen = windows.epoch(np.random.default_rng(0), "undersample")
    assert windows.labels[chosen].mean() == 0.5
    assert len(np.unique(chosen)) == len(chosen)
    batch = windows.take(chosen[:5])
    assert batch.counts.shape == (5, 100, 6)
    assert batch.labels[:, 0].tolist() == windows.labels[chosen[:5]].tolist()


def test_the_paper_s_text_turns_every_way_and_its_code_only_half_way_round() -> None:
    plain = np.tile(np.arange(6, dtype=np.float32) * 100, (400, 3, 1))
    for how, seen in (("paper", {0, 1, 2, 3}), ("as-run", {0, 3})):
        changed = augment(plain, how, np.random.default_rng(0))  # type: ignore[arg-type]
        orders = [np.round(row[0] / 100).astype(int).tolist() for row in changed]
        turns = [symmetries(6).tolist().index(order) for order in orders]
        assert set(turns) == seen
    assert 0.70 < turns.count(3) / 400 < 0.80
    assert np.array_equal(augment(plain, "none", np.random.default_rng(0)), plain)


def test_a_symmetry_done_twice_is_none() -> None:
    for order in symmetries(6):
        assert order[order].tolist() == [0, 1, 2, 3, 4, 5]


def test_calibration_undoes_overconfidence_and_a_wrong_prior() -> None:
    rng = np.random.default_rng(0)
    odds = rng.normal(0, 2, 20_000)
    labels = rng.random(20_000) < 1 / (1 + np.exp(-odds))
    temperature, shift = calibration(odds * 3 + 1.5, labels)
    assert temperature == pytest.approx(3.0, rel=0.1)
    assert shift == pytest.approx(-1.5, abs=0.2)
    assert likelihood(odds, labels) < likelihood(odds * 3 + 1.5, labels)


def test_every_network_has_defaults_that_fit_it() -> None:
    for name, settings in DEFAULTS.items():
        assert settings.dense == (not name.startswith("freq-cnn"))
        assert settings.dense == (settings.balance == "weights")


def test_the_verb_trains_logs_resumes_and_its_weights_are_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for i, recording in enumerate([*TRAIN, *VALIDATION]):
        write(tmp_path / f"{i}.npz", recording)
    out = tmp_path / "mine.onnx"
    words = ["detector", "train", "gru", "--data", str(tmp_path), "--out", str(out)]
    assert main([*words, "--steps", "20"]) == 0
    assert "processor minutes" in capsys.readouterr().out
    assert "validation loss" in out.with_suffix(".log").read_text()
    assert not out.with_suffix(".checkpoint").exists()
    assert main([*words, "--steps", "20", "--resume"]) == 2
    assert "no such file" in capsys.readouterr().err


def test_a_training_is_as_patient_as_it_is_told_to_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for i, recording in enumerate([*TRAIN, *VALIDATION]):
        write(tmp_path / f"{i}.npz", recording)
    made = []
    for patience in ("1", "1000"):
        out = tmp_path / f"{patience}.onnx"
        words = ["detector", "train", "gru", "--data", str(tmp_path), "--out", str(out)]
        asked = ["--steps", "30", "--validations", "30", "--patience", patience]
        assert main([*words, *asked]) == 0
        said = capsys.readouterr().err
        assert ("before its 30 steps: validation stood still (--patience)" in said) == (
            patience == "1"
        )
        made.append(len(out.with_suffix(".log").read_text().splitlines()))
    assert made[0] < made[1] == 30
    assert main([*words[:-1], str(tmp_path / "none.onnx"), "--patience", "0"]) == 2
    assert "--patience" in capsys.readouterr().err
