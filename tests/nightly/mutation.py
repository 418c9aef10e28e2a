"""Mutation testing of the safety core with mutmut (`make test-mutation`).

    python -m tests.nightly.mutation ["grasp.control.guard*" ...]

Without names it tries EACH mutants of each module of `[tool.mutmut]` and writes
studies/results/mutants.csv. Prints the share of killed mutants of each module. Mutants that change
only a text or `strict=` of a zip are not counted. Exit code 1 if one module is below its bound:
then `mutmut results` lists survivors and `mutmut show NAME` shows one.
"""

import ast
import csv
import random
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

EVIDENCE = Path(__file__).parents[2] / "studies/results/mutants.csv"
MUTMUT = Path(sys.executable).with_name("mutmut")
# a little below the share when the bound was set
LEAST = {
    "grasp.control.compensation": 0.80,
    "grasp.control.controller": 0.80,
    "grasp.control.guard": 0.95,
    "grasp.control.reflex_controller": 0.80,
    "grasp.control.safe_state": 0.95,
    "grasp.control.set_down": 0.80,
    "grasp.control.slip_monitor": 0.80,
    "grasp.control.slip_response.close": 0.80,
    "grasp.control.slip_response.stop_and_close": 0.80,
    "grasp.control.slip_response.stop_and_step": 0.80,
    "grasp.control.states": 0.90,
    "grasp.control.step": 0.95,
    "grasp.policy_reflex": 0.90,
    "grasp.run.loop": 0.75,
    "grasp.control.monitors.arm": 0.80,
    "grasp.control.monitors.checks": 0.92,
    "grasp.control.monitors.fingertips": 0.75,
    "grasp.control.monitors.gripper": 0.79,
    "grasp.control.monitors.run": 0.50,
    "grasp.control.monitors.settings": 0.75,
    "detector.decision": 0.95,
    "drivers.robotiq.driver": 0.90,
    "drivers.robotiq.echo_watch": 0.81,
    "drivers.robotiq.exchange": 0.81,
}


EACH = 40  # mutants of each module that are tried, drawn by a fixed seed; all take hours


def main() -> int:
    names = sys.argv[1:] or drawn()
    subprocess.run([MUTMUT, "run", *names], check=True)
    counts: dict[str, Counter[str]] = {}
    for name, status in results().items():
        if status != "not checked" and not trivial(name) and (sys.argv[1:] or name in names):
            counts.setdefault(name.rpartition(".")[0], Counter())[status] += 1
    weak = not counts
    for module, found in counts.items():
        killed, total = found["killed"] + found["timeout"], found.total()
        weak |= killed < LEAST[module] * total
        print(f"{module}: {killed} of {total} killed ({killed / total:.0%}, "
              f"at least {LEAST[module]:.0%})")  # fmt: skip
    if not sys.argv[1:]:
        write_csv(EVIDENCE, counts)
    return int(weak)


def results() -> dict[str, str]:
    """Status of each mutant, by its name."""
    command = [MUTMUT, "results", "--all", "true"]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    pairs = (line.strip().partition(": ") for line in shown.split("\n"))
    return {name: status for name, colon, status in pairs if colon}


def drawn() -> list[str]:
    """EACH mutants of each module."""
    subprocess.run([MUTMUT, "run", "grasp.control.monitors.settings*"], check=True)  # makes all
    of: dict[str, list[str]] = {}
    for name in sorted(results()):
        if not trivial(name):
            of.setdefault(name.rpartition(".")[0], []).append(name)
    rng = random.Random(5)
    return [name for each in of.values() for name in rng.sample(each, min(EACH, len(each)))]


class _Meaning(ast.NodeTransformer):
    """Drops texts and `strict=`."""

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        return ast.Constant(None) if isinstance(node.value, str) else node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.Constant:
        return ast.Constant(None)

    def visit_keyword(self, node: ast.keyword) -> Any:
        return None if node.arg == "strict" else self.generic_visit(node)


@cache
def functions(module: str) -> dict[str, str]:
    """The meaning of each function and mutant of a module, by its name."""
    tree = ast.parse(Path("mutants", *module.split(".")).with_suffix(".py").read_text("utf-8"))
    found = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
    return {f.name: ast.dump(ast.Module([_Meaning().visit(n) for n in f.body], [])) for f in found}


def trivial(mutant: str) -> bool:
    """Whether a mutant differs from the original in a text or in `strict=` alone."""
    module, _, name = mutant.rpartition(".")
    original = name.rpartition("_")[0] + "_orig"
    return functions(module)[name] == functions(module)[original]


def write_csv(path: Path, counts: dict[str, Counter[str]]) -> None:
    """One line per module."""
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(("module", "mutants", "killed", "survived", "share"))
        for module, found in counts.items():
            killed, total = found["killed"] + found["timeout"], found.total()
            lines.writerow((module, total, killed, total - killed, f"{killed / total:.3f}"))


if __name__ == "__main__":
    sys.exit(main())
