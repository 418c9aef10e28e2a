"""Checks of `grasp doctor` on this machine. An error in a check is its result; nothing moves."""

import os
import shutil
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from detector.loading import DETECTORS
from detector.plugins import installed_plugins
from drivers.checks import Check, Finding, checked, failed
from drivers.takktile.link import DEVICES, IDS, INSTALL, boards
from grasp.files import nearest_folder, why_not_writable
from grasp.run.realtime import PRIORITY
from grasp.settings import config_dir
from scenarios.rigs.device_checks import ask_devices
from scenarios.rigs.emulated import at_endpoints, cell_process
from scenarios.rigs.opening import open_rig

JITTER_S, JITTER_WARN_MS = 2.0, 5.0
DISK_WARN_BYTES = 500_000_000
NOT_YET = "not checked: fix the configuration first"

# settings of a trial for the names of a rig and of a detector (None: that of the checked run);
# raises ConfigError
Load = Callable[[str, str | None], Any]
WouldRun = Callable[[Any], object]  # raises where a run with such settings would be refused


def examine(
    rig: str | None, files: Sequence[Path] | None, load: Load, would_run: WouldRun,
    detectors: Sequence[str] = (), runs: Path = Path("runs"),
) -> list[Check]:  # fmt: skip
    """Run all checks of this machine and of the named rig's devices. ``detectors`` are checked in
    addition to those that are installed; ``runs`` is the folder of recordings."""
    checks = [checked("configuration", lambda: _configuration(rig, files, load))]
    readable = checks[0].status == "ok"
    checks += _detectors(load, detectors) if readable else [Check("detectors", "warn", NOT_YET)]
    checks += [checked("simulation", partial(_simulation, load))] if readable else []
    checks.append(checked("usb", _usb))
    checks += _devices(rig, load, would_run) if readable else [Check("devices", "warn", NOT_YET)]
    checks.append(checked("loop jitter", _jitter))
    checks.append(checked("real-time scheduling", _scheduling))
    return [*checks, checked("disk", lambda: _disk(runs))]


def _configuration(rig: str | None, files: Sequence[Path] | None, load: Load) -> Finding:
    config = load(rig or "simulated", None)
    given = ", ".join(map(str, files or ()))
    extra = given or os.environ.get("GRASP_CONFIG") or "no other file"
    return "ok", f"{config_dir()}, {extra}, hash {config.digest()}"


def _detectors(load: Load, more: Sequence[str]) -> list[Check]:
    names = dict.fromkeys([*DETECTORS, *installed_plugins(), *more])
    return [checked(f"detector {name}", partial(_detector, load, name)) for name in names]


def _detector(load: Load, name: str) -> Finding:
    config = load("simulated", name)
    detector = config.make_detector(3)
    shape = (200, 3, config.tactile.taxels)
    frames = np.random.default_rng(0).integers(-200, 0, shape, dtype=np.int16)
    start = time.perf_counter_ns()
    for frame in frames:
        detector.update(frame)
    spent_us = (time.perf_counter_ns() - start) / len(frames) * 1e-3
    return "ok", f"loads; {spent_us:.0f} us per update"


def _simulation(load: Load) -> Finding:
    with open_rig(load("simulated", None), 0, paced=False):  # loads its compiled functions
        return "ok", "a simulated cell opens"


def _usb() -> Finding:
    """Check that a fingertip board is on the bus and this user may open it; reads only sysfs."""
    if not DEVICES.is_dir():
        return "warn", "no USB bus on this machine"
    found = list(boards())
    for board in found:
        if board.allowed:
            serial = board.serial or "none"
            return "ok", f"fingertip board at {board.node}, serial number: {serial}"
    if found:
        return "fail", f"{found[0].node}: no permission", f"run {INSTALL}"
    return "warn", f"no fingertip board ({IDS}) on the bus", "plug it in"


def _devices(rig: str | None, load: Load, would_run: WouldRun) -> list[Check]:
    """Check gripper, arm and fingertips of a wired rig; starts a cell for an emulated one."""
    try:
        if rig is None or (config := load(rig, None)).rig == "simulated":
            return []
        if config.rig != "emulated":
            return ask_devices(config, would_run)
        with cell_process(config, 0) as cell:
            return ask_devices(at_endpoints(config, cell.endpoints), would_run)
    except Exception as error:  # the doctor reports every error
        return [failed("devices", error)]


def _jitter() -> Finding:
    """Measure how late a 100 Hz loop with absolute deadlines wakes on this machine."""
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
        return "ok", detail
    return "warn", detail, "stop other programs, or allow real-time scheduling"


def _scheduling() -> Finding:
    """Check that this user may use real-time scheduling; tried in a child process."""
    pid = os.fork()
    if pid == 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError:
            os._exit(1)
        os._exit(0)
    if os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0:
        return "ok", f"SCHED_FIFO {PRIORITY} allowed"
    remedy = f"in /etc/security/limits.d: `@realtime - rtprio {PRIORITY}`, join that group"
    return "warn", "SCHED_FIFO not allowed", remedy


def _disk(runs: Path) -> Finding:
    folder = nearest_folder(runs)
    if problem := why_not_writable(folder):
        remedy = "start `grasp` from another folder, or record elsewhere with --runs"
        return "fail", f"no run can be recorded: {str(runs)!r}: {problem}", remedy
    free = shutil.disk_usage(folder).free
    detail = f"{free / 1e9:.1f} GB free here; a run takes about 0.3 MB"
    if free > DISK_WARN_BYTES:
        return "ok", detail
    return "warn", detail, "free space, or record elsewhere with --runs"
