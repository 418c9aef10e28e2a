"""What the controller says by itself on ports 30001 and 30002: its version.

Layout: Universal Robots, "Client Interfaces", PolyScope 3.5 to 3.15 and 5.x. Its state, which a
real one sends ten times a second, is told on RTDE alone.
"""

import struct

from drivers.ur.emulator.settings import Profile

_MESSAGE, _VERSION = 20, 3


def version_message(profile: Profile, name: bytes = b"URControl") -> bytes:
    """The first thing that a client hears."""
    major, minor, bugfix, build = profile.version
    date = b"01-08-2022, 00:00:00"
    body = struct.pack(
        f">QbbB{len(name)}sBBii{len(date)}s",
        0, -2, _VERSION, len(name), name, major, minor, bugfix, build, date,
    )  # fmt: skip
    return struct.pack(">IB", 5 + len(body), _MESSAGE) + body
