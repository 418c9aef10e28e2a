"""Files of scores: `grasp benchmark` and `grasp detector evaluate --out FILE` write them, and
`grasp report` shows them."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from detector.decision import RuleSettings
from detector.recordings import LabelName, Split
from detector.scores.figures import Figure
from drivers.errors import BadFile
from grasp.files import write_whole

BENCHMARK = "benchmark.json"
COST = "cost.json"  # beside benchmark.json: it differs between runs
BEGINS = '{\n "kind": "grasp scores"'  # first characters of every file of scores
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


class Point(msgspec.Struct, frozen=True):
    """A detector with one threshold, or the oracle with one delay, on lifts and taps. ``right``:
    mean of the shares of lifts and of taps done right."""

    threshold: float
    right: Figure
    lifts_right: Figure
    taps_right: Figure
    delay_p50_ms: float | None  # from the onset of slip; None: more than half were missed
    delay_p90_ms: float | None


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
    point: Point | None = None
    curve: list[Point] = []  # other thresholds
    causes: dict[str, dict[str, int]] = {}  # results of all, weak and fragile lifts
    real: dict[str, Figure] = {}  # AUC by recording
    # of an evaluation
    slips: list[ScoredSlip] = []
    worst: list[SlipTrace] = []

    @property
    def own(self) -> list[Point]:
        """The point of its rule; none in an evaluation."""
        return [] if self.point is None else [self.point]


class Cost(msgspec.Struct, frozen=True):
    """Cost of a detector; the only figures that a repeated benchmark changes."""

    update_us: float  # median, three fingers
    parameters: int | None
    bytes: int | None


class ScoreFile(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="grasp scores"):
    """Content of a file of scores; an infinite value is null in it."""

    source: Source
    command: str
    versions: dict[str, str] = {}
    detectors: Annotated[list[DetectorScores], msgspec.Meta(min_length=1)]
    oracle: list[Point] = []


class ScoresWithCosts(msgspec.Struct, frozen=True):
    """A file of scores with the costs in it, as `python -m studies results` keeps it."""

    file: ScoreFile
    costs: dict[str, Cost]


def write_scores(path: Path, file: ScoreFile) -> None:
    """Write the file. Raises OSError."""
    write_whole(path, msgspec.json.format(msgspec.json.encode(file), indent=1), private=True)


def read_scores(path: Path) -> tuple[ScoreFile, dict[str, Cost]]:
    """A file of scores, and the costs of its detectors if they are beside a benchmark. Raises
    BadFile and OSError."""
    content = path.read_bytes()
    with suppress(msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        both = msgspec.json.decode(content, type=ScoresWithCosts)
        return both.file, both.costs
    try:
        found = msgspec.json.decode(content, type=ScoreFile)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadFile(path, f"is no file of scores: {error}", REMEDY) from None
    with suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
        if found.source.version is not None:
            beside = path.with_name(COST).read_bytes()
            return found, msgspec.json.decode(beside, type=dict[str, Cost])
    return found, {}


def scores_of_others(
    path: Path, source: Source, names: Sequence[str]
) -> tuple[list[DetectorScores], dict[str, Cost]]:
    """Scores and costs of other detectors than ``names`` in that file, if there is one. Raises
    BadFile for a damaged file and for one with another source, OSError."""
    if not path.exists():
        return [], {}
    file, costs = read_scores(path)
    if (found := file.source) != source:
        layout = f", layout {found.layout}" if found.layout else ""
        has = f"has results of version {found.version}, split {found.split}{layout}"
        raise BadFile(path, has, "give another --out, or move that file away")
    return [each for each in file.detectors if each.detector not in names], costs
