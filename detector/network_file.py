"""Trained networks as files: ONNX, and beside the graph a card of what it is and where it is from.

The card lies in the file's own metadata as JSON. Nothing in a file is ever unpickled or executed
but the graph, by ONNX Runtime, and only after the card and the shapes have been checked.
"""

import hashlib
import math
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from detector.onnx_wire import names_other_files
from drivers.errors import BadFile
from drivers.interfaces import FINGERS

FORMAT = 2  # 1 had no checksum
READ = (1, FORMAT)
NO_CHECKSUM = "0" * 64  # stands in the card while the checksum is made
CARD_KEY = "grasp"
SUFFIX = ".onnx"
LARGEST_BYTES = 4_000_000  # ours are a tenth of a megabyte
MOST_SAMPLES = 10_000  # of a window; ours have a hundred
MOST_STATE = 1_000_000  # numbers of a state a finger; ours have a thousand
WEIGHTS = Path(__file__).parent / "weights"

REINSTALL = "install `grasp` again"
# SHA-256 of the packaged ones: whole, and each itself
PACKAGED = {
    "freq-cnn-paper": "c0c83c42e9d3b557179b1d9f482c740ee06bed423bb7a2be832051993a6ce8c0",
    "gru": "28cca7646b5bcb489bf2acce6f80901c73ba41c50d5ae75471c457476cece696",
    "tcn": "f5a262c4ccc4d21705dd59a20ae650aa160697c3b3adb7bf927ac90c78c56818",
    "tcn-paper": "1c4e13c1a56d92b48732fb3da20fa7ef0ad0ac5569eae77a96904abc9a0a1d66",
}

Mode = Literal["stream", "window"]


class NetworkCard(msgspec.Struct, frozen=True, kw_only=True):
    """What a weights file says of itself."""

    format: int
    name: str
    mode: Mode  # a frame and a state at a time, or a whole window
    # samples that a `window` graph takes; for `stream` how many before the newest play a part,
    # 0: unbounded
    window: Annotated[int, Meta(ge=0, le=MOST_SAMPLES)]
    threshold: Annotated[float, Meta(gt=0.0, lt=1.0)]  # probability above which a sample is slip
    parameters: int
    mean_counts: tuple[float, ...]
    std_counts: tuple[float, ...]
    change_scale_counts: float
    temperature: float  # already applied in the graph, as is the shift to the true share of slip
    shift: float
    data_digest: str
    label: str
    augmentation: str
    balance: str
    seed: int
    commit: str
    steps: int
    training_minutes: float
    validation: dict[str, float]
    sha256: str = ""  # of the file, with NO_CHECKSUM in its place

    @property
    def has_own_name(self) -> bool:
        """Whether somebody wrote it: a file without a card is called as it lies there."""
        return self.parameters > 0


class LoadedNetwork(msgspec.Struct, frozen=True):
    """A checked file: its card, an ONNX Runtime session, the states' shapes a finger, and whether
    it takes the frame before, too."""

    card: NetworkCard
    session: Any
    states: dict[str, tuple[int, ...]]
    previous: bool = True

    @property
    def taxels(self) -> int:
        """Of the fingertips that it was trained on."""
        return len(self.card.mean_counts)


def is_weights(word: str) -> bool:
    """Whether a word is the path of a weights file rather than a name."""
    return word.endswith(SUFFIX)


def weights_path(weights: str) -> Path:
    """A packaged network's name, or the path of a file that ends in .onnx."""
    return Path(weights) if is_weights(weights) else WEIGHTS / f"{weights}{SUFFIX}"


def packaged_networks() -> tuple[str, ...]:
    """Names of the networks that come with the project, those too whose file has gone: it is told
    where one is loaded."""
    return tuple(sorted({*PACKAGED, *(path.stem for path in WEIGHTS.glob(f"*{SUFFIX}"))}))


def is_packaged(path: Path) -> bool:
    """Whether a file is that of a network that comes with the project."""
    return path.parent == WEIGHTS and path.stem in PACKAGED


def weights_digest(path: Path) -> str:
    """SHA-256 of the file, whatever it is called; of what cannot be read, its path instead."""
    try:
        return hashlib.sha256(_content(path)).hexdigest()
    except BadFile:
        return str(path)  # no network comes of it, and the error is told where one is loaded


