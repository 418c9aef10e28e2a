"""What heads tell of slips beside what is told without them: speed, direction, sliding or turning.

Scored are the samples that are labelled slip in which a fingertip moves over what it touches, each
finger by itself; recordings, and so objects, are what is drawn for an interval.
"""

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.energy import energy_series
from detector.heads import ENERGY_SAMPLES, LEAST_ENERGY, Float32s, Teller, inputs_of
from detector.motion import SECTORS
from detector.network_file import LoadedNetwork
from detector.recordings import Recording
from detector.scores.intervals import HIGH, LOW, RESAMPLES_OF_A_SET
from detector.scores.metrics import auc
from detector.scores.motion import left_behind, motion_of, sector_of, speed_of, turning_of
from detector.scores.quantiles import quantile
from drivers.errors import BadFile

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]
Figure = tuple[float, float, float]  # and the ends of its interval
LEAST_MPS = 0.003  # slower is no slip
FIRST = 100  # sample of a recording that is scored
AT_ONCE = 60  # recordings that are streamed side by side
# where the pressure's centre may lie, of the kit's taxels: columns and rows
PLACES = np.array([(-1.0, -0.5), (0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5), (-1.0, 0.5)])
LEAST_COUNTS = 30.0  # that a centre is worth something of
SHIFT_LAG, SHIFT_MEAN = 9, 30  # as of the networks' shifts


class Felt(msgspec.Struct, frozen=True, eq=False):
    """Samples of single fingers in motion, and the recording that each is of."""

    inputs: Float32s  # (n, width) that heads are given
    motion: Floats  # (n, 3), see `scores.motion`
    energy: Floats  # (n,) counts a sample
    shift: Floats  # (n, 2) of the pressure's centre, taxels
    recording: Whole  # (n,)
    mount: Whole  # (n,) direction in which fingertips slide over what goes down; -1: not known

    @property
    def slides(self) -> Whole:
        """Those that slide more than they turn: the others have no direction."""
        return np.flatnonzero(~turning_of(self.motion))


class Told(msgspec.Struct, frozen=True, eq=False):
    """What somebody says of samples; None: nothing of that."""

    log_speed: Floats | None = None  # (n,)
    turning: Floats | None = None  # (n,), the more the likelier
    sector: Whole | None = None  # (n,)


class Score(msgspec.Struct, frozen=True):
    """Figures, each with its 95 % interval; None where nothing was said, or nothing turns."""

    speed_factor: Figure | None  # median of how many times too fast or slow
    speed_r2: Figure | None  # of its logarithm
    direction: Figure | None  # share in the right one of eight
    beside: Figure | None  # or in one beside it
    turning_auc: Figure | None


def felt(loaded: LoadedNetwork, recordings: Sequence[Recording]) -> Felt:
    """All that is to be scored or learnt; raises BadFile where nothing moves, or no velocity is
    known."""
    known = [r for r in recordings if motion_of(r) is not None]
    parts = []
    for first in range(0, len(known), AT_ONCE):
        parts += _streamed(loaded, known[first : first + AT_ONCE], first)
    if not sum(len(part.recording) for part in parts):
        raise BadFile(
            recordings[0].source if recordings else "", "no fingertip's velocity, or no slip",
            "build the set with this version: `grasp dataset build`",
        )  # fmt: skip
    return pooled(parts)


