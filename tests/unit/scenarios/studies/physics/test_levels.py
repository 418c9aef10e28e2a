"""Closed loops at the level that is chosen, beside always L4 and always L1."""

import msgspec
import pytest

from scenarios.rigs.workers import Workers
from scenarios.studies.physics import levels
from scenarios.studies.physics.levels import Draw, Loop, check, table

HERE = Workers(0)


@pytest.fixture(scope="module")
def draws() -> list[Draw]:
    return list(check((0, 3), levels.OBJECTS, "gru", None, False, False, HERE))


def test_each_draw_runs_at_three_choices_of_level(draws: list[Draw]) -> None:
    assert [d.kind for d in draws] == ["lift", "side"]
    for d in draws:
        assert set(d.loops) == {"planned", "L1", "L4"}
        assert d.loops["L1"].turned_rad in (0.0, None)
        assert d.tolerance_rad == pytest.approx(d.tolerance_m / 0.015)
        assert d.tolerance_n == 0.2
    side = draws[1].loops
    assert side["L4"].turned_rad != 0.0
    assert side["planned"].turned_rad == pytest.approx(side["L4"].turned_rad, abs=0.05)


def test_equal_seeds_draw_alike(draws: list[Draw]) -> None:
    again = next(iter(check((3,), levels.OBJECTS, "gru", None, True, False, HERE)))
    control = again.loops.pop(levels.CONTROL)
    assert control.slip_m == pytest.approx(again.loops["L4"].slip_m, abs=1e-4)
    assert control.slip_m != again.loops["L4"].slip_m
    for name, loop in again.loops.items():
        assert loop.verdict == draws[1].loops[name].verdict
        assert loop.slip_m == draws[1].loops[name].slip_m


def test_draws_that_end_in_the_air_are_judged_as_whole_ones(draws: list[Draw]) -> None:
    for whole, kept in zip(
        draws, check((0, 3), levels.OBJECTS, "gru", None, False, True, HERE), strict=True
    ):
        for name, loop in kept.loops.items():
            assert loop.verdict == whole.loops[name].verdict
            assert loop.slip_m == pytest.approx(whole.loops[name].slip_m, abs=1e-9)


def loop(
    outcome: str, slip_m: float | None, turned_rad: float, cpu_s: float = 1.0, peak_n: float = 10.0
) -> Loop:
    return Loop(outcome, True, slip_m, turned_rad, peak_n, cpu_s)


def test_table_counts_verdicts_and_errors_beyond_the_tolerance() -> None:
    draw = Draw(
        "side", "can", 7, 1e-3, 0.06, "L1", "L3", 0.1,
        {"planned": loop("registered", 5e-3, 0.1), "L1": loop("late", 8e-3, 0.0, 0.8, 10.3),
         "L4": loop("registered", 5.1e-3, 0.1, 2.0, 10.05)},
    )  # fmt: skip
    lost = msgspec.structs.replace(
        draw, kind="lift",
        loops={**draw.loops, "L1": loop("dropped", None, 0.0), "L4": loop("dropped", None, 0.0)},
    )  # fmt: skip
    rows = {line.split(" | ")[0]: line.split(" | ") for line in table([draw, lost]).splitlines()}
    side = rows["| side"]
    assert side[2:8] == ["L1, L3: 1", "0", "1", "-", "0 of 1", "1 of 1"]
    assert side[9:11] == ["0 of 1", "1 of 1"]
    assert side[12:15] == ["0 of 1", "1 of 1", "0.05, 0.05"]
    assert rows["| lift"][3:8] == ["1", "0", "-", "0 of 0", "0 of 0"]
    held = {**draw.loops, levels.CONTROL: loop("late", 5.1e-3, 0.1)}
    told = table([msgspec.structs.replace(draw, loops=held)]).splitlines()[2].split(" | ")
    assert told[5] == "1 of 1"


def test_every_kind_can_be_drawn() -> None:
    assert {levels.KINDS[seed % len(levels.KINDS)] for seed in range(4)} == set(levels.KINDS)
