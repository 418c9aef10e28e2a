"""What detectors make of recordings with something wrong: another sensitivity, a broken taxel,
noise, lost samples, another rate, a stiffer pad (`detector.scores.perturbations`).

Detectors and rules are as they are packaged, the recordings a fixed part of the split `test`. A
detector hears each finger for itself, so all recordings are streamed side by side, as the fingers
of one large hand.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np

from detector.blows import blows_of
from detector.decision import RuleSettings, registered_events
from detector.interface import SlipDetector
from detector.recordings import Recording
from detector.scores.evaluation import (
    HAND_FINGERS,
    SLIDE,
    WARM_UP_SAMPLES,
    Streamed,
    cause_of,
    events_by_label,
    hand_rate,
    score_blows,
    scored,
    spoken,
)
from detector.scores.perturbations import RATE, perturbed
from detector.scores.quantiles import Quantiles, quantiles
from drivers.errors import BadFile
from scenarios.acquire.datasets.build import INDEX, make
from scenarios.acquire.datasets.plan import DatasetConfig, Job, plan
from scenarios.campaign.config import load_config
from scenarios.world.fingertip_settings import FingertipSettings

AMOUNTS: dict[str, tuple[float, ...]] = {
    "gain": (0.5, 0.71, 1.0, 1.41, 2.0),
    "noise": (1.0, 2.0, 4.0),
    "lost": (0.0, 0.01, 0.03, 0.1),
    "temperature": (0.0, 2.0, 10.0),
    "drift": (0.0, 30.0, 300.0),
    RATE: (90.0, 100.0, 110.0),
    "dead": (0.0, 1.0),
    "stuck": (0.0, 1.0),
    "swapped": (0.0, 1.0),
}
PAD = "pad"
STIFFER = 2.0
STIFFNESS = "fingertip.foundation_n_per_mm3"
UNITS = {
    "gain": "times", "noise": "times the board's", "lost": "of the samples",
    "temperature": "K, every 4 s", "drift": "counts a minute", RATE: "samples a second",
    "dead": "taxel of 18", "stuck": "taxel of 18", "swapped": "taxel of 18",
    PAD: "times the stiffness, simulated anew",
}  # fmt: skip
WHOLE = {"gain": 1.0, "noise": 1.0, RATE: 100.0, PAD: 1.0}  # where nothing is wrong; else 0


class Endured(msgspec.Struct, frozen=True):
    """What a detector and its rule make of recordings with one thing wrong."""

    kind: str
    amount: float
    accuracy: float  # of samples, at the detector's own threshold
    recall: float | None  # of slips
    delay_ms: Quantiles | None  # of the slips of pressed fingertips; infinite: so many are missed
    false_per_min: float | None  # of a hand
    far_share: float | None  # of the blows that moved it 2 mm, registered within 100 ms
    idle_share: float | None  # of those that left it within half a millimetre, registered
    detector_hash: str = ""  # see `TrialConfig.detector_hash`


def chosen(recordings: Sequence[Recording], most: int) -> list[Recording]:
    """At most about so many, the same share of every cause, spread over each evenly."""
    of: dict[str, list[Recording]] = {}
    for recording in recordings:
        of.setdefault(cause_of(recording), []).append(recording)
    share = min(1.0, most / max(1, len(recordings)))
    found: list[Recording] = []
    for group in of.values():
        n = max(1, round(share * len(group)))
        found += [group[(2 * i + 1) * len(group) // (2 * n)] for i in range(n)]
    return found


def rest_min(recordings: Sequence[Recording]) -> float:
    """Minutes of a hand without slip, about what a rate of false events is out of."""
    seconds = 0.0
    for r in recordings:
        still = ~r.label("slip")[WARM_UP_SAMPLES:]
        seconds += still.mean() * (r.t_s[-1] - r.t_s[WARM_UP_SAMPLES]) * r.fingers / HAND_FINGERS
    return seconds / 60.0


def stream_together(
    make_detector: Callable[[int, int], SlipDetector], recordings: Sequence[Recording]
) -> list[Streamed]:
    """What `stream_recordings` gives, all recordings of one layout at once; no cost is told."""
    fingers = [r.fingers for r in recordings]
    longest = max(len(r.t_s) for r in recordings)
    frames = np.concatenate(
        [np.pad(r.counts, ((0, longest - len(r.t_s)), (0, 0), (0, 0)), "edge") for r in recordings],
        axis=1,
    )
    detector = make_detector(sum(fingers), recordings[0].taxels)
    every = np.array([detector.update(frame) for frame in frames])
    parts = np.split(every, np.cumsum(fingers)[:-1], axis=1)
    return [
        Streamed(r, p[: len(r.t_s)], np.empty(0)) for r, p in zip(recordings, parts, strict=True)
    ]


def endured(
    kind: str, amount: float, threshold: float, rule: RuleSettings, streams: Sequence[Streamed]
) -> Endured:
    """The figures of one kind and amount."""
    how = events_by_label("slip")
    judged = [
        scored(s, how, WARM_UP_SAMPLES, blows_of(s.recording), apart=True).judged(
            registered_events(s.probabilities, rule)
        )
        for s in streams
    ]
    right = [
        ((spoken(s, rule) > threshold) == s.labels)[WARM_UP_SAMPLES:] for s in streams
    ]  # fmt: skip
    delays = np.concatenate([j.events.delays_ms for j in judged])
    pressed = quantiles(
        d for s, j in zip(streams, judged, strict=True) if cause_of(s.recording) == SLIDE
        for d in j.events.delays_ms.tolist()
    )  # fmt: skip
    blows = score_blows(judged)
    return Endured(
        kind, amount,
        accuracy=float(np.concatenate(right).mean()),
        recall=float(np.isfinite(delays).mean()) if len(delays) else None,
        delay_ms=pressed,
        false_per_min=hand_rate(streams, [j.events for j in judged]),
        far_share=_share(blows.far_registered, blows.far) if blows else None,
        idle_share=_share(blows.unmoved_registered, blows.unmoved) if blows else None,
    )  # fmt: skip


def _share(hits: int, n: int) -> float | None:
    return hits / n if n else None


Tell = Callable[[int, int], None]


def versions_of(
    recordings: Sequence[Recording], stiffer: Sequence[Recording]
) -> Iterator[tuple[str, float, Sequence[Recording]]]:
    """Every kind and amount with its recordings; nothing wrong comes first and once."""
    yield "", 0.0, recordings
    for kind, amounts in AMOUNTS.items():
        for amount in amounts:
            if amount != WHOLE.get(kind, 0.0):
                yield (
                    kind,
                    amount,
                    [perturbed(r, kind, amount, i) for i, r in enumerate(recordings)],
                )
    if stiffer:
        yield PAD, STIFFER, stiffer


def study(
    names: Sequence[str], recordings: Sequence[Recording], stiffer: Sequence[Recording],
    tell: Tell = lambda done, total: None,
) -> dict[str, list[Endured]]:  # fmt: skip
    """For each detector what it endures, nothing wrong first."""
    found: dict[str, list[Endured]] = {name: [] for name in names}
    configs = {name: load_config("can", "simulated", name) for name in names}
    total = 2 + sum(len(amounts) - 1 for amounts in AMOUNTS.values())
    for done, (kind, amount, changed) in enumerate(versions_of(recordings, stiffer)):
        tell(done, total)
        for name, config in configs.items():
            streams = stream_together(config.make_detector, changed)
            threshold = config.make_detector(1).threshold
            row = endured(kind, amount, threshold, config.rule, streams)
            found[name].append(msgspec.structs.replace(row, detector_hash=config.detector_hash()))
    return found


def made_stiffer(
    folders: Sequence[Path], recordings: Sequence[Recording], tell: Tell = lambda done, total: None
) -> list[Recording]:
    """The same recordings made anew, each by its plan and seed, on a pad twice as stiff.

    Raises BadFile for a folder that does not say what it was built from.
    """
    jobs = {str(folder / job.path): job for folder in folders for job in _plan(folder)}
    found: list[Recording] = []
    for recording in recordings:
        tell(len(found), len(recordings))
        job = jobs.get(recording.source)
        if job is None:
            raise BadFile(recording.source, "is not in its folder's plan", "build the set again")
        known = job.metadata.parameters
        stiffness = STIFFER * known.get(STIFFNESS, FingertipSettings().foundation_n_per_mm3)
        metadata = msgspec.structs.replace(job.metadata, parameters=known | {STIFFNESS: stiffness})
        found.append(make(msgspec.structs.replace(job, metadata=metadata)))
    return found


class _Built(msgspec.Struct, frozen=True):
    dataset: DatasetConfig


def _plan(folder: Path) -> list[Job]:
    path = folder / INDEX
    try:
        return plan(msgspec.json.decode(path.read_bytes(), type=_Built).dataset)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadFile(path, f"says not how the set was made: {error}", "build it again") from None


def table(found: dict[str, list[Endured]]) -> str:
    """Markdown, a row a kind and amount; a cell a detector: accuracy, %; delay, ms, p50 / p90 /
    p99; recall, %; false events a minute of a hand; blows registered of 2 mm and within half of
    one, %."""
    head = "".join(f" `{name}` |" for name in found)
    lines = [f"| what is wrong |{head}", f"|---|{'---|' * len(found)}"]
    for row in zip(*found.values(), strict=True):
        cells = " | ".join(_cell(e) for e in row)
        lines.append(f"| {_title(row[0].kind, row[0].amount)} | {cells} |")
    return "\n".join(lines)


def _title(kind: str, amount: float) -> str:
    if not kind:
        return "nothing"
    shown = f"{100 * amount:g} %" if kind == "lost" else f"{amount:g}"
    return f"{kind}: {shown} {UNITS[kind]}"


def _cell(e: Endured) -> str:
    q = e.delay_ms
    delay = "–" if q is None else f"{q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}"
    rest = [
        "–" if v is None else f"{scale * v:.{digits}f}"
        for v, scale, digits in (
            (e.recall, 100, 0), (e.false_per_min, 1, 1), (e.far_share, 100, 0),
            (e.idle_share, 100, 0),
        )
    ]  # fmt: skip
    recall, false, far, idle = rest
    return f"{100 * e.accuracy:.1f}; {delay}; {recall}; {false}; {far} / {idle}"
