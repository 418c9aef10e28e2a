"""Input that makes no sense, drawn by number: settings, words of verbs, files."""

import argparse
import math
import random
import string
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from grasp.cli.main import build_parser
from grasp.settings import config_dir
from scenarios.acquire.config import AcquireConfig
from scenarios.campaign.config import RunConfig

STRANGE = (
    "", " ", "zzz", "\x00", "\x1b[2J", "a\nb", "\u202egrasp", "e\u0301\u0301", "\U0001f916", "nan",
    "../../x", "/", "/dev/null/x", "%s%n", "{0}", "$(id)", "'; --", "a" * 5_000, "-", "=", "[",
    "\ud83d", "\udcff", "a" * 300, "b" * 252, "c/" * 3_000, ".", "-x",
)  # fmt: skip
NO_TEXT = ("\x00", "\ud83d", "\udcff", "a\x00b")  # refused whatever they are to name
# and so is what neither is there nor can be made
NOWHERE = (*NO_TEXT, "a" * 300, "a" * 5_000, "c/" * 3_000, "/dev/null/x", "/dev/null/x/y")
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


T = TypeVar("T")


@cache
def _shuffled(count: int, lap: int) -> list[int]:
    return random.Random(lap).sample(range(count), count)


def in_turn(things: Sequence[T], nth: int) -> T:
    """Each of them once before any comes again, in an order of its own each time."""
    lap, at = divmod(nth, len(things))
    return things[_shuffled(len(things), lap)[at]]


class Input(msgspec.Struct, frozen=True):
    """What is told to the command line. FILE in a word stands for a path of that content, IN for
    the folder in which all that is given lies, OUT for a path at which nothing is."""

    words: tuple[str, ...]
    content: bytes | None = None
    name: str = "in.toml"  # of that file, in IN
    sure: bool = True  # that it must be refused; else it may as well be harmless
    beside: tuple[tuple[str, str], ...] = ()  # good files in IN: name, and which
    tries: str = ""  # the setting or the option whose value it is that makes no sense

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


def _is_toml(text: str) -> bool:
    return not any(0xD800 <= ord(c) < 0xE000 for c in text)


def wrong(kind: Any, chance: random.Random) -> Any:
    """A value that such a setting cannot have; of a text one that is not likely."""
    other: list[Any] = [{"a": 1}, {}, [[[]]], ["\x00"]]
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        other += [math.nan, math.inf, -math.inf, True, "1", "nan", 10**400, *beyond(kind)]
        other += [0.5] if isinstance(kind, inspect.IntType) else []
    elif isinstance(kind, inspect.BoolType):
        other += [0, 1, "true", math.nan]
    elif isinstance(kind, inspect.StrType):
        other += [1, 1.5, False, math.nan, *(s for s in STRANGE if _is_toml(s))]
    elif isinstance(kind, inspect.LiteralType):
        other += [*(s for s in STRANGE if _is_toml(s)), 1.5, math.nan]
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


SHOW = ("config",)
# whoever resolves all settings of a run before anything else
SETTLED_BY = (
    SHOW, ("run", "lift", "--rig", "simulated", "--runs", "OUT"),
    ("run", "tap", "--rig", "simulated", "--runs", "OUT"),
    ("run", "lift", "--rig", "simulated", "--runs", "OUT", "--trials", "2", "--out", "OUT.sqlite"),
    ("run", "lift", "--rig", "emulated", "--runs", "OUT", "--json"),
    ("emulate",),
)  # fmt: skip


def a_setting(chance: random.Random, nth: int) -> Input:
    """One that cannot be, by --set or in a file."""
    leaf = in_turn(settings(), nth)
    way, value = ".".join(leaf.way), wrong(leaf.kind, chance)
    tries, verb = way, chance.choice(SETTLED_BY)
    if nth >= len(settings()) and chance.random() < 0.1:
        tries, way, value = "", way + chance.choice(("x", ".x", "\u00e9", ".\u00e9")), 1
    if chance.random() < 0.5:
        text = value if isinstance(value, str) else toml(value)
        sure = not isinstance(value, str)  # what is no TOML is a text, and may be one's own name
        words = (*(verb if sure else SHOW), "--set", f"{way}={text}")
        return Input(words, sure=sure, tries=tries)
    sure = not (isinstance(value, str) and isinstance(leaf.kind, inspect.StrType))
    content = f"{way} = {toml(value)}\n".encode()
    words = (*(verb if sure else SHOW), "--config", "FILE")
    return Input(words, content, sure=sure, tries=tries)


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


def packaged(name: str) -> bytes:
    """A good file of settings."""
    return OWN.get(name) or (config_dir() / name).read_bytes()


def of_acquisition(chance: random.Random, nth: int) -> Input:
    leaf = in_turn(settings_of_acquisition(), nth)
    way, value = ".".join(leaf.way), wrong(leaf.kind, chance)
    while isinstance(value, str):
        value = wrong(leaf.kind, chance)
    return Input((*ACQUIRE, "--set", f"{way}={toml(value)}"), tries=way)


