"""How a plain lift of each scene goes: its stretches, how long each is, what it sends and when.

As `python scripts/faults.py schedule` finds it; a test holds the table to the lifts.
"""

import textwrap

import msgspec

from grasp.phases import Phase

WIDTH = 98  # columns of the table


class Stretch(msgspec.Struct, frozen=True):
    """A phase from when it begins until the next: ``visit``: how often the lift has come to it."""

    phase: Phase
    visit: int
    ticks: int
    commands: tuple[tuple[str, int], ...]  # and after which tick of the stretch they are sent

    def __str__(self) -> str:
        return " ".join((f"{self.phase} {self.ticks}", *(f"{c}+{t}" for c, t in self.commands)))


TABLE = """
can 0: approach 33 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen 30,
    lift 5 move+0, compensate 55 close+0 stop+0 close+10, lift 221 move+0, hold 100, lower 404
    move+0, land 74 move+0, release 47 open+0, retreat 112 move+0, done 1
box 1: approach 34 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen 30,
    lift 6 move+0, compensate 53 close+0 stop+0 close+11, lift 220 move+0, hold 100, lower 403
    move+0, land 65 move+0, touch 52 stop+0, probe 57 move+0, release 47 open+0, retreat 111
    move+0, done 1
ball 1: approach 10 open+0, rest 50, grasp 62 close+0, oppose 69 close+0, relax 30, listen 30,
    lift 6 move+0, compensate 54 close+0 stop+0 close+11, lift 220 move+0, hold 100, lower 404
    move+0, land 80 move+0, release 25 open+0, retreat 111 move+0, done 1
foam 0: approach 33 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen 30,
    lift 5 move+0, compensate 77 close+0 stop+0 close+17, lift 221 move+0, hold 100, lower 404
    move+0, land 75 move+0, release 54 open+0, retreat 111 move+0, done 1
cardboard 2: approach 31 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen
    30, lift 7 move+0, compensate 55 close+0 stop+0 close+11, lift 220 move+0, hold 100, lower 403
    move+0, land 84 move+0, release 45 open+0, retreat 111 move+0, done 1
football 0: approach 26 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen
    30, lift 10 move+0, compensate 71 close+0 stop+0 close+15, lift 219 move+0, hold 100, lower
    399 move+0, land 120 move+0, release 45 open+0, retreat 111 move+0, done 1
box 24: approach 34 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen 30,
    lift 12 move+0, compensate 56 close+0 stop+0 close+10, lift 218 move+0, hold 100, lower 398
    move+0, land 107 move+0, touch 52 stop+0, probe 57 move+0, land 28 move+0, release 47 open+0,
    retreat 111 move+0, done 1
box 6: approach 33 close+0, rest 50, grasp 62 close+0, oppose 115 close+0, relax 30, listen 30,
    lift 10 move+0, compensate 56 close+0 stop+0 close+10, lift 219 move+0, hold 100, lower 399
    move+0, land 84 move+0, touch 52 stop+0, probe 57 move+0, land 30 move+0, release 47 open+0,
    retreat 112 move+0, done 1
"""


def read(table: str) -> dict[tuple[str, int], tuple[Stretch, ...]]:
    """By object and seed."""
    found = {}
    for text in table.strip().replace("\n ", " ").splitlines():
        scene, _, rest = text.partition(": ")
        name, seed = scene.split()
        found[name, int(seed)] = _stretches(rest)
    return found


def line(scene: tuple[str, int], stretches: tuple[Stretch, ...]) -> str:
    """Of the table."""
    text = f"{scene[0]} {scene[1]}: {', '.join(map(str, stretches))}"
    return textwrap.fill(text, WIDTH, subsequent_indent="    ")


def _stretches(text: str) -> tuple[Stretch, ...]:
    found: list[Stretch] = []
    for part in text.split(","):
        phase, ticks, *sent = part.split()
        visit = 1 + sum(s.phase == phase for s in found)
        commands = tuple((c, int(t)) for c, _, t in (word.partition("+") for word in sent))
        found.append(Stretch(Phase(phase), visit, int(ticks), commands))
    return tuple(found)


SCHEDULE = read(TABLE)
