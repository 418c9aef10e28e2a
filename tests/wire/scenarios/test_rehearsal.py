"""A day in the laboratory, rehearsed at a terminal as docs/hardware.md says, against its cell."""

import json
import re
import signal
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign import experiment as experiments
from scenarios.campaign.experiment import Bench, Experiment
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Row
from tests.unit.scenarios.conftest import config
from tests.wire.scenarios.test_rigs import ENVIRONMENT, GRASP
from tests.wire.terminal import Terminal

PAGE = Path(__file__).parents[3] / "docs" / "hardware.md"
HOST, PORT = "127.0.0.2", "5020"
MOVES = ("--rig", "hardware", "--confirm-motion", "--config", "lab.toml")
CTRL_C = "\x03"
SLEDGE = ("--set", "tap.impulse_n_s=2.0")
TRUE_ALONE = {
    "peak_force_n",
    "detection_latency_ms",
    "reaction_latency_ms",
    "turned_rad",
}  # a world knows


class Lab:
    """A folder, the cell of `grasp emulate` at its terminal, and programs at others."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def program(self, *words: str) -> Terminal:
        return Terminal([*GRASP, *words], ENVIRONMENT, str(self.folder))

    @contextmanager
    def cell(self, *words: str) -> Iterator[Terminal]:
        with self.program("emulate", "--host", HOST, "--gripper-port", PORT, *words) as cell:
            endpoints = json.loads(cell.wait_for(r"\{.*\}").group(0))
            self.write(endpoints)
            lab = ("--confirm-motion", "--config", "lab.toml")
            self.done("gripper", "activate", "--empty", *lab)  # no run does
            yield cell

    def write(self, endpoints: dict[str, Any]) -> None:
        """The page's file with its lines for a rehearsal, at these addresses."""
        blocks = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
        lab, rehearsal = (tomllib.loads(block) for block in blocks if "[modbus]" in block)
        for section, values in rehearsal.items():
            lab[section] = lab.get(section, {}) | values
        gripper, arm = endpoints["gripper"], endpoints["arm"]
        lab["modbus"] |= {"host": gripper["host"], "port": gripper["port"]}
        lab["usb"] = {"url": endpoints["tactile"]["url"]}
        lab["ur"]["host"] = arm["host"]
        text = "".join(
            f"[{section}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in s.items())
            for section, s in lab.items()
        )
        (self.folder / "lab.toml").write_text(text, encoding="utf-8")

    def done(self, *words: str) -> str:
        with self.program(*words) as program:
            assert program.wait() == 0, program.shown
            return program.shown

    def rows(self, name: str) -> list[Row]:
        with CampaignStore.open(self.folder / name) as store:
            return store.rows()


def put_in_place(run: Terminal, cell: Terminal, words: str) -> None:
    run.wait_for(re.escape(words))
    run.wait_for("Enter")
    cell.type("place\n")
    cell.wait_for("done")
    run.type("\n")


def moved_mm(cell: Terminal) -> str:
    cell.type("look\n")
    return cell.wait_for(r"([\d.]+) mm from its mark").group(1)


def let_go(lab: Lab, run: Terminal) -> None:
    """By the command that the run has printed."""
    found = re.search(r"`grasp (release[^`]*)`", run.shown)
    assert found is not None, run.shown
    assert "fingers open" in lab.done(*found.group(1).split())


