"""Twenty taps an object with each detector: what is registered, how soon, for how long; what each
makes of blows that move nothing; and how the verdict hangs on the windows of the scoring."""

import os
from collections.abc import Iterator

import pytest

from scenarios.campaign.config import load_config
from scenarios.tap import tap
from scenarios.tap.result import TapResult
from scenarios.tap.scoring import TapOutcome
from scenarios.tap.settings import TapScoringSettings
from scenarios.tap.summary import count
from scenarios.trial.series import Bench
from tests.bench.spread import three
from tests.unit.scenarios.tap.windows import sensitivity

OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
DETECTORS = os.environ.get("DETECTORS", "energy,tcn-paper,tcn,gru").split(",")
TAPS = int(os.environ.get("TAPS", "20"))
STRENGTHS = (0.1, 0.2, 0.4)  # of the blow that moves the object 7 mm
WINDOWS = {
    "as packaged": {},
    **{f"registered within {w * 1e3:.0f} ms": {"register_s": w} for w in (0.02, 0.03, 0.05, 0.1)},
    **{f"nominal within {w * 1e3:.0f} ms": {"clear_s": w} for w in (0.1, 0.15, 0.2, 0.3)},
    "stays nominal for 2 s": {"stay_s": 2.0},
    "moved: 5 mm": {"moved_m": 0.005},
}  # fmt: skip


def taps(name: str, detector: str, number: int, *assignments: str) -> Iterator[TapResult]:
    config = load_config(name, "simulated", detector, None, assignments).for_tap()
    for finished in tap.run_series(config, range(number), Bench()):
        assert finished.result is not None
        yield finished.result


def row(name: str, results: list[TapResult]) -> str:
    moved = [r for r in results if r.moved]
    lasted = [r.slip_duration_ms for r in moved if r.slip_duration_ms is not None]
    path = [1e3 * r.displacement_m for r in moved if r.displacement_m is not None]
    heard = [r.detection_latency_ms for r in moved]
    calm = [r.nominal_again_ms for r in moved]
    return (f"| {name} | {len(moved)} of {len(results)} | {count(results).successes} | "
            f"{three(lasted)} | {three(path)} | {three(heard)} | {three(calm)} |")  # fmt: skip


@pytest.mark.bench
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("detector", DETECTORS)
def test_taps_with_a_detector(detector: str) -> None:
    print(f"\n{detector}; p50 / p90 / p99 of what moved, inf: so many never came\n\n"
          "| object | moved | success | slip lasts, ms | moved, mm "
          "| registered after first motion, ms | nominal after its end, ms |\n"
          "|---|---|---|---|---|---|---|")  # fmt: skip
    every = []
    for name in OBJECTS:
        results = list(taps(name, detector, TAPS))
        print(row(name, results), flush=True)
        every += results
    print(row("all", every))
    print("\n| window | successes of taps that moved it |\n|---|---|")
    settings = [TapScoringSettings(**changed) for changed in WINDOWS.values()]
    for name, (_, right, moved) in zip(WINDOWS, sensitivity(every, settings), strict=True):
        print(f"| {name} | {right} of {moved} |")
    print("\n| strength of the blow | moved nothing | of these registered |\n|---|---|---|")
    for strength in STRENGTHS:
        weak = [r for name in OBJECTS for r in taps(name, detector, 4, f"tap.strength={strength}")]
        false = sum(r.outcome == TapOutcome.UNMOVED_REGISTERED for r in weak)
        print(f"| {strength:g} | {count(weak).unmoved} of {len(weak)} | {false} |", flush=True)
