"""Import of foreign tables: layouts of public data sets, stated changes, refusals."""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from detector.recording_checks import suspicions
from detector.recordings import read, read_all, read_dataset, write
from detector.text_table import MOST_BYTES
from drivers.errors import BadFile
from grasp.cli.main import main
from scenarios.acquire.datasets.build import divided
from scenarios.acquire.import_recording import ImportOptions, import_recording

REST = 430
CHANNELS = ",".join(f"c{i}" for i in range(6))


def press(t_s: float, taxel: int = 0) -> int:
    """Raw code: at rest for 0.5 s, then pressed by 60 counts and more."""
    return REST - (t_s >= 0.5) * (60 + 10 * taxel)


def rows(hz: float, row: Callable[[float], str], n: int = 200) -> list[str]:
    return [row(k / hz) for k in range(n)]


def values(t_s: float, channels: int = 6, sign: int = 1) -> str:
    return ",".join(str(sign * press(t_s, i % 6)) for i in range(channels))


def table(folder: Path, lines: list[str], name: str = "own.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_list_in_a_cell_is_read_in_milliseconds(tmp_path: Path) -> None:
    lines = rows(100, lambda t: f'{1.7e12 + t * 1e3:.0f};tip;"[{values(t)}]"')
    path = table(tmp_path, ["stamp;sensor;data", *lines])
    options = ImportOptions(unit="ms", columns="data", rest_s=0.4)
    made, changes = import_recording(path, options)
    assert made.t_s[[0, -1]] == pytest.approx([0.0, 1.99])
    assert made.counts[[0, -1], 0].tolist() == [[0] * 6, [-60, -70, -80, -90, -100, -110]]
    assert changes[0] == "time: stamp, in ms, 1700000000000 subtracted"
    assert made.metadata is not None and made.metadata.cause == "imported"
    for unit in ("s", "us", "ns"):
        with pytest.raises(BadFile, match="timestamps look like milliseconds") as error:
            import_recording(path, ImportOptions(columns="data", unit=unit))
        assert error.value.remedy == "give --unit ms", unit


def test_pairs_without_a_header_are_resampled_by_the_mean(tmp_path: Path) -> None:
    path = table(tmp_path, rows(200, lambda t: f"{t},{press(t) - 4 * (t > 0.5)}"))
    options = ImportOptions(time_column="1", taxels=1, rest_s=0.4, resample=True)
    made, changes = import_recording(path, options)
    assert (made.counts.shape, np.diff(made.t_s).max()) == ((100, 1, 1), pytest.approx(0.01))
    assert made.counts[[49, 50, 51], 0, 0].tolist() == [0, -62, -64]
    assert "rate: 200 Hz -> 100 Hz, mean of each 10 ms" in changes


def test_many_columns_without_time_are_three_fingers(tmp_path: Path) -> None:
    header = ",".join(f"taxel{i}" for i in range(18))
    path = table(tmp_path, [header, *rows(100, lambda t: values(t, 18))])
    made, changes = import_recording(path, ImportOptions(rate_hz=100.0, rest_s=0.4))
    assert made.counts.shape == (200, 3, 6) and not made.labelled
    assert changes[3].startswith("finger C: taxel12, ")
    with pytest.raises(BadFile, match="no column is named as time") as caught:
        import_recording(path, ImportOptions())
    assert "--rate" in caught.value.remedy


def test_labels_of_a_second_file_at_another_rate_are_held(tmp_path: Path) -> None:
    lines = rows(500, lambda t: f"{t + 7},{values(t, sign=-1)}", 1000)
    path = table(tmp_path, [f"time,{CHANNELS}", *lines])
    truth = table(
        tmp_path, ["time,slip", *rows(20, lambda t: f"{t + 7},{int(t >= 1)}", 30)], "t.csv"
    )
    options = ImportOptions(sign="positive", rest_s=0.4, labels=truth, resample=True)
    made, changes = import_recording(path, options)
    assert made.t_s[made.slip].min() == pytest.approx(1.005)  # middle of its 10 ms
    assert len(made.t_s) == 150 and made.counts.min() == -110
    assert any(line.startswith("labels: slip of t.csv, 30 at 20 Hz") for line in changes)
    write(tmp_path / "own.npz", made)
    kept = read(tmp_path / "own.npz").metadata
    assert kept is not None and kept.changes == tuple(changes)
    assert kept.files["own.csv"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_labels_at_the_times_of_the_samples_are_theirs(tmp_path: Path) -> None:
    """Whatever the start: a time minus the start plus the start is not always the same time."""
    times = [f"{1.85 + k / 100:.2f}" for k in range(1000)]
    lines = [f"{t},{values(k / 100)}" for k, t in enumerate(times)]
    path = table(tmp_path, [f"time,{CHANNELS}", *lines])
    labels = [f"{t},{k % 2}" for k, t in enumerate(times)]
    options = ImportOptions(rest_s=0.4, labels=table(tmp_path, ["time,slip", *labels], "t.csv"))
    made, _ = import_recording(path, options)
    assert made.slip.tolist() == [bool(k % 2) for k in range(1000)]


def test_labels_are_not_held_over_a_hole(tmp_path: Path) -> None:
    path = table(tmp_path, [f"time,{CHANNELS}", *rows(100, lambda t: f"{t},{values(t)}", 300)])
    labels = [row for k in range(60) if not 20 <= k < 40 for row in [f"{k / 20},1"]]
    options = ImportOptions(rest_s=0.4, labels=table(tmp_path, ["time,slip", *labels], "t.csv"))
    with pytest.raises(BadFile, match=r"t\.csv: a gap of 0\.96 s before 2\.000 s") as caught:
        import_recording(path, options)
    assert "each label is held for 0.1 s, twice the median interval" in caught.value.remedy


def test_labels_on_another_clock_or_in_another_unit_are_refused(tmp_path: Path) -> None:
    path = table(tmp_path, [f"t_s,{CHANNELS}", *rows(100, lambda t: f"{t:.2f},{values(t)}", 2000)])
    for scale, header in ((1e3, "time,label"), (1e-3, "time,label"), (1.0, "start,end,label")):
        between = "," * header.count("end")
        lines = [f"{t * scale:.6f},{between}{int(t % 1 > 0.5)}" for t in np.arange(0, 20, 0.01)]
        labels = table(tmp_path, [header, *lines], "labels.csv")
        with pytest.raises(BadFile, match=r"do not fit the samples|no column is named as time"):
            import_recording(path, ImportOptions(labels=labels))


def test_rest_is_that_of_the_first_seconds_even_if_they_have_no_label(tmp_path: Path) -> None:
    path = table(tmp_path, [f"t_s,{CHANNELS}", *rows(100, lambda t: f"{t:.2f},{values(t)}")])
    labels = table(tmp_path, ["t_s,slip", "1.0,0", "1.3,1", "1.6,0"], "labels.csv")
    made, _ = import_recording(path, ImportOptions(labels=labels, rest_s=0.4))
    assert made.counts[0, 0].tolist() == [-60, -70, -80, -90, -100, -110]


def test_samples_at_unix_times_are_resampled_as_at_times_from_zero(tmp_path: Path) -> None:
    found = []
    for start in (0, 1_700_000_000):
        lines = [f"{start + k / 100:.3f}," + ",".join(["100" if k % 2 else "-100"] * 6)
                 for k in range(300)]  # fmt: skip
        path = table(tmp_path, [f"t_s,{CHANNELS}", *lines])
        found.append(import_recording(path, ImportOptions(resample=True))[0].counts)
    np.testing.assert_array_equal(*found)


def test_columns_that_are_only_numbered_are_a_header(tmp_path: Path) -> None:
    path = table(tmp_path, ["0,1,2,3,4,5", *rows(100, values)])
    assert len(import_recording(path, ImportOptions(rate_hz=100.0))[0].t_s) == 200
    indexed = table(tmp_path, [",0,1,2,3,4,5", *(f"{k},{values(k / 100)}" for k in range(200))])
    options = ImportOptions(rate_hz=100.0, columns="0,1,2,3,4,5")
    assert len(import_recording(indexed, options)[0].t_s) == 200


def test_slow_file_is_interpolated_and_stays_unlabelled_in_its_file(tmp_path: Path) -> None:
    path = table(tmp_path, [f"t,{CHANNELS}", *rows(50, lambda t: f"{t},{values(t)}", 100)])
    with pytest.raises(BadFile, match="20 ms apart, 50 Hz") as caught:
        import_recording(path, ImportOptions(rest_s=0.4))
    assert "--resample" in caught.value.remedy
    made, _ = import_recording(path, ImportOptions(rest_s=0.4, resample=True))
    assert made.counts[49:51, 0, 0].tolist() == [-30, -60]
    write(tmp_path / "own.npz", made)
    assert not read(tmp_path / "own.npz").labelled
    with pytest.raises(BadFile, match="has no label"):
        list(read_all([tmp_path / "own.npz"]))


@pytest.mark.parametrize(
    ("hz", "expected"),
    [  # the labels 1, 0, 0 in turn, at the middle of 10 ms (200 Hz) or at a sample (50 Hz)
        (200, [0, 1, 0, 0, 1, 0, 0, 1, 0]),
        (50, [1, 1, 0, 0, 0, 0, 1, 1, 0]),
    ],
)  # fmt: skip
def test_resampled_labels_are_those_of_the_last_sample(
    hz: int, expected: list[int], tmp_path: Path
) -> None:
    slips = iter([1, 0, 0] * 100)
    lines = rows(hz, lambda t: f"{t},{values(t)},{next(slips)}")
    path = table(tmp_path, [f"time,{CHANNELS},slip", *lines])
    made, _ = import_recording(path, ImportOptions(rest_s=0.4, resample=True))
    assert made.slip[: len(expected)].astype(int).tolist() == expected


def steps(n: int = 100, cell: Callable[[float], str] = str) -> list[str]:
    """Header and rows of one finger at 100 Hz, pressed from 0.5 s on."""
    return [f"time;{CHANNELS.replace(',', ';')}",
            *rows(100, lambda t: f"{cell(t)};{values(t).replace(',', ';')}", n)]  # fmt: skip


def test_decimal_commas_are_read_as_points_and_stated(tmp_path: Path) -> None:
    path = table(tmp_path, steps(cell=lambda t: f"{t:.2f}".replace(".", ",")))
    made, changes = import_recording(path, ImportOptions(rest_s=0.4))
    assert made.t_s == pytest.approx(np.arange(100) / 100)
    assert made.counts[[0, -1], 0, 0].tolist() == [0, -60]
    assert changes[0] == "numbers: decimal commas read as points"


def test_a_comma_that_may_part_thousands_is_refused(tmp_path: Path) -> None:
    lines = steps()
    lines[40] = f"{lines[40].rpartition(';')[0]};1,023"
    with pytest.raises(BadFile, match=r"1,023 may mean 1023 or 1\.023"):
        import_recording(table(tmp_path, lines), ImportOptions())


@pytest.mark.parametrize("lost", ["", "nan", "NaN", "null"])
@pytest.mark.parametrize("times", [True, False], ids=["times", "rate"])
def test_up_to_five_lost_samples_in_a_row_are_left_out_and_counted(
    lost: str, times: bool, tmp_path: Path
) -> None:
    lines = steps()
    if not times:
        lines = [line.partition(";")[2] for line in lines]
    for at in (20, *range(60, 65)):  # of the last of them every cell is empty
        lines[at] = ";".join([*lines[at].split(";")[:-1], lost])
    lines[64] = ";" * lines[64].count(";")
    options = ImportOptions(rest_s=0.4, rate_hz=None if times else 100.0)
    made, changes = import_recording(table(tmp_path, lines), options)
    kept = [k for k in range(100) if k not in (19, *range(59, 64))]
    assert made.t_s == pytest.approx(np.array(kept) / 100)
    assert any(line.startswith(f"lost samples: {5 + (not times or 1)}, ") for line in changes)
    lines[65] = lines[64]
    with pytest.raises(BadFile, match=r"a gap of 0\.07 s"):
        import_recording(table(tmp_path, lines), options)


@pytest.mark.parametrize(
    ("hz", "rows_lost", "lines"),
    [
        (100, (20, *range(60, 65)), ["lost samples: 6, whose rows are missing"]),
        (50, (20, 21), ["lost samples: 2, whose rows are missing"]),
        (500, range(60, 80), ["lost samples: 3, whose rows are missing"]),  # of 10 ms
        (100, (), []),
    ],
)
def test_rows_that_are_missing_are_counted_as_lost(
    hz: int, rows_lost: Sequence[int], lines: list[str], tmp_path: Path
) -> None:
    whole = rows(hz, lambda t: f"{t},{values(t)}")
    kept = [line for k, line in enumerate(whole) if k not in rows_lost]
    options = ImportOptions(rest_s=0.02, resample=hz != 100)
    _, changes = import_recording(table(tmp_path, [f"time,{CHANNELS}", *kept]), options)
    assert [line for line in changes if line.startswith("lost")] == lines


def test_a_column_that_is_not_chosen_is_named(tmp_path: Path) -> None:
    lines = [f"time,{CHANNELS},sliding", *rows(100, lambda t: f"{t},{values(t)},1")]
    made, changes = import_recording(table(tmp_path, lines), ImportOptions(columns="2-7"))
    assert "columns left out: sliding" in changes and not made.labelled
    assert "labels: none; a column of labels is named slip or label" in changes


@pytest.mark.parametrize(
    ("name", "per_s", "unit"),
    [("ms", 1e3, "ms"), ("time_ms", 1e3, "ms"), ("Time [us]", 1e6, "us"), ("t_s", 1.0, "s")],
)
def test_the_name_of_a_time_column_states_its_unit(
    name: str, per_s: float, unit: str, tmp_path: Path
) -> None:
    lines = [f"{name},{CHANNELS}", *rows(100, lambda t: f"{t * per_s},{values(t)}")]
    truth = ["time,slip", *rows(20, lambda t: f"{t * per_s},{int(t >= 1)}", 40)]
    options = ImportOptions(rest_s=0.4, labels=table(tmp_path, truth, "t.csv"))
    made, changes = import_recording(table(tmp_path, lines), options)
    assert made.t_s == pytest.approx(np.arange(200) / 100)
    assert made.t_s[made.slip].min() == pytest.approx(1.0)
    assert changes[0] == f"time: {name}, in {unit}, 0.0 subtracted"


def test_a_table_without_any_whole_sample_is_refused(tmp_path: Path) -> None:
    lines = [f"{line};" for line in steps()]  # a nameless seventh channel
    with pytest.raises(BadFile, match="0 samples have a value in each channel"):
        import_recording(table(tmp_path, lines), ImportOptions(columns="2-8", taxels=7))


@pytest.mark.parametrize("stamp", ["2026-03-29T01:59:59.{}+01:00", "29.03.2026 01:59:59,{}"])
def test_iso_and_german_time_stamps_are_read_and_have_no_unit(stamp: str, tmp_path: Path) -> None:
    path = table(tmp_path, steps(cell=lambda t: stamp.format(f"{round(t * 1e6):06d}")))
    made, changes = import_recording(path, ImportOptions(rest_s=0.4))
    assert made.t_s == pytest.approx(np.arange(100) / 100, abs=1e-6)
    assert f"time: time, in date and time, {stamp.format('000000')} subtracted" in changes
    with pytest.raises(BadFile, match="which has no unit 'ms'") as caught:
        import_recording(path, ImportOptions(unit="ms"))
    assert caught.value.remedy == "leave --unit out"


def test_other_time_stamps_name_the_rate(tmp_path: Path) -> None:
    path = table(tmp_path, steps(cell=lambda t: f"29.3. 10 Uhr {t}"))
    with pytest.raises(BadFile, match=r"time is '29\.3\. 10 Uhr 0\.0'") as caught:
        import_recording(path, ImportOptions())
    assert "give --rate HZ" in caught.value.remedy
    made, _ = import_recording(path, ImportOptions(rate_hz=100.0, rest_s=0.4))
    assert made.counts.shape == (100, 1, 6)


def test_pressures_in_other_units_need_a_scale(tmp_path: Path) -> None:
    lines = rows(100, lambda t: f"{t}," + ",".join([f"{100 + 2.5 * (t >= 0.5)}"] * 6))
    path = table(tmp_path, [f"time,{CHANNELS}", *lines])
    options = {"sign": "positive", "rest_s": 0.4}
    with pytest.raises(BadFile, match=r"change by 2\.5 at most") as caught:
        import_recording(path, ImportOptions(**options))
    assert "--scale" in caught.value.remedy and "cable" not in caught.value.remedy
    made, changes = import_recording(path, ImportOptions(scale=8.0, **options))
    assert made.counts[[0, -1], 0, 0].tolist() == [0, -20]
    assert "scale: multiplied by 8" in changes


def test_rest_longer_than_the_file_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path, steps())
    with pytest.raises(BadFile, match=r"--rest-seconds 3 is longer than the recording, 0\.99 s"):
        import_recording(path, ImportOptions(rest_s=3.0))


def test_a_press_that_raises_the_mean_is_suspicious_even_if_one_taxel_falls(tmp_path: Path) -> None:
    def row(t: float) -> str:
        return ",".join([f"{t}", *(str(60 * (t >= 0.5)) for _ in range(5)), str(-50 * (t >= 0.5))])

    path = table(tmp_path, [f"time,{CHANNELS}", *rows(100, row)])
    wrong, _ = import_recording(path, ImportOptions())
    (line,) = suspicions(wrong)
    assert "A's counts goes up to 42 and down to 0" in line
    right, _ = import_recording(path, ImportOptions(sign="positive"))
    assert suspicions(right) == []


def test_imported_files_are_collected_and_divided_for_training(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(5):
        lines = rows(100, lambda t: f"{t},{values(t)},{int(t > 1.5)}", 200 + number)
        table(tmp_path, [f"time,{CHANNELS},slip", *lines], f"{number}.csv")
    own = tmp_path / "own"
    files = [str(tmp_path / f"{number}.csv") for number in range(5)]
    assert main(["dataset", "import", *files, "--out", str(own), "--rest-seconds", "0.4"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"next: `grasp detector evaluate tcn --data {own}`"
    said: list[str] = []
    splits = divided(own, said.append)
    assert [len(splits[split]) for split in ("train", "validation", "test")] == [3, 1, 1]
    assert len(said) == 1 and "of each five imports three are for training" in said[0]
    assert main(["dataset", "collect", str(own), "--out", str(tmp_path / "set")]) == 0
    assert len(read_dataset(tmp_path / "set", "train")) == 3
    assert divided(tmp_path / "set", said.append) == {} and len(said) == 1
    assert len(list(read_all([own]))) == 5
    tune = ["detector", "tune", "energy", "--data", str(own), "--budget", "6000"]
    assert main(tune) == 0


@pytest.mark.parametrize(
    "command",
    ["dataset collect FOLDER --out new", "detector evaluate energy --data FOLDER",
     "detector evaluate energy --recording FOLDER", "detector tune energy --data FOLDER"],
)  # fmt: skip
def test_all_imports_without_a_label_are_named(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, labelled in {"a": True, "b": False, "c": True, "d": True, "e": False}.items():
        lines = rows(100, lambda t: f"{t},{values(t)}" + ",1" * labelled)  # noqa: B023
        path = table(tmp_path, [f"time,{CHANNELS}" + ",slip" * labelled, *lines], f"{name}.csv")
        write(tmp_path / f"{name}.npz", import_recording(path, ImportOptions(rest_s=0.4))[0])
    assert main(command.replace("FOLDER", str(tmp_path)).split()) == 2
    error = capsys.readouterr().err
    assert f"{tmp_path / 'b.npz'}: has no label `slip`, nor e.npz (move or leave out" in error


def test_the_folder_of_one_import_is_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"time,{CHANNELS},slip", *rows(100, lambda t: f"{t},{values(t)},{int(t > 1)}")]
    made, _ = import_recording(table(tmp_path, lines), ImportOptions(rest_s=0.4))
    for name in ("a.npz", "b.npz"):
        write(tmp_path / name, made)
        codes = [
            main(["detector", "evaluate", "energy", "--recording", str(tmp_path)]),
            main(["replay", "--detector", "energy", "--tactile", str(tmp_path)]),
        ]
        assert codes == [0, 0 if name == "a.npz" else 2]
    error = capsys.readouterr().err
    assert f"{tmp_path} has 2 recordings (give one of them: a.npz, b.npz)" in error


def test_unlabelled_files_are_replayed_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path, steps())
    words = ("dataset", "import", str(path), "--out", str(tmp_path), "--rest-seconds", "0.4")
    assert main(words) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"next: `grasp replay --tactile {tmp_path / 'own.npz'}`"


@pytest.mark.parametrize(
    "number", ["\N{SUPERSCRIPT TWO}", "\N{ARABIC-INDIC DIGIT TWO}", "9" * 4301]
)
@pytest.mark.parametrize("option", ["--taxels", "--rate", "--scale"])
def test_numbers_that_only_python_reads_get_one_line(
    option: str, number: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("dataset", "import", "a.csv", "--out", str(tmp_path), option, number)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and len(error) < 600 and option in error


def test_a_large_file_is_refused_by_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "long.csv"
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)  # takes no room
    monkeypatch.setattr(Path, "open", None)  # it is not read
    with pytest.raises(BadFile, match=r"long\.csv: is too large: 200 MB; at most 200") as caught:
        import_recording(path, ImportOptions())
    assert caught.value.remedy == "cut it into several files"


def test_names_of_columns_are_printed_without_control_characters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = CHANNELS.replace("c3", "\x1b[31mc3")
    path = table(tmp_path, [f"time,{names}", *rows(100, lambda t: f"{t},{values(t)}")])
    words = ("dataset", "import", str(path), "--out", str(tmp_path), "--rest-seconds", "0.4")
    assert main(words) == 0
    printed = capsys.readouterr()
    assert "\x1b" not in printed.out + printed.err and "\\x1b[31mc3" in printed.out


def test_unusable_tables_are_refused_with_a_remedy(tmp_path: Path) -> None:
    good = [f"time,{CHANNELS}", *rows(100, lambda t: f"{t},{values(t)}")]
    for lines, columns, problem in (
        (good, "c0,c1,c2", "3 channels"),
        (good, "c0,chan1", "has no column 'chan1'"),
        (good, "7-2", "--columns 7-2: no column"),
        (good, "\N{SUPERSCRIPT TWO}", "has no column '\N{SUPERSCRIPT TWO}'"),
        (good, "9" * 4301, "has no column '999"),
        (good, f"1-{'9' * 4301}", "has no column '1-999"),
        (good, "c0,2-6", "--columns c0,2-6: c0 twice"),
        ([*good[:9], "0.08,1_0,0,0,0,0,0"], "", "c0 is '1_0'"),
        (good, "", "a count is 430000, beyond"),
        ([*good[:50], *good[:50][1:]], "", "time does not increase: time is 0.0 after 0.48"),
        (good[:50] + good[90:], "", "a gap of 0.41 s before 0.890 s"),
        ([*good[:9], "0.08,x,0,0,0,0,0"], "", "c0 is 'x'"),
    ):
        text = [line.replace("430", "430000") for line in lines] if "430000" in problem else lines
        with pytest.raises(BadFile) as caught:
            import_recording(table(tmp_path, text), ImportOptions(columns=columns))
        assert problem in caught.value.problem and caught.value.remedy, problem
    with pytest.raises(BadFile, match="1e-08 s apart") as wrong_unit:
        import_recording(table(tmp_path, good), ImportOptions(unit="us"))
    assert "--unit" in wrong_unit.value.remedy
    path = table(tmp_path, [line.replace("time,", "tme,") for line in good])
    with pytest.raises(BadFile, match="did you mean 'tme'"):
        import_recording(path, ImportOptions(time_column="time"))
