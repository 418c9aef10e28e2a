"""Input that makes no sense, drawn by number: settings, words of verbs, files."""

import argparse
import math
import random
import string
from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec
from msgspec import inspect

from grasp.cli.main import build_parser
from grasp.settings import config_dir
from scenarios.acquire.config import AcquireConfig
from scenarios.campaign.config import RunConfig

STRANGE = (
    "", " ", "zzz", "\x00", "\x1b[2J", "a\nb", "\u202egrasp", "e\u0301\u0301", "\U0001f916", "nan",
    "../../x", "/", "/dev/null/x", "%s%n", "{0}", "$(id)", "'; --", "a" * 5_000, "-", "=", "[",
    "\ud83d",
)  # fmt: skip
NO_NUMBERS = (
    "nan",
    "-inf",
    "x",
    "",
    "1,5",
    "0x",
    "--1",
    "1e",
    "\u0663\u0664x",
    "9" * 5_000,
    "-1e300",
)
DEEP = 3_000


class Input(msgspec.Struct, frozen=True):
    """What is told to the command line. FILE in a word stands for a path of that content, IN for
    the folder in which all that is given lies, OUT for a path at which nothing is."""

    words: tuple[str, ...]
    content: bytes | None = None
    name: str = "in.toml"  # of that file, in IN
    sure: bool = True  # that it must be refused; else it may as well be harmless
    beside: tuple[tuple[str, str], ...] = ()  # good files in IN: name, and which

    def __str__(self) -> str:
        told = " ".join(ascii(word)[1:-1][:80] for word in self.words)
        return told if self.content is None else f"{told} of {self.content[:160]!r}"


class Leaf(msgspec.Struct, frozen=True):
    """A setting, by its way there, and what it may be."""

    way: tuple[str, ...]
    kind: Any


def leaves(kind: Any, way: tuple[str, ...] = ()) -> Iterator[Leaf]:
    """All settings in a type."""
    if isinstance(kind, inspect.Metadata):
        yield from leaves(kind.type, way)
    elif isinstance(kind, inspect.UnionType):
        for part in kind.types:
            if isinstance(part, inspect.StructType):
                yield from leaves(part, way)
    elif isinstance(kind, inspect.StructType):
        for field in kind.fields:
            yield from leaves(field.type, (*way, field.encode_name))
    elif not isinstance(kind, inspect.DictType):  # one's own devices': whatever those read
        yield Leaf(way, kind)


@cache
def settings() -> tuple[Leaf, ...]:
    """Of a lift and a tap."""
    return tuple(leaf for leaf in leaves(inspect.type_info(RunConfig)) if len(leaf.way) > 1)


@cache
def settings_of_acquisition() -> tuple[Leaf, ...]:
    return tuple(leaf for leaf in leaves(inspect.type_info(AcquireConfig)) if len(leaf.way) > 1)


def beyond(kind: Any) -> list[Any]:
    """Numbers past the ends of what is allowed."""
    step = 1 if isinstance(kind, inspect.IntType) else 1e-3
    found: list[Any] = []
    if kind.ge is not None:
        found += [kind.ge - step, -(10**9)]
    if kind.gt is not None:
        found += [kind.gt, kind.gt - step]
    if kind.le is not None:
        found += [kind.le + step, 10**18]
    if kind.lt is not None:
        found += [kind.lt]
    return found


def wrong(kind: Any, chance: random.Random) -> Any:
    """A value that such a setting cannot have."""
    other: list[Any] = [{"a": 1}, {}, [[[]]], ["\x00"]]
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        other += [math.nan, math.inf, -math.inf, True, "1", "nan", 10**400, *beyond(kind)]
        other += [0.5] if isinstance(kind, inspect.IntType) else []
    elif isinstance(kind, inspect.BoolType):
        other += [0, 1, "true", math.nan]
    elif isinstance(kind, inspect.StrType):
        other += [1, 1.5, False, math.nan]
    elif isinstance(kind, inspect.LiteralType):
        other += [*STRANGE[:-1], 1.5, math.nan]
    else:
        other = [1, "x", True, math.nan, {"a": 1}, [[math.nan]], ["x"], [None]]
        other = [value for value in other if value != [None]]
    return chance.choice(other)