CHECK = ("config", "FILE")
A_LIFT = ("run", "lift", "--rig", "simulated", "--runs", "OUT", "--set", "controller.hold_s=0.2")
# of each kind of packaged file of settings one, and who reads such a file of one's own
READERS_OF_SETTINGS: tuple[tuple[str, tuple[tuple[str, ...], ...]], ...] = (
    ("objects/can.toml", (
        CHECK, (*SHOW, "--object", "FILE"), (*A_LIFT, "--object", "FILE"),
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


def a_file_of_settings(chance: random.Random, nth: int) -> Input:
    """One that was packaged, and is not what it was."""
    every = [(name, words) for name, readers in READERS_OF_SETTINGS for words in readers]
    name, words = in_turn(every, nth)
    good = packaged(name)
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


NAMES = {"--object", "--profile", "--detector", "--rig", "--surface", "--direction", "--scene"}
REFUSED = {"--set", "--url", "--host", "--taps"}  # whatever of these it is
# read as a file or a folder
OF_A_PLACE = ("Path", "file_to_write", "file_with_folders", "folder_to_fill", "picture", "_html")
ENOUGH = {"A": "1", "number": "1", "picture": "OUT.svg", "Path": "IN/none"}  # of other options
MAY_BE_EMPTY = (("runs",),)  # a folder that is not there holds no runs


def strange_values(verb: tuple[str, ...], action: argparse.Action) -> tuple[str, ...]:
    """Values for which it must be refused."""
    kind = getattr(action.type, "__name__", "")
    name = action.option_strings[-1] if action.option_strings else ""
    if action.nargs == 0:
        return ()
    if action.choices:
        return STRANGE
    if kind in ("number", "length"):
        return (*NO_NUMBERS, *NO_TEXT)
    if name in NAMES:
        return tuple(s for s in STRANGE if s not in ("", " "))
    if name in REFUSED:
        return STRANGE
    if kind in OF_A_PLACE and verb not in MAY_BE_EMPTY:
        return NOWHERE
    return NO_TEXT  # whatever else may be a name, of a host, say, or a note


def takes_values() -> tuple[Option, ...]:
    return tuple((verb, action) for verb, action in options() if action.nargs != 0)


def title(verb: tuple[str, ...], action: argparse.Action) -> str:
    name = action.option_strings[-1] if action.option_strings else action.metavar or action.dest
    return " ".join((*verb, str(name)))


def a_value_of_a_verb(chance: random.Random, nth: int) -> Input:
    """An option, or what has no name, with a value that it cannot have; all that is required
    beside it is there."""
    verb, action = in_turn(takes_values(), nth)
    value = chance.choice(strange_values(verb, action))
    words: list[str] = []
    for other_verb, other in options():
        if other_verb != verb or other is action or not _is_required(other):
            continue
        kind = getattr(other.type, "__name__", "")
        enough = next(iter(other.choices)) if other.choices else ENOUGH.get(kind, "OUT")
        words += [f"{other.option_strings[-1]}={enough}"] if other.option_strings else [enough]
    given = f"{action.option_strings[-1]}={value}" if action.option_strings else value
    last = [given] if action.option_strings else ["--", given]  # what begins with - is no option
    if not action.option_strings and chance.random() < 0.3:
        last = [given]
    return Input((*verb, *words, *last), tries=title(verb, action))


def _is_required(action: argparse.Action) -> bool:
    return action.required if action.option_strings else action.nargs not in ("?", "*")


def words_of_a_verb(chance: random.Random, nth: int) -> Input:
    """An option that it does not have, or without a value, or with one where it takes none."""
    verb, action = in_turn(options(), nth)
    name = action.option_strings[-1] if action.option_strings else ""
    ways = [(*verb, "--" + "".join(chance.choices(string.ascii_lowercase, k=9)), "1")]
    if name:
        ways.append((*verb, f"{name}=1" if action.nargs == 0 else name))
    return Input(chance.choice(ways))


RECORDED = (("run/recording.mcap", "a.mcap"), ("run/result.json", "result.json"))
LIFTED = ("run", "lift", "--rig", "simulated", "--set", "controller.hold_s=0.2")
# what reads or writes at a place of one's own, which may have any name: NAME
PLACES: tuple[tuple[tuple[str, ...], tuple[tuple[str, str], ...]], ...] = (
    (("replay", "--", "NAME"), ()),
    (("replay", "--tactile=NAME", "--detector", "energy"), ()),
    (("replay", "--tactile", "IN/a.csv", "--config=NAME"), (("a.csv", "a.csv"),)),
    (("replay", "IN/run", "--detector=NAME.py:x"), RECORDED),
    (("runs", "--runs=NAME"), ()), (("runs", "--json", "--runs=NAME"), ()),
    (("report", "--", "NAME"), ()), (("report", "IN/run", "--out=NAME.html"), RECORDED),
    (("report", "--to=csv", "--", "NAME"), ()),
    (("report", "IN/run", "--to=csv", "--out=NAME"), RECORDED),
    (("report", "IN/run", "--out=NAME.svg"), RECORDED),
    (("runs", "--", "NAME"), ()),
    (("report", "IN/a.sqlite", "--to=csv", "--out=NAME"), (("a.sqlite", "a.sqlite"),)),
    (("campaign", "run", "--out", "OUT.sqlite", "--", "NAME.toml"), ()),
    (("campaign", "run", "IN/c.toml", "--jobs", "1", "--out=NAME"), (("c.toml", OWN_CAMPAIGN),)),
    (("config", "--", "NAME"), ()),
    (("config", "--set=gripper.calibration=NAME.toml"), ()),
    (("detector", "card", "--", "NAME.onnx"), ()),
    (("detector", "evaluate", "energy", "--recording=NAME"), ()),
    (("detector", "evaluate", "energy", "--recording", "IN/a.csv", "--out=NAME.json"),
     (("a.csv", "a.csv"),)),
    (("dataset", "build", "IN/d.toml", "--jobs", "1", "--out=NAME"),
     (("d.toml", "datasets/paper.toml"),)),
    (("dataset", "collect", "--out=OUT", "--", "NAME"), ()),
    ((*LIFTED, "--runs=NAME"), ()), ((*LIFTED, "--runs", "OUT", "--out=NAME", "--trials", "2"), ()),
)  # fmt: skip


def a_place(chance: random.Random, nth: int) -> Input:
    """Where nothing is, or what no place can be called."""
    words, beside = in_turn(PLACES, nth)
    within = [name for name in STRANGE if not name.startswith("/")]  # what is written stays here
    name = chance.choice((*within, *NOWHERE))
    sure = any(mark in name for mark in NO_TEXT)
    given = tuple(word.replace("NAME", name) for word in words)
    return Input(given, sure=sure, beside=beside)


def a_file_of_results(chance: random.Random, nth: int, kept: dict[str, bytes]) -> Input:
    """A recording, verdict, campaign, network, its heads, table or scores: not what it was."""
    every = [(which, *each) for which in sorted(READERS_OF_RESULTS)
             for each in READERS_OF_RESULTS[which]]  # fmt: skip
    which, words, name, beside = in_turn(every, nth)
    return Input(words, spoilt(kept[which], chance), name, sure=False, beside=beside)


NETWORK = (("a.onnx", "a.onnx"), ("a.csv", "a.csv"))
SCORED = ("detector", "evaluate", "energy", "--recording", "FILE", "--out", "OUT.json")
# of each, by its name: the words, under which name, and what lies beside it
READERS_OF_RESULTS: dict[
    str, tuple[tuple[tuple[str, ...], str, tuple[tuple[str, str], ...]], ...]
] = {
    "a.mcap": tuple(
        (words, "run/recording.mcap", RECORDED[1:]) for words in (
            ("replay", "FILE"), ("replay", "IN/run", "--check"), ("report", "IN/run", "--out",
             "OUT.csv"), ("report", "FILE", "--out", "OUT.html"),
             ("report", "FILE", "--out", "OUT.svg"))
    ),
    "result.json": tuple(
        (words, "run/result.json", RECORDED[:1]) for words in (
            ("runs", "--runs", "IN", "--json"), ("report", "IN/run", "--out", "OUT.html"),
            ("replay", "IN/run"), ("report", "IN/run", "--out", "OUT.svg"),
            ("report", "IN/run", "--out", "OUT.csv"))
    ),
    "a.sqlite": tuple(
        (words, "a.sqlite", ()) for words in (
            ("runs", "FILE"), ("report", "FILE", "--out", "OUT.csv"),
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


# of every twenty numbers: which draws which
KINDS = (
    "setting", "file", "value", "result", "place", "setting", "acquisition", "file", "value",
    "setting", "result", "words", "setting", "file", "value", "place", "acquisition", "setting",
    "file", "result",
)  # fmt: skip


def drawn(number: int, kept: dict[str, bytes]) -> Input:
    """The same for a number, for ever; what there is of a kind in turn."""
    lap, slot = divmod(number, len(KINDS))
    kind = KINDS[slot]
    nth = lap * KINDS.count(kind) + KINDS[:slot].count(kind)
    chance = random.Random(number)
    if kind == "result":
        return a_file_of_results(chance, nth, kept)
    draw = {
        "setting": a_setting, "acquisition": of_acquisition, "file": a_file_of_settings,
        "value": a_value_of_a_verb, "words": words_of_a_verb, "place": a_place,
    }[kind]  # fmt: skip
    return draw(chance, nth)
