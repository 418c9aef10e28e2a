"""What goes wrong between application and cell, drawn by number."""

import random

import msgspec

WIRES = {"gripper": "gripper", "tactile": "fingertips", "arm": "arm"}  # and the device's name
AMOUNTS: dict[str, tuple[float, ...]] = {
    "latency_s": (0.002, 0.02, 0.08, 0.3, 1.0),
    "jitter_s": (0.005, 0.05, 0.3),
    "slice_bytes": (1, 3, 7, 50),
    "reset_share": (0.001, 0.01, 0.2),
    "bytes_per_s": (200.0, 2_000.0, 20_000.0),
    "twice_share": (0.001, 0.01, 0.2),
}


class Trouble(msgspec.Struct, frozen=True, omit_defaults=True):
    """Of one wire, both ways, from ``after_s`` on for ``lasts_s``."""

    wire: str
    after_s: float  # since the first connection
    lasts_s: float
    latency_s: float = 0.0  # of every piece
    jitter_s: float = 0.0  # on top, at random; order is kept
    slice_bytes: int = 0  # largest piece; 0: as they come
    reset_share: float = 0.0  # of pieces: the connection is reset in place of passing one
    bytes_per_s: float = 0.0  # 0: no limit
    twice_share: float = 0.0  # of pieces: passed twice


class Plan(msgspec.Struct, frozen=True):
    """One run."""

    number: int
    troubles: tuple[Trouble, ...]

    def __str__(self) -> str:
        return f"{self.number}: {msgspec.json.encode(self.troubles).decode()}"


def drawn(number: int) -> Plan:
    """Always the same for a number."""
    chance = random.Random(number)
    wires = chance.sample(tuple(WIRES), chance.choice((1, 1, 1, 2, 3)))
    return Plan(number, tuple(_trouble(chance, wire) for wire in wires))


def _trouble(chance: random.Random, wire: str) -> Trouble:
    amounts = {kind: chance.choice(values) for kind, values in AMOUNTS.items()}
    chosen = chance.sample(sorted(amounts), chance.choice((1, 1, 2, 3)))
    after_s = chance.choice((0.0, 1.0, 3.0, 5.0, 7.0))
    lasts_s = chance.choice((0.1, 0.5, 2.0, 600.0))
    return Trouble(wire, after_s, lasts_s, **{kind: amounts[kind] for kind in chosen})  # type: ignore[arg-type]
