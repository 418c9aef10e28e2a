"""A cell keeps no client waiting for the compiler."""

import subprocess
import sys

import pytest

SCRIPT = """
from numba.core.registry import CPUDispatcher

from drivers.robotiq.model import motor
from scenarios.lift import lift
from scenarios.rigs.world_of_seed import any_cell
from scenarios.world import disturbance, laws, spring_bed
from tests.unit.scenarios.conftest import config


def compiled():
    return {
        (name, str(signature))
        for module in (motor, disturbance, laws, spring_bed)
        for name, value in vars(module).items() if isinstance(value, CPUDispatcher)
        for signature in value.signatures
    }


settings = config("world.level=L1")  # named, so that nothing is planned
any_cell(settings, 0).compile()
before = compiled()
assert lift.run(settings, 0, None).result.success
print(sorted(compiled() - before))
"""


@pytest.mark.slow
def test_a_cell_that_has_compiled_its_world_compiles_nothing_in_a_lift() -> None:
    """In a process of its own: in this one other tests have compiled everything."""
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False
    )
    assert ended.stdout == "[]\n", ended.stderr
