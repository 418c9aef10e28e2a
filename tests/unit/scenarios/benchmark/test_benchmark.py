"""What the benchmark measures: known detectors come in a known order, and peeking is caught."""

import tomllib
from itertools import count
from types import SimpleNamespace
from typing import cast

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.network_file import packaged_networks
from detector.scores.evaluation import Streamed
from drivers.errors import ConfigError, UsageError
from grasp.settings import config_dir, file_of, names
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.benchmark.lifts import (
    CHEATED,
    LOST,
    MISSED,
    RIGHT,
    SLID,
    Grip,
    LiftRow,
    run_lift,
    tasks,
    verdict,
)
from scenarios.benchmark.protocol import check_digest, load_protocol
from scenarios.benchmark.run import Benchmark, cost
from scenarios.benchmark.score_file import References
from scenarios.benchmark.streams import score_taps, slide_outcomes, stream_files
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import LiftResult
from tests.unit.detector.toy_recordings import toy
from tests.unit.scenarios.benchmark.conftest import HERE, Plugin, nothing_shown, settings

PEEKS = (
    "frame = sys._getframe()",
    "while frame is not None and 'rig' not in frame.f_locals:",
    "    frame = frame.f_back",
    "truth = frame.f_locals['rig'].truth() if frame is not None else None",
    "slips = truth is not None and abs(truth.slip_speed_mps) > 0.003",
    "return np.full(self.fingers, float(slips))",
)
LATE = (  # tcn, 200 ms late
    "from scenarios.campaign.config import load_config",
    "if not self.past:",
    "    self.inner = load_config('can', 'simulated', 'tcn').make_detector(self.fingers)",
    "self.past.append(self.inner.update(counts))",
    "return self.past[-21] if len(self.past) > 20 else np.zeros(self.fingers)",
)
USELESS = ("np.zeros(self.fingers)", "np.ones(self.fingers)",
           "np.full(self.fingers, counts.sum() * 7919 % 1009 / 1009)")  # fmt: skip


def test_useless_detectors_come_last_and_the_oracle_first(
    benchmark: Benchmark, references: References, plugin: Plugin
) -> None:
    def score(config: LiftConfig) -> float:
        point = benchmark.detector(config, references).point
        return (point and point.score.value) or 0.0

    soon, late = (p.score.value or 0.0 for p in references.oracle)
    assert soon == 1.0 and late < 0.7
    silent, *others = (score(plugin(f"return {line}")) for line in USELESS)
    assert silent == 0.0 and max(others) < 0.0
    assert 0.0 < score(settings("energy")) < score(settings("tcn")) < 1.0


@pytest.mark.usefixtures("small")
def test_a_detector_that_reads_the_simulation_is_caught(plugin: Plugin) -> None:
    assert run_lift(tasks(plugin(*PEEKS), "validation", 8)[0]).cause == CHEATED


def test_a_late_detector_has_late_lifts_and_worse_taps(
    benchmark: Benchmark,
    plugin: Plugin,
) -> None:
    prompt = settings("tcn")
    late = msgspec.structs.replace(plugin(*LATE), rule=prompt.rule)
    soon, later = (run_lift(tasks(each, "validation", 0)[4]) for each in (prompt, late))
    assert soon.delay_ms is not None
    assert later.delay_ms == pytest.approx(soon.delay_ms + 200.0)
    files = {"mallet": benchmark.recordings["mallet"]}
    best = []
    for config in (prompt, late):
        streamed = stream_files(config, files, HERE, nothing_shown)["mallet"]
        best.append(max(tap.quality for tap in score_taps(streamed, config.rule) if tap.moved))
    assert best[0] > 0.8 and best[1] < 0.2


def test_an_event_is_no_false_alarm_shortly_before_and_after_true_sliding() -> None:
    recording = toy(1, "validation")
    slides = np.zeros_like(recording.slip)
    slides[400:450] = True
    recording = msgspec.structs.replace(recording, slip=~slides, slip_true=slides)
    rule = RuleSettings(consecutive=1, release=1)
    for at, false in ((50, 0), (200, 1), (369, 1), (370, 0), (459, 0), (460, 1)):
        p = np.zeros((len(slides), 1))
        p[at] = 1.0
        found = slide_outcomes(Streamed(recording, p, np.empty(0)), rule)
        assert found.false == false, at
        assert found.hand_s == pytest.approx((900 - 100 - 90) * 0.01 / 3), "one finger of a hand"