def toml(value: Any) -> str:
    """As a file writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return "nan" if math.isnan(value) else str(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, str):
        plain = (f"\\u{ord(c):04X}" if ord(c) < 32 or c in '"\\\x7f' else c for c in value)
        return f'"{"".join(plain)}"'
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return f"{{{', '.join(f'{key} = {toml(part)}' for key, part in value.items())}}}"


SHOW = ("config", "show")
# whoever resolves all settings of a run before anything else
SETTLED_BY = (
    SHOW, ("run", "lift", "--rig", "simulated", "--runs", "OUT"),
    ("run", "tap", "--rig", "simulated", "--runs", "OUT"),
    ("run", "lift", "--rig", "simulated", "--runs", "OUT", "--trials", "2", "--out", "OUT.sqlite"),
    ("run", "lift", "--rig", "emulated", "--runs", "OUT", "--json"),
    ("grip-search", "--write", "OUT.toml"), ("emulate",),
)  # fmt: skip


def a_setting(chance: random.Random) -> Input:
    """One that cannot be, by --set or in a file."""
    leaf = chance.choice(settings())
    way, value = ".".join(leaf.way), wrong(leaf.kind, chance)
    if chance.random() < 0.1:
        way, value = way + chance.choice(("x", ".x", "\u00e9", ".\u00e9")), 1
    verb = chance.choice(SETTLED_BY)
    if chance.random() < 0.5:
        text = value if isinstance(value, str) else toml(value)
        sure = not isinstance(value, str)  # what is no TOML is a text, and may be one's own name
        return Input((*(verb if sure else SHOW), "--set", f"{way}={text}"), sure=sure)
    content = f"{way} = {toml(value)}\n".encode("utf-8", "surrogatepass")
    return Input((*verb, "--config", "FILE"), content)


ACQUIRE = ("run", "acquire", "--rig", "simulated", "--runs", "OUT", "--json")
CAMPAIGN = ("campaign", "run", "FILE", "--jobs", "1", "--out", "OUT.sqlite")
BUILD = ("dataset", "build", "FILE", "--jobs", "1", "--out", "OUT")
OWN_RIG, OWN_CAMPAIGN = "a rig of one's own", "a campaign of one's own"
OWN = {
    OWN_RIG: b'rig = "simulated"\n[controller]\nhold_s = 0.2\n[gripper]\ncalibration = "paper"\n',
    OWN_CAMPAIGN: b"""name = "two"
