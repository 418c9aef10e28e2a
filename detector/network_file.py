"""Network files: ONNX, with a card in the metadata that describes the network and its training.

Nothing is unpickled. Card and shapes are checked before a graph is executed.
"""

import hashlib
import logging
import math
import os
import re
import resource
import subprocess
import sys
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from detector.onnx_file import read_inputs, read_metadata
from drivers.errors import BadFile, UsageError, describe_exception, exception_text
from drivers.interfaces import FINGERS

FORMAT = 2  # 1: without checksum
READABLE_FORMATS = (1, FORMAT)
NO_CHECKSUM = "0" * 64  # placeholder in the card while the checksum is computed
CARD_KEY = "grasp"
WEIGHTS_SUFFIX = ".onnx"
MAX_FILE_BYTES = 4_000_000  # the packaged files have a tenth of a megabyte
# Key under which a tensor names an external file with its values (TensorProto.external_data)
EXTERNAL_DATA_KEY = b"\x0a\x08location"
LOOP_KEY = b"\x22\x04Loop"  # NodeProto.op_type
OPSET_TEXT = r"Opset (\d+) is under development.* till opset (\d+)"
MOST_RUN_S, MOST_RUN_BYTES = 20.0, 1_000_000_000  # of the first run of a foreign graph
WEIGHTS = Path(__file__).parent / "weights"

REMEDY = "give a file of `grasp detector train`, or one with the tensors of docs/extending.md"
REINSTALL = "install `grasp` again"
PACKAGED_SHA256 = {
    "freq-cnn-paper": "c0c83c42e9d3b557179b1d9f482c740ee06bed423bb7a2be832051993a6ce8c0",
    "gru": "38e0aecb17722ef3e1f66d1a7c297a8383826038a4159bb9e59aa78e3b8e0bdc",
    "tcn": "78ecb627121e6e9d477c59141c2cfd1fe1bc723857ed8f4fc03fa95947d9fff9",
    "tcn-paper": "1c4e13c1a56d92b48732fb3da20fa7ef0ad0ac5569eae77a96904abc9a0a1d66",
}

Mode = Literal["stream", "window"]
Shape = tuple[int, ...]


class NetworkCard(msgspec.Struct, frozen=True, kw_only=True):
    """Description in a weights file."""

    format: int
    name: str
    mode: Mode  # one frame and a state, or a whole window
    # `window`: samples of the input. `stream`: samples before the newest that affect the output,
    # 0: unbounded
    window: int
    threshold: float = 0.5  # probability above which a sample is slip
    parameters: int = 0  # 0: a file without a card; its name is that of the file
    mean_counts: tuple[float, ...]  # of each taxel
    std_counts: tuple[float, ...] = ()
    change_scale_counts: float = 1.0
    temperature: float = 1.0  # calibration, already applied in the graph
    shift: float = 0.0  # of the log-odds to the true share of slip, already applied
    data_digest: str = ""
    label: str = ""
    augmentation: str = ""
    balance: str = ""
    seed: int = 0
    commit: str = ""
    steps: int = 0
    training_minutes: float = 0.0
    validation: dict[str, float] = {}
    sha256: str = ""  # of the file with NO_CHECKSUM in this field


class LoadedNetwork(msgspec.Struct, frozen=True, dict=True):
    """A checked network file."""

    card: NetworkCard
    content: bytes
    inputs: dict[str, Shape]  # shapes of one finger, by name
    packaged: bool

    @property
    def states(self) -> dict[str, Shape]:
        """State shapes of one finger, by input name."""
        return {name: shape for name, shape in self.inputs.items() if name.startswith("state")}

    @cached_property
    def session(self) -> Any:
        """The file in ONNX Runtime."""
        return _session(self.content)

    @property
    def memory(self) -> int:
        """Samples that an output depends on; 0: all since the reset."""
        before_newest = self.card.window > 0 and self.card.mode == "stream"
        return self.card.window + 1 if before_newest else self.card.window

    @property
    def taxels(self) -> int:
        """Taxels of a fingertip that the network was trained for."""
        return len(self.card.mean_counts)


def check_layout(name: str, made_for: int, taxels: int) -> None:
    """Raise UsageError if a detector was made for another number of taxels per fingertip."""
    if made_for != taxels:
        raise UsageError(
            f"detector {name!r} was made for fingertips of {made_for} taxels, not of {taxels}",
            "train one on recordings of this layout (`grasp detector train`), or take `energy`",
        )


def is_weights(word: str) -> bool:
    """Whether a word is the path of a weights file, not a name."""
    return word.endswith(WEIGHTS_SUFFIX)


def weights_path(weights: str) -> Path:
    """Path of the weights: a packaged network's name, or a path that ends in .onnx."""
    return Path(weights) if is_weights(weights) else WEIGHTS / f"{weights}{WEIGHTS_SUFFIX}"


def packaged_networks() -> tuple[str, ...]:
    """Names of the packaged networks."""
    return tuple(PACKAGED_SHA256)


def is_packaged(path: Path) -> bool:
    """Whether a file is that of a packaged network."""
    return path.parent == WEIGHTS and path.stem in PACKAGED_SHA256


