"""What an ONNX file holds besides its own bytes, read from its wire form before anyone runs it.

A tensor may name another file to take its values from. Only the few message types that can lead to
a tensor are followed; field numbers are those of onnx.proto (ONNX 1.17).
"""

from collections.abc import Iterator

EXTERNAL = 1  # TensorProto.data_location
_DATA_LOCATION, _EXTERNAL_DATA = 14, 13
_DEEPEST = 32
# of each message type, the fields that are messages on the way to a tensor
_LEADS_TO: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {},
}


def names_other_files(content: bytes) -> bool:
    """True if a tensor anywhere lies outside; raises ValueError for what is no message."""
    waiting = [("model", 0, memoryview(content))]
    while waiting:
        kind, depth, message = waiting.pop()
        if depth > _DEEPEST:
            raise ValueError("nested too deeply")
        for number, value in _fields(message):
            if kind == "tensor" and (
                number == _EXTERNAL_DATA or (number == _DATA_LOCATION and value == EXTERNAL)
            ):
                return True
            if number in _LEADS_TO[kind] and isinstance(value, memoryview):
                waiting.append((_LEADS_TO[kind][number], depth + 1, value))
    return False


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Number and value of each field; of fixed-size numbers the bytes."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, form = key >> 3, key & 7
        if form == 0:
            value, at = _varint(message, at)
            yield number, value
            continue
        size = {1: 8, 5: 4}.get(form)
        if form == 2:
            size, at = _varint(message, at)
        if size is None or at + size > len(message):
            raise ValueError("not the wire form of a message")
        yield number, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("ends in the middle of a number")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("a number without an end")
