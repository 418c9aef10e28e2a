"""Trained networks as files: ONNX, and in the file's metadata a card of what it is and where from.

Nothing in a file is ever unpickled or executed but the graph, by ONNX Runtime, once card and shapes
have been checked.
"""

import hashlib
import os
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGERS

FORMAT = 2  # 1 had no checksum
READ = (1, FORMAT)
NO_CHECKSUM = "0" * 64  # stands in the card while the checksum is made
CARD_KEY = "grasp"
SUFFIX = ".onnx"
LARGEST_BYTES = 4_000_000  # ours are a tenth of a megabyte
# Key under which a tensor names another file that holds its values (TensorProto.external_data)
OTHER_FILE = b"\x0a\x08location"
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
Shape = tuple[int, ...]


class NetworkCard(msgspec.Struct, frozen=True, kw_only=True):
    """What a weights file says of itself."""

    format: int
    name: str
    mode: Mode  # a frame and a state at a time, or a whole window
    # samples that a `window` graph takes; for `stream` how many before the newest play a part,
    # 0: unbounded
    window: int
    threshold: float = 0.5  # probability above which a sample is slip
    parameters: int = 0  # 0: a file without a card, which is called as it lies there
    mean_counts: tuple[float, ...]  # of each taxel
    std_counts: tuple[float, ...] = ()
    change_scale_counts: float = 1.0
    temperature: float = 1.0  # already applied in the graph, as is the shift to the true share of
    shift: float = 0.0  # slip
    data_digest: str = ""
    label: str = ""
    augmentation: str = ""
    balance: str = ""
    seed: int = 0
    commit: str = ""
    steps: int = 0
    training_minutes: float = 0.0
    validation: dict[str, float] = {}
    sha256: str = ""  # of the file, with NO_CHECKSUM in its place


class LoadedNetwork(msgspec.Struct, frozen=True):
    """A checked file: its card, an ONNX Runtime session, and whether it takes the frame before."""

    card: NetworkCard
    session: Any
    states: dict[str, Shape]  # of a finger
    previous: bool

    @property
    def taxels(self) -> int:
        """Of the fingertips that it was trained on."""
        return len(self.card.mean_counts)


def check_layout(name: str, made_for: int, taxels: int) -> None:
    """Raises UsageError when a detector for fingertips of so many taxels meets others."""
    if made_for != taxels:
        raise UsageError(
            f"detector {name!r} was made for fingertips of {made_for} taxels, not of {taxels}",
            "train one on recordings of this layout (`grasp detector train`), or take `energy`",
        )


def is_weights(word: str) -> bool:
    """Whether a word is the path of a weights file rather than a name."""
    return word.endswith(SUFFIX)


def weights_path(weights: str) -> Path:
    """A packaged network's name, or the path of a file that ends in .onnx."""
    return Path(weights) if is_weights(weights) else WEIGHTS / f"{weights}{SUFFIX}"


def packaged_networks() -> tuple[str, ...]:
    """Names of the networks that come with the project."""
    return tuple(PACKAGED)


def is_packaged(path: Path) -> bool:
    """Whether a file is that of a network that comes with the project."""
    return path.parent == WEIGHTS and path.stem in PACKAGED


def weights_digest(path: Path) -> str:
    """SHA-256 of the file, whatever it is called; of what cannot be read, its path instead."""
    try:
        return hashlib.sha256(_content(path)).hexdigest()
    except BadFile:
        return str(path)  # the error is reported where the network is loaded


def read_network(path: Path) -> LoadedNetwork:
    """Load, check and try a weights file (docs/extending.md); raises BadFile for anything else."""
    content = _content(path)
    if is_packaged(path) and hashlib.sha256(content).hexdigest() != PACKAGED[path.stem]:
        raise BadFile(path, "damaged: it is not as it was packaged", REINSTALL)
    if OTHER_FILE in content:
        raise _bad(path, "takes data from other files, which is not allowed")
    try:
        loaded = _loaded(path, _session(content))
        told = loaded.card.sha256
        has_sum = told or loaded.card.format >= FORMAT
        if has_sum and (not told or _checksum(content, told) != told):
            raise _bad(path, "damaged: it is not what its checksum says")
        for fingers in (1, FINGERS):
            _try(path, loaded, fingers)
    except BadFile:
        raise
    except Exception as error:  # onnxruntime raises classes of its own for every kind of damage
        problem = f"damaged, or no ONNX graph that can run ({type(error).__name__})"
        raise _bad(path, problem) from None
    return loaded


