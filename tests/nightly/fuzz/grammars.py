"""What a hostile client says on each port, made from a seed: half grammar, half rubble.

A grammar makes the pieces that one connection sends. Nothing here asks for what its owner may ask
for and others would suffer from by right: a freeze, dropped links, the load of another world.
"""

import json
import random
import struct

import msgspec

from drivers.ur.emulator.rtde_wire import E_SERIES_OUTPUT_TYPES, INPUT_TYPES, STRUCT_CODES
from drivers.ur.emulator.urscript.builtins import BUILTINS

NUMBERS = (0, 1, -1, 2, 6, 0.1, 1e-320, 5e-324, 1e-9, 1e9, 1e200, 1e308, 2**31 - 1, 2**31, -(2**31))
WORDS = ("a", "b", "x", "p", "input_int_register_0", "stop", "\\u0000", "é", "")
OUTPUTS, INPUTS, CALLS = sorted(E_SERIES_OUTPUT_TYPES), sorted(INPUT_TYPES), sorted(BUILTINS)
LATER = {"name": "gripper_delay", "seconds": 0.0}
MOST_BYTES = 200_000  # of one connection


def number(r: random.Random) -> str:
    return str(r.choice((r.choice(NUMBERS), r.uniform(-2, 2), r.randint(-5, 300))))


# URScript


def expression(r: random.Random, deep: int = 0) -> str:
    kind = r.randrange(9 if deep < 4 else 3)
    inner = lambda: expression(r, deep + 1)  # noqa: E731
    match kind:
        case 0 | 1:
            return number(r)
        case 2:
            return r.choice(("a", "b", "True", "False", '"text"', "nowhere"))
        case 3:
            return f"({inner()} {r.choice('+-*/%<>')} {inner()})"
        case 4:
            return f"{r.choice(('not ', '-'))}{inner()}"
        case 5:
            return f"[{', '.join(inner() for _ in range(r.choice((0, 3, 6, 6))))}]"
        case 6:
            return f"p[{', '.join(number(r) for _ in range(6))}]"
        case 7:
            return f"{inner()}[{inner()}]"
    return call(r, deep)


def call(r: random.Random, deep: int = 0) -> str:
    given = [expression(r, deep + 1) for _ in range(r.randrange(4))]
    if r.random() < 0.5:
        given[:1] = [
            f"{r.choice('p ')}[{', '.join(f'{r.uniform(-0.6, 0.6):.3f}' for _ in range(6))}]"
        ]
    return f"{r.choice(CALLS)}({', '.join(given)})"


def statement(r: random.Random, deep: int = 0) -> str:
    kind = r.randrange(10 if deep < 4 else 4)
    match kind:
        case 0 | 1:
            return call(r)
        case 2:
            return f"{r.choice(('', 'global ', 'local '))}{r.choice('ab')} = {expression(r)}"
        case 3:
            return r.choice(("sync()", "break", "return", "halt", "sleep(0.01)", "enter_critical"))
        case 4 | 5:
            return f"while {r.choice(('True', expression(r)))}:\n{block(r, deep)}\nend"
        case 6:
            return f"if {expression(r)}:\n{block(r, deep)}\nelse:\n{block(r, deep)}\nend"
        case 7:
            name = r.choice("fgh")
            return f"def {name}():\n{block(r, deep)}\nend\n{name}()"
        case 8:
            name = r.choice("tuv")
            return f"thread {name}():\n{block(r, deep)}\nend\nh = run {name}()"
    return f"while True:\n{block(r, deep)}\nsync()\nend"


def block(r: random.Random, deep: int) -> str:
    return "\n".join(statement(r, deep + 1) for _ in range(r.randrange(5)))


def urscript(r: random.Random) -> list[bytes]:
    kind = r.random()
    if kind < 0.1:  # long
        line = statement(r)
        text = f"def f():\na=1\nb=[1,2]\n{(line + chr(10)) * (MOST_BYTES // (len(line) + 1))}end\n"
    elif kind < 0.2:  # deep
        text = f"def f():\n{r.choice(('(', '[', '-', 'not ', 'if 1:', 'f('))}" * r.randrange(20_000)
    else:
        kind_of = r.choice(("def", "def", "def", "sec"))
        text = f"{kind_of} f():\na = 1\nb = [1, 2, 3]\n{block(r, -1)}\nend\n" * r.randrange(1, 3)
    return pieces(r, rubble(r, text.encode()[:MOST_BYTES]))


