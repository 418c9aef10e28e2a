"""Networks at run time: ONNX Runtime, one thread, all fingertips in one call, no allocation.

A streaming network has two sets of state arrays that alternate as input and output. They are bound
once by address, so an update copies 18 numbers in and 3 out.
"""

from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.auxiliary_outputs import AuxiliaryOutputs, Motion, read_outputs
from detector.network_file import (
    LoadedNetwork,
    check_layout,
    is_weights,
    packaged_networks,
    read_network,
    weights_digest,
    weights_path,
)
from detector.psd import SampleWindow
from drivers.errors import UsageError
from drivers.interfaces import KIT_TAXELS

Float32s = NDArray[np.float32]


class NetworkSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Weights of a network."""

    weights: Annotated[
        str, Meta(description="FILE.onnx or a packaged network; empty: the detector's own")
    ] = ""


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
        self.memory = card.window + 1 if card.window else 0
        self._outputs = outputs
        self._shape = (fingers, loaded.taxels)
        self._session = loaded.session
        self._takes_previous = loaded.previous
        # two frames and two sets of states: each call reads what the one before wrote
        self._frames = [np.zeros(self._shape, np.float32) for _ in range(2)]
        self._states = [
            {name: np.zeros((fingers, *shape), np.float32) for name, shape in loaded.states.items()}
            for _ in range(2)
        ]
        self._probability = np.zeros(fingers, np.float32)
        self._bindings = [self._bind(0), self._bind(1)]
        self.reset()

    def _bind(self, turn: int) -> Any:
        """Binding that reads the frame and states of this turn and writes those of the other."""
        binding = self._session.io_binding()
        _bind_input(binding, "counts", self._frames[turn])
        if self._takes_previous:
            _bind_input(binding, "previous", self._frames[1 - turn])
        for name, state in self._states[turn].items():
            _bind_input(binding, name, state)
        for name, state in self._states[1 - turn].items():
            _bind_output(binding, f"next_{name}", state)
        _bind_output(binding, "probability", self._probability)
        return binding

    def reset(self) -> None:
        self._turn = 0
        self._started = False
        for state in self._states[0].values():
            state.fill(0.0)

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
        if counts.shape != self._shape:
            raise ValueError(f"frame has shape {counts.shape}, not {self._shape}")
        turn = self._turn
        self._frames[turn][:] = counts
        if not self._started:
            self._frames[1 - turn][:] = counts
            self._started = True
        self._session.run_with_iobinding(self._bindings[turn])
        self._turn = 1 - turn
        return self._probability.astype(np.float64)

    def motion(self) -> Motion | None:
        """Estimated motion at the latest frame; None without a frame or auxiliary outputs."""
        if self._outputs is None or not self._started:
            return None
        return self._outputs.motion(self._states[self._turn], self._frames[1 - self._turn])


class WindowedNetwork:
    """Network that processes a whole window for each frame.

    Until the window is full after a reset, the first frame is repeated.
    """

    def __init__(self, loaded: LoadedNetwork, fingers: int) -> None:
        self.card = card = loaded.card
        self.name, self.threshold, self.memory = card.name, card.threshold, card.window
        self._session = loaded.session
        self._window = SampleWindow(fingers, card.window, loaded.taxels, np.float32)
        self._probability = np.zeros(fingers, np.float32)
        self._binding = self._session.io_binding()
        _bind_input(self._binding, "counts", self._window.samples)
        _bind_output(self._binding, "probability", self._probability)
        self.reset()

    def reset(self) -> None:
        self._window.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
        self._window.add(counts)
        self._session.run_with_iobinding(self._binding)
        return self._probability.astype(np.float64)


def _bind_input(binding: Any, name: str, array: Float32s) -> None:
    binding.bind_input(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)


def _bind_output(binding: Any, name: str, array: Float32s) -> None:
    binding.bind_output(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)


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
    """Detector from a weights file and the auxiliary outputs beside it. Raises BadFile. Raises
    UsageError for another layout, for two files, and for weights of another network than the
    packaged one with that name: its rule would not fit."""
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
    return run_network(loaded, fingers, read_outputs(path, weights_digest(path), loaded))
