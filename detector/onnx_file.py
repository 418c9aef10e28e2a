"""Reader of ONNX files that needs no library: inputs, metadata, nodes and constants of a graph.

An ONNX file is a message of Protocol Buffers. The numbers below are those of the fields in
`onnx.proto` of the ONNX project. A reader may raise any exception for a damaged file.
"""

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

VARINT, EIGHT_BYTES, BYTES, FOUR_BYTES = 0, 1, 2, 5  # kinds of fields
FLOAT = 1  # type of a tensor
TYPES = {FLOAT: "<f4", 7: "<i8"}  # of numpy
CONSTANT = "Constant"  # operator

GraphShape = tuple[int | str, ...]  # a name: any length


class GraphInput(NamedTuple):
    """A tensor that the caller provides."""

    is_float: bool  # float32
    shape: GraphShape


class Node(NamedTuple):
    """An operator and the names of its tensors."""

    operator: str
    inputs: list[str]
    outputs: list[str]
    attributes: dict[str, Any]


class Graph(NamedTuple):
    """Nodes in the order in which they are computed, and constants by name."""

    nodes: list[Node]
    constants: dict[str, NDArray[Any]]


def read_inputs(content: bytes) -> dict[str, GraphInput]:
    """Inputs of a file's graph, by name."""
    graph = _graph(content)
    constants = {_text(_fields(tensor)[8][0]) for tensor in graph.get(5, [])}
    inputs = dict(map(_input, graph.get(11, [])))
    return {name: each for name, each in inputs.items() if name not in constants}


def read_metadata(content: bytes) -> dict[str, str]:
    """Metadata of a file."""
    pairs = map(_fields, _fields(content).get(14, []))
    empty = [b""]  # some writers leave it out
    return {_text(pair.get(1, empty)[0]): _text(pair.get(2, empty)[0]) for pair in pairs}


def read_graph(content: bytes) -> Graph:
    """The graph of a file; constants also where nodes hold them."""
    graph = _graph(content)
    nodes, constants = [_node(each) for each in graph[1]], dict(map(_tensor, graph.get(5, [])))
    constants |= {n.outputs[0]: n.attributes["value"] for n in nodes if n.operator == CONSTANT}
    return Graph([node for node in nodes if node.operator != CONSTANT], constants)


def _graph(content: bytes) -> dict[int, list[Any]]:
    return _fields(_fields(content)[7][0])


def _input(message: bytes) -> tuple[str, GraphInput]:
    fields = _fields(message)
    tensor = _fields(_fields(fields[2][0])[1][0])
    lengths = map(_fields, _fields(tensor[2][0]).get(1, []))
    shape = tuple(each[1][0] if 1 in each else "any" for each in lengths)
    return _text(fields[1][0]), GraphInput(tensor[1][0] == FLOAT, shape)


def _node(message: bytes) -> Node:
    fields = _fields(message)
    inputs, outputs = (list(map(_text, fields.get(number, []))) for number in (1, 2))
    return Node(_text(fields[4][0]), inputs, outputs, dict(map(_attribute, fields.get(5, []))))


def _attribute(message: bytes) -> tuple[str, Any]:
    fields = _fields(message)
    value: Any
    if 5 in fields:
        value = _tensor(fields[5][0])[1]
    elif 8 in fields:
        value = [_signed(number) for number in fields[8]]
    else:
        value = _signed(fields[3][0]) if 3 in fields else struct.unpack("<f", fields[2][0])[0]
    return _text(fields[1][0]), value


def _tensor(message: bytes) -> tuple[str, NDArray[Any]]:
    fields = _fields(message)
    values = np.frombuffer(fields[9][0], TYPES[fields[2][0]])
    return _text(fields.get(8, [b""])[0]), values.reshape(fields.get(1, []))


def _text(value: bytes) -> str:
    return value.decode()


def _signed(number: int) -> int:
    return number - (1 << 64) if number >> 63 else number


def _fields(message: bytes) -> dict[int, list[Any]]:
    """Values of a message's fields, by number."""
    found: dict[int, list[Any]] = {}
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, kind = key >> 3, key & 7
        if kind == VARINT:
            value, at = _varint(message, at)
            found.setdefault(number, []).append(value)
            continue
        if kind == BYTES:
            length, at = _varint(message, at)
        else:
            length = {EIGHT_BYTES: 8, FOUR_BYTES: 4}[kind]
        found.setdefault(number, []).append(message[at : at + length])
        at += length
    return found


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number, seven bits in each byte, the lowest first; and the position after it."""
    number = shift = 0
    while message[at] >= 0x80:
        number |= (message[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
    return number | message[at] << shift, at + 1