# RTDE


def rtde_packet(r: random.Random, recipes: list[tuple[int, list[str]]]) -> bytes:
    kind = r.choice("VvOIIISPUUUUUU?\x00")
    body = b""
    if kind == "V":
        body = struct.pack(">H", r.choice((1, 2, 2, 2, 65535)))
    elif kind == "O":
        names = r.choices(OUTPUTS, k=r.choice((1, 5, 100, 1000, 1400)))
        rate = r.choice((125.0, 500.0, 1.0, 10.0, float("nan"), *NUMBERS))
        body = struct.pack(">d", rate) + ",".join(names).encode()
    elif kind == "I":
        names = r.choices(INPUTS, k=r.choice((1, 2, 6, 40, 3000)))
        recipes.append((len(recipes) + 1, names))
        body = ",".join(names).encode()
    elif kind == "U" and recipes and r.random() < 0.8:
        number_, names = r.choice(recipes)
        codes = ">B" + "".join(STRUCT_CODES[INPUT_TYPES[name]] for name in names)
        body = bytes([number_]) + r.randbytes(struct.calcsize(codes) - 1)
    elif r.random() < 0.5:
        body = r.randbytes(r.choice((0, 1, 9, 200, 5000)))
    size = 3 + len(body) if r.random() < 0.97 else r.choice((0, 2, 3, 100, 65535))
    return struct.pack(">HB", min(size, 65535), ord(kind)) + body


def rtde(r: random.Random) -> list[bytes]:
    recipes: list[tuple[int, list[str]]] = []
    start = struct.pack(">HBH", 5, ord("V"), 2)
    sent = start + b"".join(rtde_packet(r, recipes) for _ in range(r.choice((3, 30, 300))))
    return pieces(r, rubble(r, sent[:MOST_BYTES], 0.15))


# Modbus


def modbus(r: random.Random) -> list[bytes]:
    return pieces(r, b"".join(frame(r) for _ in range(r.choice((1, 20, 2000))))[:MOST_BYTES])


def frame(r: random.Random) -> bytes:
    function = r.choice((4, 4, 4, 16, 16, 3, 6, 23, r.randrange(256)))
    if function == 16 and r.random() < 0.7:
        count = r.randrange(4)
        body = struct.pack(">HHB", r.randrange(10), count, 2 * count) + r.randbytes(2 * count)
    else:
        body = struct.pack(">HH", r.choice((0, 1, 7, 8, 65535)), r.choice((0, 1, 8, 9, 125, 126)))
    length = 2 + len(body) if r.random() < 0.98 else r.choice((0, 1, 254, 255, 65535))
    protocol = 0 if r.random() < 0.99 else 1
    unit = r.choice((0, 1, 2, 9, 255))
    return struct.pack(">HHHBB", r.randrange(65536), protocol, length, unit, function) + body


# The rest


def hop(r: random.Random) -> list[bytes]:
    return pieces(r, b"".join(hop_message(r) for _ in range(r.choice((1, 20, 500))))[:MOST_BYTES])


def hop_message(r: random.Random) -> bytes:
    fields = [r.choice((0, 1, 2, 3, 6, 8, 9, 10, 11, 12, -1))]
    fields += [r.choice((0, 1, 0x81, 0xC0, 0x80, 0x5C, 0xBA, 64, 512, 2**40)) for _ in range(6)]
    fields = [*fields[: r.choice((1, 4, 7))], *([r.choice((1, 5))] if r.random() < 0.9 else [])]
    data = msgspec.msgpack.encode(fields) if r.random() < 0.95 else r.randbytes(30)
    length = len(data) if r.random() < 0.97 else r.choice((0, 1, 1 << 16, 1 << 31))
    return length.to_bytes(4) + data


