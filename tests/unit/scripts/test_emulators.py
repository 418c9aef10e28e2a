"""The table of clients: as the page shows it, and by tests that there are."""

import re
from pathlib import Path

import pytest

from scripts import emulators
from scripts.emulators import CLIENTS, END, HEAD, PAGE, ROWS, table

ROOT = Path(__file__).parents[3]
BY_PIP = ("pip_clients", "client_of_the_package_index")  # tests of clients that are installed
IDS = r"[\w-]*names\d|\d+|request_\d|(cb3|e-series)-[\d.]+"  # that pytest makes of parameters


def test_the_page_shows_the_table_with_nothing_that_fails() -> None:
    shown = PAGE.read_text().partition(HEAD)[2].partition(END)[0].rstrip()
    assert HEAD + shown == table(ROWS, {row.test for row in ROWS})


@pytest.mark.parametrize("test", sorted({row.test for row in ROWS}))
def test_each_row_names_a_test(test) -> None:
    path, _, name = test.partition("::")
    text = (ROOT / path).read_text()
    function, _, parameter = name.rstrip("]").partition("[")
    assert re.search(rf"^def {function}\(", text, re.MULTILINE)
    scenario = any(f"{quote}{parameter}{quote}" in text for quote in "\"'")
    assert not parameter or scenario or re.fullmatch(IDS, parameter)


def test_a_row_whose_test_fails_says_so() -> None:
    assert table(ROWS[:2], {ROWS[0].test}).splitlines()[-1].endswith("| **fails** |")


def test_a_row_whose_test_was_skipped_stays_as_it_was() -> None:
    told = table(ROWS[:2], {row.test for row in ROWS})
    assert table(ROWS[:2], {ROWS[0].test}, told) == told


def test_the_script_installs_the_clients_that_its_rows_name_and_tells_what_was_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    named = {
        tuple(row.client.split(",")[0].split())
        for row in ROWS
        if any(word in row.test for word in BY_PIP)
    }
    assert named == {tuple(word.split("==")) for word in CLIENTS if "==" in word}
    page = tmp_path / "page.md"
    page.write_text(PAGE.read_text())
    monkeypatch.setattr(emulators, "PAGE", page)
    every = {row.test for row in ROWS}
    lost = next(row for row in ROWS if row.client.startswith("urx"))
    monkeypatch.setattr(emulators, "played", lambda _: (every, set()))
    assert emulators.main() == 0
    monkeypatch.setattr(emulators, "played", lambda _: (every - {lost.test}, {lost.test}))
    assert emulators.main() == 1
    assert f"not run, kept as it was: {lost.client}" in capsys.readouterr().out
    assert page.read_text() == PAGE.read_text()
