"""What `grasp doctor` looks at. Standard library at the top, so that it runs where packages are
missing; every check returns its finding, none raises, and nothing moves.
"""

import importlib
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from pathlib import Path
from typing import Any, NamedTuple

from drivers.errors import ConfigError, GraspError

JITTER_S = 2.0
JITTER_WARN_MS = 5.0
DISK_WARN_BYTES = 500_000_000
DISTRIBUTION = "grasp-controller"
OWN_PACKAGES = ("grasp", "drivers", "detector", "scenarios")


# a rig's name and a detector's in, the settings of a trial out; raises ConfigError
Load = Callable[[str, str], Any]


class Check(NamedTuple):
    """One finding: status is ok, warn or fail; the remedy is empty when all is well."""

    name: str
    status: str
    detail: str
    remedy: str = ""


def examine(rig: str | None, files: Sequence[Path] | None, load: Load) -> list[Check]:
    """All checks of this machine, then those of the rig's devices if one is named."""
    checks = [_python(), *_packages(), *_shadows(), *_rivals(), _configuration(rig, files, load)]
    readable = checks[-1].status == "ok"
    checks += _detectors(load) if readable else [_unseen("detectors")]
    checks.append(_guarded("usb", _usb))
    checks += _devices(rig, load) if readable or rig is None else [_unseen("devices")]
    checks += [_guarded("loop jitter", _jitter), _guarded("real-time scheduling", _scheduling)]
    return [*checks, _disk()]


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
    for requirement in wanted:
        name = requirement.split(";")[0].split("[")[0]
        for sign in "<>=!~ ":
            name = name.split(sign)[0]
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    yield Check("packages", "ok", ", ".join(found))
    if missing:
        yield Check("packages", "fail", "missing: " + ", ".join(missing), "run `make install`")


def _shadows() -> Iterator[Check]:
    """A lab's own folder called `drivers` must not stand in for ours."""
    home = Path(__file__).parents[2]
    for name in OWN_PACKAGES:
        origin = importlib.import_module(name).__file__
        if origin is None or Path(origin).parent.parent != home:
            yield Check(
                "own packages", "fail", f"{name} comes from {origin}",
                "start `grasp` from another folder, or rename yours",
            )  # fmt: skip


def _rivals() -> Iterator[Check]:
    """Another distribution with a top-level name of ours: which files are imported then is a matter
    of who was installed last."""
    known = packages_distributions()
    for name in OWN_PACKAGES:
        others = sorted(set(known.get(name, ())) - {DISTRIBUTION})
        if others:
            yield Check(
                "own packages", "warn", f"{name} is also provided by {', '.join(others)}",
                f"keep {DISTRIBUTION} in an environment of its own, or uninstall {others[0]}",
            )  # fmt: skip


def _unseen(name: str) -> Check:
    return Check(name, "warn", "not looked at: the configuration comes first")


def _guarded(name: str, look: Callable[[], Check]) -> Check:
    """The finding, or a failure made of whatever error came instead."""
    try:
        return look()
    except GraspError as error:
        return Check(name, "fail", error.message, error.remedy)
    except Exception as error:  # a doctor reports, whatever it meets
        return Check(name, "fail", f"{type(error).__name__}: {error}", "see the message")


def _configuration(rig: str | None, files: Sequence[Path] | None, load: Load) -> Check:
    def look() -> Check:
        from grasp.settings import config_dir

        config = load(rig or "simulated", "energy")
        own = ", ".join(map(str, files or ()))
        extra = own or os.environ.get("GRASP_CONFIG") or "no further file"
        return Check("configuration", "ok", f"{config_dir()}, {extra}, hash {config.digest()}")

    return _guarded("configuration", look)


def _detectors(load: Load) -> Iterator[Check]:
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
        from detector.own import offered
    except ImportError as error:
        yield Check("detectors", "fail", str(error), "run `make install`")
        return
    for name in dict.fromkeys([*DETECTORS, *offered()]):
        yield _guarded(f"detector {name}", lambda n=name: look(n))  # type: ignore[misc]


def _usb() -> Check:
    """Is a fingertip board on the bus, and may this user open it? Reads sysfs alone."""
    from drivers.takktile.protocol import PRODUCT_ID, VENDOR_ID

    board = f"{VENDOR_ID:04x}:{PRODUCT_ID:04x}"
    base = Path("/sys/bus/usb/devices")
    if not base.is_dir():
        return Check("usb", "warn", "no USB bus on this machine", "")
    for entry in base.iterdir():
        try:
            ids = ":".join((entry / name).read_text().strip() for name in ("idVendor", "idProduct"))
            bus, number = (int((entry / name).read_text()) for name in ("busnum", "devnum"))
        except (OSError, ValueError):
            continue
        if ids != board:
            continue
        node = f"/dev/bus/usb/{bus:03d}/{number:03d}"
        if os.access(node, os.R_OK | os.W_OK):
            serial = entry / "serial"
            known = serial.read_text().strip() if serial.is_file() else "none"
            return Check("usb", "ok", f"fingertip board at {node}, serial number: {known}")
        return Check(
            "usb", "fail", f"{node}: no permission", "install the rule of `grasp tactile udev`"
        )
    return Check("usb", "warn", f"no fingertip board ({board}) on the bus", "plug it in")


