"""The import contracts of pyproject.toml hold, and each of them catches what it forbids."""

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("grasp", "drivers", "detector", "scenarios")

# contract, module that breaks it, what that module imports
VIOLATIONS = [
    ("layers", "drivers.planted", "grasp.planted_other"),
    ("layers", "drivers.planted", "detector.planted_other"),
    ("detector-alone", "detector.planted", "drivers.robotiq.protocol"),
    ("detector-alone", "detector.training.planted", "drivers.planted_other"),
    ("layers", "detector.planted", "grasp.planted_other"),
    ("layers", "grasp.planted", "scenarios.planted_other"),
    ("scenario-rooms", "scenarios.report.planted", "scenarios.testing.planted_other"),
    ("scenario-rooms", "scenarios.report.planted", "scenarios.library.planted_other"),
    ("layers", "grasp.planted", "scenarios.library.calls"),
    ("scenario-rooms", "scenarios.benchmark.planted", "scenarios.report.planted_other"),
    ("scenario-rooms", "scenarios.campaign.planted", "scenarios.benchmark.planted_other"),
    ("scenario-rooms", "scenarios.campaign.planted", "scenarios.acquire.planted_other"),
    ("scenario-rooms", "scenarios.acquire.planted", "scenarios.campaign.planted_other"),
    ("scenario-rooms", "scenarios.lift.planted", "scenarios.campaign.planted_other"),
    ("scenario-rooms", "scenarios.lift.planted", "scenarios.lab.planted_other"),
    ("scenario-rooms", "scenarios.lab.planted", "scenarios.campaign.planted_other"),
    ("scenario-rooms", "scenarios.lift.planted", "scenarios.tap.planted_other"),
    ("scenario-rooms", "scenarios.tap.planted", "scenarios.lift.planted_other"),
    ("scenario-rooms", "scenarios.trial.planted", "scenarios.lift.planted_other"),
    ("scenario-rooms", "scenarios.rigs.planted", "scenarios.trial.planted_other"),
    ("scenario-rooms", "scenarios.rigs.planted", "scenarios.tap.planted_other"),
    ("scenario-rooms", "scenarios.world.planted", "scenarios.rigs.planted_other"),
    ("cli-is-top", "grasp.planted", "grasp.cli"),
    ("cli-is-top", "scenarios.planted", "grasp.cli"),
    ("world-alone", "scenarios.world.planted", "grasp.planted_other"),
    ("world-alone", "scenarios.world.planted", "detector.planted_other"),
    ("world-alone", "scenarios.world.planted", "scenarios.planted_other"),
    ("world-drivers", "scenarios.world.planted", "drivers.interfaces"),
    ("world-drivers", "scenarios.world.contact", "drivers.robotiq.model.gripper"),
    ("world-drivers", "scenarios.world.cell", "drivers.robotiq.protocol"),
    ("world-drivers", "scenarios.world.cell", "drivers.errors"),
    ("drivers-independent", "drivers.robotiq.planted", "drivers.takktile.planted_other"),
    ("drivers-independent", "drivers.ur.planted", "drivers.robotiq.planted_other"),
    ("no-driver-imports-a-model", "drivers.robotiq.driver", "drivers.robotiq.model.gripper"),
    ("no-driver-imports-a-model", "drivers.ur.link.planted", "drivers.ur.model"),
    ("no-driver-imports-a-model", "drivers.takktile.protocol", "drivers.takktile.emulator.server"),
    ("no-driver-imports-a-model", "drivers.ur.model", "drivers.ur.emulator.motion"),
    ("no-driver-imports-a-model", "drivers.planted.driver", "drivers.planted.model"),
    ("model-has-its-own-codec", "drivers.robotiq.model.gripper", "drivers.robotiq.protocol"),
    ("model-has-its-own-codec", "drivers.takktile.model.codec", "drivers.takktile.protocol"),
    ("motor-internal", "scenarios.planted", "drivers.robotiq.model.motor"),
    ("devices-by-interface", "grasp.controller", "drivers.robotiq.protocol"),
    ("devices-by-interface", "grasp.guard", "drivers.robotiq.driver"),
    ("devices-by-interface", "grasp.slip", "drivers.takktile.protocol"),
    ("devices-by-interface", "grasp.loop", "drivers.ur.driver"),
    ("devices-by-interface", "grasp.phases", "drivers.planted_other"),
    ("no-torch", "grasp.planted", "torch"),
    ("no-torch", "drivers.robotiq.planted", "torch.nn"),
    ("no-torch", "detector.planted", "torch"),
    ("no-torch", "scenarios.world.planted", "torch"),
    ("no-torch", "detector.network_file", "onnx"),
    ("training-apart", "detector.interface", "detector.training.architecture"),
    ("training-apart", "scenarios.planted", "detector.training.planted_other"),
    ("training-apart", "grasp.loop", "detector.training.planted_other"),
]

