"""Fails when the product has more lines than `product_lines` in pyproject.toml allows.

A change that adds lines removes others, or raises that number with the reason in its commit.
"""

import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("grasp", "drivers", "detector", "scenarios")


def product_lines() -> int:
    files = (file for package in PRODUCT for file in (ROOT / package).rglob("*.py"))
    return sum(file.read_text(encoding="utf-8").count("\n") for file in files)


def main() -> int:
    allowed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["grasp"]["product_lines"]
    lines = product_lines()
    if lines <= allowed:
        return 0
    sys.stderr.write(
        f"{', '.join(PRODUCT)} have {lines} lines, product_lines in pyproject.toml allows "
        f"{allowed}: remove some, or raise it in a commit that says why\n"
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
