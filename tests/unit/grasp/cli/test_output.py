"""With --json standard output contains only JSON, whatever else prints."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from grasp.cli.output import json_line, listing

ROOT = Path(__file__).parents[4]
NOISY = (
    "import os, sys, ctypes\n"
    "from grasp.cli import recordings\n"
    "inner = recordings.runs\n"
    "def noisy(args):\n"
    "    print('EP Error: a library speaks'); print('3')\n"
    "    os.write(1, b'a library writes\\n')\n"
    "    os.system('echo a process writes')\n"
    "    return inner(args)\n"
    "recordings.runs = noisy\n"
    "from grasp.cli.main import main\n"
    "sys.exit(main(['runs', '--runs', sys.argv[1], '--json']))\n"
)


def test_with_json_only_the_result_is_on_standard_output(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", NOISY, str(tmp_path)], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert json.loads(done.stdout) == []
    assert done.stdout.count("\n") == 1
    for text in ("a library speaks", "a library writes", "a process writes"):
        assert text in done.stderr


def test_nan_and_infinity_become_null() -> None:
    output = {"p90": math.inf, "all": [1, (float("nan"), 2.5)], "word": "Infinity"}
    assert json_line(output) == '{"p90":null,"all":[1,[null,2.5]],"word":"Infinity"}'


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("how", [["--json"], []])
def test_a_full_disk_is_reported_in_one_line(how: list[str]) -> None:
    start = "import sys; from grasp.cli.main import main; sys.exit(main(sys.argv[1:]))"
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", start, "config", "guard", *how], stdout=full,
            stderr=subprocess.PIPE, text=True, check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": ""},
        )  # fmt: skip
    assert done.returncode == 5
    assert done.stderr.startswith("grasp: No space left on device")
    assert done.stderr.count("\n") == 1


def test_large_numbers_are_listed_without_a_power_of_ten() -> None:
    assert listing({"us": {"p50": 7.4567, "max": 16950.4}}).split(maxsplit=1)[1] == (
        "p50 7.457, max 16950"
    )
