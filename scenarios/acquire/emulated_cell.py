"""The emulated cell of the acquisition: one process, one pressed fingertip, arm and board on wires.

    python -m scenarios.acquire.emulated_cell   reads {"config": ..., "seed": ...}, a line of stdin

As ``scenarios.rigs.emulated_cell`` for the lift: one line of JSON when ready, ends with its parent.
There is no gripper: whatever the hand's pose, one finger points down.
"""

import json
import os
import threading
import time
from contextlib import ExitStack
from typing import Any, Self

import msgspec

from drivers.interfaces import PERIOD_NS
from drivers.takktile.emulator.server import BoardServer
from drivers.ur.emulator.robot import UrEmulator
from drivers.ur.emulator.settings import EmulatorSettings
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.world_of_seed import pressed_cell
from scenarios.rigs.cell_control import ControlServer
from scenarios.rigs.emulated_cell import at_free_address, end_on_signals, read_order


class EmulatedPressedCell:
    """One world behind two real wires and a control channel."""

    def __init__(self, config: AcquireConfig, seed: int, host: str) -> None:
        """Raises OSError when the address is taken."""
        self._lock = threading.RLock()
        self._start_ns = self._last_ns = time.monotonic_ns()
        self.cell = pressed_cell(config, seed, self._start_ns)
        arm = EmulatorSettings(host=host, start_m=config.arm_model.start_m)
        with ExitStack() as stack:
            self.arm = stack.enter_context(UrEmulator(arm, self.cell.arm, self._lock, self.advance))
            board = stack.enter_context(
                BoardServer(self.cell.board, self._lock, host, clock=self._advanced)
            )
            control = stack.enter_context(ControlServer(host, self.obey))
            self._stack = stack.pop_all()
        self.endpoints = {
            "host": host,
            "start_ns": self._start_ns,
            "tactile": {"url": board.url},
            "arm": {"host": host},
            "control": {"host": host, "port": control.port},
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def advance(self, now_ns: int) -> None:
        """Bring the world to now_ns; a time that has passed already changes nothing."""
        with self._lock:
            if now_ns > self._last_ns:
                self._last_ns = now_ns
                self.cell.advance(now_ns)

    def _advanced(self) -> int:
        now_ns = time.monotonic_ns()
        self.advance(now_ns)
        return now_ns

    def obey(self, request: dict[str, Any]) -> dict[str, Any]:
        """One request of the control channel; an unknown one is answered with an error."""
        verb = request.get("verb")
        if verb != "truth":
            return {"error": f"unknown verb {verb!r}: truth"}
        with self._lock:
            self.advance(time.monotonic_ns())
            return {"truth": msgspec.to_builtins(self.cell.truth())}


def main() -> None:
    ended = end_on_signals()
    order = read_order(ended)
    config = msgspec.convert(order["config"], AcquireConfig)
    warm = pressed_cell(config, 0)  # compiles the world, which takes seconds the first time
    warm.advance(PERIOD_NS)
    warm.pad.tips.codes()
    with at_free_address(lambda host: EmulatedPressedCell(config, order["seed"], host)) as cell:
        print(json.dumps({"ready": True, "pid": os.getpid(), **cell.endpoints}), flush=True)
        cell.arm.run(ended.is_set)


if __name__ == "__main__":
    main()