def pooled(parts: Sequence[Felt]) -> Felt:
    """Of several as of one, recordings keeping their numbers."""
    names = Felt.__struct_fields__
    return Felt(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


def _streamed(loaded: LoadedNetwork, some: Sequence[Recording], first: int) -> list[Felt]:
    """Samples of each recording, numbered from ``first``; the fingers of all are streamed side by
    side from a reset, and what is not wanted of a network's states is not kept."""
    fingers = [(i, f) for i, r in enumerate(some) for f in range(r.fingers)]
    longest = max(len(r.t_s) for r in some)
    series = [some[i].counts[:, f] for i, f in fingers]
    counts = np.stack([np.pad(s, ((0, longest - len(s)), (0, 0)), "edge") for s in series], axis=1)
    moves = [_moves(r) for r in some]
    wanted = np.zeros((longest, len(fingers)), np.bool_)
    for column, (i, f) in enumerate(fingers):
        wanted[: len(moves[i]), column] = moves[i][:, f]
    states = {k: np.zeros((len(fingers), *s), np.float32) for k, s in loaded.states.items()}
    names = [f"next_{name}" for name in states]
    found, at = [], []
    for t in range(longest):
        frame = {"counts": counts[t], "previous": counts[max(t - 1, 0)]}
        fed = {k: v.astype(np.float32) for k, v in frame.items()} | states
        states = dict(zip(states, loaded.session.run(names, fed), strict=True))
        (columns,) = np.nonzero(wanted[t])
        if len(columns):
            kept = {k: v[columns] for k, v in states.items()}
            found.append(inputs_of(kept, counts[t, columns]))
            at += [(*fingers[column], t) for column in columns.tolist()]
    if not found:
        return []
    inputs, where = np.concatenate(found), np.array(at)
    return [
        _of_recording(r, inputs[mine], where[mine, 1:], first + i)
        for i, r in enumerate(some)
        for mine in [where[:, 0] == i]
    ]


def _moves(recording: Recording) -> NDArray[np.bool_]:
    """Which samples of which fingers (n, fingers) are scored."""
    motion = motion_of(recording)
    if motion is None:
        raise ValueError(f"{recording.source} has no velocity")
    moves: NDArray[np.bool_] = (speed_of(motion) > LEAST_MPS) & recording.slip[:, None]
    moves[:FIRST] = False
    return moves


def _of_recording(recording: Recording, inputs: Float32s, where: Whole, number: int) -> Felt:
    """``where`` (n, 2): finger and sample of each row."""
    motion = motion_of(recording)
    assert motion is not None  # noqa: S101  (or it would have no rows)
    finger, sample = where.T
    return Felt(
        inputs, motion[sample, finger],
        energy_series(recording.counts, ENERGY_SAMPLES)[sample, finger],
        centre_shift(recording.counts)[sample, finger], np.full(len(where), number),
        np.full(len(where), left_behind(recording)),
    )  # fmt: skip


def centre_shift(counts: NDArray[np.int16]) -> Floats:
    """How far the pressure's centre (n, fingers, 2) of counts (n, fingers, 6) lies from its own
    mean of 0.3 s, 0.09 s ago; from its first place, where there is no such past."""
    load = np.maximum(-counts.astype(np.float64), 0.0)
    centre = load @ PLACES / np.maximum(load.sum(axis=2, keepdims=True), LEAST_COUNTS)
    first: Floats = np.repeat(centre[:1], SHIFT_LAG + SHIFT_MEAN, axis=0)
    sums = np.cumsum(np.concatenate([first, centre]), axis=0)
    n = len(centre)
    mean = (sums[SHIFT_MEAN : SHIFT_MEAN + n] - sums[:n]) / SHIFT_MEAN
    out: Floats = centre - mean
    return out


def told_by_heads(teller: Teller, samples: Felt) -> Told:
    """What heads say."""
    out = teller.outputs(samples.inputs).astype(np.float64)
    return Told(out[:, 0], out[:, 1], out[:, 2:].argmax(axis=1))


def told_without(learnt: Felt, asked: Felt) -> dict[str, Told]:
    """What can be said without a network, learnt on other samples: always the same; speed and
    turning by the energy; a direction by the pressure's centre, or downwards where it is known how
    the fingertips are mounted."""
    n = len(asked.recording)
    speed = np.log(speed_of(learnt.motion))
    sectors = sector_of(learnt.motion[learnt.slides])
    commonest = int(np.bincount(sectors, minlength=SECTORS).argmax())
    sign = 1.0 if (auc(learnt.energy, turning_of(learnt.motion)) or 0.0) >= 0.5 else -1.0
    by_energy = _fitted(_powers(learnt.energy), speed[:, None])
    moves = learnt.motion[learnt.slides, :2]
    ways: Floats = moves / np.linalg.norm(moves, axis=1, keepdims=True)
    by_centre = _fitted(_with_one(learnt.shift[learnt.slides]), ways)
    found = {
        "always the same": Told(np.full(n, np.median(speed)), None, np.full(n, commonest)),
        "energy": Told((_powers(asked.energy) @ by_energy)[:, 0], sign * asked.energy, None),
        "pressure's centre": Told(None, None, sector_of(_with_one(asked.shift) @ by_centre)),
    }
    if (asked.mount >= 0).all():
        found["down, by the mount"] = Told(None, None, asked.mount)
    return found


def _powers(energy: Floats) -> Floats:
    log = np.log(energy + LEAST_ENERGY)
    return np.stack([np.ones_like(log), log, log**2], axis=1)


def _with_one(x: Floats) -> Floats:
    return np.column_stack([x, np.ones(len(x))])


def _fitted(inputs: Floats, wanted: Floats) -> Floats:
    out: Floats = np.linalg.lstsq(inputs, wanted, rcond=None)[0].astype(np.float64)
    return out


def score(told: Told, truth: Felt, seed: int = 0) -> Score:
    """Figures of what was said, over all samples or those that slide."""
    drawn = _drawn(truth.recording, seed)
    speed, turns = np.log(speed_of(truth.motion)), turning_of(truth.motion)
    slides, sector = ~turns, sector_of(truth.motion)

    def figure(of: Callable[[Whole], float | None]) -> Figure | None:
        value = of(np.arange(len(turns)))
        values = sorted(x for x in map(of, drawn) if x is not None)
        return None if value is None else (value, quantile(values, LOW), quantile(values, HIGH))

    return Score(
        figure(lambda i: _factor(told.log_speed, speed, i[slides[i]])),
        figure(lambda i: _r2(told.log_speed, speed, i)),
        figure(lambda i: _right(told.sector, sector, i[slides[i]], 0)),
        figure(lambda i: _right(told.sector, sector, i[slides[i]], 1)),
        figure(lambda i: None if told.turning is None else auc(told.turning[i], turns[i])),
    )


def _drawn(recording: Whole, seed: int) -> list[Whole]:
    rng = np.random.default_rng(seed)
    of = [np.flatnonzero(recording == r) for r in np.unique(recording)]
    return [
        np.concatenate([of[k] for k in rng.integers(0, len(of), len(of))])
        for _ in range(RESAMPLES_OF_A_SET)
    ]


def _factor(told: Floats | None, truth: Floats, at: Whole) -> float | None:
    if told is None or not len(at):
        return None
    return float(np.exp(np.median(abs(told[at] - truth[at]))))


def _r2(told: Floats | None, truth: Floats, at: Whole) -> float | None:
    if told is None or truth[at].var() == 0.0:
        return None
    return float(1.0 - ((told[at] - truth[at]) ** 2).mean() / truth[at].var())


def _right(told: Whole | None, truth: Whole, at: Whole, beside: int) -> float | None:
    if told is None or not len(at):
        return None
    apart = (told[at] - truth[at] + SECTORS // 2) % SECTORS - SECTORS // 2
    return float((abs(apart) <= beside).mean())
