"""Auxiliary outputs of a network (speed, direction, sliding or turning) against simple baselines.

The scores use samples labelled slip in which a fingertip moves, for each finger separately. The
split `train` of each set fits the baselines; the split `test` scores all. Intervals are 95 %, by
bootstrap over recordings. `--train` (extra `train`) trains new outputs on the split `train` of all
sets and writes DIR/NAME.auxiliary.json. Without it the study scores the outputs beside the weights.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import (
    ENERGY_SAMPLES,
    MIN_ENERGY,
    OUTPUTS_SUFFIX,
    SECTORS,
    AuxiliaryOutputs,
    Float32s,
    OutputsFile,
    input_width,
    inputs_of,
    read_outputs,
)
from detector.network_file import LoadedNetwork, read_network, weights_digest
from detector.recordings import Recording
from detector.scores.figures import HIGH, LOW, RESAMPLES
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from drivers.errors import BadFile, UsageError
from grasp.cli.detector import network_path
from grasp.cli.options import need, whole
from grasp.cli.parser import Parser
from grasp.files import write_whole
from scenarios.benchmark.data_sets import read_set, require_whole
from scenarios.trial.result import versions
from studies.runner import Study, add_data, markdown

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]
Figure = tuple[float, float, float]  # and its interval
SPAN = 5  # samples in the mean of a motion; a tap lasts less than two
TURN_LEVER_M = 0.003 / 0.2  # of the paper's label: 3 mm/s, 0.2 rad/s
NETWORK, SEED = "auxiliary outputs", 0
LEAST_MPS, FIRST_SAMPLE, HAND_FINGERS = 0.003, 100, 3
UPWARDS = "fingertip.slip_direction_deg"  # of a recording's parameters
# taxel positions of the kit, columns and rows; and the past samples for the centre's reference
PLACES = np.array([(-1.0, -0.5), (0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5), (-1.0, 0.5)])
LEAST_COUNTS, SHIFT_LAG, SHIFT_MEAN = 30.0, 9, 30
FIGURES = ("speed factor, median", "speed, R2 of its logarithm", "direction, one of eight",
           "or one beside it", "turning, AUC")  # fmt: skip


class Task(msgspec.Struct, frozen=True):
    """A network to be evaluated."""

    network: str
    digest: str
    data: tuple[str, ...]
    train: bool
    steps: int
    out: str


class Row(msgspec.Struct, frozen=True):
    """FIGURES of a network by set and predictor; None for a figure without a prediction."""

    network: str
    scores: dict[str, tuple[Figure | None, ...]]


class Samples(msgspec.Struct, frozen=True, eq=False):
    """Samples of single fingers that slip."""

    inputs: Float32s  # (n, width) of the auxiliary outputs
    motion: Floats  # (n, 3): velocity x and y, spin times the lever, m/s
    energy: Floats  # (n,) counts a sample
    shift: Floats  # (n, 2) of the centre of pressure, taxels
    recording: Whole  # (n,)
    down: Whole  # (n,) direction in which an object falls over the pad; -1: unknown


class Guess(msgspec.Struct, frozen=True, eq=False):
    """Predictions for samples (n,); None: no prediction of that figure."""

    log_speed: Floats | None = None
    turning: Floats | None = None  # the more, the likelier
    sector: Whole | None = None


def energy_series(counts: NDArray[np.int16], window: int) -> Floats:
    """Energies (n, fingers) of a recording (n, fingers, taxels), as `detector.energy` streams."""
    changes = np.abs(np.diff(counts.astype(np.int64), axis=0, prepend=counts[:1])).sum(axis=2)
    total = np.cumsum(changes, axis=0)
    total[window:] -= total[:-window].copy()
    energies: Floats = total / (window * counts.shape[2])
    return energies


def add_options(parser: Parser) -> None:
    parser.add_argument("network", nargs="*", default=["tcn", "gru"], help="(default: tcn gru)")
    add_data(parser)
    parser.add_argument("--train", action="store_true", help="train new outputs first")
    parser.add_argument("--steps", type=whole(1, 10**6), default=3000, metavar="N",
                        help="optimiser steps (default: %(default)s)")  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    if args.train:
        need("train", "torch")
        require_whole(args.data)
        args.jobs = 0  # in this process: torch makes a worker so large that the leak check ends it
    data = tuple(map(str, args.data))
    rest = (data, args.train, args.steps, str(args.out))
    return [Task(str(p), weights_digest(p), *rest) for p in map(network_path, args.network)]


def trial(task: Task) -> Row:
    weights, folders = Path(task.network), [Path(f) for f in task.data]
    loaded = read_network(weights)
    input_width(loaded)  # raises for a network without state, before reading data
    learnt = [read_set(folder, "train") for folder in folders]
    known = [samples_of(loaded, recordings) for recordings in learnt]
    outputs = read_outputs(weights, task.digest, loaded)
    if task.train:
        outputs = AuxiliaryOutputs(_trained(task, known, [r for each in learnt for r in each]))
    if outputs is None:
        raise UsageError(f"{weights.name} has no auxiliary outputs", "give --train")
    scores: dict[str, tuple[Figure | None, ...]] = {}
    for folder, samples in zip(folders, known, strict=True):
        test = samples_of(loaded, read_set(folder, "test"))
        out = outputs.outputs(test.inputs).astype(np.float64)
        by_network = {NETWORK: Guess(out[:, 0], out[:, 1], out[:, 2:].argmax(axis=1))}
        guesses = baselines(samples, test) | by_network
        scores |= {f"{folder.name}: {by}": score(each, test) for by, each in guesses.items()}
    if task.train:
        kept = {f"{of}, {title}": figure for of, figures in scores.items() if of.endswith(NETWORK)
                for title, figure in zip(FIGURES, figures, strict=True) if figure}  # fmt: skip
        content = msgspec.json.encode(msgspec.structs.replace(outputs.file, scores=kept))
        write_whole(Path(task.out) / f"{weights.stem}{OUTPUTS_SUFFIX}", content)
    return Row(weights.stem, scores)


def _trained(task: Task, sets: Sequence[Samples], recordings: Sequence[Recording]) -> OutputsFile:
    from detector.training.sequences import digest
    from studies.auxiliary_training import OutputTargets, train_outputs

    truths = [(log_speed(s.motion), turning_of(s.motion), sector_of(s.motion)) for s in sets]
    targets = [OutputTargets(s.inputs, *truth) for s, truth in zip(sets, truths, strict=True)]
    used, commit = digest(recordings), versions()["commit"]
    return train_outputs(targets, SEED, task.steps, task.digest, used, commit)


def samples_of(loaded: LoadedNetwork, recordings: Sequence[Recording]) -> Samples:
    """Samples to learn from or to score. Raises BadFile where no motion is recorded."""
    known = [(r, motion) for r in recordings if (motion := motion_of(r)) is not None]
    parts = [_samples(loaded, r, motion, i) for i, (r, motion) in enumerate(known)]
    if not sum(len(part.recording) for part in parts):
        source = recordings[0].source if recordings else ""
        raise BadFile(source, "has no recorded motion, or no slip", "build the set again")
    names = Samples.__struct_fields__
    return Samples(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


def _samples(loaded: LoadedNetwork, r: Recording, motion: Floats, number: int) -> Samples:
    states = {k: np.zeros((r.fingers, *s), np.float32) for k, s in loaded.states.items()}
    names, inputs = [f"next_{name}" for name in states], []
    moves = (np.linalg.norm(motion, axis=2) > LEAST_MPS) & r.slip[:, None]
    moves[:FIRST_SAMPLE] = False
    counts = r.counts.astype(np.float32)
    for frame, previous, chosen in zip(counts, [counts[0], *counts[:-1]], moves, strict=True):
        feeds = {"counts": frame, "previous": previous}
        states = dict(zip(states, loaded.session.run(names, feeds | states), strict=True))
        inputs.append(inputs_of(states, frame)[chosen])
    n, up = int(moves.sum()), _up_rad(r)
    down = -1 if up is None else int(sector_of(np.array([math.cos(up), math.sin(up), 0.0])))
    return Samples(
        np.concatenate(inputs), motion[moves], energy_series(r.counts, ENERGY_SAMPLES)[moves],
        centre_shift(r.counts)[moves], np.full(n, number), np.full(n, down),
    )  # fmt: skip


def _up_rad(recording: Recording) -> float | None:
    """Direction of up on the thumb's pad, rad; None if nothing is held or it is not recorded."""
    about = recording.metadata.parameters if recording.metadata else {}
    held = recording.fingers == HAND_FINGERS and UPWARDS in about
    return math.radians(about[UPWARDS]) if held else None


