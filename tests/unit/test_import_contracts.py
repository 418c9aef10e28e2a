"""The import contracts of pyproject.toml hold, and each of them catches what it forbids."""

import ast
import re
import shutil
import subprocess
import sys
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
    ("scenario-rooms", "scenarios.studies.planted", "scenarios.report.planted_other"),
    ("scenario-rooms", "scenarios.campaign.planted", "scenarios.studies.planted_other"),
    ("scenario-rooms", "scenarios.campaign.planted", "scenarios.acquire.planted_other"),
    ("scenario-rooms", "scenarios.acquire.planted", "scenarios.campaign.planted_other"),
    ("scenario-rooms", "scenarios.lift.planted", "scenarios.campaign.planted_other"),
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
    ("grasp.cli.planted", "drivers.robotiq.protocol"),
    ("grasp.controller", "drivers.interfaces"),
    ("grasp.guard", "drivers.errors"),
    ("scenarios.world.cell", "drivers.interfaces"),
    ("scenarios.world.cell", "drivers.robotiq.model.gripper"),
    ("scenarios.planted", "drivers.robotiq.driver"),
    ("scenarios.studies.planted", "scenarios.campaign.planted_other"),
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


def test_no_module_is_named_in_a_string() -> None:
    modules = {".".join(s.relative_to(ROOT).with_suffix("").parts) for s in sources()}
    found = []
    for source in sources():
        tree = ast.parse(source.read_text(encoding="utf-8"))
        lines = {n.value for n in ast.walk(tree) if isinstance(n, ast.Expr)}  # docstrings
        texts = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and n not in lines)
        named = {w for n in texts for w in re.findall(r"[\w.]+", str(n.value))} & modules
        found += [f"{source.relative_to(ROOT)}: {name}" for name in named if "." in name]
    assert found == []


# what starts quickly, or where packages are missing; each looks down the layers
LATE = ("grasp/cli", "scenarios/rigs/doctor.py", "scenarios/testing/plugin.py")


def test_no_import_of_ours_hides_in_a_function() -> None:
    found = []
    for source in sources():
        path = source.relative_to(ROOT).as_posix()
        if path.startswith(LATE):
            continue
        tree = ast.parse(source.read_text(encoding="utf-8"))
        functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))
        for node in (inner for function in functions for inner in ast.walk(function)):
            if isinstance(node, ast.Import | ast.ImportFrom):
                text = ast.unparse(node)
                if text.split()[1].startswith(PACKAGES):
                    found.append(f"{path}: {text}")
    assert found == []
