"""Files of scores: `grasp benchmark` and `grasp detector evaluate --out FILE` write them, and
`grasp report` shows them."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from detector.decision import RuleSettings
from detector.recordings import LabelName, Split
from detector.scores.figures import Figure
from drivers.errors import BadFile
from grasp.files import write_whole
from scenarios.benchmark.quality import NO_TRIALS, Trials

BENCHMARK = "benchmark.json"
COST = "cost.json"  # beside benchmark.json: µs for an update, which differ between runs
BEGINS = '{"kind":"grasp scores"'  # first characters of every file of scores
REMEDY = (
    "make it again, elsewhere: `grasp benchmark`, or `grasp detector evaluate NAME --data DIR "
    "--out FILE.json`"
)


class Source(msgspec.Struct, frozen=True):
    """What detectors were scored on: a split of the benchmark, or other data."""

    data: str
    split: Split | Literal["all", ""]  # empty: a recording
    label: LabelName
    version: int | None = None  # of the benchmark's protocol; None: other data
    seeds: str = ""  # digest
    layout: str = ""
    quick: bool = False  # the first quarter of lifts and taps: to compare with none but such


class Point(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A detector with one threshold or limit, or the oracle with one delay in seconds. Shares from
    0 to 1, see `scenarios.benchmark.quality`."""

    threshold: float
    score: Figure
    raw: Figure
    lifts: Figure  # mean quality
    moved: Figure  # of taps that moved the object
    unmoved: Figure
    false_per_min: Figure
    delay_p50_ms: float | None  # from the onset of slip; None: more than half were missed
    delay_p90_ms: float | None
    trials: Trials = NO_TRIALS  # of a row; other thresholds keep none


class References(msgspec.Struct, frozen=True):
    """The ends of the score: a detector that never registers, and an oracle with some delays."""

    silence: Point
    oracle: list[Point]

    @property
    def ends(self) -> tuple[Trials, Trials]:
        """Trials with the scores 0 and 1."""
        return self.silence.trials, self.oracle[0].trials


class ScoredSlip(msgspec.Struct, frozen=True):
    """A slip and its delay; ``delay_ms`` None: missed."""

    recording: str
    onset_s: float
    delay_ms: float | None
    kind: str  # of motion, or the cause
    speed_mps: float | None  # commanded speed, or maximum sliding speed of the contact
    slid_mm: float | None  # total distance


class SlipTrace(msgspec.Struct, frozen=True):
    """Samples around one slip, times in seconds from its onset."""

    slip: ScoredSlip
    t_s: list[float]
    pressed: list[list[float]]  # of each finger, sum of counts above its mean before the slip
    probabilities: list[float]
    slipping: list[tuple[float, float]]  # from, to

    def __post_init__(self) -> None:
        if {len(self.probabilities), *map(len, self.pressed)} != {len(self.t_s)}:
            raise ValueError("t_s, pressed and probabilities have different lengths")


class DetectorScores(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """All scores of one detector with one rule, except its cost."""

    detector: str
    detector_hash: str  # see `TrialConfig.detector_hash`
    rule: RuleSettings
    figures: dict[str, Figure]  # by measure: `scenarios.report.score_page` has their meaning
    # of the benchmark
    point: Point | None = None  # own rule
    best: Point | None = None  # threshold with the highest `raw` within BUDGET_PER_MIN
    curve: list[Point] = []  # thresholds that were tried, on the first lifts
    causes: dict[str, int] = {}  # of its own rule, lifts by result
    real: dict[str, Figure] = {}  # AUC by recording
    # of an evaluation
    slips: list[ScoredSlip] = []
    worst: list[SlipTrace] = []

    @property
    def rows(self) -> list[Point]:
        """Its best threshold, and its own rule if that is another one; none in an evaluation."""
        points = [self.best] if self.point == self.best else [self.point, self.best]
        return [p for p in points if p is not None]


class ScoreFile(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="grasp scores"):
    """Content of a file of scores; an infinite value is null in it."""

    source: Source
    command: str
    versions: dict[str, str] = {}
    detectors: Annotated[list[DetectorScores], msgspec.Meta(min_length=1)]
    references: References | None = None  # of a benchmark

    @property
    def ends(self) -> tuple[Trials, Trials]:
        """Trials with the scores 0 and 1; empty in an evaluation."""
        return self.references.ends if self.references else (NO_TRIALS, NO_TRIALS)


def write_scores(path: Path, file: ScoreFile) -> None:
    """Write the file. Raises OSError."""
    write_whole(path, msgspec.json.encode(file), private=True)


def read_scores(path: Path) -> tuple[ScoreFile, dict[str, float]]:
    """A file of scores, and the costs of its detectors if they are beside a benchmark. Raises
    BadFile and OSError."""
    try:
        found = msgspec.json.decode(path.read_bytes(), type=ScoreFile)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadFile(path, f"is no file of scores: {error}", REMEDY) from None
    with suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
        if found.source.version is not None:
            beside = path.with_name(COST).read_bytes()
            return found, msgspec.json.decode(beside, type=dict[str, float])
    return found, {}


def earlier_scores(
    path: Path, source: Source
) -> tuple[dict[str, DetectorScores], dict[str, float]]:
    """Scores and costs of detectors in that file, if there is one. Raises BadFile for a damaged
    file and for one of another version, OSError."""
    if not path.exists():
        return {}, {}
    file, costs = read_scores(path)
    if file.source != source:
        has = f"has results of version {file.source.version}, or other seeds"
        raise BadFile(path, has, "give another --out, or move that file away")
    return {each.detector: each for each in file.detectors}, costs