# the exceptions that the contracts make
PERMITTED = [
    ("detector.planted", "drivers.errors"),
    ("detector.planted", "drivers.interfaces"),
    ("grasp.cli.planted", "scenarios.planted_other"),
    ("grasp", "scenarios.library.calls"),
    ("grasp.cli.planted", "drivers.robotiq.protocol"),
    ("grasp.controller", "drivers.interfaces"),
    ("grasp.guard", "drivers.errors"),
    ("scenarios.world.cell", "drivers.interfaces"),
    ("scenarios.world.cell", "drivers.robotiq.model.gripper"),
    ("scenarios.planted", "drivers.robotiq.driver"),
    ("scenarios.benchmark.planted", "scenarios.campaign.planted_other"),
    ("scenarios.acquire.planted", "scenarios.lift.planted_other"),
    ("scenarios.tap.planted", "scenarios.trial.planted_other"),
    ("drivers.robotiq.emulator.planted", "drivers.robotiq.model.gripper"),
    ("drivers.robotiq.model.planted", "drivers.robotiq.exchange"),
    ("drivers.robotiq.model.planted", "drivers.robotiq.model.motor"),
    ("detector.training.planted", "torch"),
    ("detector.training.planted", "onnx"),
    ("grasp.cli.train", "detector.training.planted_other"),
]


