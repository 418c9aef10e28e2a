"""Compiles the simulation, once on a machine, as `make install` does:

    python -m grasp.cli.compiling

It runs a lift, a tap, a pressed fingertip and every detector; numba keeps what these compile.
"""

import argparse
import os
import sys

import numpy as np

from detector.loading import DETECTORS
from drivers.interfaces import FINGERS
from grasp.cli.output import progress
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.session import pressed_gain
from scenarios.campaign.config import load_config
from scenarios.campaign.experiments import EXPERIMENTS
from scenarios.rigs.compilation import count_compilation
from scenarios.world import COMPILING

EVERY_S = 5.0


def compile_simulation() -> None:
    """Run everything that has compiled functions."""
    config = load_config("can", "simulated")
    for name in DETECTORS:
        made = load_config("can", "simulated", name).make_detector(FINGERS)
        made.update(np.zeros((FINGERS, config.tactile.taxels), np.int16))
    for experiment in EXPERIMENTS.values():
        experiment.run(experiment.select(config), 0, None)
    pressed_gain(load_acquire_config("planar", "simulated"), 0)


def main() -> None:
    os.environ.pop("GRASP_CONFIG", None)  # not every detector reads the user's settings
    with progress(COMPILING, every_s=EVERY_S) as report, count_compilation(report):
        compile_simulation()


if __name__ == "__main__":
    about = "Compile the simulation, once on a machine."
    argparse.ArgumentParser(description=about, allow_abbrev=False).parse_args()
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)  # what is compiled is kept
