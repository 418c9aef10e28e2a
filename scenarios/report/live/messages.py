"""What the process that runs tells the one that serves the page: one JSON line a message.

A line is shorter than a pipe takes at once. A row says all of its instant, so that any of them may
be lost: only a picture lacks something then.
"""

from typing import Any

import msgspec

from scenarios.report.drawn import Seen


class Serve(msgspec.Struct, frozen=True, tag=True):
    """The first message: listen on that descriptor, and hand this page to who knows the token."""

    descriptor: int
    address: str  # host and port
    token: str
    title: str
    fingers: tuple[str, ...]
    seen: Seen
    open: bool  # in a browser


class Begin(msgspec.Struct, frozen=True, tag=True):
    """A trial begins: what came before is over. ``data`` is for the scripts of the page,
    ``left_s`` how long all that is to come will last, None where nobody can tell."""

    number: int
    of: int
    left_s: float | None
    data: dict[str, Any]


class Row(msgspec.Struct, frozen=True, tag=True):
    """One instant: its phase, and the columns of ``Begin.data`` side by side; None: no number."""

    phase: str
    values: list[float | None]
    left_s: float | None = None  # of an acquisition


class Said(msgspec.Struct, frozen=True, tag=True):
    """A line between two trials, or when all is over."""

    text: str


Message = Serve | Begin | Row | Said
