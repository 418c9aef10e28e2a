"""The tables of `grasp dataset describe`."""

import re
from types import SimpleNamespace

import pytest

from grasp.cli.dataset import print_figures

EMPTY = SimpleNamespace(
    recordings=1, samples=100, static=60, slip=40, slip_true=None, moved=None, speed_p50_mps=None,
    splits={}, kinds={}, acts={}, table=[], taxels=[],
)  # fmt: skip


def shown(capsys: pytest.CaptureFixture[str], **figures: object) -> list[str]:
    print_figures(SimpleNamespace(**(vars(EMPTY) | figures)))
    return capsys.readouterr().out.splitlines()


def test_each_share_of_what_was_done_stands_below_its_heading(
    capsys: pytest.CaptureFixture[str],
) -> None:
    deeds = SimpleNamespace(
        number=12, below_half_mm=1.0, half_to_one_mm=0.25, above_two_mm=0.07, furthest_p50_m=0.0015
    )
    lines = shown(capsys, acts={"push": deeds})
    (at,) = (i for i, line in enumerate(lines) if line.startswith("act "))
    heading, row = lines[at : at + 2]
    ends = [match.end() for match in re.finditer(r"number|< 0.5 mm|0.5-1 mm|> 2 mm|mm$", heading)]
    assert [match.end() for match in re.finditer(r"12|100 %|25 %|7 %|1\.50", row)] == ends


def test_table_one_has_its_heading_where_there_are_rows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    cell = SimpleNamespace(
        motion="primary", speed=0.05, surface="planar", samples=100, slip=40, percent=100.0,
        paper_percent=None,
    )  # fmt: skip
    lines = shown(capsys, table=[cell])
    (at,) = (i for i, line in enumerate(lines) if line.startswith("Table I "))
    assert lines[at].split()[2:] == ["speed", "surface", "samples", "slip", "%", "paper"]
    assert lines[at + 1].split() == ["primary", "0.05", "planar", "100", "40", "100.0", "-"]
    assert not any(line.startswith("Table I") for line in shown(capsys))