def weights_digest(path: Path) -> str:
    """SHA-256 of the file's content; the path if the file cannot be read."""
    try:
        return hashlib.sha256(_content(path)).hexdigest()
    except BadFile:
        return str(path)  # loading the network reports the error


def read_network(path: Path) -> LoadedNetwork:
    """Load a weights file and check it (docs/extending.md). A file that is not packaged is run once
    in ONNX Runtime. Raises BadFile."""
    content = _content(path)
    packaged = is_packaged(path)
    if packaged and hashlib.sha256(content).hexdigest() != PACKAGED_SHA256[path.stem]:
        raise BadFile(path, "damaged: it differs from the packaged file", REINSTALL)
    if EXTERNAL_DATA_KEY in content:
        raise BadFile(
            path, "takes weights from other files, which is not allowed",
            "store them in the file: onnx.save(onnx.load(FILE), NEW_FILE), or "
            "torch.onnx.export(..., external_data=False)",
        )  # fmt: skip
    if LOOP_KEY in content:
        raise _bad(path, "has a Loop, which may never end")
    loaded = _loaded(path, content, packaged)
    stored = loaded.card.sha256
    has_sum = stored or loaded.card.format >= FORMAT
    if has_sum and (not stored or _checksum(content, stored) != stored):
        raise _bad(path, "damaged: its checksum does not match")
    if packaged:
        return loaded
    if compiled_network(loaded, FINGERS) is not None:  # it cannot run for long
        _test_runs(path, loaded)
    elif problem := problem_in_a_child(content, path.name):
        raise BadFile(path, *problem)
    return loaded


def compiled_network(loaded: LoadedNetwork, fingers: int) -> Any:
    """The `CompiledNetwork` of a file. None, with a line in the log, without a folder for the
    compiler's cache, and for an `UnsupportedGraph`."""
    try:
        # the first import compiles it
        from detector.compiled import CompiledNetwork  # noqa: PLC0415

        return CompiledNetwork(loaded.content, loaded.inputs, fingers)
    except (ImportError, OSError, RuntimeError) as error:
        log_runtime(loaded.card.name, describe_exception(error), loaded.packaged)
        return None


@cache
def log_runtime(network: str, reason: str, warn: bool) -> None:
    """Log once why a network runs in ONNX Runtime, which needs more time."""
    level = logging.WARNING if warn else logging.INFO
    logging.getLogger(__name__).log(
        level, "network %s runs in ONNX Runtime, not compiled: %s", network, reason
    )


@lru_cache(maxsize=8)
def problem_in_a_child(content: bytes, name: str) -> tuple[str, str] | None:
    """Problem and remedy of a foreign graph, which runs in a process with limits of time and
    memory; None if it runs."""
    home = str(Path(__file__).parents[1])
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __name__, name], input=content, timeout=MOST_RUN_S,
            capture_output=True, check=False, env={**os.environ, "PYTHONPATH": home},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"a run takes more than {MOST_RUN_S:g} s", REMEDY
    if done.returncode:
        return f"a run ends the process with code {done.returncode}", REMEDY
    return msgspec.json.decode(done.stdout, type=tuple[str, str] | None)


def _try_network(name: str) -> None:
    """Test-run the network on standard input; print problem and remedy, or null, as JSON."""
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_RUN_BYTES, MOST_RUN_BYTES))
    most_s = math.ceil(MOST_RUN_S) + 1  # for a child whose parent was killed
    resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s))
    problem = None
    try:
        _test_runs(Path(name), _loaded(Path(name), sys.stdin.buffer.read(), packaged=False))
    except BadFile as error:
        problem = error.problem, error.remedy
    sys.stdout.buffer.write(msgspec.json.encode(problem))


def with_checksum(model: Any, card: NetworkCard) -> bytes:
    """Content of the file of an `onnx.ModelProto` with that card and a checksum."""
    del model.metadata_props[:]
    open_card = msgspec.structs.replace(card, sha256=NO_CHECKSUM)
    model.metadata_props.add(key=CARD_KEY, value=msgspec.json.encode(open_card).decode())
    content: bytes = model.SerializeToString()
    return content.replace(NO_CHECKSUM.encode(), _checksum(content, NO_CHECKSUM).encode())


def _checksum(content: bytes, stored: str) -> str:
    """SHA-256 of the content with the ``stored`` checksum replaced by NO_CHECKSUM."""
    return hashlib.sha256(content.replace(stored.encode(), NO_CHECKSUM.encode())).hexdigest()


def _content(path: Path) -> bytes:
    """Content of the file. Raises BadFile beyond MAX_FILE_BYTES."""
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise _bad(path, f"cannot be read: {error.strerror}") from None
    if len(content) > MAX_FILE_BYTES:
        raise _bad(path, f"more than {MAX_FILE_BYTES} bytes: not a slip detection network")
    return content


