"""What a part of the results gets: its settings, data sets, studies and campaigns."""

import shlex
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

from grasp.cli.options import Pool
from grasp.cli.output import progress
from grasp.cli.parser import Parser
from grasp.settings import file_of
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import load_dataset_config, plan, reduced
from scenarios.campaign import run as campaigns
from scenarios.campaign import worker
from scenarios.campaign.spec import read_spec
from scenarios.campaign.store import CampaignStore
from scenarios.rigs.workers import Workers
from studies import runner
from studies.results_page import Topic


class DataSet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of config/datasets, with a seed of its own."""

    set: str
    seed: int
    share: float


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """studies/results.toml."""

    intro: str
    data: dict[str, DataSet]
    detectors: tuple[str, ...]
    campaign: dict[str, Any]  # changes of config/campaigns/paper.toml
    hands: dict[str, tuple[str, ...]]  # settings of each hand
    hand_campaign: dict[str, Any]
    studies: dict[str, str]  # options
    contact_step_s: float
    speed_lifts: int
    rig_lifts: int
    rig_settings: tuple[str, ...]
    topics: list[Topic]


class Run(msgspec.Struct, frozen=True):
    """What a part gets. ``work`` holds data sets, ``folder`` what this part stores."""

    settings: Settings
    work: Path
    folder: Path
    jobs: int
    real: Path | None  # a labelled recording, for the part `benchmark`

    def data(self, name: str) -> Path:
        """Folder of a data set; missing recordings are made."""
        chosen, out = self.settings.data[name], self.work / "data" / name
        config = load_dataset_config(file_of("datasets", chosen.set))
        config = msgspec.structs.replace(reduced(config, chosen.share), seed=chosen.seed)
        with progress(f"data set {name}") as show:
            build(plan(config), config, out, Workers(self.jobs), show)
        return out

    def study(self, name: str, words: str = "", jobs: int | None = None) -> list[Any]:
        """Rows of a study; those stored are not run again."""
        study, parser = import_module(f"studies.{name}").STUDY, Parser(prog=name)
        study.options(parser)
        Pool.add_to(parser)
        options = f"{self.settings.studies[name]} {words} --jobs {jobs or self.jobs}"
        args = parser.parse_args(shlex.split(options))
        return runner.run(study, study.grid(args), args, self.folder)

    def campaign(self, name: str, changes: dict[str, Any]) -> list[worker.Row]:
        """Rows of the paper's campaign with changes; those stored are not run again."""
        spec = read_spec(file_of("campaigns", "paper"))
        spec = msgspec.convert(msgspec.to_builtins(spec) | changes, type(spec))
        path = self.folder / f"{name}.sqlite"
        self.folder.mkdir(parents=True, exist_ok=True)
        with progress(name) as show:
            campaigns.run(spec, path, Workers(self.jobs), resume=path.exists(),
                          on_progress=lambda p: show(p.done, p.total))  # fmt: skip
        with CampaignStore.open(path) as store:
            return store.rows()