def read_network(path: Path) -> LoadedNetwork:
    """Load, check and try a weights file, of ours or of the same form (docs/extending.md); raises
    BadFile for anything else."""
    content = _content(path)
    try:
        _check_packaged(path, content)
        if names_other_files(content):
            raise _bad(path, "takes data from other files, which is not allowed")
        loaded = _loaded(path, _session(content))
        _check_whole(path, content, loaded.card)
        _try(path, loaded)
    except BadFile:
        raise
    except ValueError:
        raise _bad(path, "no ONNX file, or a damaged one") from None
    except Exception as error:  # onnxruntime raises classes of its own for every kind of damage
        problem = f"damaged, or no ONNX graph that can run ({type(error).__name__})"
        raise _bad(path, problem) from None
    return loaded


def checksum(content: bytes, written: str) -> str:
    """Of a file in which ``written`` stands for it."""
    return hashlib.sha256(content.replace(written.encode(), NO_CHECKSUM.encode())).hexdigest()


def _check_whole(path: Path, content: bytes, card: NetworkCard) -> None:
    """A card of format 2 has a checksum; what has no card of ours, or an older one, has none."""
    if card.format < FORMAT and not card.sha256:
        return
    if not card.sha256 or checksum(content, card.sha256) != card.sha256:
        raise _bad(path, "damaged: it is not what its checksum says")


def _check_packaged(path: Path, content: bytes) -> None:
    if is_packaged(path) and hashlib.sha256(content).hexdigest() != PACKAGED[path.stem]:
        raise BadFile(path, "damaged: it is not as it was packaged", REINSTALL)


def _content(path: Path) -> bytes:
    """No more of the file than a network may have."""
    try:
        if path.is_fifo():
            raise ValueError("a named pipe, which may have no writer")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            content = b"" if size > LARGEST_BYTES else file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise _bad(path, f"cannot be read: {reason}") from None
    if max(size, len(content)) > LARGEST_BYTES:
        raise _bad(path, f"more than {LARGEST_BYTES} bytes: no network of this project")
    return content


def _session(content: bytes) -> Any:
    # else, from 1.29 on, it tells its maker of each session: a thread, a data base in the user's
    # cache, a file in the temporary folder, and packets to the Internet
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime as ort  # noqa: PLC0415 (`energy` runs without it, and starts sooner)

    ort.set_default_logger_severity(4)  # an exception says it already
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.add_session_config_entry("session.load_model_format", "ONNX")
    # without the fallback to other providers, which it announces on standard output
    return ort.InferenceSession(
        content, options, providers=["CPUExecutionProvider"], enable_fallback=0
    )


def _loaded(path: Path, session: Any) -> LoadedNetwork:
    inputs = {i.name: (i.type, tuple(i.shape)) for i in session.get_inputs()}
    outputs = {o.name: (o.type, tuple(o.shape)) for o in session.get_outputs()}
    card = _card(path, session) or _card_of_shapes(path, inputs)
    _check_ends(path, card, inputs, outputs)
    states = {name: shape[1:] for name, (_, shape) in inputs.items() if name.startswith("state")}
    _check_states(path, card, inputs, outputs, states)
    return LoadedNetwork(card, session, states, "previous" in inputs)


def _try(path: Path, loaded: LoadedNetwork) -> None:
    """A graph that cannot run, or gives no probability, is found here and not in a lift."""
    frame = (FINGERS, loaded.taxels)
    shapes: dict[str, tuple[int, ...]] = {"counts": frame}
    if loaded.previous:
        shapes["previous"] = frame
    if loaded.card.mode == "window":
        shapes = {"counts": (FINGERS, loaded.card.window, loaded.taxels)}
    shapes |= {name: (FINGERS, *shape) for name, shape in loaded.states.items()}
    fed = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    names = ["probability", *(f"next_{name}" for name in loaded.states)]
    p, *states = loaded.session.run(names, fed)
    if p.shape != (FINGERS,) or not ((p >= 0.0) & (p <= 1.0)).all():
        raise _bad(path, f"gives {p}, not a probability a finger")
    for name, state in zip(loaded.states, states, strict=True):
        if state.shape != fed[name].shape or not np.isfinite(state).all():
            raise _bad(path, f"{name} does not come out as it went in")