def motion_of(recording: Recording) -> Floats | None:
    """True motion (n, fingers, 3), mean of SPAN samples; None if it is not recorded.

    Recordings have the thumb's motion. The fingers face it, so theirs is its mirror image.
    """
    up = _up_rad(recording)
    if recording.velocity_mps is None or recording.spin_radps is None:
        return None
    each = np.column_stack([recording.velocity_mps, TURN_LEVER_M * recording.spin_radps])
    sums = np.cumsum(each.astype(np.float64), axis=0)
    thumb = np.zeros_like(sums)
    thumb[SPAN:] = (sums[SPAN:] - sums[:-SPAN]) / SPAN
    if recording.fingers == 1 or up is None:
        return thumb[:, None] if recording.fingers == 1 else None
    axis = np.array([math.cos(up), math.sin(up)])
    mirrored = 2.0 * np.outer(thumb[:, :2] @ axis, axis) - thumb[:, :2]
    finger = np.column_stack([mirrored, -thumb[:, 2]])
    return np.stack([thumb, finger, finger], axis=1)


def log_speed(motion: Floats) -> Floats:
    found: Floats = np.log(np.linalg.norm(motion, axis=-1))
    return found


def turning_of(motion: Floats) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = abs(motion[..., 2]) > np.hypot(motion[..., 0], motion[..., 1])
    return found


