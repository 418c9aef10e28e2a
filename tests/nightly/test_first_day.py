"""The commands of docs/first-day.md, run in an empty folder against `grasp emulate`: same order,
same exit codes, every question answered."""

import json
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.nightly.terminal import Terminal
from tests.wire.lab import ENVIRONMENT, GRASP

DOCS = Path(__file__).parents[2] / "docs"
HOST, PORT = "127.0.0.2", "5020"
EMULATE = (
    "emulate", "--host", HOST, "--gripper-port", PORT, "--object", "foam",
    "--write", "emulated.toml",
)  # fmt: skip
LAB = ("--config", "lab.toml")
MOVES = (*LAB, "--confirm-motion")
# a question, the prompt for a word, or a request for an action at the devices
ASKED = re.compile(r"(>>> (?:[^\n]*(?:Enter|\?|type)[^\n]*)\n|Type (\w+): |press one pad [^\n]*\n)")
ENDED = re.compile(r"\[exit code (\d+)\]")
LONG_S = 600.0
AGAIN = 6
LOADS_N = (0.5, 1.0, 1.5, 2.0, 2.5)  # weights on each pad
OWN_LIMIT = {"guard": {"force_limit_n": 11.0}, "controller": {"grip_force_n": 11.0}}


class Day:
    """The folder, the cell and its terminal, and all output so far."""

    def __init__(self, folder: Path, cell: Terminal) -> None:
        self.folder, self.cell = folder, cell
        self.shown: list[str] = []
        cell.wait_for("actions of an operator, one per line")

    def run(self, *arguments: str, answer: Callable[[str], str | None] = lambda question: "",
            code: int = 0) -> str:  # fmt: skip
        """Run a command in its own terminal, answer its questions (None: type nothing), and return
        its output. A command without motion is repeated while the machine is so busy that frames of
        the fingertips are lost."""
        for left in reversed(range(AGAIN)):
            ended, shown = self._once(arguments, answer)
            reads = arguments[0] == "doctor" or "--dry-run" in arguments
            if ended == code or not (left and reads and "use another USB port" in shown):
                break
        assert ended == code, shown
        failed = f"[exit code {code}]" if code else ""
        self.shown += [f"$ {shlex.join(('grasp', *arguments))}", ENDED.sub("", shown), failed]
        return shown

    def _once(
        self, arguments: tuple[str, ...], answer: Callable[[str], str | None]
    ) -> tuple[int, str]:
        script = [*GRASP, *arguments]
        with Terminal(["/bin/bash", "-c", f"{shlex.join(script)}; echo \"[exit code $?]\""],
                      ENVIRONMENT, str(self.folder)) as program:  # fmt: skip
            both = re.compile(f"{ASKED.pattern}|{ENDED.pattern}")
            while (found := program.wait_for(both.pattern, LONG_S)).group(1):
                if (typed := answer(found.group(1))) is not None:
                    program.type(typed + "\n")
            return int(found.group(3)), program.shown

    def word(self, word: str) -> str:
        """Type an action of the operator, or a reading of the scale, into the cell's terminal."""
        self.cell.type(f"{word}\n")
        return self.cell.wait_for(r"cell: ([^\n]*)\n").group(1)

    def newtons(self) -> float:
        found = re.search(r"A ([\d.]+) N", self.word("scale"))
        assert found is not None
        return float(found.group(1))

    def write(self, **more: dict[str, Any]) -> None:
        """Write lab.toml: what the emulator wrote, less the hand's calibration, and more."""
        sections = tomllib.loads((self.folder / "emulated.toml").read_text())
        del sections["gripper"], sections["calibration"]
        for section, values in more.items():
            sections[section] = sections.get(section, {}) | values
        (self.folder / "lab.toml").write_text(
            "".join(
                f"[{name}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in keys.items())
                for name, keys in sections.items()
            )
        )


