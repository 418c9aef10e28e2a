"""A campaign's file: one writer, damage, and a full disk."""

import csv
import errno
import io
import os
import random
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from drivers.errors import BadFile, ConfigError, CouldNotRecord
from grasp.cli.main import main
from scenarios.campaign.run import run
from scenarios.campaign.spec import CampaignSpec, Task, combinations, read_spec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Row, error_row
from scenarios.rigs.workers import Workers

MANY = ", ".join(f"{i}e-6" for i in range(60_000))
ENDLESS = "WITH RECURSIVE n(key) AS (SELECT 1 UNION ALL SELECT key FROM n) SELECT key FROM n"
SPEC = CampaignSpec(name="two", objects=("can", "ball"), repetitions=3)


def stub_trial(trial: Task) -> tuple[Row, bytes | None]:
    """A stub for a trial, with unusual values."""
    row = msgspec.structs.replace(
        error_row(trial, "Grüße \ud800 \x00 \n"), status="done", success=trial.number % 2 == 0,
        slip_distance_m=float("inf"), reaction_latency_ms=float("nan"), wall_s=1,
        peak_force_n=10.1 + trial.number, detection_latency_ms=-0.0,
    )  # fmt: skip
    return row, b"recorded" * 100


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An undamaged campaign."""
    out = tmp_path_factory.mktemp("whole") / "a.sqlite"
    run(SPEC, out, Workers(0), work=stub_trial)
    return out


@pytest.fixture
def copy(whole: Path, tmp_path: Path) -> Path:
    return shutil.copy(whole, tmp_path / "a.sqlite")


def change(path: Path, statement: str) -> None:
    with closing(sqlite3.connect(path)) as db:
        if statement.startswith("CREATE VIEW"):
            db.execute(f"DROP TABLE {statement.split()[2]}")
        db.execute(statement)
        db.commit()


def everything(path: Path) -> object:
    with CampaignStore.open(path) as opened:
        return opened.spec, opened.rows(), opened.finished()


# One writer


def test_a_second_writer_is_refused_with_the_name_of_the_first(tmp_path: Path) -> None:
    out = tmp_path / "a.sqlite"
    grid = combinations(SPEC)
    with CampaignStore.create(out, SPEC, grid):
        for resume in (False, True):
            with pytest.raises(ConfigError, match=rf"written by process {os.getpid()}: ") as caught:
                CampaignStore.create(out, SPEC, grid, resume)
            assert caught.value.key == "--out"
        assert everything(out)  # reading is allowed
    with CampaignStore.create(out, SPEC, grid, resume=True):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.sqlite"]


# What a file holds


def test_unusual_values_are_stored_and_read(whole: Path) -> None:
    with CampaignStore.open(whole) as opened:
        rows = opened.rows()
    assert [row.trial for row in rows] == list(range(6))
    assert rows[0].slip_distance_m == float("inf") and rows[0].reaction_latency_ms is None
    assert rows[0].error is not None and rows[0].error.startswith("Grüße ?")


@pytest.mark.parametrize(
    ("statement", "named"),
    [
        ("UPDATE trials SET peak_force_n = 'strong' WHERE trial = 2", "peak_force_n"),
        ("UPDATE campaign SET value = replace(value, 'objects', 'object')", "object"),
        ("UPDATE campaign SET value = 'grasp-campaign 1' WHERE key = 'format'", "run the campaign"),
        ("DROP TABLE configs", "not a campaign"),
        (f"CREATE VIEW trials AS {ENDLESS}", "not a campaign"),
        (f"CREATE VIEW campaign AS {ENDLESS}", "not a campaign"),
        ("UPDATE trials SET swept = '[]'", "cannot be read"),
    ],
)
def test_a_file_whose_content_does_not_fit_is_refused_and_left_as_it_is(
    statement: str, named: str, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(copy, statement)
    before = copy.read_bytes()
    with pytest.raises(BadFile):
        run(SPEC, copy, Workers(0), resume=True, work=stub_trial)
    assert copy.read_bytes() == before
    for command in ("runs", "export"):
        assert main([command, str(copy)]) == 2
        out, err = capsys.readouterr()
        assert out == "" and named in err


# Damage


def damage(content: bytes, rng: random.Random) -> bytes:
    """Content with a page of zeros, a changed page header, two swapped pages, or a missing end."""
    data = bytearray(content)
    kind = rng.choice(("head", "zeros", "exchange", "cut"))
    a, b = (rng.randrange(len(data) // 4096) * 4096 for _ in range(2))
    if kind == "head":
        data[a : a + 16] = rng.randbytes(16)
    elif kind == "zeros":
        data[a : a + 4096] = bytes(4096)
    elif kind == "exchange":
        data[a : a + 4096], data[b : b + 4096] = data[b : b + 4096], data[a : a + 4096]
    else:
        del data[rng.randrange(len(data)) :]
    return bytes(data)


def test_damaged_files_are_refused_in_one_line_or_read_completely(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng, content, expected = random.Random(20_26), whole.read_bytes(), everything(whole)
    out, refused = tmp_path / "a.sqlite", 0
    for _ in range(25):
        out.write_bytes(damage(content, rng))
        code = main(["runs", str(out), "--json"])
        printed = capsys.readouterr()
        assert (code, printed.err, printed.out.count("\n")) in ((0, "", 1), (2, "", 1))
        refused += code == 2
        if code == 0:
            assert everything(out) == expected  # the damage was in an unused part
        else:
            assert out.name in printed.out
            with pytest.raises(BadFile):
                run(SPEC, out, Workers(0), resume=True, work=stub_trial)
    assert refused > 15


# A disk that is full, or may not be written


def full(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def after_half(path: Path, content: bytes) -> int:
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("method", ["write_bytes", "replace"])
def test_a_recording_that_the_disk_refuses_leaves_neither_file_nor_row(
    method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "a.sqlite"
    CampaignStore.create(out, SPEC, combinations(SPEC)).__exit__()
    failing: Callable[..., object] = after_half if method == "write_bytes" else full
    with monkeypatch.context() as patch:
        patch.setattr(Path, method, failing)
        with pytest.raises(CouldNotRecord, match="No space left"):
            run(SPEC, out, Workers(0), resume=True, work=stub_trial)
    assert files(tmp_path) == ["a.sqlite"]
    with CampaignStore.open(out) as opened:
        assert opened.rows() == []
    assert run(SPEC, out, Workers(0), resume=True, work=stub_trial).done == 6


# Content of a campaign file


def test_csv_has_the_numbers_of_the_table(whole: Path) -> None:
    text = io.StringIO(newline="")
    with CampaignStore.open(whole) as opened:
        opened.write_csv(text)
    text.seek(0)
    shown = [(row["set_down"], row["success"], row["moved"]) for row in csv.DictReader(text)]
    assert shown[:2] == [("0", "1", ""), ("0", "0", "")]


def test_a_campaign_with_repeated_values_or_an_invalid_sweep_is_refused(tmp_path: Path) -> None:
    for content, named in [
        ('objects = ["can", "ball", "can"]', '"can" twice'),
        ('objects = ["can"]\nseeds = [1, 2, 1]', "1 twice"),
        ('objects = ["can"]\n[sweep]\n"controller.lift_speed_mps" = [0.1, 0.10]', "0.1 twice"),
        ('objects = ["can"]\n[sweep]\n"rig" = ["hardware"]', "--rig"),
        ('objects = ["can"]\nsettings = ["rig=hardware"]', "--rig"),
        (f'objects = ["can"]\n[sweep]\n"loop.decision_delay_s" = [{MANY}]', "too large"),
    ]:
        file, out = tmp_path / "c.toml", tmp_path / "a.sqlite"
        file.write_text(f'name = "c"\n{content}\n')
        with pytest.raises(ConfigError) as caught:
            run(read_spec(file), out, Workers(0), work=stub_trial)
        assert named in f"{caught.value.message} {caught.value.remedy}", (content, named)
        assert not out.exists(), (content, named)