def _devices(rig: str | None, load: Load) -> list[Check]:
    """Ask gripper, arm and fingertips of a wired rig; an emulated one gets a cell meanwhile."""
    if rig is None or rig == "simulated":
        return []
    try:
        config = load(rig, "energy")
        if config.rig == "simulated":
            return []
        if config.rig != "emulated":
            return _ask_devices(config)
        from scenarios.rigs.cell_process import at_endpoints, cell_process

        with cell_process(config, 0) as cell:
            return _ask_devices(at_endpoints(config, cell.endpoints))
    except GraspError as error:
        return [Check("devices", "fail", error.message, error.remedy)]
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        return [Check("devices", "fail", message, "see the message")]


def _ask_devices(config: Any) -> list[Check]:
    hand = [_guarded(name, partial(look, config)) for name, look in
            (("calibration", _calibration), ("cell", _cell), ("gripper", _gripper))]  # fmt: skip
    return [*hand, *arm_checks(config), _guarded("fingertips", lambda: _board(config))]


def _calibration(config: Any) -> Check:
    """Has somebody said which hand this is? A run is refused where nobody has."""
    from scenarios.rigs.rig import calibration

    chosen = calibration(config)
    least = f"force byte 0 is {chosen.least_force_n:g} N"
    return Check("calibration", "ok", f"{config.gripper.calibration}: {least}")


def _cell(config: Any) -> Check:
    """Does a run drive it? Its locks are held for an instant, and let go."""
    from scenarios.rigs.cell_lock import devices_of, driving

    try:
        devices = devices_of(config)
    except ConfigError:  # told by whoever asks the device
        return Check("cell", "warn", "not looked at: an address is missing")
    with driving(*devices):  # raises the name of who does
        return Check("cell", "ok", "driven by no run of this machine")


def _board(config: Any) -> Check:
    """Find and open the board that the rig names, and let it go again."""
    from scenarios.rigs.permission import board_address
    from scenarios.rigs.wired import board_finder

    board_address(config)  # raises where nobody has said which
    if config.devices.fingertips:
        return _foreign("fingertips", config)
    board = board_finder(config, time.monotonic_ns)(None)
    board.close()
    return Check("fingertips", "ok", f"board {board.serial} is there")


def _gripper(config: Any) -> Check:
    """Read the status registers once; write nothing."""
    from drivers.robotiq.link.modbus import ModbusTransport
    from drivers.robotiq.protocol import (
        FAULTS,
        REGISTERS,
        RTU,
        TCP,
        StatusRegisters,
    )
    from scenarios.rigs.permission import gripper_address

    gripper_address(config)  # raises where nobody has said which
    if config.devices.gripper:
        return _foreign("gripper", config)
    link = TCP if config.gripper.link == "tcp" else RTU
    transport = ModbusTransport(config.modbus, config.gripper.link)
    try:
        words = transport.read(link.status_register, REGISTERS, time.monotonic_ns())
    finally:
        transport.close()
    status = StatusRegisters.from_registers(words)
    fault = FAULTS[status.fault]
    state = "active" if status.ready else "not activated"
    if fault.code:
        return Check("gripper", "fail", f"answers, {state}; {fault.text}", fault.remedy)
    return Check("gripper", "ok", f"answers, {state}, no fault")


def arm_checks(config: Any) -> list[Check]:
    """Ask the arm's controller how it is; moves nothing, raises nothing."""
    if config.devices.arm:
        return [_guarded("arm", lambda: _foreign("arm", config))]
    from drivers.ur.link.preflight import preflight
    from scenarios.rigs.permission import arm_address

    try:
        report = preflight(arm_address(config), config.ur.step_timeout_s)
    except GraspError as error:
        return [Check("arm", "fail", error.message, error.remedy)]
    return [Check(f"arm {c.name}", c.status, c.detail, c.remedy) for c in report.checks]


def _foreign(device: str, config: Any) -> Check:
    """A device of another package: is it installed? Opening it might move it."""
    from scenarios.rigs.own_devices import check_offered

    check_offered(config.devices)
    return Check(device, "warn", f"{config.devices.called(device)}: of another package, not asked")


def _jitter() -> Check:
    """How late a 100 Hz loop with absolute deadlines wakes on this machine now."""
    from detector.scores.quantiles import quantile
    from drivers.interfaces import PERIOD_NS

    late = []
    deadline = time.monotonic_ns()
    for _ in range(int(JITTER_S * 1e9 / PERIOD_NS)):
        deadline += PERIOD_NS
        time.sleep(max(0.0, (deadline - time.monotonic_ns()) * 1e-9))
        late.append((time.monotonic_ns() - deadline) * 1e-6)
    late.sort()
    p50, p99, most = (quantile(late, share) for share in (0.5, 0.99, 1.0))
    detail = f"100 Hz for {JITTER_S:g} s: late by p50 {p50:.2f}, p99 {p99:.2f}, max {most:.2f} ms"
    if p99 < JITTER_WARN_MS:
        return Check("loop jitter", "ok", detail)
    return Check(
        "loop jitter", "warn", detail, "stop other programs, or allow real-time scheduling"
    )


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


def _disk() -> Check:
    free = shutil.disk_usage(".").free
    detail = f"{free / 1e9:.1f} GB free here; a run takes about 0.3 MB"
    if free > DISK_WARN_BYTES:
        return Check("disk", "ok", detail)
    return Check("disk", "warn", detail, "free space, or record elsewhere with --runs")