def play(folder: Path) -> str:
    """Run the whole day and return its output."""
    with Terminal([*GRASP, *EMULATE], ENVIRONMENT, str(folder)) as cell:
        day = Day(folder, cell)
        _check(day)
        _move(day)
        _calibrate(day)
        _lift(day)
        return "\n".join(day.shown) + "\n"


def _check(day: Day) -> None:
    day.write()
    day.run("doctor", "--rig", "hardware", *LAB, code=3)
    day.run("status", "gripper", *LAB)
    day.run("status", "arm", *LAB)

    def presses(question: str) -> None:
        for pad in ("A 2", "C 5"):
            day.word(f"press {pad}")

    shown = day.run("tactile", "identify", "--seconds", "6", *LAB, answer=presses)
    assert re.findall(r"^finger (\w taxel \d)", shown, re.MULTILINE) == ["A taxel 2", "C taxel 5"]
    day.run("tactile", "watch", "--seconds", "3", *LAB)
    day.run("tactile", "watch", "--rest", "--out", "rest.toml", *LAB)


def _move(day: Day) -> None:
    day.write(gripper={"calibration": "manual"})
    day.run("gripper", "activate", *MOVES, answer=lambda question: "empty")
    day.word("take")
    # the manual's hand closes with 15 N at least and cannot keep a limit of 10 N
    day.run("gripper", "close", *LAB, "--dry-run", code=2)


def _calibrate(day: Day) -> None:
    day.word("place")

    def weighed(question: str) -> str:
        return "scale" if question.startswith("Type") else f"{day.newtons():.2f} N"

    hand = ("calibrate", "hand", "--up-to", "16", "--out", "hand.toml")
    day.run(*hand, *MOVES, answer=weighed)
    day.write(gripper={"calibration": "hand.toml"}, **OWN_LIMIT)

    day.word("take")
    loads = iter([(finger, load_n) for finger in "ABC" for load_n in (*LOADS_N, 0.0)])

    def loaded(question: str) -> str:
        finger, load_n = next(loads)
        assert f"fingertip {finger}" in question
        day.word(f"lay {finger} {load_n:g}")
        return f"{load_n:g} N" if load_n else ""

    day.run("calibrate", "force", "--out", "force.toml", *LAB, answer=loaded)
    day.run("gripper", "step", "--finger", "B", "--mm", "3", *MOVES)
    day.run("gripper", "step", "--finger", "B", "--mm", "3", "--open", *MOVES)
    day.run("release", *MOVES)
    day.run("arm", "step", "--z", "3", *MOVES)
    day.run("arm", "step", "--z", "-3", *MOVES)
    day.run("calibrate", "noise", "--seconds", "60", "--out", "rule.toml", *MOVES,
            answer=lambda question: [day.word("place"), ""][1])  # fmt: skip


def _lift(day: Day) -> None:
    kept = [word for name in ("rest", "force", "rule") for word in ("--config", f"{name}.toml")]
    day.run("doctor", "--rig", "hardware", "--object", "foam", *LAB, *kept)
    actions = iter(("take", "place", "place"))

    def answered(question: str) -> str:
        if "How far" in question:
            day.cell.type("look\n")
            return day.cell.wait_for(r"([\d.]+) mm from its mark").group(1)
        day.word(next(actions))
        return ""

    day.run("run", "lift", "--first", "--dry-run", "--rig", "hardware", *LAB, *kept)
    day.run("run", "lift", "--first", "--rig", "hardware", *MOVES, *kept, answer=answered)
    day.word("home")  # as with the pendant: the arm is still where the lift ended
    day.run("runs")
    day.run("release", "--dry-run", "--rig", "hardware", *LAB)


def steps(page: str) -> list[str]:
    """The commands of a page or of a terminal, in order, with exit codes other than 0."""
    lines = (line.strip() for line in page.splitlines())
    return [line for line in lines if line.startswith(("$ grasp", "[exit code"))]


@pytest.mark.timeout(900)
def test_first_day_matches_its_page(tmp_path: Path) -> None:
    page = (DOCS / "first-day.md").read_text(encoding="utf-8")
    assert steps(play(tmp_path)) == steps(page)
