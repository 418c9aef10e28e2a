"""CSV recordings: read unchanged, or refused with file, line, problem and remedy."""

import os
from pathlib import Path

import numpy as np
import pytest

from detector.recordings import Recording, missed_samples, read, read_csv
from drivers.errors import BadFile

HEADER = "t_s,p0,p1,p2,p3,p4,p5,slip"
GOOD = (HEADER, "0.00,-6,52,-158,-125,-24,-1,0", "0.01,-5,52,-158,-125,-24,-1,1")


def write(folder: Path, *lines: str) -> Path:
    path = folder / "tip.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def row(t_s: float, first: object = 0, slip: object = 0) -> str:
    return f"{t_s},{first},0,0,0,0,0,{slip}"


def refused(folder: Path, *lines: str) -> BadFile:
    path = write(folder, *lines)
    with pytest.raises(BadFile) as caught:
        read_csv(path)
    assert caught.value.file == str(path)
    assert caught.value.remedy
    return caught.value


def test_csv_is_read_unchanged(tmp_path: Path) -> None:
    path = write(tmp_path, *GOOD)
    r = read_csv(path)
    assert r.t_s.tolist() == [0.0, 0.01]
    assert r.counts.dtype == np.int16
    assert r.counts.tolist() == [[[-6, 52, -158, -125, -24, -1]], [[-5, 52, -158, -125, -24, -1]]]
    assert r.slip.tolist() == [False, True]
    assert r.slip_true is None
    assert (r.fingers, r.source) == (1, str(path))


def test_true_labels_are_read_if_they_are_there(tmp_path: Path) -> None:
    r = read_csv(write(tmp_path, HEADER + ",slip_true", row(0.0) + ",1", row(0.01) + ",0"))
    assert r.slip_true is not None
    assert r.slip_true.tolist() == [True, False]
    assert r.slip.tolist() == [False, False]


def test_byte_order_mark_crlf_and_blank_lines_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "tip.csv"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join((*GOOD, "", "")).encode())
    assert len(read_csv(path).t_s) == 2


def test_jittered_times_are_kept_and_one_long_step_is_one_missed_sample(tmp_path: Path) -> None:
    times = [0.0, 0.0062, 0.0193, 0.0386, 0.05]
    r = read_csv(write(tmp_path, HEADER, *map(row, times)))
    assert r.t_s.tolist() == times
    assert missed_samples(r.t_s).sum() == 1


def test_too_many_missed_samples_in_a_row_are_refused(tmp_path: Path) -> None:
    error = refused(tmp_path, HEADER, *map(row, [0.0, 0.01, 0.08]))
    assert (error.line, error.problem) == (4, "6 samples are missing before this")


def test_what_is_no_regular_file_is_refused_unread(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in ("/dev/zero", tmp_path / "pipe"):
        with pytest.raises(BadFile, match="is not a regular file"):
            read(path)
    with pytest.raises(BadFile, match="is a folder"):
        read(tmp_path)


def test_quotes_and_other_delimiters_are_read_and_decimal_commas_refused(tmp_path: Path) -> None:
    expected = read_csv(write(tmp_path, *GOOD)).counts.tolist()
    for delimiter in ",;\t":
        lines = [delimiter.join(f'"{cell}"' for cell in line.split(",")) for line in GOOD]
        assert read_csv(write(tmp_path, *lines)).counts.tolist() == expected, delimiter
    error = refused(tmp_path, *(line.replace(",", ";").replace(".", ",") for line in GOOD))
    assert (error.line, error.problem) == (2, "'0,00' has a comma as the decimal sign")


def test_times_in_other_units_are_named(tmp_path: Path) -> None:
    for unit, factor in [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)]:
        for hz in (50, 100, 500):
            rows = [row(round(k * factor / hz)) for k in range(30)]
            error = refused(tmp_path, HEADER, *rows)
            assert error.problem.startswith(f"timestamps look like {unit}"), (unit, hz)
            assert "resample" not in error.remedy


def test_wrong_columns_are_refused(tmp_path: Path) -> None:
    for header in ["t_s,p0,p2,slip", HEADER + ",speed", row(0.0)]:
        error = refused(tmp_path, header, row(0.0), row(0.01))
        assert error.line == 1, header
        assert HEADER in error.remedy, header


def test_a_bad_row_is_refused_with_its_line(tmp_path: Path) -> None:
    for line, problem in [
        ("0.01,1,2", "3 columns"),
        (row(0.01, "x"), "p0 is 'x'"),
        (row(0.01, ""), "p0 is ''"),
        (row(0.01, "nan"), "p0 is 'nan'"),
        (row(0.01, "2.5"), "p0 is '2.5'"),
        (row(0.01, 1024), "p0 is '1024'"),
        (row(0.01, slip=2), "slip is '2'"),
        ("inf" + row(0.01)[4:], "t_s is 'inf'"),
    ]:
        error = refused(tmp_path, HEADER, row(0.0), "", line)
        assert (error.line, error.problem) == (4, problem), (line, problem)


def test_times_that_do_not_increase_are_refused(tmp_path: Path) -> None:
    for second in [0.0, -0.01]:
        error = refused(tmp_path, HEADER, row(0.0), row(second))
        assert (error.line, error.problem) == (3, "time does not increase"), second


def test_the_authors_recording_has_jitter_and_one_missed_sample(
    authors_recording: Recording,
) -> None:
    assert authors_recording.counts.shape == (416, 1, 6)
    assert missed_samples(authors_recording.t_s).sum() == 1
    assert np.diff(authors_recording.t_s).min() < 0.0065


def test_recording_at_another_rate_is_refused_with_its_rate(tmp_path: Path) -> None:
    for hz, problem in [(50, "20 ms apart, 50 Hz"), (500, "2 ms"), (1000, "1 ms")]:
        rows = [f"{k / hz:.4f},{','.join(['-100'] * 6)},0" for k in range(200)]
        with pytest.raises(BadFile, match=problem) as raised:
            read_csv(write(tmp_path, "t_s,p0,p1,p2,p3,p4,p5,slip", *rows))
        assert "100 Hz" in raised.value.remedy, (hz, problem)


def test_recording_at_a_slightly_different_rate_is_read(tmp_path: Path) -> None:
    for hz in [90, 100, 110]:
        rows = [f"{k / hz:.4f},{','.join(['-100'] * 6)},0" for k in range(200)]
        assert len(read_csv(write(tmp_path, "t_s,p0,p1,p2,p3,p4,p5,slip", *rows)).t_s) == 200, hz
