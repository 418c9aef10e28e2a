"""Lifts one after the other on the hardware rig, pointed at an emulated cell, with a person."""

import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from grasp.messages import ARM, PHASES
from grasp.recording import RunRecording
from scenarios.campaign.store import CampaignStore
from scenarios.rigs.cell_control import ControlClient
from scenarios.trial.run_folder import RUN_CHANNELS
from tests.wire.scenarios.test_rigs import ENVIRONMENT, GRASP, emulate, lab_file, sets, woken


class Bench:
    """A cell, the file that points at it, and a person who answers the prompts of a run there."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        self.lab = woken(lab_file(folder / "lab.toml", endpoints))
        self.out, self.runs = folder / "lifts.sqlite", folder / "runs"
        self.prompts: list[str] = []
        control = endpoints["control"]
        self.world = ControlClient(control["host"], control["port"])

    def run(
        self, slips_mm: list[str], *words: str, unplugged_in: int = 0
    ) -> "tuple[int, str, str]":
        """Lifts with these answers; in one of them the board is unplugged at the top."""
        rig = ["--rig", "hardware", "--confirm-motion", "--config", str(self.lab)]
        kept = ["--out", str(self.out), "--runs", str(self.runs)]
        with subprocess.Popen(
            [*GRASP, "run", "lift", *rig, *kept, "--detector", "gru", *words, *sets()],
            env=ENVIRONMENT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:  # fmt: skip
            assert process.stderr is not None and process.stdin is not None
            answers, rest = iter(slips_mm), []
            for line in process.stderr:
                if not line.startswith(">>>"):
                    rest.append(line)
                    continue
                self.prompts.append(line)
                if "Put the object" in line:
                    self.world.ask("place")
                    process.stdin.write("\n")
                elif line.startswith(">>> How far"):
                    if len([p for p in self.prompts if "How far" in p]) == unplugged_in:
                        self.world.ask("fault", name="unplug")
                        continue
                    process.stdin.write(f"{next(answers)}\n")
                process.stdin.flush()
            out = process.stdout.read() if process.stdout is not None else ""
            return process.wait(60), out, "".join(rest)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with emulate() as endpoints:
        made = Bench(endpoints, tmp_path)
        yield made
        made.world.close()


def grasp_heights_m(recordings: list[str]) -> list[float]:
    """Of the arm, when the fingers had closed on the object; one a recording."""
    found = []
    for path in recordings:
        recording = RunRecording.open(Path(path), RUN_CHANNELS)
        gripped_ns = next(t_ns for t_ns, change in recording.of(PHASES) if change.phase == "relax")
        found.append(next(arm.position_m[2] for t, arm in recording.of(ARM) if t >= gripped_ns))
    return found


def test_lifts_with_a_person_leave_the_rows_of_a_campaign(bench: Bench) -> None:
    code, out, err = bench.run(["12", "70,5", "l"], "--trials", "3", "--json")
    series = json.loads(out)
    assert code == 1, err  # the last one was lost
    assert [r["outcome"] for r in series["lifts"]] == [
        "held_within_6cm", "held_within_12cm", "dropped",
    ]  # fmt: skip
    assert [r["slip_distance_m"] for r in series["lifts"]] == [
        pytest.approx(0.012), pytest.approx(0.0705), None,
    ]  # fmt: skip
    asked = [p.split(".")[0] for p in bench.prompts if "Put the object" in p]
    assert asked == [f">>> Trial {n} of 3" for n in (1, 2, 3)]
    heights_m = grasp_heights_m([r["recording"] for r in series["lifts"]])
    assert heights_m == pytest.approx([heights_m[0]] * 3, abs=0.002)  # three equal lifts
    for result in series["lifts"]:
        replayed = subprocess.run(
            [*GRASP, "replay", result["recording"], "--check"], env=ENVIRONMENT, check=False,
            capture_output=True, text=True,
        )  # fmt: skip
        assert replayed.returncode == 0, replayed.stdout
    with CampaignStore.open(bench.out) as store:
        rows = store.rows()
    assert [row.outcome for row in rows] == [r["outcome"] for r in series["lifts"]]
    assert all(row.status == "done" and row.recording for row in rows)
    done = subprocess.run(
        [*GRASP, "runs", str(bench.out)], env=ENVIRONMENT, check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    assert "n 3" in done.stdout and "1 dropped" in done.stdout


def test_trial_that_a_device_ended_is_run_again_when_gone_on_with(bench: Bench) -> None:
    words = ("--trials", "3")
    code, _, err = bench.run(["12"], *words, unplugged_in=2)
    assert code == 3, err
    assert "go on with" in err and "--resume" in err
    assert f"`grasp release --rig hardware --confirm-motion --config {bench.lab}`" in err
    with CampaignStore.open(bench.out) as store:
        assert [(row.trial, row.status) for row in store.rows()] == [(0, "done"), (1, "error")]
    bench.world.ask("fault", name="replug")
    opened = subprocess.run(
        [*GRASP, "release", "--rig", "hardware", "--confirm-motion", "--config", str(bench.lab)],
        env=ENVIRONMENT, check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert opened.returncode == 0, opened.stderr
    code, _, err = bench.run([], *words, "--resume")
    assert code == 4 and "mm from where the first trial began" in err
    while bench.world.ask("home")["away_m"] > 0.0:
        time.sleep(0.1)
    code, out, err = bench.run(["13", "14"], *words, "--resume")
    assert code == 0, err
    with CampaignStore.open(bench.out) as store:
        rows = store.rows()
    assert [(row.trial, row.status) for row in rows] == [(0, "done"), (1, "done"), (2, "done")]
    assert [row.slip_distance_m for row in rows] == [
        pytest.approx(mm * 1e-3) for mm in (12, 13, 14)
    ]
    assert "object lift" in out and "n 3" in out  # Table IV of all three