def contract_ids() -> list[str]:
    return re.findall(r'^id = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)


def lint(folder: Path, *contracts: str) -> subprocess.CompletedProcess[str]:
    chosen = [argument for contract in contracts for argument in ("--contract", contract)]
    program = "from importlinter.cli import lint_imports_command as main; main()"
    options = ["--no-logo", "--no-cache", *chosen]  # its cache misses modules that are new
    return subprocess.run(
        [sys.executable, "-P", "-c", program, *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def broken(output: str) -> int:
    found = re.search(r"(\d+) kept, (\d+) broken", output)
    assert found, output
    return int(found[2])


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources alone."""
    folder = tmp_path_factory.mktemp("original")
    for package in PACKAGES:
        for source in (ROOT / package).rglob("*.py"):
            copy = folder / source.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)
    shutil.copyfile(ROOT / "pyproject.toml", folder / "pyproject.toml")
    return folder


@pytest.fixture
def tree(original: Path, tmp_path: Path) -> Path:
    return shutil.copytree(original, tmp_path / "tree")


def file_of(tree: Path, module: str) -> Path:
    """The module's file, made with its packages where there is none."""
    path = tree.joinpath(*module.split("."))
    if (path / "__init__.py").exists():
        return path / "__init__.py"
    for parent in [p for p in path.parents if p.is_relative_to(tree) and p != tree]:
        parent.mkdir(exist_ok=True, parents=True)
        (parent / "__init__.py").touch()
    source = path.with_suffix(".py")
    source.touch()
    return source


def plant(tree: Path, importer: str, imported: str) -> None:
    if imported.startswith(PACKAGES):
        file_of(tree, imported)
    with file_of(tree, importer).open("a") as source:
        source.write(f"\nimport {imported}\n")


def test_the_tree_keeps_its_contracts() -> None:
    result = lint(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


def test_every_contract_has_a_planted_violation() -> None:
    assert {contract for contract, _, _ in VIOLATIONS} == set(contract_ids())


@pytest.mark.parametrize(("contract", "importer", "imported"), VIOLATIONS)
def test_a_violation_is_caught(tree: Path, contract: str, importer: str, imported: str) -> None:
    plant(tree, importer, imported)
    result = lint(tree, contract)
    assert result.returncode == 1, result.stdout + result.stderr
    assert broken(result.stdout) == 1
    assert importer in result.stdout


def test_what_is_permitted_is_not_caught(tree: Path) -> None:
    for importer, imported in PERMITTED:
        plant(tree, importer, imported)
    result = lint(tree)
    assert result.returncode == 0, result.stdout


def test_a_verb_that_imports_within_a_function_is_seen(tree: Path) -> None:
    with file_of(tree, "grasp.planted").open("a") as source:
        source.write("def verb():\n    import scenarios\n")
    assert lint(tree, "layers").returncode == 1


def sources() -> list[Path]:
    return [source for package in PACKAGES for source in (ROOT / package).rglob("*.py")]


def parsed() -> Iterator[tuple[str, ast.Module]]:
    """Path and syntax tree of every module of the product."""
    for source in sources():
        tree = ast.parse(source.read_text(encoding="utf-8"))
        yield source.relative_to(ROOT).as_posix(), tree


@cache
def module_names() -> set[str]:
    """Of modules and of the packages that hold them, where there is a dot to know them by."""
    found = {path.removesuffix(".py").removesuffix("/__init__") for path, _ in parsed()}
    return {name.replace("/", ".") for name in found if "/" in name}


def named_in_strings(tree: ast.Module) -> set[str]:
    docstrings = {n.value for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    texts = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and n not in docstrings)
    words = (re.findall(r"\w[\w.]*\w", str(text.value)) for text in texts)
    return {word for found in words for word in found} & module_names()


def imported(node: ast.stmt) -> list[str]:
    """Modules that a statement imports; one of ours where it is relative."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else ["grasp"]


def hidden(tree: ast.Module) -> list[str]:
    """Imports of ours that are not made as a module begins."""
    inner = (n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom))
    later = [n for n in inner if n not in tree.body]
    return [ast.unparse(n) for n in later if any(ours(name) for name in imported(n))]


def ours(name: str) -> bool:
    return name.partition(".")[0] in PACKAGES


def dynamic(tree: ast.Module) -> list[str]:
    """What imports a module by a name that is computed, or a file as a program."""
    names = (n for n in ast.walk(tree) if isinstance(n, ast.Name | ast.Attribute))
    called = {n.id if isinstance(n, ast.Name) else n.attr for n in names}
    froms = (n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom))
    called |= {alias.name for n in froms for alias in n.names}
    return sorted(called & {"import_module", "__import__", "run_module", "run_path", "modules"})


def test_no_module_is_named_in_a_string() -> None:
    found = {path: named_in_strings(tree) for path, tree in parsed()}
    assert {path: names for path, names in found.items() if names} == {}


# code of other people: detectors, the arm's library in its worker, and what is installed
BY_NAME = ["detector/own.py", "drivers/ur/link/worker.py", "scenarios/rigs/doctor.py"]


def test_no_module_is_imported_by_a_computed_name() -> None:
    assert sorted(path for path, tree in parsed() if dynamic(tree)) == BY_NAME


# what starts quickly, or where packages are missing
LATE = (
    "grasp/__init__.py",
    "grasp/cli/",
    "scenarios/rigs/doctor.py",
    "scenarios/testing/plugin.py",
)


def test_no_import_of_ours_hides_below_the_beginning_of_a_module() -> None:
    found = {path: hidden(tree) for path, tree in parsed() if not path.startswith(LATE)}
    assert {path: imports for path, imports in found.items() if imports} == {}


def test_nothing_that_is_delivered_imports_tests_or_scripts() -> None:
    found = [
        (path, name)
        for path, tree in parsed()
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in imported(node)
        if name.partition(".")[0] in ("tests", "scripts")
    ]
    assert found == []


HIDING = {
    "in a function": "def f():\n    from scenarios.trial import trace\n",
    "in one that waits": "async def f():\n    import scenarios.trial.trace\n",
    "in a class": "class A:\n    import scenarios.trial.trace as t\n",
    "where it may fail": "try:\n    import scenarios.trial.trace\nexcept ImportError:\n    pass\n",
    "behind another": "def f():\n    import os, scenarios.trial.trace\n",
    "relative": "def f():\n    from . import trace\n",
}
BY_STRING = {
    "a module": "import_it('scenarios.trial.trace')\n",
    "a package": "import_it('scenarios.trial')\n",
    "a part": "import_it(f'scenarios.trial.{name}')\n",
}
COMPUTED = {
    "of parts": "import importlib\nimportlib.import_module('scenarios.' + 'trial')\n",
    "relative": "from importlib import import_module\nimport_module('..trial', __package__)\n",
    "by the interpreter": "__import__('scenarios')\n",
    "already there": "import sys\nsys.modules['scenarios' + '.trial']\n",
    "run": "import runpy\nrunpy.run_module(name)\n",
}


@pytest.mark.parametrize("how", HIDING)
def test_a_hidden_import_is_found(how: str) -> None:
    assert hidden(ast.parse(HIDING[how]))
    assert not hidden(ast.parse("import scenarios.trial.trace\nfrom grasp import slip\n"))


@pytest.mark.parametrize("what", BY_STRING)
def test_a_module_in_a_string_is_found(what: str) -> None:
    assert named_in_strings(ast.parse(BY_STRING[what]))


@pytest.mark.parametrize("how", COMPUTED)
def test_an_import_by_a_computed_name_is_found(how: str) -> None:
    assert dynamic(ast.parse(COMPUTED[how]))
