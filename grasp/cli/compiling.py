"""Compiles the simulation, once on a machine, as `make install` does:

    python -m grasp.cli.compiling

It runs a lift, a tap, a pressed fingertip and every detector; numba keeps what these compile.
"""

import gc
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import event
from numba.core.dispatcher import Dispatcher

from detector.interface import DETECTORS
from drivers.interfaces import FINGERS
from grasp.cli.output import progress
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.session import pressed_gain
from scenarios.campaign.config import load_config
from scenarios.campaign.experiments import EXPERIMENTS
from scenarios.rigs import simulated  # noqa: F401  (its compiled functions are counted)

DOING = "compiling the simulation (once)"
PACKAGES = ("detector", "drivers", "scenarios")
EVERY_S = 5.0


class Count(event.Listener):
    """Reports how many of this project's compiled functions are ready, and how many there are."""

    def __init__(self, report: Callable[[int, int], object]) -> None:
        self._all = {of(each) for each in gc.get_objects() if isinstance(each, Dispatcher)}
        self._all = {name for name in self._all if name.startswith(PACKAGES)}
        self._ready: set[str] = set()
        self._report = report

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        if (name := of(event.data["dispatcher"])) in self._all:
            self._ready.add(name)
            self._report(len(self._ready), len(self._all))


def of(dispatcher: Any) -> str:
    """Module and name of a compiled function."""
    return f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"


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
    with (
        progress(DOING, every_s=EVERY_S) as report,
        event.install_listener("numba:compile", Count(report)),
    ):
        compile_simulation()


if __name__ == "__main__":
    main()
