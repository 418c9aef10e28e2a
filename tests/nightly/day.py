"""A laboratory's first day, played at terminals from an empty folder against `grasp emulate`.

docs/first-day.md shows one play; a test plays it again and compares.
"""

import json
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.nightly.terminal import Terminal
from tests.wire.lab import ENVIRONMENT, GRASP

PAGE = Path(__file__).parents[2] / "docs" / "hardware.md"
HOST, PORT = "127.0.0.2", "5020"
EMULATE = ("emulate", "--host", HOST, "--gripper-port", PORT, "--object", "foam")
LAB = ("--config", "lab.toml")
MOVES = (*LAB, "--confirm-motion")
# a question, the prompt of a word, or what is done somewhere else than at the keyboard
ASKED = re.compile(r"(>>> (?:[^\n]*(?:Enter|\?|type)[^\n]*)\n|Type (\w+): |press one pad [^\n]*\n)")
ENDED = re.compile(r"\[exit code (\d+)\]")
LONG_S = 600.0
AGAIN = 6
OWN_LIMIT = {"guard": {"force_limit_n": 11.0}, "controller": {"grip_force_n": 11.0}}
STATUS = re.compile(r"^ *\d+\.\d+ s ")  # lines that follow a run where no picture is drawn


class Day:
    """The folder, the cell and its terminal, and what has been shown so far."""

    def __init__(self, folder: Path, cell: Terminal) -> None:
        self.folder, self.cell = folder, cell
        self.shown: list[str] = []
        self.endpoints: dict[str, Any] = json.loads(cell.wait_for(r"\{.*\}").group(0))
        cell.wait_for("what a person does, a line each")

    def say(self, text: str) -> None:
        """What a person thinks or does, between the commands."""
        self.shown.append(f"\n{text}\n")

    def run(self, *words: str, answer: Callable[[str], str | None] = lambda question: "",
            code: int = 0) -> str:  # fmt: skip
        """A command in its own terminal, each of its questions answered (None: nothing is typed);
        what it showed. One that moves nothing is asked again while the machine is so busy that
        frames of the fingertips are lost."""
        for left in reversed(range(AGAIN)):
            ended, shown = self._once(words, answer)
            reads = words[0] == "doctor" or "--dry-run" in words
            if ended == code or not (left and reads and "use another USB port" in shown):
                break
        assert ended == code, shown
        self.shown.append(_as_text(words, shown))
        return shown

    def _once(self, words: tuple[str, ...], answer: Callable[[str], str | None]) -> tuple[int, str]:
        script = [*GRASP, *words]
        with Terminal(["/bin/bash", "-c", f"{shlex.join(script)}; echo \"[exit code $?]\""],
                      ENVIRONMENT, str(self.folder)) as program:  # fmt: skip
            both = re.compile(f"{ASKED.pattern}|{ENDED.pattern}")
            while (found := program.wait_for(both.pattern, LONG_S)).group(1):
                if (typed := answer(found.group(1))) is not None:
                    program.type(typed + "\n")
            return int(found.group(3)), program.shown

    def word(self, word: str) -> str:
        """Into the cell's terminal: what a person does there, or reads off a scale."""
        self.cell.type(f"{word}\n")
        return self.cell.wait_for(r"cell: ([^\n]*)\n").group(1)

    def newtons(self) -> float:
        found = re.search(r"A ([\d.]+) N", self.word("scale"))
        assert found is not None
        return float(found.group(1))

    def write(self, **more: dict[str, Any]) -> None:
        """lab.toml: addresses, what a rehearsal needs, and more."""
        blocks = re.findall(r"```toml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
        _, rehearsal = (tomllib.loads(block) for block in blocks if "[modbus]" in block)
        del rehearsal["gripper"], rehearsal["calibration"]  # this day measures its own
        found: dict[str, dict[str, Any]] = {
            "modbus": {"host": HOST, "port": int(PORT)}, "ur": {"host": HOST},
            "usb": {"url": self.endpoints["tactile"]["url"]},
        }  # fmt: skip
        sections: dict[str, dict[str, Any]] = {}
        for table in (found, rehearsal, more):
            for section, values in table.items():
                sections[section] = sections.get(section, {}) | values
        (self.folder / "lab.toml").write_text(
            "".join(
                f"[{name}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in keys.items())
                for name, keys in sections.items()
            )
        )


def _as_text(words: tuple[str, ...], shown: str) -> str:
    kept = [line.rstrip() for line in shown.splitlines() if not STATUS.match(line)]
    body = "\n".join(line for line in kept if not ENDED.match(line))
    code = ENDED.search(shown)
    ended = f"\n[exit code {code.group(1)}]" if code and code.group(1) != "0" else ""
    return f"```\n$ {shlex.join(('grasp', *words))}\n{body}{ended}\n```"


def play(folder: Path) -> str:
    """The day, as a page shows it. AssertionError where it does not go as it should."""
    with Terminal([*GRASP, *EMULATE], ENVIRONMENT, str(folder)) as cell:
        day = Day(folder, cell)
        _looks(day)
        _moves(day)
        _calibrates(day)
        _lifts(day)
        return "\n".join(day.shown) + "\n"


def _looks(day: Day) -> None:
    url = day.endpoints["tactile"]["url"]
    day.say("Who is there? Its last lines begin `lab.toml`; what a rehearsal needs besides "
            "([hardware.md](hardware.md#rehearsing-all-of-this)) is put into the same sections, "
            "for each stands once in a file.")  # fmt: skip
    day.run("doctor", HOST, f"{HOST}:{PORT}", url)
    day.write()
    day.say("What stands against a run? Nobody has said yet which hand this is, and it is not "
            "active: both are right.")  # fmt: skip
    day.run("doctor", "--rig", "hardware", *LAB, code=3)
    day.run("gripper", "status", *LAB)
    day.run("arm", "status", *LAB)
    day.say("Which finger and taxel is which? Two pads are pressed while it looks (`press A 2`, "
            "`press C 5`), and they are those that answer: `tactile.cells` is right for this "
            "board.")  # fmt: skip

    def presses(question: str) -> None:
        for pad in ("A 2", "C 5"):
            day.word(f"press {pad}")

    shown = day.run("tactile", "identify", "--seconds", "6", *LAB, answer=presses)
    assert re.findall(r"^finger (\w taxel \d)", shown, re.MULTILINE) == ["A taxel 2", "C taxel 5"]
    day.run("tactile", "watch", "--seconds", "3", *LAB)
    day.run("tactile", "watch", "--rest", "--out", "rest.toml", *LAB)


def _moves(day: Day) -> None:
    day.write(gripper={"calibration": "manual"})
    day.say("The manual's hand, 15 N at least, goes into `lab.toml`. First motion: the hand alone, "
            "empty.")  # fmt: skip
    day.run("gripper", "activate", *MOVES, answer=lambda question: "empty")
    day.word("take")
    day.run("gripper", "close", *LAB, "--dry-run", code=2)
    day.say("Whatever closes is refused where a run would be: 15 N cannot keep a limit of 10 N. "
            "What does this hand press with? A scale stands before the thumb (the emulated lab's "
            "object is one: its word `scale`).")  # fmt: skip


def _calibrates(day: Day) -> None:
    day.word("place")

    def weighed(question: str) -> str:
        return "scale" if question.startswith("Type") else f"{day.newtons():.2f} N"

    hand = ("calibrate", "hand", "--up-to", "16", "--out", "hand.toml")
    day.run(*hand, *MOVES, answer=weighed)
    day.write(gripper={"calibration": "hand.toml"}, **OWN_LIMIT)

    def pressed(question: str) -> str:
        if question.startswith("Type"):
            return "scale"
        if "almost touch" in question:
            return "96"
        newtons = day.newtons()
        return f"{newtons:.2f} N" if newtons > 0.3 else ""

    force = ("calibrate", "force", "--press", "--up-to", "15", "--out", "force.toml")
    day.run(*force, *MOVES, answer=pressed)
    day.say("`lab.toml` says since the scale what `calibrate hand` ended with: `hand.toml` is this "
            "hand, and not weak enough for a limit of 10 N, so `guard.force_limit_n` and "
            "`controller.grip_force_n` are 11. Small motions.")  # fmt: skip
    day.word("take")
    day.run("gripper", "step", "--finger", "B", "--mm", "3", *MOVES)
    day.run("gripper", "step", "--finger", "B", "--mm", "3", "--open", *MOVES)
    day.run("release", *MOVES)
    day.run("arm", "step", "--z", "3", *MOVES)
    day.run("arm", "step", "--z", "-3", *MOVES)
    day.run("calibrate", "noise", "--seconds", "60", "--out", "rule.toml", *MOVES,
            answer=lambda question: [day.word("place"), ""][1])  # fmt: skip


def _lifts(day: Day) -> None:
    day.say("Everything together, the rest of the pads too, which each run compares its own with: "
            "would that lift start?")  # fmt: skip
    kept = [word for name in ("rest", "force", "rule") for word in ("--config", f"{name}.toml")]
    day.run("doctor", "--rig", "hardware", "--object", "foam", *LAB, *kept)
    does = iter(("take", "place", "place"))

    def answered(question: str) -> str:
        if "How far" in question:
            day.cell.type("look\n")
            return day.cell.wait_for(r"([\d.]+) mm from its mark").group(1)
        day.word(next(does))
        return ""

    day.say("What would it do? The devices are asked, nothing moves.")
    day.run("run", "lift", "--first", "--dry-run", "--rig", "hardware", *LAB, *kept)
    day.say("Then it does it.")
    day.run("run", "lift", "--first", "-v", "--rig", "hardware", *MOVES, *kept, answer=answered)
    day.say("The arm stands where the lift ended; brought back by its pendant (the lab's word "
            "`home`), the day is over.")  # fmt: skip
    day.word("home")
    day.run("runs")
    day.say("Had the hand been left closed, this would open it; what it holds falls.")
    day.run("release", "--dry-run", "--rig", "hardware", *LAB)


def skeleton(page: str) -> list[str]:
    """What two plays of one day have in common: commands, exit codes, questions and figures' words,
    without the figures; a question that is asked again counts once."""
    told = [
        re.sub(r"[\d.]+", "#", line)
        for line in page.splitlines()
        if line.startswith(("$ grasp", "[exit code", ">>> "))
    ]
    return [line for line, before in zip(told, ["", *told], strict=False) if line != before]
