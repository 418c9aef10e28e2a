"""`grasp doctor`: check everything that a run needs, with remedies; moves nothing. `grasp doctor
HOST...`: list the devices that answer at these addresses."""

from drivers.checks import failures
from grasp.cli import exits
from grasp.cli.device_commands import DoctorOptions
from grasp.cli.output import show
from scenarios.campaign.config import RunConfig, load_config, load_for_devices
from scenarios.lab.find import find, settings_of
from scenarios.rigs.doctor import examine
from scenarios.trial.execution import make_guard
from scenarios.world import COMPILING, is_compiled

MARKS = {"ok": "ok  ", "warn": "warn", "fail": "FAIL"}


def doctor(args: DoctorOptions) -> int:
    if args.hosts:
        return _find(args)

    def load(rig: str, detector: str | None) -> RunConfig:
        if detector is None:  # settings of the run in the options
            return load_config(args.object, rig, args.detector, args.config, args.set, args.profile)
        return load_for_devices(args.object, rig, args.config, args.set, detector)

    def check_run(config: RunConfig) -> None:
        make_guard(config)
        config.make_detector(3)

    if not is_compiled():
        exits.print_detail(COMPILING)
    detectors = (args.detector,) if args.detector else ()
    checks = examine(args.rig, args.config, load, check_run, detectors, args.runs)
    failed = failures(checks)
    code = exits.DEVICE if failed else exits.SUCCESS
    if any(check.name in ("configuration", "disk") for check in failed):
        code = exits.USAGE  # as in other commands

    def text() -> str:
        width, lines = max(len(check.name) for check in checks), []
        for check in sorted(checks, key=lambda check: check.status == "fail"):  # failures last
            detail = check.detail.replace("\n", f"\n      {'':<{width}}  ")
            lines.append(f"{MARKS[check.status]}  {check.name:<{width}}  {detail}")
            if check.remedy:
                lines.append(f"      {'':<{width}}  -> {check.remedy}")
        warned = sum(check.status == "warn" for check in checks)
        end = f"a run is possible; warnings: {warned}" if warned else "all checks passed"
        if args.rig is None:
            end += " on this machine; no device was queried (--rig hardware queries them)"
        if failed:
            first = f"{failed[0].name} ({failed[0].remedy or failed[0].detail})"
            end = f"failed checks: {', '.join(check.name for check in failed)}; fix first: {first}"
        return "\n".join([*lines, end])

    found = [check._asdict() for check in checks]
    return show(args, {"healthy": not failed, "checks": found, "exit_code": code}, text, code)


def _find(args: DoctorOptions) -> int:
    found = list(find(args.hosts))
    settings = settings_of(found)
    lines = [
        f"{'yes' if f.answered else 'no':<4}  {f.device} at {f.where}: {f.detail}" for f in found
    ]
    if settings:
        lines += ["", "for your settings file, e.g. lab.toml:", "", settings]
    code = exits.SUCCESS if any(f.answered for f in found) else exits.DEVICE
    return show(args, {"found": found, "settings": settings}, "\n".join(lines), code)
