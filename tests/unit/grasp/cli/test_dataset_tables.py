"""The tables of `grasp dataset describe`."""

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