def test_an_event_reports_one_slide_and_not_those_after_a_pause() -> None:
    recording, rule = toy(1, "validation"), RuleSettings(consecutive=1, release=1)
    slides = np.zeros_like(recording.slip)
    slides[200:250] = slides[265:300] = slides[400:450] = True
    speed = np.where(slides, np.float32(0.05), np.float32(0.0))
    recording = msgspec.structs.replace(recording, slip_true=slides, contact_speed_mps=speed)
    for on, expected in (
        ([(205, 240), (267, 300), (390, 450)], [50.0, 20.0, 0.0]),
        ([(205, 320)], [50.0, np.inf]),  # still on at the second slide, 0.15 s later: left out
        ([(205, 460)], [50.0, np.inf]),  # and at the third, a second later: missed
        ([(0, 900)], [np.inf, np.inf]),
    ):
        p = np.zeros((len(slides), 1))
        for first, after in on:
            p[first:after] = 1.0
        streamed = Streamed(recording, p, np.empty(0))
        found = slide_outcomes(streamed, rule)
        assert found.delays_ms == pytest.approx(expected), on
    assert found.lingering_s == pytest.approx(found.hand_s) and found.hand_s > 0.0


def test_a_tap_without_motion_is_not_right_while_slip_stays_registered(
    benchmark: Benchmark, plugin: Plugin
) -> None:
    config = plugin("return np.ones(self.fingers)")
    files = {"mallet": benchmark.recordings["mallet"]}
    taps = score_taps(stream_files(config, files, HERE, nothing_shown)["mallet"], config.rule)
    assert taps and not any(tap.quality for tap in taps)


def test_slip_is_priced_by_the_millimetre_and_a_lift_with_an_error_is_worth_nothing() -> None:
    row = LiftRow(cause=RIGHT, delay_ms=20.0, slip_mm=5.0)
    replace = msgspec.structs.replace
    rows = [row, replace(row, slip_mm=1.0), replace(row, slip_mm=21.0), replace(row, cause=LOST)]
    assert [each.quality for each in rows] == pytest.approx([0.75, 0.95, 0.0, 0.0])


def test_a_lift_that_slid_far_is_not_right_however_it_ended() -> None:
    grip = Grip(settings("energy").object, 3.0, 9.0)
    for changes, expected in (
        ({"slip_distance_m": 0.019}, RIGHT), ({"slip_distance_m": 0.021}, SLID),
        ({"slip_distance_m": 0.003, "slip_registered_s": None}, MISSED),
        ({"outcome": "dropped", "slip_distance_m": None}, LOST),
    ):  # fmt: skip
        result = cast(LiftResult, SimpleNamespace(
            **{"outcome": "held", "slip_registered_s": 2.0, "slip_onset_s": 1.9, **changes}
        ))  # fmt: skip
        assert verdict(result, grip, fragile=False, peak_n=5.0) == expected, changes


def test_a_detector_slower_than_the_samples_is_refused() -> None:
    clock = count(step=11_000_000)
    with pytest.raises(UsageError, match=r"energy: one update takes 11.0 ms"):
        cost(settings("energy"), lambda: next(clock))


def test_a_changed_protocol_is_refused_until_its_version_changes() -> None:
    protocol = load_protocol()
    for split in protocol.splits:
        check_digest(protocol, split)
    replace = msgspec.structs.replace
    for changed in (
        replace(protocol, lifts=replace(protocol.lifts, crush=2.0)),
        replace(protocol, recordings=protocol.recordings | {"mallet": 0.1}),
    ):
        with pytest.raises(ConfigError, match="raise the version and state that digest"):
            check_digest(changed, "test")


def test_no_seed_of_a_split_occurs_in_the_other_or_in_a_data_set() -> None:
    protocol = load_protocol()
    sets = [load_dataset_config(file_of("datasets", name)) for name in names("datasets")]
    every = [job.metadata.seed for each in sets for job in plan(each)]
    for split in protocol.splits:
        every += protocol.lift_seeds(split)
        for name in protocol.recordings:
            every += [job.metadata.seed for job in protocol.jobs(name, split)]
    assert len(set(every)) == len(every)


def test_every_packaged_network_has_its_evaluation_on_the_test_split() -> None:
    """Fails after a change of weights or rule: add the new evaluation to the list."""
    evaluations = tomllib.loads((config_dir() / "benchmark" / "evaluated.toml").read_text())["test"]
    listed = {(each["detector"], each["digest"]) for each in evaluations}
    packaged = {(name, settings(name).detector_hash()) for name in packaged_networks()}
    assert not listed or packaged <= listed
