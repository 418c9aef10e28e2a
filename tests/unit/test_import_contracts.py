"""The import contracts of pyproject.toml hold, and each detects a violation."""

import ast
import re
import shutil
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[2]
PACKAGES = ("grasp", "drivers", "detector", "scenarios")


# of each contract, a module that breaks it and what that module imports
VIOLATIONS = {
    "layers": ("drivers.planted", "grasp.planted_other"),
    "control-alone": ("grasp.control.planted", "grasp.run.planted_other"),
    "detector-alone": ("detector.training.planted", "drivers.planted_other"),
    "scenario-packages": ("scenarios.lift.planted", "scenarios.campaign.planted_other"),
    "cli-is-top": ("scenarios.planted", "grasp.cli"),
    "world-alone": ("scenarios.world.planted", "detector.planted_other"),
    "world-drivers": ("scenarios.world.cell", "drivers.robotiq.protocol"),
    "drivers-independent": ("drivers.ur.planted", "drivers.robotiq.planted_other"),
    "no-driver-imports-a-model": ("drivers.robotiq.driver", "drivers.robotiq.model.gripper"),
    "model-has-its-own-codec": ("drivers.takktile.model.board", "drivers.takktile.protocol"),
    "motor-internal": ("scenarios.planted", "drivers.robotiq.model.motor"),
    "devices-by-interface": ("grasp.control.guard", "drivers.robotiq.driver"),
    "devices-uncompiled": ("drivers.ur.link.planted", "numba"),
    "no-torch": ("grasp.planted", "torch"),
    "training-apart": ("grasp.run.loop", "detector.training.planted_other"),
}


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    program = "from importlinter.cli import lint_imports_command as main; main()"
    # its cache misses modules that are new
    return subprocess.run(
        [sys.executable, "-P", "-c", program, "--no-logo", "--no-cache"],
        cwd=folder, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip


def file_of(tree: Path, module: str) -> Path:
    """The module's file, created if it does not exist."""
    path = tree.joinpath(*module.split("."))
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    source.touch()
    return source


def test_import_contracts_hold() -> None:
    result = lint(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


def test_each_contract_catches_what_it_forbids(tmp_path: Path) -> None:
    pyproject = (ROOT / "pyproject.toml").read_text()
    assert set(re.findall(r'^id = "(.*)"$', pyproject, re.MULTILINE)) == set(VIOLATIONS)
    (tmp_path / "pyproject.toml").write_text(pyproject)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package)
    for importer, imported in VIOLATIONS.values():
        if ours(imported):
            file_of(tmp_path, imported)
        with file_of(tmp_path, importer).open("a") as source:
            source.write(f"\nimport {imported}\n")
    output = lint(tmp_path).stdout
    assert f"0 kept, {len(VIOLATIONS)} broken" in output, output
    assert [name for name, _ in VIOLATIONS.values() if name not in output] == []


def test_there_are_no_circular_imports() -> None:
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    arrows = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    TopologicalSorter(arrows).prepare()


def sources() -> list[Path]:
    return [source for package in PACKAGES for source in (ROOT / package).rglob("*.py")]


@cache
def parsed() -> list[tuple[str, ast.Module]]:
    """Path and syntax tree of every module of the product."""
    return [
        (source.relative_to(ROOT).as_posix(), ast.parse(source.read_text(encoding="utf-8")))
        for source in sources()
    ]


@cache
def module_names() -> set[str]:
    """Dotted names of all modules and packages of the product."""
    found = {path.removesuffix(".py").removesuffix("/__init__") for path, _ in parsed()}
    return {name.replace("/", ".") for name in found if "/" in name}


def named_in_strings(tree: ast.Module) -> set[str]:
    docstrings = {n.value for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    texts = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and n not in docstrings)
    words = (re.findall(r"\w[\w.]*\w", str(text.value)) for text in texts)
    return {word for found in words for word in found} & module_names()


def imported(node: ast.stmt) -> list[str]:
    """Modules that a statement imports; relative imports are resolved."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else ["grasp"]


def hidden(tree: ast.Module) -> list[str]:
    """Imports of this project's modules that are not at the beginning of a module."""
    inner = (n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom))
    later = [n for n in inner if n not in tree.body]
    return [ast.unparse(n) for n in later if any(ours(name) for name in imported(n))]


def ours(name: str) -> bool:
    return name.partition(".")[0] in PACKAGES


def dynamic(tree: ast.Module) -> list[str]:
    """Calls that import a module by a computed name, or run a file as a program."""
    names = (n for n in ast.walk(tree) if isinstance(n, ast.Name | ast.Attribute))
    called = {n.id if isinstance(n, ast.Name) else n.attr for n in names}
    froms = (n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom))
    called |= {alias.name for n in froms for alias in n.names}
    return sorted(called & {"import_module", "__import__", "run_module", "run_path", "modules"})


def test_no_module_is_named_in_a_string() -> None:
    found = {path: named_in_strings(tree) for path, tree in parsed()}
    # the command line imports the module of the command that runs, all of them in its own package;
    # gymnasium imports an environment when it is made
    assert {path: names for path, names in found.items() if names} == {
        "grasp/cli/main.py": {"grasp.cli"},
        "grasp/gym.py": {"scenarios.library.lift_environment"},
    }


# code of other people: detectors, the arm's library in its worker, messages of ROS, and what is
# installed
BY_NAME = [
    "detector/plugins.py", "drivers/ur/link/worker.py", "grasp/cli/main.py",
    "grasp/cli/ros_node.py",
]  # fmt: skip


def test_no_module_is_imported_by_a_computed_name() -> None:
    assert sorted(path for path, tree in parsed() if dynamic(tree)) == BY_NAME


# what starts quickly, or where packages are missing
LATE = (
    "grasp/__init__.py",
    "grasp/cli/",
    "scenarios/testing/plugin.py",
    "detector/network",  # compiled networks: where they cannot be compiled, ONNX Runtime is used
    # what a device is driven with imports the compiled world only where there is one
    "scenarios/acquire/session.py",
    "scenarios/rigs/opening.py",
    "scenarios/rigs/rig.py",
    "scenarios/tap/mallet.py",
    "scenarios/world/__init__.py",
)


def test_imports_within_functions_are_declared() -> None:
    found = {path: hidden(tree) for path, tree in parsed() if not path.startswith(LATE)}
    assert {path: imports for path, imports in found.items() if imports} == {}


def test_packaged_code_imports_no_tests() -> None:
    found = [
        (path, name)
        for path, tree in parsed()
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in imported(node)
        if name.partition(".")[0] == "tests"
    ]
    assert found == []