def _session(content: bytes) -> Any:
    # from version 1.29 on, each session is reported over the Internet by default
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime as ort  # noqa: PLC0415 (`energy` starts faster without it)

    ort.set_default_logger_severity(4)  # an exception has the same message
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.add_session_config_entry("session.load_model_format", "ONNX")
    # without the fallback to other providers, which prints to standard output
    return ort.InferenceSession(
        content, options, providers=["CPUExecutionProvider"], enable_fallback=0
    )


def _loaded(path: Path, content: bytes, packaged: bool) -> LoadedNetwork:
    try:
        tensors, metadata = read_inputs(content), read_metadata(content)
    except Exception as error:  # as its docstring says
        text = f"damaged, or no ONNX file ({describe_exception(error)})"
        raise _bad(path, text) from error
    inputs: dict[str, Shape] = {}
    for name, each in tensors.items():
        fingers, *lengths = each.shape or (1,)
        fixed = tuple(n for n in lengths if isinstance(n, int) and n > 0)
        if not each.is_float or isinstance(fingers, int) or len(fixed) < len(lengths):
            expected = "float (fingers, ...) with all axes but the first fixed"
            kind = "float" if each.is_float else "of another type,"
            raise _bad(path, f"input {name!r} is {kind} {each.shape}, not {expected}")
        if math.prod(fixed) > MAX_FILE_BYTES:
            raise _bad(
                path, f"input {name!r} has {math.prod(fixed)} numbers: not one frame or window"
            )
        inputs[name] = fixed
    card = _card(path, metadata.get(CARD_KEY), inputs.get("counts", ()))
    frame: Shape = (len(card.mean_counts),)
    by_card = {"counts": frame if card.mode == "stream" else (card.window, *frame)}
    loaded = LoadedNetwork(card, content, inputs, packaged)
    if card.mode == "stream":
        by_card |= loaded.states | ({"previous": frame} if "previous" in inputs else {})
    if inputs != by_card:
        raise _bad(path, f"inputs are {inputs}, not {by_card} as in its card")
    return loaded


def _test_runs(path: Path, loaded: LoadedNetwork) -> None:
    for fingers in (1, FINGERS):
        _test_run(path, loaded, fingers)


def _test_run(path: Path, loaded: LoadedNetwork, fingers: int) -> None:
    """Run the graph on zeros. Raises BadFile for outputs that are not probabilities and states."""
    feeds = {name: np.zeros((fingers, *shape), np.float32) for name, shape in loaded.inputs.items()}
    names = ["probability", *(f"next_{name}" for name in loaded.states)]
    try:
        outputs = [each.name for each in loaded.session.get_outputs()]
        if missing := [name for name in names if name not in outputs]:
            raise _bad(path, f"has no output {missing[0]!r}; its outputs are {outputs}")
        p, *states = loaded.session.run(names, feeds)
    except BadFile:
        raise
    except Exception as error:  # onnxruntime has its own exception class for each kind of damage
        raise _cannot_run(path, exception_text(error)) from error
    if p.shape != (fingers,) or p.dtype != np.float32 or not ((p >= 0.0) & (p <= 1.0)).all():
        raise _bad(path, f"returns {p}, not a probability per finger")
    for name, state in zip(loaded.states, states, strict=True):
        if state.shape != feeds[name].shape or not np.isfinite(state).all():
            raise _bad(path, f"next_{name} is not finite, or has another shape than {name}")


def _card(path: Path, text: str | None, counts: Shape) -> NetworkCard:
    """The card in the file's metadata. Without one, the shape of ``counts`` determines the mode:
    (taxels,) is a stream, (samples, taxels) a window."""
    if text is None:
        if len(counts) not in (1, 2):
            raise _bad(path, "no card, and no input `counts` with a frame or a window")
        mode: Mode = "stream" if len(counts) == 1 else "window"
        return NetworkCard(
            format=READABLE_FORMATS[0], name=path.stem, mode=mode,
            window=counts[0] if len(counts) == 2 else 0, mean_counts=(0.0,) * counts[-1],
        )  # fmt: skip
    try:
        card = msgspec.json.decode(text, type=NetworkCard)
    except (msgspec.DecodeError, RecursionError) as error:
        raise _bad(path, f"its card cannot be read: {error}") from None
    if card.format not in READABLE_FORMATS:
        raise _bad(path, f"format {card.format}, this version reads {READABLE_FORMATS}")
    return card


def _cannot_run(path: Path, text: str) -> BadFile:
    """The error for a text of ONNX Runtime."""
    for what, pattern in (("IR", r"IR version: (\d+).*: (\d+)"), ("opset", OPSET_TEXT)):
        if found := re.search(pattern, text):
            problem = f"has {what} version {found[1]}; ONNX Runtime here reads up to {found[2]}"
            return BadFile(path, problem, f"export it with {what} version {found[2]} or lower")
    return _bad(path, f"ONNX Runtime cannot run it: {text.rpartition(' : ')[2].strip()}")


def _bad(path: Path, problem: str) -> BadFile:
    if is_packaged(path):
        return BadFile(path, f"{problem}; it is part of `grasp`", REINSTALL)
    return BadFile(path, problem, REMEDY)


if __name__ == "__main__":
    _try_network(sys.argv[1])