def sealed(model: Any, card: NetworkCard) -> bytes:
    """The file of an `onnx.ModelProto` with that card, and its checksum."""
    del model.metadata_props[:]
    open_card = msgspec.structs.replace(card, sha256=NO_CHECKSUM)
    model.metadata_props.add(key=CARD_KEY, value=msgspec.json.encode(open_card).decode())
    content: bytes = model.SerializeToString()
    return content.replace(NO_CHECKSUM.encode(), _checksum(content, NO_CHECKSUM).encode())


def _checksum(content: bytes, written: str) -> str:
    """Of a file in which ``written`` stands for it."""
    return hashlib.sha256(content.replace(written.encode(), NO_CHECKSUM.encode())).hexdigest()


def _content(path: Path) -> bytes:
    """No more of the file than a network may have."""
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise _bad(path, f"cannot be read: {error.strerror}") from None
    if len(content) > LARGEST_BYTES:
        raise _bad(path, f"more than {LARGEST_BYTES} bytes: no network of this project")
    return content


def _session(content: bytes) -> Any:
    # versions from 1.29 on report each session to their maker, over the Internet
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
    inputs: dict[str, Shape] = {}
    for each in session.get_inputs():
        fingers, *shape = each.shape or [1]
        fixed = all(isinstance(n, int) and n > 0 for n in shape)
        if each.type != "tensor(float)" or isinstance(fingers, int) or not fixed:
            wanted = "float (fingers, ...) with all axes but the first fixed"
            raise _bad(path, f"input {each.name!r} is {each.type} {each.shape}, not {wanted}")
        inputs[each.name] = tuple(shape)
    card = _card(path, session, inputs.get("counts", ()))
    frame: Shape = (len(card.mean_counts),)
    known = {"counts": frame if card.mode == "stream" else (card.window, *frame)}
    states = {}
    if card.mode == "stream":
        states = {name: shape for name, shape in inputs.items() if name.startswith("state")}
        known |= states | ({"previous": frame} if "previous" in inputs else {})
    if inputs != known:
        raise _bad(path, f"inputs are {inputs}, not {known} as its card says")
    return LoadedNetwork(card, session, states, "previous" in inputs)


def _try(path: Path, loaded: LoadedNetwork, fingers: int) -> None:
    """A graph that cannot run, or gives no probability, is found here and not in a lift."""
    fed = {
        each.name: np.zeros((fingers, *each.shape[1:]), np.float32)
        for each in loaded.session.get_inputs()
    }
    names = ["probability", *(f"next_{name}" for name in loaded.states)]
    p, *states = loaded.session.run(names, fed)
    if p.shape != (fingers,) or p.dtype != np.float32 or not ((p >= 0.0) & (p <= 1.0)).all():
        raise _bad(path, f"gives {p}, not a probability a finger")
    for name, state in zip(loaded.states, states, strict=True):
        if state.shape != fed[name].shape or not np.isfinite(state).all():
            raise _bad(path, f"{name} does not come out as it went in")


def _card(path: Path, session: Any, counts: Shape) -> NetworkCard:
    """The card in the file; where it has none, what the shape of ``counts`` says: (taxels,) is a
    frame at a time, (samples, taxels) a window."""
    text = session.get_modelmeta().custom_metadata_map.get(CARD_KEY)
    if text is None:
        if len(counts) not in (1, 2):
            raise _bad(path, "no card, and no input `counts` of a frame or a window")
        return NetworkCard(
            format=READ[0], name=path.stem, mode="stream" if len(counts) == 1 else "window",
            window=counts[0] if len(counts) == 2 else 0, mean_counts=(0.0,) * counts[-1],
        )  # fmt: skip
    try:
        card = msgspec.json.decode(text, type=NetworkCard)
    except msgspec.DecodeError as error:
        raise _bad(path, f"its card cannot be read: {error}") from None
    if card.format not in READ:
        raise _bad(path, f"format {card.format}, this version reads {READ[0]} to {FORMAT}")
    return card


def _bad(path: Path, problem: str) -> BadFile:
    if is_packaged(path):
        return BadFile(path, f"{problem}; it is part of `grasp`", REINSTALL)
    return BadFile(
        path, problem,
        "give one that `grasp detector train` wrote, or whose tensors are as in docs/extending.md",
    )  # fmt: skip
