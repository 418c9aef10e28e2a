"""A controller without sockets, in virtual time."""

from contextlib import nullcontext

from drivers.ur.emulator.controller import (
    Controller,
    EmulatorSettings,
    RuntimeState,
    SafetyMode,
)
from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings

PERIOD_NS = 8_000_000
DOWN = "3.141592653589793, 0, 0"


class Bench:
    """A controller whose cycles are run by the test."""

    def __init__(self):
        settings = EmulatorSettings(host="127.0.0.2")
        self.arm = ArmModel(ArmModelSettings(), 0, command_latency_s=0.0)
        self.motion = RobotMotion(PERIOD_NS * 1e-9, self.arm, nullcontext(), 0)
        self.controller = Controller(settings, self.motion, 0)
        self.now_ns = 0

    def cycles(self, count, inputs=None):
        for _ in range(count):
            self.now_ns += PERIOD_NS
            self.controller.step(self.now_ns, inputs or {})

    def run(self, body):
        self.controller.load(f"def main():\n{body}\nend\n")

    @property
    def last(self):
        return self.controller.messages[-1]


def run_to_end(bench, body, cycles=600):
    """Run a program to its end, without an error."""
    bench.run(body)
    for _ in range(cycles):
        bench.cycles(1)
        if bench.controller.runtime_state is RuntimeState.STOPPED:
            break
    assert not bench.controller.script_errors, bench.last
    assert bench.controller.safety_mode is SafetyMode.NORMAL, bench.last
    assert bench.controller.runtime_state is RuntimeState.STOPPED
    bench.cycles(3)