scenarios = ["lift", "tap"]
objects = ["can", "ball"]
detectors = ["energy"]
settings = ["controller.hold_s=0.2"]
seeds = [0, 1]
repetitions = 2
recordings = "failures"
sweep = { "controller.lift_height_m" = [0.02, 0.05] }
""",
}


def of_acquisition(chance: random.Random) -> Input:
    leaf = chance.choice(settings_of_acquisition())
    way, value = ".".join(leaf.way), wrong(leaf.kind, chance)
    while isinstance(value, str):
        value = wrong(leaf.kind, chance)
    return Input((*ACQUIRE, "--set", f"{way}={toml(value)}"))


CHECK = ("config", "check", "FILE")
A_LIFT = ("run", "lift", "--rig", "simulated", "--runs", "OUT", "--set", "controller.hold_s=0.2")
# of each kind of packaged file of settings one, and who reads such a file of one's own
READERS_OF_SETTINGS: tuple[tuple[str, tuple[tuple[str, ...], ...]], ...] = (
    ("objects/can.toml", (
        CHECK, (*SHOW, "--object", "FILE"), (*A_LIFT, "--object", "FILE"),
        ("world", "plan", "hold", "--object", "FILE", "--json"),
    )),
    ("surfaces/planar.toml", (CHECK, (*ACQUIRE, "--surface", "FILE"))),
    ("calibrations/paper.toml", (
        CHECK, (*SHOW, "--set", "gripper.calibration=FILE"),
        (*A_LIFT, "--set", "gripper.calibration=FILE"),
    )),
    ("rigs/emulated.toml", (CHECK, (*SHOW, "--config", "FILE"))),
    (OWN_RIG, (CHECK, (*SHOW, "--rig", "FILE"), (*A_LIFT, "--rig", "FILE"))),
    ("profiles/paper.toml", (CHECK, (*SHOW, "--config", "FILE"), (*A_LIFT, "--config", "FILE"),
                             (*SHOW, "--profile", "FILE"))),
    ("detectors/tcn.toml", (CHECK, (*SHOW, "--config", "FILE"), (*SHOW, "--detector", "FILE"),
                            ("detector", "evaluate", "FILE", "--recording", "IN/a.csv"))),
    (OWN_CAMPAIGN, (CHECK, CAMPAIGN, CAMPAIGN, (*CAMPAIGN, "--resume"))),
    ("campaigns/paper.toml", (CHECK, CAMPAIGN)),
    ("datasets/paper.toml", (CHECK, BUILD, BUILD)),
    ("datasets/confusers.toml", (CHECK, BUILD)),
    ("layouts/eight.toml", ((*SHOW, "--config", "FILE"),)),
)  # fmt: skip


def a_file_of_settings(chance: random.Random) -> Input:
    """One that was packaged, and is not what it was."""
    name, readers = chance.choice(READERS_OF_SETTINGS)
    good = OWN.get(name) or (config_dir() / name).read_bytes()
    words = chance.choice(readers)
    beside = (("a.csv", "a.csv"),) if "IN/a.csv" in words else ()
    return Input(words, spoilt(good, chance), sure=False, beside=beside)


def spoilt(content: bytes, chance: random.Random) -> bytes:
    """Cut, flipped, doubled, with something in it, nested, or nothing of it."""
    at = chance.randrange(len(content) + 1)
    other = chance.randrange(len(content) + 1)
    low, high = min(at, other), max(at, other)
    strange = chance.choice(STRANGE).encode("utf-8", "surrogatepass")
    bits = bytearray(content)
    for _ in range(chance.choice((1, 1, 8))):
        bits[chance.randrange(len(bits))] ^= 1 << chance.randrange(8)
    number = chance.choice((b"nan", b"-inf", b"1e999", b"9" * 400, b"true", b'"x"', b"[]", b"{}"))
    return chance.choice((
        content[:at], bytes(bits), content[:low] + content[high:], content + content,
        content[:at] + strange + content[at:], content[:at] + b"[" * DEEP + content[at:],
        b"", chance.randbytes(200), b"\xff\xfe" + content, with_number(content, number, chance),
    ))  # fmt: skip


def with_number(content: bytes, number: bytes, chance: random.Random) -> bytes:
    """One line's value is another."""
    lines = content.splitlines()
    at = chance.choice([i for i, line in enumerate(lines) if b" = " in line] or [0])
    if lines:
        lines[at] = lines[at].partition(b" = ")[0] + b" = " + number
    return b"\n".join(lines)


Option = tuple[tuple[str, ...], argparse.Action]


@cache
def options() -> tuple[Option, ...]:
    """Of every verb."""

    def of(parser: argparse.ArgumentParser, words: tuple[str, ...]) -> Iterator[Option]:
        actions = parser._actions  # noqa: SLF001  (argparse tells them nowhere else)
        deeper = [a.choices for a in actions if a.nargs == argparse.PARSER and a.choices]
        for choices in deeper:
            for name, sub in dict(choices).items():
                yield from of(sub, (*words, name))
        if not deeper:
            yield from ((words, action) for action in actions if action.dest != "help")

    return tuple(of(build_parser(), ()))


# a name of something that is there, or of a place of one's own, which any text may be
FREE = {"--set", "--url", "--serial", "--cluster", "--host", "--out", "--taps"}
NAMES = {"--object", "--profile", "--detector", "--rig", "--surface", "--direction", "--scene"}


