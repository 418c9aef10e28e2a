"""Which modules mutants are made of, and which tests they are shown (scripts/mutants.py)."""

import random

import msgspec

from scripts.mutation import HOME, Mutant, mutants

MOST_S = 30.0  # of tests that a mutant is shown; those that have killed its kin go first

UNIT = "tests/unit"
ROBOTIQ = tuple(f"{UNIT}/drivers/robotiq/test_{name}.py" for name in (
    "calibration", "driver_contact", "driver_faults", "driver_modes", "driver_verbs", "exchange",
    "protocol", "registers",
))  # fmt: skip
GRASP = f"{UNIT}/grasp"


class Part(msgspec.Struct, frozen=True):
    """Modules, and the tests that cover them."""

    paths: tuple[str, ...]
    tests: tuple[str, ...]


PARTS = {
    "guard": Part(("grasp/guard.py",), (f"{GRASP}/test_guard.py", f"{GRASP}/test_step.py")),
    "step": Part(("grasp/step.py",), (f"{GRASP}/test_step.py",)),
    "rule": Part(
        ("detector/decision.py",),
        (f"{UNIT}/detector/test_decision.py", f"{UNIT}/detector/scores/test_sweep.py"),
    ),
    "safe-states": Part(
        ("grasp/safe_state.py",),
        (f"{GRASP}/test_safe_state.py", f"{GRASP}/test_controller_safe_states.py"),
    ),
    "gripper": Part(
        tuple(f"drivers/robotiq/{name}.py" for name in (
            "driver", "pumped", "encoding", "modes", "exchange", "calibration", "protocol",
        )),
        ROBOTIQ,
    ),
    "closings": Part(
        ("grasp/closing.py", "grasp/steps.py", "grasp/stiffness.py"),
        tuple(f"{GRASP}/test_{name}.py" for name in (
            "closing", "steps", "stiffness", "controller_slip", "pause",
            "controller_safe_states",
        )),
    ),
    "gripper-doubt": Part(
        ("grasp/gripper_doubt.py",), (f"{GRASP}/test_gripper_doubt.py", f"{GRASP}/test_doubt.py")
    ),
    "gripper-link": Part(
        tuple(f"drivers/robotiq/link/{name}.py" for name in ("modbus", "thread", "timing")),
        (f"{UNIT}/drivers/robotiq/test_link_*.py", *(
            f"tests/wire/drivers/robotiq/{name}.py" for name in (
                "link/test_thread", "test_driver", "emulator/test_rtu",
            )
        )),
    ),
    "loop": Part(
        ("grasp/loop.py", "grasp/commands.py"),
        tuple(f"{GRASP}/test_{name}.py" for name in ("loop_alone", "loop", "commands")),
    ),
}  # fmt: skip


class Stratum(msgspec.Struct, frozen=True):
    """A sample: modules by what is in their paths, how many mutants, and the tests they are shown,
    so much of them each."""

    words: tuple[str, ...]
    mutants: int
    tests: tuple[str, ...]
    most_s: float = MOST_S


SAMPLED = ("grasp", "drivers")
STRATA = {
    "command-line": Stratum(
        ("grasp/cli/",), 30, (f"{GRASP}/cli", f"{GRASP}/test_watch.py"), most_s=15.0
    ),
    "wires": Stratum(
        ("/emulator/", "/link/"), 40, (f"{UNIT}/drivers", "tests/wire/drivers"), most_s=15.0
    ),
    "rest": Stratum(
        ("",), 300, (f"{UNIT}/drivers", f"{UNIT}/test_safety_settings.py", f"{GRASP}/test_*.py")
    ),
}  # fmt: skip


def of_part(part: Part) -> list[Mutant]:
    return [mutant for path in part.paths for mutant in mutants(path)]


def of_stratum(name: str) -> list[Mutant]:
    """Of all modules that are of no part and of no stratum before it."""
    theirs = {path for part in PARTS.values() for path in part.paths}
    paths = sorted(
        str(path.relative_to(HOME)) for top in SAMPLED for path in (HOME / top).rglob("*.py")
    )
    return [
        mutant for path in paths
        if path not in theirs and _stratum(path) == name for mutant in mutants(path)
    ]  # fmt: skip


def _stratum(path: str) -> str:
    return next(name for name, one in STRATA.items() if any(word in path for word in one.words))


def drawn(name: str, seed: int) -> list[Mutant]:
    """A sample, in the order in which the seed draws it."""
    return random.Random(seed).sample(of_stratum(name), STRATA[name].mutants)


def tests_of(name: str) -> list[str]:
    """That are shown the mutants of a part or a stratum."""
    tests = PARTS[name].tests if name in PARTS else STRATA[name].tests
    return [str(path.relative_to(HOME)) for test in tests for path in sorted(HOME.glob(test))]
