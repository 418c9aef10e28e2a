"""Networks at run time: compiled, or in ONNX Runtime, all fingertips in one call."""

from typing import Annotated, Any, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.auxiliary_outputs import AuxiliaryOutputs, read_outputs
from detector.interface import Motion
from detector.network_file import (
    LoadedNetwork,
    check_layout,
    compiled_network,
    is_weights,
    log_runtime,
    packaged_networks,
    read_network,
    weights_digest,
    weights_path,
)
from detector.psd import SampleWindow
from drivers.errors import UsageError
from drivers.interfaces import KIT_TAXELS

Float32s = NDArray[np.float32]
# comparison of a compiled network with ONNX Runtime: frames, their counts, and probability
COMPARED, COUNTS_RANGE, MOST_DIFFERENCE = 30, (-300, 100), 1e-5


class NetworkSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Weights of a network."""

    weights: Annotated[
        str, Meta(description="FILE.onnx or a packaged network; empty: the detector's own")
    ] = ""


class Engine(Protocol):
    """Computes ``probability`` from ``inputs``; then the next state and the previous counts are in
    ``inputs``."""

    name: str  # in results
    inputs: dict[str, Float32s]
    probability: Float32s

    def run(self) -> None: ...


class RuntimeNetwork:
    """A network in ONNX Runtime: one thread, all fingertips in one call, no allocation."""

    name = "onnxruntime"

    def __init__(self, loaded: LoadedNetwork, fingers: int) -> None:
        shapes = {name: (fingers, *shape) for name, shape in loaded.inputs.items()}
        self.inputs = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
        self.probability = np.zeros(fingers, np.float32)
        self._session, self._binding = loaded.session, loaded.session.io_binding()
        nexts = {name: np.zeros(shapes[name], np.float32) for name in loaded.states}
        self._kept = [(self.inputs[name], array) for name, array in nexts.items()]
        if "previous" in shapes:
            self._kept.append((self.inputs["previous"], self.inputs["counts"]))
        for name, array in self.inputs.items():
            self._binding.bind_input(name, *_buffer(array))
        outputs = {f"next_{name}": array for name, array in nexts.items()}
        for name, array in (outputs | {"probability": self.probability}).items():
            self._binding.bind_output(name, *_buffer(array))

    def run(self) -> None:
        self._session.run_with_iobinding(self._binding)
        for array, after in self._kept:
            array[:] = after


def _buffer(array: Float32s) -> tuple[Any, ...]:
    return "cpu", 0, np.float32, array.shape, array.ctypes.data


def engine_of(loaded: LoadedNetwork, fingers: int) -> Engine:
    """The compiled network, or ONNX Runtime if it cannot be compiled (`compiled_network`). A file
    that is not packaged is also compared with ONNX Runtime."""
    compiled: Engine | None = compiled_network(loaded, fingers)
    if compiled is None:
        return RuntimeNetwork(loaded, fingers)
    if loaded.packaged or _equal(compiled, runtime := RuntimeNetwork(loaded, fingers)):
        return compiled
    log_runtime(loaded.card.name, "compiled, it gives other outputs", warn=True)
    return runtime


def _equal(one: Engine, other: Engine) -> bool:
    """Whether two networks have the same outputs on random counts."""
    rng = np.random.default_rng(0)
    for _ in range(COMPARED):
        counts = rng.integers(*COUNTS_RANGE, one.inputs["counts"].shape)
        for each in (one, other):
            each.inputs["counts"][:] = counts
            each.run()
        if not (abs(one.probability - other.probability) <= MOST_DIFFERENCE).all():
            return False
    return True


class StreamingNetwork:
    """Causal network with explicit state.

    A reset clears the state; the first frame after it has no change. A repeated frame (a missed
    sample) is processed like any other.
    """

    def __init__(
        self, loaded: LoadedNetwork, fingers: int, outputs: AuxiliaryOutputs | None = None
    ) -> None:
        self.card = card = loaded.card
        self.name, self.threshold = card.name, card.threshold
        self.memory = loaded.memory
        self._outputs = outputs
        self.engine = engine_of(loaded, fingers)
        inputs = self.engine.inputs
        self._counts = inputs["counts"]
        self._previous = inputs.get("previous", self._counts)
        self._states = {name: inputs[name] for name in loaded.states}
        self.reset()

    def reset(self) -> None:
        self._started = False
        for state in self._states.values():
            state.fill(0.0)

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
        if counts.shape != self._counts.shape:
            raise ValueError(f"frame has shape {counts.shape}, not {self._counts.shape}")
        self._counts[:] = counts
        if not self._started:
            self._previous[:] = counts
            self._started = True
        self.engine.run()
        return self.engine.probability.astype(np.float64)

    def motion(self) -> Motion | None:
        """Estimated motion at the latest frame; None without a frame or auxiliary outputs."""
        if self._outputs is None or not self._started:
            return None
        return self._outputs.motion(self._states, self._counts)


class WindowedNetwork:
    """Network that processes a whole window for each frame.

    Until the window is full after a reset, the first frame is repeated.
    """

    def __init__(self, loaded: LoadedNetwork, fingers: int) -> None:
        self.card = card = loaded.card
        self.name, self.threshold, self.memory = card.name, card.threshold, loaded.memory
        self.engine = engine_of(loaded, fingers)
        self._window = SampleWindow(self.engine.inputs["counts"])
        self.reset = self._window.reset

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
        self._window.add(counts)
        self.engine.run()
        return self.engine.probability.astype(np.float64)


def run_network(
    loaded: LoadedNetwork, fingers: int, outputs: AuxiliaryOutputs | None = None
) -> StreamingNetwork | WindowedNetwork:
    """Detector of a loaded network file, reset."""
    if loaded.card.mode == "stream":
        return StreamingNetwork(loaded, fingers, outputs)
    return WindowedNetwork(loaded, fingers)


def load_network(
    name: str, settings: NetworkSettings, fingers: int, taxels: int = KIT_TAXELS
) -> StreamingNetwork | WindowedNetwork:
    """Detector from a weights file and the auxiliary outputs beside it; raises as ``find_network``
    and BadFile."""
    loaded, outputs = find_network(name, settings, taxels)
    return run_network(loaded, fingers, outputs)


def find_network(
    name: str, settings: NetworkSettings, taxels: int = KIT_TAXELS
) -> tuple[LoadedNetwork, AuxiliaryOutputs | None]:
    """The file and the auxiliary outputs of a network. Raises BadFile. Raises UsageError for
    another layout, for two files, and for weights of another network than the packaged one with
    that name: its rule would not fit."""
    if settings.weights and is_weights(name):
        both = f"{name} and network.weights={settings.weights}"
        raise UsageError(f"{both} are two files of weights", "name one")
    chosen = settings.weights or name
    path = weights_path(chosen)
    loaded = read_network(path)
    if name in packaged_networks() and loaded.card.parameters and loaded.card.name != name:
        raise UsageError(
            f"{chosen} holds a network {loaded.card.name!r}, not {name!r}",
            f"the rule of {name!r} is not tuned for it: `--detector {loaded.card.name}` with these "
            "weights, or `--detector FILE.onnx` and a rule of its own",
        )
    if is_weights(chosen):  # the names in the cards of two files may be equal
        card = msgspec.structs.replace(loaded.card, name=path.name)
        loaded = msgspec.structs.replace(loaded, card=card)
    check_layout(name, loaded.taxels, taxels)
    return loaded, read_outputs(path, weights_digest(path), loaded)