def words_of_a_verb(chance: random.Random) -> Input:
    """An option that it does not have, or without a value, or with one that it cannot have."""
    verb, action = chance.choice(options())
    kind = getattr(action.type, "__name__", "")
    name = action.option_strings[-1] if action.option_strings else ""
    ways = [(*verb, "--" + "".join(chance.choices(string.ascii_lowercase, k=9)), "1")]
    if name and action.nargs == 0:
        ways.append((*verb, f"{name}=1"))
    elif name:
        ways.append((*verb, name))
    if name and kind in ("number", "length"):
        ways += [(*verb, f"{name}={chance.choice(NO_NUMBERS)}")] * 4
    if name and action.choices:
        ways += [(*verb, f"{name}={chance.choice(STRANGE)}")] * 4
    if name in NAMES:
        strange = [s for s in STRANGE if s not in ("", " ")]
        ways += [(*verb, f"{name}={chance.choice(strange)}")] * 4
    return Input(chance.choice(ways))


def a_file_of_results(chance: random.Random, kept: dict[str, bytes]) -> Input:
    """A recording, verdict, campaign, network, its heads, table or scores: not what it was."""
    which = chance.choice(sorted(READERS_OF_RESULTS))
    words, name, beside = chance.choice(READERS_OF_RESULTS[which])
    return Input(words, spoilt(kept[which], chance), name, sure=False, beside=beside)


RUN = (("run/recording.mcap", "a.mcap"), ("run/result.json", "result.json"))
NETWORK = (("a.onnx", "a.onnx"), ("a.csv", "a.csv"))
SCORED = ("detector", "evaluate", "energy", "--recording", "FILE", "--out", "OUT.json")
# of each, by its name: the words, under which name, and what lies beside it
READERS_OF_RESULTS: dict[
    str, tuple[tuple[tuple[str, ...], str, tuple[tuple[str, str], ...]], ...]
] = {
    "a.mcap": tuple(
        (words, "run/recording.mcap", RUN[1:]) for words in (
            ("replay", "FILE"), ("replay", "IN/run", "--check"), ("export", "IN/run", "--out",
             "OUT.csv"), ("report", "FILE", "--out", "OUT.html"), ("chart", "run", "FILE", "--out",
             "OUT.svg"))
    ),
    "result.json": tuple(
        (words, "run/result.json", RUN[:1]) for words in (
            ("runs", "--runs", "IN", "--json"), ("report", "IN/run", "--out", "OUT.html"),
            ("replay", "IN/run"), ("chart", "run", "IN/run", "--out", "OUT.svg"),
            ("export", "IN/run", "--out", "OUT.csv"))
    ),
    "a.sqlite": tuple(
        (words, "a.sqlite", ()) for words in (
            ("campaign", "summary", "FILE"), ("campaign", "export", "FILE", "--out", "OUT.csv"),
            ("report", "FILE", "--out", "OUT.html"))
    ),
    "a.onnx": tuple(
        (words, "a.onnx", NETWORK[1:]) for words in (
            ("detector", "card", "FILE"), (*SHOW, "--detector", "FILE"),
            ("replay", "--tactile", "IN/a.csv", "--detector", "FILE"))
    ),
    "a.heads.json": tuple(
        (words, "a.heads.json", NETWORK) for words in (
            ("detector", "card", "IN/a.onnx"),
            ("replay", "--tactile", "IN/a.csv", "--detector", "IN/a.onnx"))
    ),
    "scores.json": ((("report", "FILE", "--out", "OUT.html"), "scores.json", ()),),
    "a.npz": tuple(
        (words, "a.npz", ()) for words in (
            ("replay", "--detector", "energy", "--tactile", "FILE"), SCORED)
    ),
    "a.csv": tuple(
        (words, "a.csv", ()) for words in (
            ("replay", "--detector", "energy", "--tactile", "FILE"), SCORED)
    ),
}  # fmt: skip


def drawn(number: int, kept: dict[str, bytes]) -> Input:
    """The same for a number, for ever."""
    chance = random.Random(number)
    share = chance.random()
    if share < 0.25:
        return a_setting(chance)
    if share < 0.32:
        return of_acquisition(chance)
    if share < 0.57:
        return a_file_of_settings(chance)
    if share < 0.77:
        return words_of_a_verb(chance)
    return a_file_of_results(chance, kept)
