"""A laboratory's first day, played against `grasp emulate` in an empty folder: docs/first-day.md.

    python -m scripts.first_day          print the page
    python -m scripts.first_day --write  and keep it

`tests/wire/scenarios/lab/test_day.py` plays it again and compares commands, questions and exit
codes, so that the page cannot go stale unnoticed.
"""

import argparse
import sys
import tempfile
from pathlib import Path

HOME = Path(__file__).resolve().parent.parent
PAGE = HOME / "docs" / "first-day.md"
HEAD = """# A first day

From an empty folder to a first lift, as it was typed and shown at terminals: played by
`scripts/first_day.py` against `grasp emulate`, and played again by a test. **Nothing of it was done
on hardware.** What each step is for: [on a lab's own devices](hardware.md).

In a terminal of its own: `grasp emulate --host 127.0.0.2 --gripper-port 5020 --object foam`. There
a person types what they do to the object (`take`, `place`, `home`) or to a pad (`press A 2`), and
reads the scale (`scale`).
"""


def main() -> int:
    sys.path.insert(0, str(HOME))
    from tests.wire.scenarios.lab.day import play  # noqa: PLC0415  (a script's path comes first)

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        page = HEAD + play(Path(folder)).replace(str(HOME), "/opt/grasp")
    if args.write:
        PAGE.write_text(page, encoding="utf-8")
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
