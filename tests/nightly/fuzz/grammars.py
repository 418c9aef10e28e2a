"""Input of hostile clients for each port, generated from a seed: valid grammar and damaged bytes.

A grammar generates the bytes of one connection. It never requests what the protocol allows but
what would disturb other clients: a freeze, dropped links, the load of another world.
"""

import random
import struct

import msgspec

from drivers.ur.emulator import rtde as ur_rtde
from drivers.ur.emulator.urscript_functions import BUILTINS

NUMBERS = (0, 1, -1, 6, 0.1, 5e-324, 1e-9, 1e200, 1e308, 2**31 - 1, 2**31, -(2**31))
OUTPUTS, INPUTS, CALLS = sorted(ur_rtde.OUTPUTS), sorted(ur_rtde.INPUTS), sorted(BUILTINS)
MAX_BYTES = 200_000  # of one connection


def number(r: random.Random) -> str:
    return str(r.choice((r.choice(NUMBERS), r.uniform(-2, 2), r.randint(-5, 300))))


def expression(r: random.Random, depth: int = 0) -> str:
    inner = lambda: expression(r, depth + 1)  # noqa: E731
    match r.randrange(8 if depth < 4 else 3):
        case 0 | 1:
            return number(r)
        case 2:
            return r.choice(("a", "b", "True", "False", '"text"', "nowhere"))
        case 3:
            return f"({inner()} {r.choice('+-*/%<>')} {inner()})"
        case 4:
            return f"{r.choice(('not ', '-'))}{inner()}"
        case 5:
            return f"{r.choice('p ')}[{', '.join(inner() for _ in range(r.choice((0, 3, 6, 6))))}]"
        case 6:
            return f"{inner()}[{inner()}]"
    return call(r, depth)


def call(r: random.Random, depth: int = 0) -> str:
    arguments = [expression(r, depth + 1) for _ in range(r.randrange(4))]
    if r.random() < 0.5:
        pose = ", ".join(f"{r.uniform(-0.6, 0.6):.3f}" for _ in range(6))
        arguments[:1] = [f"{r.choice('p ')}[{pose}]"]
    return f"{r.choice(CALLS)}({', '.join(arguments)})"


def statement(r: random.Random, depth: int = 0) -> str:
    inner = lambda: "\n".join(statement(r, depth + 1) for _ in range(r.randrange(5)))  # noqa: E731
    match r.randrange(9 if depth < 4 else 4):
        case 0 | 1:
            return call(r)
        case 2:
            return f"{r.choice(('', 'global '))}{r.choice('ab')} = {expression(r)}"
        case 3:
            return r.choice(("sync()", "break", "return", "sleep(0.01)", "enter_critical"))
        case 4 | 5:
            return f"while {r.choice(('True', expression(r)))}:\n{inner()}\nsync()\nend"
        case 6:
            return f"if {expression(r)}:\n{inner()}\nelse:\n{inner()}\nend"
        case 7:
            return f"def g():\n{inner()}\nend\ng()"
    return f"thread t():\n{inner()}\nend\nh = run t()"


def urscript(r: random.Random) -> bytes:
    kind = r.random()
    if kind < 0.1:  # long
        line = statement(r)
        return f"def f():\na=1\n{(line + chr(10)) * (MAX_BYTES // (len(line) + 1))}end\n".encode()
    if kind < 0.2:  # depth
        opening = r.choice(("(", "[", "-", "not ", "if 1:", "f("))
        return f"def f():\n{opening * r.randrange(20_000)}\nend\n".encode()
    body = "\n".join(statement(r) for _ in range(r.randrange(5)))
    return f"{r.choice(('def', 'def', 'sec'))} f():\na = 1\nb = [1, 2]\n{body}\nend\n".encode()


def rtde(r: random.Random) -> bytes:
    recipes: list[list[str]] = []
    start = struct.pack(">HBH", 5, ord("V"), 2)
    return start + b"".join(rtde_packet(r, recipes) for _ in range(r.choice((3, 30, 300))))


