"""What `grasp doctor` looks at. Standard library at the top, so that it runs where packages are
missing; every check returns its finding, none raises, and nothing moves.
"""

import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from drivers.errors import GraspError
from scenarios.rigs.checks import Check, guarded

JITTER_S = 2.0
JITTER_WARN_MS = 5.0
DISK_WARN_BYTES = 500_000_000
DISTRIBUTION = "grasp-controller"


# a rig's name and a detector's (None: that of the run which is asked about) in, the settings of a
# trial out; raises ConfigError
Load = Callable[[str, str | None], Any]
WouldRun = Callable[[Any], object]  # raises where a run with such settings would be refused


def examine(
    rig: str | None, files: Sequence[Path] | None, load: Load, would_run: WouldRun,
    detectors: Sequence[str] = (), runs: Path = Path("runs"),
) -> list[Check]:  # fmt: skip
    """All checks of this machine, then those of the rig's devices if one is named. ``detectors``
    are looked at beside those that are installed; ``runs`` is where a run would be recorded."""
    checks = [_python(), *_packages(), _configuration(rig, files, load)]
    readable = checks[-1].status == "ok"
    checks += _detectors(load, detectors) if readable else [_unseen("detectors")]
    checks.append(guarded("usb", _usb))
    checks += _devices(rig, load, would_run) if readable else [_unseen("devices")]
    checks += [guarded("loop jitter", _jitter), guarded("real-time scheduling", _scheduling)]
    return [*checks, guarded("disk", lambda: _disk(runs))]


def _python() -> Check:
    detail = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if (3, 11) <= sys.version_info[:2] <= (3, 12):
        return Check("python", "ok", detail)
    return Check("python", "fail", detail, "use Python 3.11 or 3.12")


def _packages() -> Iterator[Check]:
    try:
        wanted = [r for r in requires(DISTRIBUTION) or [] if "extra ==" not in r]
    except PackageNotFoundError:
        yield Check("packages", "warn", f"{DISTRIBUTION} is not installed", "run `make install`")
        return
    found, missing = [], []
    for name in (re.split(r"[^\w.-]", requirement)[0] for requirement in wanted):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    yield Check("packages", "ok", ", ".join(found))
    if missing:
        yield Check("packages", "fail", "missing: " + ", ".join(missing), "run `make install`")


def _unseen(name: str) -> Check:
    return Check(name, "warn", "not looked at: the configuration comes first")


def _configuration(rig: str | None, files: Sequence[Path] | None, load: Load) -> Check:
    def look() -> Check:
        from grasp.settings import config_dir

        config = load(rig or "simulated", None)
        own = ", ".join(map(str, files or ()))
        extra = own or os.environ.get("GRASP_CONFIG") or "no further file"
        return Check("configuration", "ok", f"{config_dir()}, {extra}, hash {config.digest()}")

    return guarded("configuration", look)


def _detectors(load: Load, more: Sequence[str]) -> Iterator[Check]:
    def look(name: str) -> Check:
        import numpy as np

        config = load("simulated", name)
        detector = config.make_detector(3)
        shape = (200, 3, config.tactile.taxels)
        frames = np.random.default_rng(0).integers(-200, 0, shape, dtype=np.int16)
        start = time.perf_counter_ns()
        for frame in frames:
            detector.update(frame)
        spent_us = (time.perf_counter_ns() - start) / len(frames) * 1e-3
        return Check(f"detector {name}", "ok", f"loads; {spent_us:.0f} us an update")

    try:
        from detector.interface import DETECTORS
        from detector.plugins import offered
    except ImportError as error:
        yield Check("detectors", "fail", str(error), "run `make install`")
        return
    for name in dict.fromkeys([*DETECTORS, *offered(), *more]):
        yield guarded(f"detector {name}", lambda n=name: look(n))  # type: ignore[misc]


def _usb() -> Check:
    """Is a fingertip board on the bus, and may this user open it? Reads sysfs alone."""
    from drivers.takktile.link import DEVICES, IDS, INSTALL, boards

    if not DEVICES.is_dir():
        return Check("usb", "warn", "no USB bus on this machine")
    found = list(boards())
    for board in found:
        if board.allowed:
            serial = board.serial or "none"
            return Check("usb", "ok", f"fingertip board at {board.node}, serial number: {serial}")
    if found:
        return Check("usb", "fail", f"{found[0].node}: no permission", f"run {INSTALL}")
    return Check("usb", "warn", f"no fingertip board ({IDS}) on the bus", "plug it in")


def _devices(rig: str | None, load: Load, would_run: WouldRun) -> list[Check]:
    """Ask gripper, arm and fingertips of a wired rig; an emulated one gets a cell meanwhile."""
    try:
        if rig is None or (config := load(rig, None)).rig == "simulated":
            return []
        from scenarios.rigs.device_checks import ask_devices

        if config.rig != "emulated":
            return ask_devices(config, would_run)
        from scenarios.rigs.cell_process import at_endpoints, cell_process

        with cell_process(config, 0) as cell:
            return ask_devices(at_endpoints(config, cell.endpoints), would_run)
    except GraspError as error:
        return [Check("devices", "fail", error.message, error.remedy)]
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        return [Check("devices", "fail", message, "see the message")]


def _jitter() -> Check:
    """How late a 100 Hz loop with absolute deadlines wakes on this machine now."""
    late = []
    deadline = time.monotonic_ns()
    for _ in range(int(JITTER_S * 100)):
        deadline += 10_000_000
        time.sleep(max(0.0, (deadline - time.monotonic_ns()) * 1e-9))
        late.append((time.monotonic_ns() - deadline) * 1e-6)
    late.sort()
    p99 = late[int(0.99 * (len(late) - 1))]
    detail = f"100 Hz for {JITTER_S:g} s: late by p99 {p99:.2f}, max {late[-1]:.2f} ms"
    if p99 < JITTER_WARN_MS:
        return Check("loop jitter", "ok", detail)
    remedy = "stop other programs, or allow real-time scheduling"
    return Check("loop jitter", "warn", detail, remedy)


def _scheduling() -> Check:
    """May this user ask for real-time scheduling? Tried in a child, so nothing changes here."""
    from grasp.realtime import PRIORITY

    pid = os.fork()
    if pid == 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError:
            os._exit(1)
        os._exit(0)
    allowed = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    if allowed:
        return Check("real-time scheduling", "ok", f"SCHED_FIFO {PRIORITY} allowed")
    return Check(
        "real-time scheduling", "warn", "SCHED_FIFO not allowed",
        f"in /etc/security/limits.d: `@realtime - rtprio {PRIORITY}`, join that group",
    )  # fmt: skip


def _disk(runs: Path) -> Check:
    from grasp.files import against_writing, nearest

    folder = nearest(runs)
    if against := against_writing(folder):
        remedy = "start `grasp` from another folder, or record elsewhere with --runs"
        return Check("disk", "fail", f"no run can be recorded: {str(runs)!r}: {against}", remedy)
    free = shutil.disk_usage(folder).free
    detail = f"{free / 1e9:.1f} GB free here; a run takes about 0.3 MB"
    if free > DISK_WARN_BYTES:
        return Check("disk", "ok", detail)
    return Check("disk", "warn", detail, "free space, or record elsewhere with --runs")
