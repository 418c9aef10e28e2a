"""What goes wrong on the way between the application and the cell, drawn by number."""

import random

import msgspec

WIRES = ("gripper", "tactile", "arm")


class Trouble(msgspec.Struct, frozen=True):
    """Of one wire, from ``after_s`` on for ``lasts_s``; both ways. Nothing set: it only passes."""

    wire: str
    after_s: float  # since the first connection
    lasts_s: float
    latency_s: float = 0.0  # of every piece
    jitter_s: float = 0.0  # on top, at random; order is kept
    slice_bytes: int = 0  # pieces are cut to at most so many; 0: as they come
    reset_share: float = 0.0  # of pieces: the connection is reset in place of passing one
    bytes_per_s: float = 0.0  # 0: no limit
    twice_share: float = 0.0  # of pieces: passed twice


class Plan(msgspec.Struct, frozen=True):
    """One run."""

    number: int
    troubles: tuple[Trouble, ...]

    def __str__(self) -> str:
        kinds = (
            "latency_s",
            "jitter_s",
            "slice_bytes",
            "reset_share",
            "bytes_per_s",
            "twice_share",
        )
        parts = (
            f"{t.wire} {t.after_s:g}+{t.lasts_s:g} s: "
            + ", ".join(f"{kind} {getattr(t, kind):g}" for kind in kinds if getattr(t, kind))
            for t in self.troubles
        )
        return f"{self.number}: {'; '.join(parts)}"


def drawn(number: int) -> Plan:
    """The same for a number, for ever."""
    chance = random.Random(number)
    wires = chance.sample(WIRES, chance.choice((1, 1, 1, 2, 3)))
    return Plan(number, tuple(_trouble(chance, wire) for wire in wires))


def _trouble(chance: random.Random, wire: str) -> Trouble:
    kinds = {
        "latency_s": chance.choice((0.002, 0.02, 0.08, 0.3, 1.0)),
        "jitter_s": chance.choice((0.005, 0.05, 0.3)),
        "slice_bytes": chance.choice((1, 3, 7, 50)),
        "reset_share": chance.choice((0.001, 0.01, 0.2)),
        "bytes_per_s": chance.choice((200.0, 2_000.0, 20_000.0)),
        "twice_share": chance.choice((0.001, 0.01, 0.2)),
    }
    chosen = chance.sample(sorted(kinds), chance.choice((1, 1, 2, 3)))
    after_s = chance.choice((0.0, 1.0, 3.0, 5.0, 7.0))
    lasts_s = chance.choice((0.1, 0.5, 2.0, 600.0))
    return Trouble(wire, after_s, lasts_s, **{kind: kinds[kind] for kind in chosen})
