"""The page of a campaign: rates beside the paper's, swept values, and every failure."""

import json
import re
import shlex
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.errors import BadFile
from grasp.cli.commands import build_parser
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import CampaignSpec, combinations, trials
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import wilson
from scenarios.campaign.worker import Row
from scenarios.report.campaign_page import campaign_page

SPEC = CampaignSpec(
    name="small", scenarios=("lift", "tap"), objects=("ball", "can"), detectors=("energy",),
    repetitions=10, sweep={"controller.lift_speed_mps": (0.05, 0.1)},
)  # fmt: skip
HOSTILE = "</p><script>alert(1)</script>"


def made(path: Path, spec: CampaignSpec, **more: Any) -> Path:
    """A campaign in which every fifth trial failed, with its recording, and one had an error."""
    grid = combinations(spec)
    with CampaignStore.create(path, spec, grid) as store:
        for task in trials(spec, grid):
            lost, lift = task.number % 5 == 0, task.scenario == "lift"
            values: dict[str, Any] = {
                "trial": task.number, "scenario": task.scenario, "object": task.config.object.name,
                "profile": task.config.profile, "detector": task.config.detector_name,
                "swept": json.dumps(task.swept), "repetition": task.repetition, "seed": task.seed,
                "set_down": task.set_down, "status": "done", "success": not lost,
                "config_hash": task.config.digest(),
                "outcome": ("dropped" if lost else "held") if lift else
                           ("undetected" if lost else "registered"),
                "moved": None if lift else True, "detection_latency_ms": None if lost else 60.0,
                "slip_distance_m": 0.004, "peak_force_n": 10.0, "detector_hash": "", "cpu_s": 0.5,
                "versions": json.dumps({"grasp": "0.1.0", "commit": "abc"}),
            }  # fmt: skip
            if task.number == 7:
                values |= {"status": "error", "error": f"Traceback\n{HOSTILE}", "success": None}
            row = msgspec.convert(values | more, Row)
            store.add(row, b"recorded" if lost and lift else None)
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("campaign") / "small.sqlite", SPEC)


@pytest.fixture(scope="module")
def page(file: Path) -> str:
    return campaign_page(file, file.with_suffix(".html"))


def settings_by(command: str) -> Any:
    """The settings of a run of that command."""
    args = build_parser().parse_args(shlex.split(command)[1:])
    config = load_config(args.object, args.rig, args.detector, None, args.set, args.profile)
    return config.for_tap() if args.command == "run tap" else config.for_lift()


def test_rates_are_shown_beside_the_papers_with_intervals(page: str) -> None:
    table = page.split("<h2>Object lift</h2>")[1].split("</table>", maxsplit=1)[0]
    ball = re.split(r'<th scope="row">\s*ball\s*</th>', table)[1].split("</tr>")[0]
    paper, *ours = re.findall(r"(\d+) % \((\d+)–(\d+)\)", ball)
    low, high = wilson(7, 20)
    assert paper == ("35", f"{100 * low:.0f}", f"{100 * high:.0f}")
    assert len(ours) == 2  # one for each value of the sweep
    assert "8 held" in ball and "2 dropped" in ball


def test_every_failure_is_listed_with_a_command_of_the_same_settings(file: Path, page: str) -> None:
    with CampaignStore.open(file) as store:
        failed = [row for row in store.rows() if not row.success]
    rows = (
        page.split("<h2>Trials that failed")[1].split("<tbody>")[1].split("</tbody>", maxsplit=1)[0]
    )
    commands = re.findall(r"<code>(.*?)</code>", rows)
    assert len(commands) == len(failed)
    for command, row in zip(commands, failed, strict=True):
        config = settings_by(command)
        assert config.controller.keep is not row.set_down
        controller = msgspec.structs.replace(config.controller, keep=True)
        config = msgspec.structs.replace(config, controller=controller)
        assert config.digest() == row.config_hash
        assert f"--seed {row.seed}" in command and row.object in command


def test_the_rig_is_named_and_failures_are_listed_only_where_there_are_some(
    tmp_path: Path, page: str
) -> None:
    facts = r'<p class="what">campaign small <span>· rig simulated · '
    assert re.search(facts, page) and "<h2>Trials that failed" in page
    file = made(tmp_path / "small.sqlite", SPEC, status="done", success=True, outcome="held")
    assert "<h2>Trials that failed" not in campaign_page(file, file.with_suffix(".html"))


def test_html_in_a_foreign_text_is_escaped(page: str) -> None:
    assert "<script" not in page
    assert "&lt;/p&gt;&lt;script&gt;" in page


@pytest.mark.parametrize("target", ["../secret.txt", "file:///etc/passwd", "javascript:alert(1)"])
def test_links_stay_in_the_campaigns_folder(tmp_path: Path, target: str) -> None:
    (tmp_path / "secret.txt").touch()
    (tmp_path / "own").mkdir()
    file = made(tmp_path / "own" / "small.sqlite", SPEC)
    with closing(sqlite3.connect(file)) as db, db:
        db.execute("UPDATE trials SET recording = ?", (target,))
    assert "<a href" not in campaign_page(file, file.with_suffix(".html"))


@pytest.mark.parametrize("settings", [None, "[]", "{}", '{"object": 1}'])
def test_settings_of_another_shape_are_refused(tmp_path: Path, settings: str | None) -> None:
    file = made(tmp_path / "small.sqlite", SPEC)
    with closing(sqlite3.connect(file)) as db, db:
        db.execute("UPDATE configs SET settings = ?", (settings,))
    with pytest.raises(BadFile, match=r"small\.sqlite: "):
        campaign_page(file, file.with_suffix(".html"))
