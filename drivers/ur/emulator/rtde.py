"""RTDE as the controller serves it: one object per connection, bytes in, bytes out.

After setup a connection gets data packets only; nothing is ever sent before the answer to a
request, because clients read exactly one packet as that answer.
"""

import struct
from collections.abc import Mapping
from weakref import WeakValueDictionary

from drivers.ur.emulator.rtde_wire import (
    IN_USE,
    INPUT_TYPES,
    NOT_FOUND,
    PROTOCOL_VERSION,
    Cells,
    PacketType,
    Recipe,
    Splitter,
    Values,
    packet,
    split_names,
)
from drivers.ur.emulator.settings import Profile

_MAX_RECIPES = 255
_MAX_NAMES = 1000  # of one recipe; all outputs together are fewer
_MAX_HELD = 5000  # of all input recipes of one client
_SLOWEST_HZ = 1.0  # RTDE Guide: 1 to 125 or 500
_FREQUENCY = struct.Struct(">d")


class RtdeServer:
    """What all connections share: who may write which input, and what they have written."""

    def __init__(self, profile: Profile) -> None:
        self.profile = profile
        self.claims: dict[str, object] = {}
        self.ignored_packets = 0
        self._written: dict[str, Values] = {}
        self._recipes: WeakValueDictionary[tuple[str, ...], Recipe] = WeakValueDictionary()

    def write(self, values: dict[str, Values]) -> None:
        self._written.update(values)

    def outputs(self, names: list[str]) -> Recipe:
        """Those who ask for the same get the same recipe, which is packed once for all."""
        recipe = self._recipes.get(tuple(names))
        if recipe is None:
            recipe = self._recipes[tuple(names)] = Recipe(1, names, self.profile.output_types)
        return recipe

    def take_inputs(self) -> dict[str, Values]:
        """Inputs written since the last call: the controller reads them once per cycle."""
        written, self._written = self._written, {}
        return written

    def claim(self, names: list[str], owner: object) -> None:
        """Give these inputs to somebody; another one's request is answered IN_USE."""
        for name in names:
            self.claims.setdefault(name, owner)

    def release(self, owner: object) -> None:
        self.claims = {name: one for name, one in self.claims.items() if one is not owner}


class Told:
    """What is told of one cycle: each field and each recipe is packed once, whoever asks."""

    def __init__(self, values: Mapping[str, Values], profile: Profile) -> None:
        self._cells = Cells(values, profile.output_types)
        self._packets: dict[Recipe, bytes] = {}

    def packet(self, recipe: Recipe) -> bytes:
        if recipe not in self._packets:
            self._packets[recipe] = recipe.pack(self._cells)
        return self._packets[recipe]


class RtdeConnection:
    """One client."""

    def __init__(self, server: RtdeServer) -> None:
        self._server = server
        self._splitter = Splitter()
        self._inputs: dict[int, Recipe] = {}
        self._held = 0  # names of all these
        self._output: Recipe | None = None
        self._every = 1  # cycles per data packet
        self._started = False

    @property
    def broken(self) -> bool:
        return self._splitter.broken

    def close(self) -> None:
        self._server.release(self)

    def feed(self, data: bytes) -> bytes:
        """Answers to the requests in these bytes."""
        return b"".join(self._answer(kind, body) for kind, body in self._splitter.feed(data))

    def sample(self, cycle: int, told: "Told") -> bytes:
        """The data packet of this cycle, or nothing."""
        if not self._started or self._output is None or cycle % self._every:
            return b""
        return told.packet(self._output)

    def _answer(self, kind: int, body: bytes) -> bytes:
        match kind:
            case PacketType.PROTOCOL_VERSION:
                accepted = body == PROTOCOL_VERSION.to_bytes(2, "big")
                return packet(PacketType.PROTOCOL_VERSION, bytes([accepted]))
            case PacketType.CONTROLLER_VERSION:
                version = struct.pack(">4I", *self._server.profile.version)
                return packet(PacketType.CONTROLLER_VERSION, version)
            case PacketType.OUTPUTS:
                return packet(PacketType.OUTPUTS, self._set_up_outputs(body))
            case PacketType.INPUTS:
                return packet(PacketType.INPUTS, self._set_up_inputs(body))
            case PacketType.START:
                self._started = self._output is not None
                return packet(PacketType.START, bytes([self._started]))
            case PacketType.PAUSE:
                self._started = False
                return packet(PacketType.PAUSE, bytes([1]))
            case PacketType.DATA:
                self._take(body)
            case _:
                self._server.ignored_packets += 1
        return b""

    def _set_up_outputs(self, body: bytes) -> bytes:
        rate = self._server.profile.rate_hz
        wanted = _FREQUENCY.unpack_from(body)[0] if len(body) >= _FREQUENCY.size else 0.0
        names = split_names(body[_FREQUENCY.size :])
        known = self._server.profile.output_types
        types = [known.get(name, NOT_FOUND) for name in names[:_MAX_NAMES]]
        valid = _SLOWEST_HZ <= wanted <= rate and 0 < len(names) <= _MAX_NAMES
        valid = valid and NOT_FOUND not in types
        self._output = self._server.outputs(names) if valid else None
        self._every = round(rate / wanted) if valid else 1
        return bytes([valid]) + ",".join(types).encode()

    def _set_up_inputs(self, body: bytes) -> bytes:
        names = split_names(body)
        types = [self._input_type(name) for name in names[:_MAX_NAMES]]
        valid = 0 < len(names) <= _MAX_NAMES and self._held + len(names) <= _MAX_HELD
        valid = valid and NOT_FOUND not in types and IN_USE not in types
        number = len(self._inputs) + 1 if valid and len(self._inputs) < _MAX_RECIPES else 0
        if number:
            self._inputs[number] = Recipe(number, names, INPUT_TYPES)
            self._held += len(names)
            self._server.claim(names, self)
        return bytes([number]) + ",".join(types).encode()

    def _input_type(self, name: str) -> str:
        if name not in INPUT_TYPES:
            return NOT_FOUND
        free = self._server.claims.get(name, self) is self
        return INPUT_TYPES[name] if free else IN_USE

    def _take(self, body: bytes) -> None:
        recipe = self._inputs.get(body[0]) if body else None
        values = recipe.unpack(body) if recipe else None
        if values is None:
            self._server.ignored_packets += 1
        else:
            self._server.write(values)
