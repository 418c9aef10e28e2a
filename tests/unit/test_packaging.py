"""The wheel contains only the packages and the configuration; the lock files are complete."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = {"grasp", "drivers", "detector", "scenarios"}
LOCKS = {path.stem: path for path in (ROOT / "requirements").glob("*.txt")}
PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", re.MULTILINE)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a wheel, built from the sdist as most tools do; nothing is fetched."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> zipfile.ZipFile:
    (path,) = built.glob("*.whl")
    return zipfile.ZipFile(path)


@pytest.fixture(scope="module")
def wheel_files(wheel: zipfile.ZipFile) -> set[str]:
    return {name for name in wheel.namelist() if ".dist-info/" not in name}


def tracked(package: str, pattern: str) -> set[str]:
    return {path.relative_to(ROOT).as_posix() for path in (ROOT / package).rglob(pattern)}


def test_wheel_contains_only_the_packages(wheel_files: set[str]) -> None:
    assert {name.split("/")[0] for name in wheel_files} == PACKAGES
    sources = set().union(*(tracked(package, "*.py") for package in PACKAGES))
    assert {name for name in wheel_files if name.endswith(".py")} == sources


def test_wheel_contains_the_configuration_inside_grasp(wheel_files: set[str]) -> None:
    config = {f"grasp/_{name}" for name in tracked("config", "*.toml")}
    assert {name for name in wheel_files if name.startswith("grasp/_config/")} >= config


def test_wheel_contains_the_networks_and_their_auxiliary_outputs(wheel_files: set[str]) -> None:
    weights = tracked("detector/weights", "*.*")
    assert {"detector/weights/tcn.onnx", "detector/weights/tcn.auxiliary.json"} <= weights
    assert weights <= wheel_files


# Lock files


def pins(name: str) -> dict[str, str]:
    return dict(PIN.findall(LOCKS[name].read_text()))


def normal(requirement: str) -> str:
    return re.split(r"[<>=!~ \[;]", requirement)[0].lower().replace("_", "-")


def test_base_pins_match_dev_pins() -> None:
    assert pins("base").items() <= pins("dev").items()


def test_cluster_pins_match_the_others() -> None:
    base, dev, cluster = pins("base"), pins("dev"), pins("cluster")
    assert base.items() <= cluster.items()
    assert all(dev.get(name, version) == version for name, version in cluster.items())


@pytest.mark.parametrize("lock", ["base", "dev", "cluster"])
def test_lock_names_every_requirement(lock: str) -> None:
    expected = list(PROJECT["dependencies"])
    if lock == "dev":
        expected += [*PROJECT["optional-dependencies"]["dev"]]
    if lock == "cluster":
        expected += PROJECT["optional-dependencies"]["cluster"]
    assert {normal(requirement) for requirement in expected} <= pins(lock).keys()
    assert "hatchling" in pins(lock)  # the editable install builds with it


@pytest.mark.parametrize("lock", ["base", "dev", "cluster", "exports", "docs"])
def test_every_pin_has_a_hash(lock: str) -> None:
    entries = re.split(r"\n(?=\S)", LOCKS[lock].read_text().strip())
    entries = [entry for entry in entries if not entry.startswith("#")]
    assert len(entries) == len(pins(lock))
    assert all("--hash=sha256:" in entry for entry in entries)


@pytest.mark.parametrize("lock", ["base", "dev", "cluster", "exports", "docs", "train"])
def test_lock_files_contain_no_local_paths(lock: str) -> None:
    text = LOCKS[lock].read_text()
    assert not re.search(r"://|--index|--extra-index|--find-links|@ file|^-", text, re.MULTILINE)