def rtde_packet(r: random.Random, recipes: list[list[str]]) -> bytes:
    kind = r.choice("VvOIIISPUUUUUU?\x00")
    body = b""
    if kind == "O":
        names = r.choices(OUTPUTS, k=r.choice((1, 5, 100, 1400)))
        rate = r.choice((125.0, 500.0, 1.0, float("nan"), *NUMBERS))
        body = struct.pack(">d", rate) + ",".join(names).encode()
    elif kind == "I":
        recipes.append(r.choices(INPUTS, k=r.choice((1, 2, 6, 40, 3000))))
        body = ",".join(recipes[-1]).encode()
    elif kind == "U" and recipes and r.random() < 0.8:
        i = r.randrange(len(recipes))
        codes = ">B" + "".join(ur_rtde.STRUCT_CODES[ur_rtde.INPUTS[name]] for name in recipes[i])
        body = bytes([(i + 1) % 256]) + r.randbytes(struct.calcsize(codes) - 1)
    elif r.random() < 0.5:
        body = r.randbytes(r.choice((0, 1, 9, 200, 5000)))
    size = 3 + len(body) if r.random() < 0.97 else r.choice((0, 2, 3, 100, 65535))
    return struct.pack(">HB", min(size, 65535), ord(kind)) + body


def modbus(r: random.Random) -> bytes:
    return b"".join(modbus_frame(r) for _ in range(r.choice((1, 20, 2000))))


def modbus_frame(r: random.Random) -> bytes:
    function = r.choice((4, 4, 4, 16, 16, 3, 6, 23, r.randrange(256)))
    if function == 16 and r.random() < 0.7:
        count = r.randrange(4)
        body = struct.pack(">HHB", r.randrange(10), count, 2 * count) + r.randbytes(2 * count)
    else:
        body = struct.pack(">HH", r.choice((0, 1, 7, 8, 65535)), r.choice((0, 1, 8, 9, 125, 126)))
    length = 2 + len(body) if r.random() < 0.98 else r.choice((0, 1, 254, 255, 65535))
    unit = r.choice((0, 1, 2, 9, 255))
    return struct.pack(">HHHBB", r.randrange(65536), 0, length, unit, function) + body


def usb(r: random.Random) -> bytes:
    return b"".join(usb_message(r) for _ in range(r.choice((1, 20, 500))))


def usb_message(r: random.Random) -> bytes:
    fields = [r.choice((0, 1, 2, 3, 6, 8, 9, 10, 11, 12, -1))]
    fields += [r.choice((0, 1, 0x81, 0xC0, 0x80, 0x5C, 0xBA, 64, 512, 2**40)) for _ in range(6)]
    fields = [*fields[: r.choice((1, 4, 7))], *([r.choice((1, 5))] if r.random() < 0.9 else [])]
    data = msgspec.msgpack.encode(fields) if r.random() < 0.95 else r.randbytes(30)
    length = len(data) if r.random() < 0.97 else r.choice((0, 1, 1 << 16, 1 << 31))
    return length.to_bytes(4) + data


COMMANDS = (
    "robotmode", "is in remote control", "programState", "play", "stop", "power on", "power off",
    "brake release", "quit", "unlock protective stop",
)  # fmt: skip


def dashboard(r: random.Random) -> bytes:
    words = (*COMMANDS, "", "x" * r.choice((5, 70_000)))
    return "\n".join(r.choice(words) for _ in range(r.choice((3, 900)))).encode() + b"\n"


def damaged(r: random.Random, data: bytes) -> bytes:
    """Data with some bytes changed, removed or repeated, or with the end cut off."""
    changed = bytearray(data)
    for _ in range(r.choice((1, 3, 30))):
        at = r.randrange(len(changed) + 1)
        match r.randrange(3):
            case 0:
                changed[at : at + 1] = r.randbytes(1)
            case 1:
                del changed[at : at + r.randrange(50)]
            case 2:
                changed[at:at] = changed[max(0, at - r.randrange(200)) : at]
    return bytes(changed[: r.randrange(len(changed) + 1)] if r.random() < 0.3 else changed)


GRAMMARS = {
    "urscript": urscript, "rtde": rtde, "modbus": modbus, "usb": usb, "dashboard": dashboard,
}  # fmt: skip


def pieces(name: str, r: random.Random) -> list[bytes]:
    """Bytes of a connection in a few pieces of any size; damaged in a third of the cases."""
    data = GRAMMARS[name](r)[:MAX_BYTES]
    data = damaged(r, data) if r.random() < 0.3 else data
    cuts = sorted(r.randrange(len(data) + 1) for _ in range(r.choice((0, 0, 1, 8))))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
