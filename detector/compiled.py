"""Compiled networks: the graph of an ONNX file as instructions, which one function executes.

All tensors lie in one array of float32, the memory. While a graph is translated, a tensor is the
array of its places in the memory. So slicing, transposing and concatenating tensors need no
instruction: they only select places. What is left are products with constant matrices, and
functions element by element. An instruction processes some rows of equal length; from row to row,
the place of each operand moves by its own step.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial, reduce
from math import asinh, prod, sqrt
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from detector.onnx_file import Graph, read_graph
from drivers.errors import describe_exception
from drivers.numba_cache import compiled

Float32s = NDArray[np.float32]
Places = NDArray[np.int64]

COPY, FILL, ADD, SUB, MUL, DIV, MAX, TANH, SIGMOID, SELU, SQRT, ASINH, PRODUCT = range(13)
ALIGNED = 16  # numbers: a cache line
MOST_NUMBERS = 500_000  # in the memory; with more, ONNX Runtime is two to ten times as fast
F, U = np.float32, np.uintp  # a literal would make numba compute with other types
SELU_SCALE, SELU_ALPHA = F(1.0507009873554805), F(1.6732632423543772)


@njit(inline="always")
def _tanh(x):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Rational approximation of Eigen, within 3e-7; ONNX Runtime uses the same."""
    x = min(max(x, F(-9.0)), F(9.0))
    s = x * x
    p = F(-2.76076847742355e-16) * s + F(2.00018790482477e-13)
    p = p * s + F(-8.60467152213735e-11)
    p = p * s + F(5.12229709037114e-08)
    p = p * s + F(1.48572235717979e-05)
    p = p * s + F(6.37261928875436e-04)
    p = p * s + F(4.89352455891786e-03)
    q = F(1.19825839466702e-06) * s + F(1.18534705686654e-04)
    q = q * s + F(2.26843463243900e-03)
    q = q * s + F(4.89352518554385e-03)
    return x * p / q