def sector_of(motion: Floats) -> Whole:
    """Direction as one of eight: 0 along x, 2 along y."""
    angle = np.arctan2(motion[..., 1], motion[..., 0])
    return np.rint(angle * SECTORS / (2.0 * math.pi)).astype(np.intp) % SECTORS


def centre_shift(counts: NDArray[np.int16]) -> Floats:
    """Centre of pressure (n, fingers, 2) minus its mean over 0.3 s, ended 0.09 s earlier."""
    load = np.maximum(-counts.astype(np.float64), 0.0)
    centre = load @ PLACES / np.maximum(load.sum(axis=2, keepdims=True), LEAST_COUNTS)
    before = np.repeat(centre[:1], SHIFT_LAG + SHIFT_MEAN, axis=0)
    sums, n = np.cumsum(np.concatenate([before, centre]), axis=0), len(centre)
    found: Floats = centre - (sums[SHIFT_MEAN : SHIFT_MEAN + n] - sums[:n]) / SHIFT_MEAN
    return found


def baselines(learnt: Samples, test: Samples) -> dict[str, Guess]:
    """Predictions without the network."""
    speed, turns = log_speed(learnt.motion), turning_of(learnt.motion)
    slides = learnt.motion[~turns]
    sign = 1.0 if (auc(learnt.energy, turns) or 0.0) >= 0.5 else -1.0
    energy, new = (np.log(samples.energy + MIN_ENERGY) for samples in (learnt, test))
    ways = slides[:, :2] / np.linalg.norm(slides[:, :2], axis=1, keepdims=True)
    old, test_shift = (np.insert(s.shift, 2, 1.0, axis=1) for s in (learnt, test))
    by_centre = np.linalg.lstsq(old[~turns], ways, rcond=None)[0]
    by_energy: Floats = np.polyval(np.polyfit(energy, speed, 2), new).astype(np.float64)
    n, commonest = len(test.recording), np.bincount(sector_of(slides)).argmax()
    found = {
        "always the same": Guess(np.full(n, np.median(speed)), None, np.full(n, commonest)),
        "energy": Guess(by_energy, sign * test.energy),
        "centre of pressure": Guess(sector=sector_of(test_shift @ by_centre)),
    }
    if (test.down >= 0).all():
        found["down, by the mount"] = Guess(sector=test.down)
    return found


def score(guess: Guess, truth: Samples) -> tuple[Figure | None, ...]:
    """FIGURES of all samples, and their intervals."""
    rng = np.random.default_rng(0)
    of = [np.flatnonzero(truth.recording == r) for r in np.unique(truth.recording)]
    resamples = [
        figures_of(guess, truth, np.concatenate([of[k] for k in rng.integers(0, len(of), len(of))]))
        for _ in range(RESAMPLES)
    ]
    found: list[Figure | None] = []
    for i, value in enumerate(figures_of(guess, truth, np.arange(len(truth.recording)))):
        values = sorted(x for each in resamples if (x := each[i]) is not None)
        if value is None or not values:
            found.append(None)
        else:
            found.append((value, quantile(values, LOW), quantile(values, HIGH)))
    return tuple(found)


def figures_of(guess: Guess, truth: Samples, at: Whole) -> tuple[float | None, ...]:
    """FIGURES of the samples; speed factor and direction use only sliding ones."""
    motion = truth.motion[at]
    speed, turns = log_speed(motion), turning_of(motion)
    factor = r2 = right = beside = area = None
    if guess.log_speed is not None:
        error = guess.log_speed[at] - speed
        r2 = float(1.0 - (error**2).mean() / speed.var()) if speed.var() else None
        factor = None if turns.all() else float(np.exp(np.median(abs(error[~turns]))))
    if guess.sector is not None and not turns.all():
        apart = guess.sector[at] - sector_of(motion) + SECTORS // 2
        apart = abs(apart % SECTORS - SECTORS // 2)[~turns]
        right, beside = float((apart == 0).mean()), float((apart <= 1).mean())
    if guess.turning is not None:
        area = auc(guess.turning[at], turns)
    return factor, r2, right, beside, area


def table(rows: Sequence[Row]) -> str:
    parts = []
    for row in rows:
        columns = {f"`{row.network}`": [*row.scores]}
        for i, title in enumerate(FIGURES):
            found = [figures[i] for figures in row.scores.values()]
            columns[title] = [f"{f[0]:.2f} [{f[1]:.2f}, {f[2]:.2f}]" if f else "–" for f in found]
        parts.append(markdown(columns))
    return "\n\n".join(parts)


STUDY = Study("auxiliary outputs: speed, direction, sliding or turning", grid, trial, Row, table,
              options=add_options)  # fmt: skip