def lift_three(lab: Lab) -> None:
    lifts = ("run", "lift", "--object", "can", *MOVES, "--trials", "3", "--out", "can.sqlite")
    with lab.cell() as cell:
        assert "nothing stands against a run" in lab.done(
            "doctor", "--rig", "hardware", "--config", "lab.toml"
        )
        with lab.program(*lifts) as run:
            put_in_place(run, cell, "Trial 1 of 3")
            run.wait_for("How far has the object slipped")
            run.type("a bit\n")
            run.wait_for("'a bit' is no length")
            run.type(f"{moved_mm(cell)}\n")
            put_in_place(run, cell, "Trial 2 of 3")
            run.wait_for("How far has the object slipped")
            run.type(CTRL_C)
            assert run.wait() == 130, run.shown
            assert "object lift" in run.shown  # Table IV up to now
            assert "1 trial is in can.sqlite: go on with --out can.sqlite --resume" in run.shown
            let_go(lab, run)
        with lab.program(*lifts, "--resume") as run:
            assert run.wait() == 4, run.shown
            assert "the arm stands 200 mm from where the first trial began" in run.shown
        cell.type("home\n")
        cell.wait_for("done")
        with lab.program(*lifts, "--resume") as run:
            put_in_place(run, cell, "Trial 2 of 3")
            run.wait_for("How far has the object slipped")
            run.type(f"{moved_mm(cell)}\n")
            put_in_place(run, cell, "Trial 3 of 3")
            run.wait_for("How far has the object slipped")
            cell.kill(signal.SIGKILL)
            assert run.wait() == 3, run.shown
            assert "2 trials are in can.sqlite, 1 more does not count" in run.shown
            assert "cannot be told anything and holds by itself" in run.shown
    with lab.cell() as cell, lab.program(*lifts, "--resume") as run:
        put_in_place(run, cell, "Trial 3 of 3")
        run.wait_for("How far has the object slipped")
        run.type(f"{moved_mm(cell)}\n")
        assert run.wait() == 0, run.shown
        assert "n 3" in run.shown


def tap_three(lab: Lab) -> None:
    taps = ("run", "tap", "--object", "can", *MOVES, "--trials", "3", "--out", "taps.sqlite")
    with lab.cell() as cell, lab.program(*taps) as run:
        for number in (1, 2, 3):
            put_in_place(run, cell, f"Trial {number} of 3")
            side = run.wait_for("Tap the object once on the (TOP|SIDE)").group(1).lower()
            cell.type(f"tap {side}\n")
            cell.wait_for("done")
            run.type("\n")
            run.wait_for("How far has the tape mark moved")
            run.type(f"{moved_mm(cell)}\n")
        assert run.wait() in (0, 1), run.shown
        assert "mallet tap" in run.shown


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_lifts_and_taps_of_a_day_with_what_goes_wrong_leave_the_rows_of_a_campaign(
    tmp_path: Path,
) -> None:
    lab = Lab(tmp_path)
    lift_three(lab)
    tap_three(lab)
    lifts, taps = lab.rows("can.sqlite"), lab.rows("taps.sqlite")
    assert [(row.trial, row.status) for row in lifts] == [(n, "done") for n in range(3)]
    assert all(row.slip_distance_m is not None for row in lifts)
    assert [row.direction for row in taps] == ["top", "side", "top"]
    assert all(row.moved for row in taps)
    simulated = Experiment(config(), 0, 1)
    with simulated.store(tmp_path / "simulated.sqlite", resume=False) as store:
        (_, row), *_ = experiments.run(simulated, Bench(None, False, lambda tick: None), store)
    assert row is not None
    filled = {name for name in row.__struct_fields__ if getattr(row, name) is not None}
    for own in lifts:
        has = {name for name in own.__struct_fields__ if getattr(own, name) is not None}
        assert filled - has == TRUE_ALONE
        assert has - filled == {"recording"}


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_object_that_falls_ends_a_series_which_goes_on_when_the_hand_is_open_again(
    tmp_path: Path,
) -> None:
    lab = Lab(tmp_path)
    lifts = ("run", "lift", "--object", "can", *MOVES, "--trials", "2", "--out", "can.sqlite")
    with lab.cell(*SLEDGE) as cell:
        with lab.program(*lifts) as run:
            put_in_place(run, cell, "Trial 1 of 2")
            run.wait_for("How far has the object slipped")
            cell.type("tap top\n")
            run.wait_for("seed 0 *dropped")
            assert run.wait() == 1, run.shown
            assert "and feels nothing: the object may still be in it" in run.shown
            assert "the arm stands" in run.shown
            assert "1 trial is in can.sqlite: go on with --out can.sqlite --resume" in run.shown
        with lab.program(*lifts, "--resume") as again:
            assert again.wait() == 4, again.shown
            assert "Trial 2" not in again.shown  # asks nobody to put anything into a closed hand
        let_go(lab, run)
    with lab.cell() as cell, lab.program(*lifts, "--resume") as run:
        put_in_place(run, cell, "Trial 2 of 2")
        run.wait_for("How far has the object slipped")
        run.type(f"{moved_mm(cell)}\n")
        assert run.wait() in (0, 1), run.shown
    fell, held = lab.rows("can.sqlite")
    assert (fell.trial, fell.outcome, held.trial) == (0, "dropped", 1)
    assert (held.outcome or "").startswith("held")
