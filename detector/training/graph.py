"""Networks as ONNX graphs, built operator by operator from their weights.

No exporter stands between: what is in the file is what is written here. Temperature and prior shift
are part of the graph, its output is the calibrated probability.
"""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from detector.network_file import CARD_KEY, NO_CHECKSUM, Mode, NetworkCard, checksum
from detector.training.architecture import (
    NORM_EPS,
    SHIFT_MEAN,
    SHIFT_SCALE_COUNTS,
    WINDOW,
    Architecture,
    shift_taps,
)

OPSET, IR_VERSION = 17, 8
BATCH_NORM_EPS = 1e-5
Weights = dict[str, NDArray[np.float32]]
Shape = tuple[str | int, ...]
States = dict[str, tuple[int, ...]]


class _Graph:
    """Collects nodes; every method gives the name of what it computes."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self.nodes: list[onnx.NodeProto] = []
        self.constants: dict[str, onnx.TensorProto] = {}

    def const(self, array: object, dtype: type = np.float32) -> str:
        name = f"c{len(self.constants)}"
        self.constants[name] = numpy_helper.from_array(np.asarray(array, dtype), name)
        return name

    def op(self, kind: str, *inputs: str, out: str = "", **attributes: Any) -> str:
        name = out or f"n{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def slice(self, x: str, start: int, end: int, axis: int, out: str = "") -> str:
        ints = [self.const([v], np.int64) for v in (start, end, axis)]
        return self.op("Slice", x, *ints, out=out)

    def reshape(self, x: str, *shape: int, out: str = "") -> str:
        return self.op("Reshape", x, self.const(shape, np.int64), out=out)

    def dense(self, x: str, prefix: str) -> str:
        matrix = self.const(self.weights[f"{prefix}.weight"].T)
        return self.affine(x, matrix, self.const(self.weights[f"{prefix}.bias"]))

    def affine(self, x: str, matrix: str, bias: str) -> str:
        return self.op("Add", self.op("MatMul", x, matrix), bias)

    def norm(self, x: str, prefix: str) -> str:
        if f"{prefix}.weight" not in self.weights:
            return x  # trained without
        scale, bias = (self.const(self.weights[f"{prefix}.{w}"]) for w in ("weight", "bias"))
        return self.op("LayerNormalization", x, scale, bias, axis=-1, epsilon=NORM_EPS)

    def batch_norm(self, x: str, prefix: str, axes_after: int) -> str:
        """Batch norm of trained statistics is a scale and a shift a channel."""
        w = {k: self.weights[f"{prefix}.{k}"] for k in ("weight", "bias")}
        scale = w["weight"] / np.sqrt(self.weights[f"{prefix}.running_var"] + BATCH_NORM_EPS)
        shift = w["bias"] - self.weights[f"{prefix}.running_mean"] * scale
        shape = (-1, *[1] * axes_after)
        scaled = self.op("Mul", x, self.const(scale.reshape(shape)))
        return self.op("Add", scaled, self.const(shift.reshape(shape)))


def make_model(arch: Architecture, mode: Mode, weights: Weights, card: NetworkCard) -> bytes:
    """The file: a graph for one frame (`stream`) or a window, and its card."""
    g = _Graph(weights)
    states: States = {}
    if mode == "stream":
        logit, states = {"tcn": _gated_step, "gru": _gru_step}[arch.family](g, arch)
        inputs: dict[str, Shape] = dict.fromkeys(("counts", "previous"), ("fingers", arch.taxels))
    else:
        tcn = _gated_window if arch.gated else _tcn_window
        window = {"tcn": tcn, "gru": _gru_window, "freq-cnn": _frequency_window}
        logit = window[arch.family](g, arch)
        samples = "samples" if arch.streaming else arch.window
        inputs = {"counts": ("fingers", samples, arch.taxels)}
    _probability(g, logit, card)
    ends_in: dict[str, Shape] = {**inputs, **{k: ("fingers", *s) for k, s in states.items()}}
    ends_out: dict[str, Shape] = {"probability": ("fingers",)}
    ends_out |= {f"next_{k}": ("fingers", *s) for k, s in states.items()}
    graph = helper.make_graph(
        g.nodes, card.name, _ends(ends_in), _ends(ends_out), list(g.constants.values())
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="grasp"
    )
    model.ir_version = IR_VERSION
    open_card = msgspec.structs.replace(card, sha256=NO_CHECKSUM)
    helper.set_model_props(model, {CARD_KEY: msgspec.json.encode(open_card).decode()})
    onnx.checker.check_model(model, full_check=True)
    content = bytes(model.SerializeToString())
    return content.replace(NO_CHECKSUM.encode(), checksum(content, NO_CHECKSUM).encode())


def _ends(shapes: Mapping[str, Shape]) -> list[onnx.ValueInfoProto]:
    return [helper.make_tensor_value_info(k, TensorProto.FLOAT, list(s)) for k, s in shapes.items()]


def _probability(g: _Graph, logit: str, card: NetworkCard) -> None:
    shifted = g.op("Add", logit, g.const(card.shift))
    cooled = g.op("Div", shifted, g.const(card.temperature))
    g.op("Sigmoid", g.reshape(cooled, -1), out="probability")


def _features(g: _Graph, arch: Architecture, previous: str, shifts: Callable[[str], str]) -> str:
    """Inputs (..., width) of the network; ``shifts`` makes shifts of changes."""
    changes = g.op("Sub", "counts", previous) if arch.inputs != ("counts",) else ""
    parts = []
    for name in arch.inputs:
        if name == "counts":
            centred = g.op("Sub", "counts", g.const(g.weights["features.mean"]))
            parts.append(g.op("Div", centred, g.const(g.weights["features.std"])))
        elif name == "changes":
            scaled = g.op("Div", changes, g.const(g.weights["features.change_scale"]))
            parts.append(g.op("Asinh", scaled))
        else:
            scale = g.const(SHIFT_MEAN * SHIFT_SCALE_COUNTS)
            parts.append(g.op("Asinh", g.op("Div", shifts(changes), scale)))
    return parts[0] if len(parts) == 1 else g.op("Concat", *parts, axis=-1)


def _window_features(g: _Graph, arch: Architecture) -> str:
    def shifts(changes: str) -> str:
        taps = np.array(shift_taps())
        kernel = g.const(np.tile(taps, (arch.taxels, 1, 1)))
        series = g.op("Transpose", changes, perm=[0, 2, 1])
        summed = g.op("Conv", series, kernel, group=arch.taxels, pads=[len(taps) - 1, 0])
        return g.op("Transpose", summed, perm=[0, 2, 1])

    first = g.slice("counts", 0, 1, 1)
    previous = g.op("Concat", first, g.slice("counts", 0, -1, 1), axis=1)
    return _features(g, arch, previous, shifts)


def _frame_features(g: _Graph, arch: Architecture, states: States) -> str:
    """Those of one frame (fingers, width); the changes that a shift is made of are a state."""

    def shifts(changes: str) -> str:
        taps = np.array(shift_taps())
        states["state1"] = ((len(taps) - 1) * arch.taxels,)
        seen = g.op("Concat", "state1", changes, axis=1)
        g.slice(seen, arch.taxels, 2**31, 1, out="next_state1")
        matrix = np.kron(taps[:, None], np.eye(arch.taxels))
        return g.op("MatMul", seen, g.const(matrix))

    return _features(g, arch, "previous", shifts)


def _head(g: _Graph, x: str, outputs: int) -> str:
    for i in (1, 2):
        x = g.op("Selu", g.norm(g.dense(x, f"head.dense{i}"), f"head.norm{i}"))
    return _log_odds(g, x, "head.out", outputs)


def _log_odds(g: _Graph, x: str, prefix: str, outputs: int) -> str:
    """Softmax of two is the logistic of their difference: the output layer takes it at once."""
    weight, bias = g.weights[f"{prefix}.weight"], g.weights[f"{prefix}.bias"]
    if outputs == 2:
        weight, bias = weight[1:] - weight[:1], bias[1:] - bias[:1]
    return g.affine(x, g.const(weight.T), g.const(bias))


def _layers(arch: Architecture) -> list[tuple[int, str, int]]:
    return [
        (i, half, dilation)
        for i, dilation in enumerate(arch.dilations)
        for half in ("first", "second")
    ]


def _gated_blocks(
    g: _Graph, arch: Architecture, x: str, convolve: Callable[[str, int], str]
) -> tuple[str, list[str]]:
    """What all blocks have found, summed, and what each was given; ``convolve`` gives value and
    gate of a block, along the last axis."""
    total, given = "", []
    sizes = g.const([arch.channels] * 2, np.int64)
    for i in range(len(arch.dilations)):
        given.append(g.op("Add", x, total) if total else x)
        value, gate = f"value{i}", f"gate{i}"
        both = convolve(given[-1], i)
        g.nodes.append(helper.make_node("Split", [both, sizes], [value, gate], axis=-1))
        found = g.op("Mul", g.op("Tanh", value), g.op("Sigmoid", gate))
        total = g.op("Add", total, found) if total else found
    return total, given


def _gated_step(g: _Graph, arch: Architecture) -> tuple[str, States]:
    """One frame. The state is what every block was given before, and what all found of late.

    All that the past contributes to all blocks is one product before the first of them; along the
    chain of blocks only the newest tap is left.
    """
    kernels = [_kernel(g, arch, i) for i in range(len(arch.dilations))]
    width = arch.channels * len(kernels)
    length = (arch.kernel - 1) * max(arch.dilations)
    past = _past(g, arch, kernels, length)
    states: States = {
        "state0": (length * width,), "state2": ((arch.held - 1) * arch.channels,),
    }  # fmt: skip
    x = g.dense(_frame_features(g, arch, states), "enter")

    def convolve(given: str, block: int) -> str:
        return g.op("Gemm", given, g.const(kernels[block][:, :, -1].T), past[block])

    total, given = _gated_blocks(g, arch, x, convolve)
    kept = g.slice("state0", width, 2**31, 1)
    g.op("Concat", kept, *given, axis=1, out="next_state0")
    late = g.op("Concat", "state2", total, axis=1)
    g.slice(late, arch.channels, 2**31, 1, out="next_state2")
    most = g.op("ReduceMax", g.reshape(late, -1, arch.held, arch.channels), axes=[1], keepdims=0)
    both = g.op("Concat", total, most, axis=1)
    return _log_odds(g, both, "out", arch.outputs), states


def _kernel(g: _Graph, arch: Architecture, block: int) -> NDArray[np.float32]:
    """(2 channels, channels, kernel) of a gated block, whose weights have the taps side by side."""
    flat = g.weights[f"blocks.{block}.conv.weight"]
    return flat.reshape(len(flat), arch.kernel, arch.channels).transpose(0, 2, 1)


def _past(
    g: _Graph, arch: Architecture, kernels: list[NDArray[np.float32]], length: int
) -> list[str]:
    """What the older taps and the biases add to each block (fingers, 2 channels)."""
    own, width = arch.channels, arch.channels * len(kernels)
    rows, blocks = [], []
    for i, (dilation, kernel) in enumerate(zip(arch.dilations, kernels, strict=True)):
        back = np.arange(arch.kernel - 1, 0, -1) * dilation  # samples ago, the oldest tap first
        rows.append(((length - back)[:, None] * width + i * own + np.arange(own)).ravel())
        blocks.append(kernel[:, :, :-1].transpose(2, 1, 0).reshape(-1, 2 * own))
    matrix = np.zeros((sum(map(len, blocks)), 2 * width), np.float32)
    at = 0
    for i, block in enumerate(blocks):
        matrix[at : at + len(block), 2 * own * i : 2 * own * (i + 1)] = block
        at += len(block)
    biases = [g.weights[f"blocks.{i}.conv.bias"] for i in range(len(blocks))]
    taps = g.op("Gather", "state0", g.const(np.concatenate(rows), np.int64), axis=1)
    every = g.op("Gemm", taps, g.const(matrix), g.const(np.concatenate(biases)))
    names = [f"past{i}" for i in range(len(blocks))]
    sizes = g.const([2 * own] * len(blocks), np.int64)
    g.nodes.append(helper.make_node("Split", [every, sizes], names, axis=1))
    return names


def _gated_window(g: _Graph, arch: Architecture) -> str:
    """A whole window; zeros before its beginning in every block, the last step is read."""

    def convolve(given: str, block: int) -> str:
        dilation = arch.dilations[block]
        y = g.op(
            "Conv", g.op("Transpose", given, perm=[0, 2, 1]), g.const(_kernel(g, arch, block)),
            g.const(g.weights[f"blocks.{block}.conv.bias"]),
            dilations=[dilation], pads=[(arch.kernel - 1) * dilation, 0],
        )  # fmt: skip
        return g.op("Transpose", y, perm=[0, 2, 1])

    x = g.dense(_window_features(g, arch), "enter")
    total, _ = _gated_blocks(g, arch, x, convolve)
    before = g.const([0, arch.held - 1, 0, 0, 0, 0], np.int64)
    late = g.slice(g.op("Pad", total, before), -arch.held, 2**31, 1)
    most = g.op("ReduceMax", late, axes=[1], keepdims=1)
    both = g.op("Concat", g.slice(total, -1, 2**31, 1), most, axis=2)
    return _log_odds(g, both, "out", arch.outputs)


def _skip(g: _Graph, x: str, block: int) -> str:
    """The way around a block, (..., channels): a matrix where the width changes."""
    kernel = g.weights.get(f"blocks.{block}.skip.weight")
    if kernel is None:
        return x
    bias = g.const(g.weights[f"blocks.{block}.skip.bias"])
    return g.affine(x, g.const(kernel[:, :, 0].T), bias)


def _tcn_window(g: _Graph, arch: Architecture) -> str:
    """A whole window; zeros before its beginning in every layer, the last step is read."""
    x = _window_features(g, arch)  # (fingers, samples, width)
    around = x
    for i, half, dilation in _layers(arch):
        prefix = f"blocks.{i}.{half}"
        if half == "first":
            around = _skip(g, x, i)
        y = g.op(
            "Conv", g.op("Transpose", x, perm=[0, 2, 1]),
            g.const(g.weights[f"{prefix}.conv.weight"]), g.const(g.weights[f"{prefix}.conv.bias"]),
            dilations=[dilation], pads=[(arch.kernel - 1) * dilation, 0],
        )  # fmt: skip
        x = g.op("Selu", g.norm(g.op("Transpose", y, perm=[0, 2, 1]), f"{prefix}.norm"))
        if half == "second":
            x = g.op("Selu", g.op("Add", around, x))
    return _head(g, g.slice(x, -1, 2**31, 1), arch.outputs)


def _gru_weights(g: _Graph) -> list[str]:
    """Torch orders the gates reset, update, new; ONNX update, reset, new."""

    def reorder(array: NDArray[np.float32]) -> NDArray[np.float32]:
        reset, update, new = np.split(array, 3)
        return np.concatenate([update, reset, new])

    w, r, wb, rb = (
        reorder(g.weights[f"gru.{k}_l0"]) for k in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
    )
    return [g.const(w[None]), g.const(r[None]), g.const(np.concatenate([wb, rb])[None])]


def _gru_step(g: _Graph, arch: Architecture) -> tuple[str, States]:
    states: States = {"state0": (arch.channels,)}
    x = _frame_features(g, arch, states)
    sequence = g.op("Unsqueeze", x, g.const([0], np.int64))  # (time, fingers, width)
    before = g.op("Unsqueeze", "state0", g.const([0], np.int64))
    g.nodes.append(helper.make_node(
        "GRU", [sequence, *_gru_weights(g), "", before], ["", "hidden"],
        hidden_size=arch.channels, linear_before_reset=1,
    ))  # fmt: skip
    hidden = g.op("Squeeze", "hidden", g.const([0], np.int64), out="next_state0")
    return _log_odds(g, hidden, "out", arch.outputs), states


def _gru_window(g: _Graph, arch: Architecture) -> str:
    sequence = g.op("Transpose", _window_features(g, arch), perm=[1, 0, 2])
    g.nodes.append(helper.make_node(
        "GRU", [sequence, *_gru_weights(g)], ["", "hidden"],
        hidden_size=arch.channels, linear_before_reset=1,
    ))  # fmt: skip
    return _log_odds(g, "hidden", "out", arch.outputs)


def _frequency_window(g: _Graph, arch: Architecture) -> str:
    """The spectrum is a product with cosines and sines: 100 samples, 51 frequencies."""
    series = g.reshape(_window_features(g, arch), -1, arch.taxels, WINDOW)
    angle = 2.0 * np.pi / WINDOW * np.outer(np.arange(WINDOW), np.arange(WINDOW // 2 + 1))
    parts = [g.op("MatMul", series, g.const(f(angle))) for f in (np.cos, np.sin)]
    power = g.op("Add", *(g.op("Mul", part, part) for part in parts))
    spectra = g.op("Transpose", g.op("Sqrt", power), perm=[0, 2, 1])  # (fingers, 51, 6)
    y = g.reshape(spectra, -1, WINDOW // 2 + 1, 2, 3)
    for i, pads in ((1, [1, 1, 1, 1]), (2, [0, 0, 0, 0])):
        weights = [g.const(g.weights[f"conv{i}.{w}"]) for w in ("weight", "bias")]
        y = g.batch_norm(g.op("Relu", g.op("Conv", y, *weights, pads=pads)), f"norm{i}", 2)
    y = g.reshape(y, -1, 40)
    for i, norm in ((1, "norm3"), (2, "norm4")):
        dense = g.dense(y, f"dense{i}")
        y = g.op("Relu", g.batch_norm(dense, norm, 0))
    return _log_odds(g, y, "out", arch.outputs)
