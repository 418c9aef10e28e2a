"""Recording files: written and read back; anything else is refused with a remedy."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from detector import recordings
from detector.recordings import Metadata, Recording, read, read_dataset, write
from drivers.errors import BadFile

METADATA = Metadata(
    set="slide", split="train", surface="sphere", motion="oblique", speed_mps=0.075,
    spin_radps=0.0, direction="135", seed=7, parameters={"depth_mm": 4.2}, commit="abc",
)  # fmt: skip
OPTIONAL = ("contact_speed_mps", "contact_turn_radps", "velocity_mps", "spin_radps", "moved_m")


def recording(samples: int = 5, fingers: int = 1, **changes: Any) -> Recording:
    rng = np.random.default_rng(samples)
    made = Recording(
        t_s=np.arange(samples) * 0.01,
        counts=rng.integers(-400, 50, (samples, fingers, 6)).astype(np.int16),
        slip=rng.random(samples) > 0.5,
        slip_true=rng.random(samples) > 0.5,
        source="here",
        metadata=METADATA,
        contact_speed_mps=rng.random(samples).astype(np.float32),
        contact_turn_radps=rng.random(samples).astype(np.float32),
        velocity_mps=rng.random((samples, 2)).astype(np.float32),
        spin_radps=rng.random(samples).astype(np.float32),
        moved_m=rng.random(samples).astype(np.float32),
    )
    return msgspec.structs.replace(made, **changes)


def refused(path: Path) -> BadFile:
    with pytest.raises(BadFile) as caught:
        read(path)
    assert caught.value.file == str(path)
    assert caught.value.remedy
    return caught.value


def rewrite(path: Path, **changes: Any) -> None:
    """The file with some arrays replaced, or left out for None."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files} | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "a.npz"
    write(path, recording())
    return path


def test_labels_are_chosen_by_name() -> None:
    r = recording(moved_m=np.array([0.0, 0.0005, 0.0015, 0.003, 0.0], np.float32))
    assert r.label("moved").tolist() == [False, False, True, True, False]
    assert r.label("slip") is r.slip
    with pytest.raises(BadFile, match="has no moved"):
        recording(moved_m=None).label("moved")


def test_recording_is_read_back_unchanged(tmp_path: Path) -> None:
    for fingers in [1, 3]:
        path = tmp_path / "a.npz"
        written = recording(fingers=fingers)
        write(path, written)
        back = read(path)
        for name in ("t_s", "counts", "slip", "slip_true", *OPTIONAL):
            array = getattr(back, name)
            np.testing.assert_array_equal(array, getattr(written, name))
            assert array.dtype == getattr(written, name).dtype, fingers
            assert not array.flags.writeable, fingers
        assert back.metadata == METADATA, fingers
        assert back.source == str(path), fingers


def test_missing_arrays_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    nothing = dict.fromkeys(("slip_true", "metadata", *OPTIONAL))
    write(path, recording(**nothing))
    back = read(path)
    assert all(getattr(back, name) is None for name in nothing)


def test_a_data_set_is_read_sorted_whole_or_by_split(tmp_path: Path) -> None:
    for name, split in (("b/2", "test"), ("a/1", "train"), ("c", "train")):
        path = tmp_path / f"{name}.npz"
        path.parent.mkdir(exist_ok=True)
        write(path, recording(metadata=msgspec.structs.replace(METADATA, split=split)))
    (tmp_path / "a/.1.npz.99").write_bytes(b"partial file of a killed process")
    names = [Path(r.source).relative_to(tmp_path).as_posix() for r in read_dataset(tmp_path)]
    assert names == ["a/1.npz", "b/2.npz", "c.npz"]
    assert len(read_dataset(tmp_path, "train")) == 2
    with pytest.raises(BadFile, match="no validation recordings"):
        read_dataset(tmp_path, "validation")


def test_a_recording_without_metadata_belongs_to_no_split(tmp_path: Path) -> None:
    write(tmp_path / "a.npz", recording(metadata=None))
    with pytest.raises(BadFile, match="belongs to no split"):
        read_dataset(tmp_path, "train")


def test_flipped_bytes_are_refused(good: Path) -> None:
    whole = bytearray(good.read_bytes())
    for at in range(200, 230):
        whole[at] ^= 0xFF
    good.write_bytes(bytes(whole))
    refused(good)


def test_a_bad_header_is_refused(good: Path) -> None:
    for header, problem in [
        ("{", "bad header"),
        ("[]", "bad header"),
        ('{"a":' * 100_000, "bad header"),
        ("\ud800", "bad header"),
        (
            '{"format": "grasp-recording", "version": 1, "metadata": null}',
            "value 1 - at `$.version`",
        ),
        ('{"format": "other", "version": 2, "metadata": null}', "'other' - at `$.format`"),
        ('{"format": "grasp-recording", "version": 2, "metadata": {}}', "bad header"),
    ]:
        rewrite(good, header=np.array(header))
        assert problem in refused(good).problem, (header, problem)


def test_arrays_of_gigabytes_are_refused_unread(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings, "MOST_BYTES", 100_000)
    rewrite(good, counts=np.zeros((10_000, 3, 6), np.int16))
    assert "bytes, more than 100000" in refused(good).problem


def test_wrong_arrays_are_refused(good: Path) -> None:
    whole = good.read_bytes()
    for changes, problem in [
        ({"slip": np.zeros(5, np.int64)}, "slip is int64"),
        ({"slip": np.zeros(4, np.bool_)}, "slip is bool"),
        ({"counts": np.zeros((5, 6), np.int16)}, "counts is"),
        ({"counts": np.zeros((5, 0, 6), np.int16)}, "counts is"),
        ({"counts": np.full((5, 1, 6), -1024, np.int16)}, "counts beyond"),
        ({"counts": np.full((5, 1, 6), np.iinfo(np.int16).min, np.int16)}, "counts beyond"),
        ({"t_s": np.zeros(5)}, "time does not increase"),
        ({"t_s": np.array([0, 0.01, 0.02, 0.03, np.nan])}, "t_s holds"),
        ({"t_s": np.array([0, 0.01, 0.02, 0.03, 0.2])}, "samples are missing"),
        ({"t_s": np.array(0.0)}, "0 samples"),
        ({"spin_radps": np.full(5, np.inf, np.float32)}, "spin_radps holds"),
        ({"velocity_mps": np.zeros((5, 3), np.float32)}, "velocity_mps is"),
        ({"extra": np.zeros(5)}, "unknown arrays extra"),
    ]:
        good.write_bytes(whole)
        rewrite(good, **changes)
        assert problem in refused(good).problem, (changes, problem)


def test_recording_that_could_not_be_read_back_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="slip is"):
        write(tmp_path / "a.npz", recording(slip=np.zeros(4, np.bool_)))
    with pytest.raises(BadFile, match="suffix"):
        write(tmp_path / "a.csv", recording())
    assert not list(tmp_path.iterdir())


def test_an_interrupted_write_leaves_the_old_file(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = good.read_bytes()

    def fail(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(KeyboardInterrupt):
        write(good, recording(samples=9))
    assert good.read_bytes() == before
    assert len(list(good.parent.iterdir())) == 1
