"""A recorded trial as a table for other programs: `grasp export RUN --to csv`."""

import csv
import io
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from scenarios.report.run_record import RunRecord, read_run

Floats = NDArray[np.float64]
BEGINS = "t_s,phase,"  # how a table of ours is recognised


def as_csv(path: Path) -> str:
    """One row a control step, units in the names of the columns; empty: not known then, or never.
    Raises BadFile as ``read_run``."""
    run = read_run(path)
    columns = _columns(run)
    begins = np.array([change.t_ns * 1e-9 for change in run.phases])
    at = np.searchsorted(begins, run.t_s + 1e-9, side="right") - 1
    phases = [run.phases[i].phase if i >= 0 else "" for i in at]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["t_s", "phase", *columns])
    for i, t_s in enumerate(run.t_s):
        values = (float(column[i]) for column in columns.values())
        cells = ("" if math.isnan(value) else f"{value:.6g}" for value in values)
        writer.writerow([f"{t_s:.6f}", phases[i], *cells])
    return out.getvalue()


def _columns(run: RunRecord) -> dict[str, Floats]:
    """In their order; what nobody knows on that rig is no column."""
    found: dict[str, Floats] = {
        "armed": run.armed.astype(np.float64),
        "masked": run.masked.astype(np.float64),
        "registered": run.registered.astype(np.float64),
        **_by_finger("probability", run.known(run.probabilities)),
        **_by_finger("felt_n", run.known(run.felt_n)),
        **_by_finger("position_counts", run.fingers_counts),
        **{f"arm_{axis}_m": run.arm_m[:, i] for i, axis in enumerate("xyz")},
    }
    for i, name in enumerate(FINGER_NAMES):
        taxels = range(run.counts.shape[2])
        found |= {f"taxel_{name}{k}_counts": run.counts[:, i, k] for k in taxels}
    if (motion := run.motion) is not None:
        found |= _by_finger("told_speed_mps", motion.speed_mps)
        found |= _by_finger("told_direction_deg", motion.direction_deg)
        found |= _by_finger("told_turning", motion.turning)
    if (truth := run.truth) is not None:
        found |= _by_finger("true_n", truth.normal_n)
        found |= _by_finger("true_shear_n", truth.shear_n)
        found |= {
            "true_height_m": truth.height_m, "true_slip_m": truth.slip_m,
            "true_slip_mps": truth.slip_mps, "true_across_m": truth.across_m,
            "true_turn_rad": truth.turn_rad,
        }  # fmt: skip
    return found


def _by_finger(what: str, values: Floats) -> dict[str, Floats]:
    return {f"{name}_{what}": values[:, i] for i, name in enumerate(FINGER_NAMES)}