# Without numpy's error model, a check of every divisor would prevent vector instructions.
@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def execute(program, m):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201, PLR0912
    """Execute a program on the memory ``m``. A line of the program is an instruction: operator,
    number and length of its rows, inner length of a product; then the place of the result and of
    two operands, each with its step from row to row."""
    for i in range(program.shape[0]):
        op, rows, cols, inner = program[i, 0], program[i, 1], program[i, 2], program[i, 3]
        step = program[i, 9]
        for r in range(rows):
            # unsigned, because numba checks whether a signed place is negative
            o = program[i, 4] + r * program[i, 5]
            a = program[i, 6] + r * program[i, 7]
            b = program[i, 8] + r * step
            if op == PRODUCT:  # row `a` times the matrix at `b`, four rows of the matrix at a time
                b = program[i, 8]
                for _ in range(inner // U(4)):
                    x0, x1, x2, x3 = m[a], m[a + U(1)], m[a + U(2)], m[a + U(3)]
                    b1, b2, b3 = b + step, b + U(2) * step, b + U(3) * step
                    for j in range(cols):
                        low = x0 * m[b + j] + x1 * m[b1 + j]
                        m[o + j] += low + (x2 * m[b2 + j] + x3 * m[b3 + j])
                    a, b = a + U(4), b + U(4) * step
                for _ in range(inner % U(4)):
                    x0 = m[a]
                    for j in range(cols):
                        m[o + j] += x0 * m[b + j]
                    a, b = a + U(1), b + step
            elif op == COPY:
                for j in range(cols):
                    m[o + j] = m[a + j]
            elif op == FILL:
                for j in range(cols):
                    m[o + j] = m[a]
            elif op == ADD:
                for j in range(cols):
                    m[o + j] = m[a + j] + m[b + j]
            elif op == SUB:
                for j in range(cols):
                    m[o + j] = m[a + j] - m[b + j]
            elif op == MUL:
                for j in range(cols):
                    m[o + j] = m[a + j] * m[b + j]
            elif op == DIV:
                for j in range(cols):
                    m[o + j] = m[a + j] / m[b + j]
            elif op == MAX:
                for j in range(cols):
                    m[o + j] = max(m[a + j], m[b + j])
            elif op == TANH:
                for j in range(cols):
                    m[o + j] = _tanh(m[a + j])
            elif op == SIGMOID:
                for j in range(cols):
                    m[o + j] = F(0.5) + F(0.5) * _tanh(F(0.5) * m[a + j])
            elif op == SELU:
                for j in range(cols):
                    x = m[a + j]
                    t = _tanh(F(0.5) * min(x, F(0.0)))  # exp(x) - 1 = 2 t / (1 - t)
                    negative = SELU_ALPHA * (t + t) / (F(1.0) - t)
                    m[o + j] = SELU_SCALE * (max(x, F(0.0)) + negative)
            elif op == SQRT:
                for j in range(cols):
                    m[o + j] = sqrt(m[a + j])
            elif op == ASINH:
                for j in range(cols):
                    m[o + j] = asinh(m[a + j])


class UnsupportedGraph(RuntimeError):
    """A graph with another operator than the packaged networks, or so large that ONNX Runtime is
    faster."""


class CompiledNetwork:
    """A network for a number of fingers. ``run`` computes ``probability`` from ``inputs``, and
    makes the next state and the previous counts of it the inputs."""

    name = "compiled"

    def __init__(self, content: bytes, inputs: Mapping[str, tuple[int, ...]], fingers: int) -> None:
        """Raises UnsupportedGraph."""
        made = _translated(content, tuple(inputs.items()), fingers)
        self._program, self._memory = made.program, made.memory.copy()
        execute(self._program[:0], self._memory)  # compiles it, or raises
        self.inputs = {name: self._view(made.tensors[name]) for name in inputs}
        self.probability = self._view(made.tensors["probability"])

    def run(self) -> None:
        execute(self._program, self._memory)

    def _view(self, places: Places) -> Float32s:
        first = int(places.flat[0])
        return self._memory[first : first + places.size].reshape(places.shape)


@lru_cache(maxsize=8)
def _translated(
    content: bytes, inputs: tuple[tuple[str, tuple[int, ...]], ...], fingers: int
) -> "_Translation":
    shapes = {name: (fingers, *shape) for name, shape in inputs}
    try:
        return _Translation(read_graph(content), shapes)
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise UnsupportedGraph(describe_exception(error)) from error


class _Translation:
    """Translates a graph into a program."""

    def __init__(self, graph: Graph, shapes: dict[str, tuple[int, ...]]) -> None:
        self._size = 0
        self._lines: list[tuple[int, ...]] = []
        self._constants: dict[int, Float32s] = {}  # by the first place
        self.tensors: dict[str, Any] = {name: self._new(shape) for name, shape in shapes.items()}
        for name, values in graph.constants.items():
            floats = values.dtype == np.float32
            self.tensors[name] = self.constant(values) if floats else values
        for node in graph.nodes:
            operands = [self.tensors[name] for name in node.inputs if name]
            results = OPERATORS[node.operator](self, *operands, **node.attributes)
            several = results if isinstance(results, list) else [results]
            self.tensors.update(zip(node.outputs, several, strict=True))
            if any(np.size(each) > MOST_NUMBERS for each in several):
                raise ValueError("a large network")
        self.tensors["probability"] = self.elementwise(COPY, self.tensors["probability"])
        nexts = {"previous": "counts"} | {n: f"next_{n}" for n in shapes if n.startswith("state")}
        kept = {n: self.tensors[after] for n, after in nexts.items() if n in shapes}
        # a state may consist of shifted parts of itself: copied first
        copies = {name: self.elementwise(COPY, places) for name, places in kept.items()}
        for name, copied in copies.items():
            self._emit(COPY, self.tensors[name], copied)
        self.program = np.array(self._lines, np.int64).astype(np.uintp)
        self.memory = np.zeros(self._size, np.float32)
        for first, values in self._constants.items():
            self.memory[first : first + values.size] = values.ravel()

    def _new(self, shape: Sequence[int], by_channel: bool = False) -> Places:
        """Places of a new tensor (..., samples, channels). ``by_channel``: the samples of a channel
        are neighbours, not the channels of a sample."""
        if by_channel:
            return np.swapaxes(self._new((*shape[:-2], shape[-1], shape[-2])), -1, -2)
        first = -(-self._size // ALIGNED) * ALIGNED
        self._size = first + prod(shape)
        if self._size > MOST_NUMBERS:
            raise ValueError("a large network")
        return np.arange(first, self._size).reshape(shape)

    def constant(self, values: Any) -> Places:
        places = self._new(np.shape(values))
        self._constants[int(places.flat[0])] = np.asarray(values, np.float32)
        return places

    def _check(self, places: Places) -> None:
        """Raise ValueError for integers of the graph that are no places: the program reads memory
        without a check."""
        if places.min() < 0 or places.max() >= self._size:
            raise ValueError("an operation with integers")

    def _value(self, places: Places) -> Float32s:
        """Values of a constant. Raises KeyError for any other tensor."""
        return self._constants[int(places.flat[0])]

    def elementwise(self, op: int, *operands: Places) -> Places:
        """A function element by element; the result lies in the memory like the first operand."""
        shape = np.broadcast_shapes(*(each.shape for each in operands))
        broadcast = [np.broadcast_to(each, shape) for each in operands]
        order = _order(broadcast[0])
        out = self._new([shape[axis] for axis in order]).transpose(np.argsort(order))
        self._emit(op, out, *broadcast)
        return out

    def _emit(self, op: int, out: Places, *operands: Places) -> None:
        """Add the instructions of a function: along a row, all operands move by one place."""
        order = _order(out)
        repeated = [_step(each, order[-1]) == 0 for each in operands]
        if op == COPY and repeated[0]:
            op = FILL
        elif any(repeated):
            both = zip(operands, repeated, strict=True)
            operands = tuple(self.elementwise(COPY, x) if again else x for x, again in both)
        flat = np.stack([each.transpose(order).ravel() for each in (out, *operands)])
        self._check(flat)
        expected = [[1], [0 if op == FILL else 1]] + [[1]] * (len(flat) - 2)
        jumps = (np.diff(flat, axis=1) != expected).any(axis=0)
        first = np.concatenate([[0], np.flatnonzero(jumps) + 1])
        lengths = np.diff(np.append(first, flat.shape[1]))
        for row, rows, steps in _series(flat[:, first], lengths):
            self._line(op, rows, int(lengths[row]), 0, flat[:, first[row]], steps)

    def _line(self, op: int, rows: int, cols: int, inner: int, at: Any, steps: Any) -> None:
        pairs = [int(n) for pair in zip(at, steps, strict=True) for n in pair]
        self._lines.append((op, rows, cols, inner, *pairs, *[0] * (6 - len(pairs))))

    def _products(
        self, out: Places, base: Places, terms: Iterable[tuple[Places, Float32s]]
    ) -> Places:
        """``out`` (..., n, m): a base plus products of tensors (..., n, k) and matrices (k, m).
        Samples at place -1 are left out: they are 0."""
        self._emit(COPY, out, np.broadcast_to(base, out.shape))
        for tensor, weights in terms:
            blocks = [each.reshape(-1, *each.shape[-2:]) for each in (out, tensor)]
            for o, x in zip(*blocks, strict=True):
                inside = x[:, 0] >= 0
                if inside.any():
                    self._add_product(o[inside], x[inside], weights)
        return out

    def _add_product(self, out: Places, x: Places, weights: Float32s) -> None:
        """``out`` (n, m) += x (n, k) times weights (k, m)."""
        self._check(x)
        if len(out) > 1 and (np.diff(out, axis=0) == 1).all() and (np.diff(x, axis=0) == 1).all():
            # both by channel: rows of the transposed weights times the matrix of all samples
            w = int(self.constant(weights.T).flat[0])
            ((_, rows, (out_step,)),) = _series(out[:1], np.ones(out.shape[1]))
            ((_, _, (step,)),) = _series(x[:1], np.ones(x.shape[1]))
            at, steps = [out[0, 0], w, x[0, 0]], [out_step, len(weights), step]
            self._line(PRODUCT, rows, len(out), len(weights), at, steps)
            return
        if (np.diff(out, axis=1) != 1).any():
            raise ValueError("a product of tensors that lie in the memory in different ways")
        parts = np.flatnonzero((np.diff(x, axis=1) != 1).any(axis=0)) + 1
        for part in np.split(np.arange(x.shape[1]), parts):
            used = np.flatnonzero(weights[part].any(axis=0))  # many are 0 where blocks are joined
            if len(used):
                block = weights[part, used[0] : used[-1] + 1]
                k, m = block.shape
                w = int(self.constant(block).flat[0])
                starts = np.stack([out[:, used[0]], x[:, part[0]]])
                for row, rows, moves in _series(starts, np.full(len(x), m)):
                    self._line(PRODUCT, rows, m, k, [*starts[:, row], w], [*moves, m])

    def _by_channel(self, x: Places, channels: int) -> tuple[Places, bool]:
        """``x`` (..., samples, k) for a product of few channels, and whether it lies by channel:
        vector instructions need long rows."""
        if x.ndim > 2 and x.shape[-2] > channels and _step(x, -2) != 1:
            out = self._new(x.shape, by_channel=True)
            self._emit(COPY, out, x)
            return out, True
        return x, x.shape[-2] > 1 and _step(x, -2) == 1

    def product(self, x: Places, weights: Float32s, base: Places | None = None) -> Places:
        x, by_channel = self._by_channel(x, weights.shape[1])
        out = self._new((*x.shape[:-1], weights.shape[1]), by_channel)
        zero = self.constant(0.0) if base is None else base
        return self._products(out, zero, [(x, weights)])

    def gemm(
        self, x: Places, w: Places, base: Places | None = None,
        *, alpha: float = 1.0, beta: float = 1.0, transB: int = 0,
    ) -> Places:  # fmt: skip
        if alpha != 1.0 or beta != 1.0:
            raise ValueError("a product with factors")
        weights = self._value(w)
        return self.product(x, weights.T if transB else weights, base)

    def conv(self, x: Places, w: Places, bias: Places, *, pads: list[int],
             dilations: list[int] | None = None) -> Places:  # fmt: skip
        weights = self._value(w)  # (channels, k, taps...)
        taps, axes = weights.shape[2:], weights.ndim - 2
        spread = dilations or [1] * axes
        x, by_channel = self._by_channel(np.moveaxis(x, 1, -1), len(weights))
        around = [(0, 0), *zip(pads[:axes], pads[axes:], strict=True), (0, 0)]
        padded = np.pad(x, around, constant_values=-1)
        size = [padded.shape[1 + i] - (taps[i] - 1) * spread[i] for i in range(axes)]
        out = self._new((len(x), *size, len(weights)), by_channel)
        windows = (
            (padded[:, *(slice(tap[i] * spread[i], tap[i] * spread[i] + size[i])
                         for i in range(axes))], weights[:, :, *tap].T)
            for tap in np.ndindex(*taps)
        )  # fmt: skip
        return np.moveaxis(self._products(out, bias, windows), -1, 1)

    def layer_norm(
        self, x: Places, scale: Places, bias: Places, *, axis: int, epsilon: float
    ) -> Places:
        if axis != -1:
            raise ValueError(f"LayerNormalization over axis {axis}")
        mean = np.full((x.shape[-1], 1), 1.0 / x.shape[-1], np.float32)
        d = self.elementwise(SUB, x, self.product(x, mean))
        variance = self.product(self.elementwise(MUL, d, d), mean, self.constant(epsilon))
        normal = self.elementwise(DIV, d, self.elementwise(SQRT, variance))
        return self.elementwise(ADD, self.elementwise(MUL, normal, scale), bias)

    def gru(self, x: Places, w: Places, r: Places, biases: Places, hidden: Places, *,
            hidden_size: int, linear_before_reset: int) -> list[Places]:  # fmt: skip
        if linear_before_reset != 1 or len(x) != 1:
            raise ValueError("a GRU of another kind")
        of_input, of_state = (
            np.split(self.product(each[0], self._value(m)[0].T, self.constant(b)), 3, axis=1)
            for each, m, b in zip((x, hidden), (w, r), np.split(self._value(biases)[0], 2),
                                  strict=True)
        )  # fmt: skip
        sums = [self.elementwise(ADD, of_input[i], of_state[i]) for i in range(2)]
        update, reset = (self.elementwise(SIGMOID, each) for each in sums)
        gated = self.elementwise(MUL, reset, of_state[2])
        new = self.elementwise(TANH, self.elementwise(ADD, of_input[2], gated))
        change = self.elementwise(MUL, update, self.elementwise(SUB, hidden[0], new))
        out = self.elementwise(ADD, new, change)
        return [out[None, None], out[None]]

    def reduce_max(self, x: Places, *, axes: list[int], keepdims: int) -> Places:
        if len(axes) != 1 or keepdims:
            raise ValueError("a maximum of another shape")
        return reduce(partial(self.elementwise, MAX), np.moveaxis(x, axes[0], 0))

    def slice(
        self, x: Places, starts: Places, ends: Places, axes: Places, steps: Places | None = None
    ) -> Places:
        each = zip(starts, ends, axes, np.ones_like(axes) if steps is None else steps, strict=True)
        for start, end, axis, step in each:
            x = np.moveaxis(np.moveaxis(x, axis, 0)[start:end:step], 0, axis)
        return x


def _series(starts: NDArray[Any], lengths: NDArray[Any]) -> Iterator[tuple[int, int, NDArray[Any]]]:
    """Groups of rows of equal length that move by equal steps, from the ``starts`` (operands, rows)
    of all rows: the first row, the number of rows, and the steps."""
    moves = np.diff(starts, axis=1, append=starts[:, -1:])
    same_length = np.diff(lengths, append=-1) == 0
    first = 0
    while first < len(lengths):
        last, steps = first, moves[:, first] if same_length[first] else 0 * starts[:, first]
        while same_length[last] and (moves[:, last] == steps).all():
            last += 1
        yield first, last + 1 - first, steps
        first = last + 1


def _step(places: Places, axis: int) -> int:
    """Step in the memory along an axis; 0 along an axis of one."""
    line = np.moveaxis(places, axis, 0).reshape(places.shape[axis], -1)[:2, 0]
    return int(line[-1] - line[0])


def _order(places: Places) -> list[int]:
    """Axes of a tensor as it lies in the memory, the innermost last."""
    return sorted(range(places.ndim), key=lambda i: (places.shape[i] > 1, -_step(places, i)))


def _function(op: int) -> Any:
    return lambda t, *operands: t.elementwise(op, *operands)


OPERATORS: dict[str, Any] = {
    "Add": _function(ADD), "Sub": _function(SUB), "Mul": _function(MUL), "Div": _function(DIV),
    "Tanh": _function(TANH), "Sigmoid": _function(SIGMOID), "Selu": _function(SELU),
    "Sqrt": _function(SQRT), "Asinh": _function(ASINH),
    "Relu": lambda t, x: t.elementwise(MAX, x, t.constant(0.0)),
    "Abs": lambda t, x: t.elementwise(MAX, x, t.elementwise(MUL, x, t.constant(-1.0))),
    "Gemm": _Translation.gemm, "MatMul": _Translation.gemm, "Conv": _Translation.conv,
    "LayerNormalization": _Translation.layer_norm, "GRU": _Translation.gru,
    "ReduceMax": _Translation.reduce_max, "Slice": _Translation.slice,
    "Identity": lambda t, x: x,
    "Concat": lambda t, *x, axis: np.concatenate(x, axis),
    "Gather": lambda t, x, at, *, axis=0: np.take(x, at, axis),
    "Split": lambda t, x, sizes, *, axis=0: np.split(x, np.cumsum(sizes)[:-1], axis),
    "Reshape": lambda t, x, shape, *, allowzero=0: x.reshape(shape),
    "Transpose": lambda t, x, *, perm: x.transpose(perm),
    "Squeeze": lambda t, x, axes: np.squeeze(x, tuple(axes)),
    "Unsqueeze": lambda t, x, axes: np.expand_dims(x, tuple(axes)),
}  # fmt: skip
