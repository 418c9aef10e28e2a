"""A grid of trials, and a column of its rows: how far objects slip at two speeds of the arm."""

import json
from pathlib import Path

import numpy as np

import grasp

done = grasp.campaign(Path(__file__).with_suffix(".toml"), jobs=0)
slip_mm = done.column("slip_distance_m") * 1e3
speed = np.array([json.loads(row.swept)["controller.lift_speed_mps"] for row in done.rows])
for each in np.unique(speed):
    print(f"{each:g} m/s: {np.median(slip_mm[speed == each]):.1f} mm slip in the median")
print(f"{done.summary.trials} trials, {done.summary.errors} errors")
