"""Run a campaign and compare the slip distance at two speeds of the arm."""

import json
from pathlib import Path

import numpy as np

import grasp

campaign = grasp.campaign(Path(__file__).with_suffix(".toml"), jobs=0)
slip_mm = campaign.column("slip_distance_m") * 1e3
speed = np.array([json.loads(row.swept)["controller.lift_speed_mps"] for row in campaign.rows])
for each in np.unique(speed):
    print(f"{each:g} m/s: median slip {np.median(slip_mm[speed == each]):.1f} mm")
print(f"{campaign.summary.trials} trials, {campaign.summary.errors} errors")