COMMANDS = (
    "robotmode", "PolyscopeVersion", "is in remote control", "get serial number", "programState",
    "load x.urp", "play", "pause", "stop", "power on", "power off", "brake release", "quit",
    "popup a", "unlock protective stop", "addToLog a", "restart safety", "close popup", "running",
)  # fmt: skip


def dashboard(r: random.Random) -> list[bytes]:
    lines = [
        r.choice((*COMMANDS, "", "x" * r.choice((5, 70_000)))) for _ in range(r.choice((3, 900)))
    ]
    return pieces(r, rubble(r, "\n".join(lines).encode()[:MOST_BYTES] + b"\n"))


def anything(r: random.Random, deep: int = 0) -> object:
    kind = r.randrange(8 if deep < 3 else 5)
    match kind:
        case 0:
            return r.choice(NUMBERS)
        case 1:
            return r.choice(WORDS)
        case 2:
            return r.choice((None, True, False))
        case 3 | 4:
            return r.uniform(-1, 1)
        case 5:
            return {r.choice(WORDS): anything(r, deep + 1) for _ in range(r.randrange(4))}
    return [anything(r, deep + 1) for _ in range(r.randrange(7))]


def control(r: random.Random) -> list[bytes]:
    keys = (
        "name", "seed", "at_s", "force_n", "grasp", "press", "direction", "momentum_ns", "finger",
        "taxel", "newtons", "seconds",
    )  # fmt: skip
    lines = []
    for _ in range(r.choice((1, 10, 300))):
        verb = r.choice(
            ("truth", "truth", "place", "home", "fault", "tap", "press", "nonsense", anything(r))
        )
        if verb == "fault" and r.random() < 0.5:  # any number of them that wait, and hurt nobody
            lines.append({"verb": verb, **LATER, "after_s": r.uniform(1.0, 600.0)})
            continue
        lines.append({"verb": verb, **{r.choice(keys): anything(r) for _ in range(r.randrange(3))}})
    return pieces(r, rubble(r, _lines(lines)))


def faults(r: random.Random) -> list[bytes]:
    lines = []
    for _ in range(r.choice((1, 10, 300))):
        do = r.choice(("state", "state", "wrench", "claim", "unclaim", "kill_program", "nonsense"))
        value = [r.choice(NUMBERS) for _ in range(r.choice((0, 6, 6, 600)))]
        given = {"value": value, "names": [r.choice((*WORDS, *INPUTS[:3])) for _ in range(3)]}
        lines.append({"do": do, **(given if r.random() < 0.8 else {r.choice(WORDS): anything(r)})})
    return pieces(r, rubble(r, _lines(lines)))


def _lines(items: list[dict[str, object]]) -> bytes:
    return b"".join(json.dumps(item).encode() + b"\n" for item in items)[:MOST_BYTES]


def silence(r: random.Random) -> list[bytes]:
    """Connections that say nothing, or next to nothing, for a while."""
    return [b"", *(r.randbytes(1) for _ in range(r.randrange(3)))]


def rubble(r: random.Random, data: bytes, share: float = 0.3) -> bytes:
    """Some of them damaged: bytes changed, cut out, doubled, or the end missing."""
    if not data or r.random() > share:
        return data
    changed = bytearray(data)
    for _ in range(r.choice((1, 3, 30))):
        at = r.randrange(len(changed) + 1)
        match r.randrange(4):
            case 0:
                changed[at : at + 1] = r.randbytes(1)
            case 1:
                del changed[at : at + r.randrange(50)]
            case 2:
                changed[at:at] = changed[max(0, at - r.randrange(200)) : at]
            case 3:
                changed[at:at] = r.randbytes(r.randrange(20))
    return bytes(changed[: r.randrange(len(changed) + 1)] if r.random() < 0.3 else changed)


def pieces(r: random.Random, data: bytes) -> list[bytes]:
    """As it is, or in a few pieces of any size."""
    cuts = sorted(r.randrange(len(data) + 1) for _ in range(r.choice((0, 0, 1, 8))))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


GRAMMARS = {
    "urscript": urscript, "rtde": rtde, "modbus": modbus, "hop": hop, "dashboard": dashboard,
    "control": control, "faults": faults, "silence": silence,
}  # fmt: skip