def _card(path: Path, session: Any) -> NetworkCard | None:
    text = session.get_modelmeta().custom_metadata_map.get(CARD_KEY)
    if text is None:
        return None
    try:
        card = msgspec.json.decode(text, type=NetworkCard)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise _bad(path, f"its card cannot be read: {error}") from None
    if card.format not in READ:
        raise _bad(path, f"format {card.format}, this version reads {READ[0]} to {FORMAT}")
    return card


Ends = dict[str, tuple[str, tuple[Any, ...]]]


def _card_of_shapes(path: Path, inputs: Ends) -> NetworkCard:
    """What the shapes of a file without a card say: (fingers, taxels) is a frame at a time,
    (fingers, samples, taxels) a window."""
    shape = inputs["counts"][1] if "counts" in inputs else ()
    if len(shape) not in (2, 3) or not all(isinstance(n, int) for n in shape[1:]):
        raise _bad(
            path, f"without a card, and no input `counts` of a frame or a window, but {inputs}"
        )
    window = min(shape[1], MOST_SAMPLES) if len(shape) == 3 else 0
    taxels = min(shape[-1], MOST_SAMPLES)
    return NetworkCard(
        format=READ[0], name=path.stem, mode="window" if window else "stream", window=window,
        threshold=0.5, parameters=0, mean_counts=(0.0,) * taxels, std_counts=(1.0,) * taxels,
        change_scale_counts=1.0, temperature=1.0, shift=0.0, data_digest="", label="",
        augmentation="", balance="", seed=0, commit="", steps=0, training_minutes=0.0,
        validation={},
    )  # fmt: skip


def _fits(found: tuple[str, tuple[Any, ...]] | None, wanted: tuple[str | int, ...]) -> bool:
    """Whether it is of that shape, floats; an axis that is named may have any name, but no number
    of its own."""
    if found is None or found[0] != "tensor(float)" or len(found[1]) != len(wanted):
        return False
    pairs = zip(found[1], wanted, strict=True)
    return all(n == m if isinstance(m, int) else not isinstance(n, int) for n, m in pairs)


def _check_ends(path: Path, card: NetworkCard, inputs: Ends, outputs: Ends) -> None:
    """The frame or window that goes in, and the probability that comes out."""
    taxels = len(card.mean_counts)
    frame: tuple[str | int, ...] = ("fingers", taxels)
    wanted = {"counts": frame}
    if "previous" in inputs:
        wanted["previous"] = frame
    if card.mode == "window":
        wanted = {"counts": ("fingers", card.window, taxels)}
        if card.window < 1:
            raise _bad(path, f"a window of {card.window} samples")
    for name, shape in wanted.items():
        found = inputs.get(name)
        variable = found is not None and found[1][1:2] == ("samples",)
        if not _fits(found, shape) and not (variable and card.mode == "window"):
            raise _bad(path, f"input {name!r} is {found}, not float {shape}")
    if not _fits(outputs.get("probability"), ("fingers",)):
        raise _bad(path, f"output is {outputs.get('probability')}, not float ('fingers',)")


def _check_states(
    path: Path, card: NetworkCard, inputs: Ends, outputs: Ends, states: dict[str, tuple[Any, ...]]
) -> None:
    """Every state goes in and comes out with one shape, and there is nothing else."""
    known = {"counts", *states}
    if set(inputs) - {"previous"} != known or (card.mode == "window" and set(inputs) != {"counts"}):
        raise _bad(path, f"inputs {sorted(inputs)} do not fit mode {card.mode!r}")
    for name, shape in states.items():
        if not _fits(outputs.get(f"next_{name}"), ("fingers", *shape)):
            raise _bad(path, f"{name} goes in as {inputs[name]}, out otherwise")
        if any(type(n) is not int or n < 1 for n in shape):
            raise _bad(path, f"{name} has no fixed shape: {shape}")
        if math.prod(shape) > MOST_STATE:
            raise _bad(path, f"{name} is too large: {shape}")


def _bad(path: Path, problem: str) -> BadFile:
    if is_packaged(path):
        return BadFile(path, f"{problem}; it is part of `grasp`", REINSTALL)
    remedy = (
        "give one that `grasp detector train` wrote, or whose tensors are as in docs/extending.md"
    )
    return BadFile(path, problem, remedy)
