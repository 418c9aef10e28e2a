"""A laboratory's first day, played against `grasp emulate` in an empty folder: docs/first-day.md.

    python -m scripts.first_day          print the page
    python -m scripts.first_day --write  and keep it

`tests/nightly/test_day.py` plays it again and compares commands, questions and exit
codes, not the figures: those are of the play at the commit that the page names, and whether its
code has changed since is told by `scripts/figures.py`.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HOME = Path(__file__).resolve().parent.parent
PAGE = HOME / "docs" / "first-day.md"
HEAD = """# A first day

From an empty folder to a first lift, as it was typed and shown at terminals: played by
`scripts/first_day.py` against `grasp emulate`, and played again by a test, which compares commands,
questions and exit codes, not the figures. **Nothing of it was done on hardware.** What each step is
for: [on a lab's own devices](hardware.md).

In a terminal of its own: `grasp emulate --host 127.0.0.2 --gripper-port 5020 --object foam`. There
a person types what they do to the object (`take`, `place`, `home`) or to a pad (`press A 2`), and
reads the scale (`scale`).
"""

# what the figures of its table rest on most: what else a lift rests on, others measure, and what
# the verbs say the test compares
CODE = (
    "scenarios/lab,scenarios/rigs,grasp/cli/calibrate.py,grasp/cli/first.py,drivers,"
    "tests/nightly/day.py"
)
ENTRY = '<!-- figure: id=first-day command="python -m scripts.first_day --write" detector=tcn'
FOUND = {
    "`calibrate hand`": r"^(byte 0: .*)$",
    "`calibrate force --press`": r"^# (.* counts a newton \[.*\]) \(95 %",
    "`calibrate noise`": r"^# (Level .*\]) \(95 %",
    "`run lift --first`": r"^  (the object slipped .*)$",
}


def table_of(played: str) -> str:
    """What the day found, a row a verb. Raises ValueError where a play has not found it."""
    rows = []
    for verb, pattern in FOUND.items():
        found = re.search(pattern, played, re.MULTILINE)
        if found is None:
            raise ValueError(f"nothing that {verb} has found: {pattern}")
        rows.append(f"| {verb} | {found.group(1)} |")
    return "\n".join(("| `grasp` | found (in brackets: 95 %) |", "|---|---|", *rows)) + "\n"


def page_of(played: str, commit: str) -> str:
    """The whole page."""
    return f"{HEAD}\n{ENTRY} commit={commit} code={CODE} -->\n{table_of(played)}{played}"


def main() -> int:
    sys.path.insert(0, str(HOME))
    from tests.nightly.day import play  # noqa: PLC0415  (a script's path comes first)

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    commit = _commit()  # before: others may commit meanwhile
    with tempfile.TemporaryDirectory() as folder:
        page = page_of(play(Path(folder)).replace(str(HOME), "/opt/grasp"), commit)
    if args.write:
        PAGE.write_text(page, encoding="utf-8")
    print(page)
    return 0


def _commit() -> str:
    told = subprocess.check_output(("git", "rev-parse", "--short", "HEAD"), cwd=HOME, text=True)
    return told.strip()


if __name__ == "__main__":
    sys.exit(main())
