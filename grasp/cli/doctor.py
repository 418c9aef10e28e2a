"""`grasp doctor`: check everything that a run needs and name every remedy; moves nothing."""

import argparse
from typing import Any

from grasp.cli import exits
from grasp.cli.options import OBJECT_HELP, add_runs, add_settings
from grasp.cli.output import json_line
from grasp.cli.parser import verb

HELP = "check this machine and the devices of a rig; moves nothing"
_MARK = {"ok": "ok  ", "warn": "warn", "fail": "FAIL"}


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "doctor", doctor, HELP, ". Reads only.")
    parser.option("--rig NAME", "also ask the devices of this rig (one of config/rigs, or a .toml "
        "file)")  # fmt: skip
    parser.option("--object NAME",
        f"of the lift that is to start: {OBJECT_HELP} (default: %(default)s)",
        default="can")  # fmt: skip
    parser.option("--profile NAME", "likewise: one of config/profiles", default="default")
    parser.option("--detector NAME", "likewise, as of `grasp run lift` (default: the profile's)")
    add_settings(parser)
    add_runs(parser)
    parser.flag("--json", "one JSON object on standard output, nothing else")


def doctor(args: argparse.Namespace) -> int:
    from scenarios.rigs.doctor import examine

    def load(rig: str, detector: str | None) -> Any:
        from scenarios.campaign.config import load_config, load_for_devices

        if detector is None:  # the run that is named
            named = args.object, rig, args.detector, args.config, args.set, args.profile
            return load_config(*named)
        return load_for_devices(args.object, rig, args.config, args.set, detector)

    def would_run(config: Any) -> None:
        from scenarios.trial.execution import make_guard

        make_guard(config)
        config.make_detector(3)

    own = (args.detector,) if args.detector else ()
    checks = examine(args.rig, args.config, load, would_run, own, args.runs)
    failed = [c for c in checks if c.status == "fail"]
    code = _code(failed)
    if args.json:
        print(json_line({"healthy": not failed, "checks": [c._asdict() for c in checks],
                          "exit_code": code}))  # fmt: skip
        return code
    width = max(len(c.name) for c in checks)
    for check in checks:
        print(f"{_MARK[check.status]}  {check.name:<{width}}  {check.detail}")
        if check.remedy:
            print(f"      {'':<{width}}  -> {check.remedy}")
    doubtful = sum(check.status == "warn" for check in checks)
    well = f"nothing stands against a run; {doubtful} to look at" if doubtful else "all well"
    if args.rig is None:
        well += " on this machine; no device was asked (--rig hardware asks a lab's)"
    print(f"{len(failed)} to mend; first: {failed[0].name}" if failed else well)
    return code


def _code(failed: list[Any]) -> int:
    """A configuration that cannot be read is a usage error here as everywhere, and so is a folder
    of recordings in which nothing can be written."""
    if any(check.name in ("configuration", "disk") for check in failed):
        return exits.USAGE
    return exits.DEVICE if failed else exits.SUCCESS
