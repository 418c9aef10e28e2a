"""`grasp tactile` through the entry point of the command line."""

import json

from grasp.cli.main import main
from tests.wire.drivers.takktile.conftest import Bench


def identify(bench: Bench, *options: str) -> int:
    return main(["tactile", "identify", "--url", bench.server.url, *options])


def press(bench: Bench, cell: int) -> None:
    """Press a cell after the rest has been taken."""
    bench.pressed, bench.pressed_after = cell, 60


def test_identify_names_finger_taxel_and_cell(bench, capsys):
    press(bench, 6 + 4)
    assert identify(bench, "--seconds", "1") == 0
    shown = capsys.readouterr()
    assert "press one pad" in shown.err
    assert shown.out.splitlines() == [
        "finger B taxel 4 (row 1, column 4)",
        "strongest: finger B taxel 4 (row 1, column 4), 150 counts below its rest",
    ]
    assert bench.board.ready_ns is None  # stopped


def test_identify_uses_board_and_wiring_of_a_config_file(bench, capsys, tmp_path):
    lab, turned = tmp_path / "lab.toml", [[[r, c] for c in range(6)] for r in (2, 1, 0)]
    lab.write_text(f"[usb]\nurl = '{bench.server.url}'\n[tactile]\ncells = {turned}\n")
    press(bench, 4)
    words = ["tactile", "identify", "--seconds", "1", "--config", str(lab)]
    assert main(words) == 0
    assert "strongest: finger C taxel 4 (row 0, column 4)" in capsys.readouterr().out
    assert main([*words, "--set", "usb.serial=another"]) == 3
    assert "with serial number another" in capsys.readouterr().err


def test_identify_reports_when_no_pad_was_pressed(bench, capsys):
    assert identify(bench, "--seconds", "0.1") == 1
    assert "no pad was pressed" in capsys.readouterr().out


def test_identify_without_a_board_refuses_with_a_remedy(bench, capsys):
    bench.inject("unplug")
    assert identify(bench) == 3
    assert "no TakkTile board" in capsys.readouterr().err
    assert identify(bench, "--json") == 3
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["kind"] == "link_lost"
    assert "plug it in" in error["remedy"]
