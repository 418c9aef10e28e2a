"""The paper's network in variants: what each is, what it is scored on, what is not done twice."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

pytest.importorskip("torch")

from detector.network_file import read_network
from scenarios.studies.detectors.variants import (
    ABLATIONS,
    SAMPLES_PER_STEP,
    Sets,
    Variant,
    settings_of,
    table,
    train,
    window_variants,
)
from tests.unit.detector.toys import toys

pytestmark = pytest.mark.train

SETS = Sets(toys("train", 3, 0), toys("validation", 2, 20), toys("test", 2, 40))


def test_every_window_has_the_same_budget_of_samples() -> None:
    for variant in window_variants((10, 50, 100)):
        s = settings_of(variant, 100, 0)
        assert s.batch * (s.warm + s.crop) == SAMPLES_PER_STEP
        assert (s.warm + s.crop, s.window) == (variant.window, variant.window)


def test_ablations_differ_from_the_first_in_one_thing_each() -> None:
    first = msgspec.structs.asdict(ABLATIONS[0])
    for other in ABLATIONS[1:]:
        changed = {k for k, v in msgspec.structs.asdict(other).items() if v != first[k]}
        assert len(changed - {"name"}) == 1
    assert {a.augmentation for a in ABLATIONS} == {"none", "paper", "as-run", "ours"}


def test_a_variant_is_trained_once_and_scored_on_the_split_test(tmp_path: Path) -> None:
    told: list[int] = []
    variant = Variant("window 20", window=20)
    first = train(variant, 3, 1, SETS, tmp_path, lambda step, steps: told.append(step))
    assert told == [1, 2, 3]
    assert (first.seed, first.steps) == (1, 3)
    assert read_network(tmp_path / "window-20-1.onnx").card.window == 20
    again = train(variant, 3, 1, SETS, tmp_path, lambda step, steps: told.append(step))
    assert told == [1, 2, 3]
    assert again.accuracy == first.accuracy
    train(variant, 4, 1, SETS, tmp_path, lambda step, steps: told.append(step))
    assert told[3:] == [1, 2, 3, 4]
    assert "| window 20 | 1 | 3 (0.0) |" in table([first])


def test_a_network_without_layer_norm_has_fewer_parameters(tmp_path: Path) -> None:
    train(Variant("bare", norm=False), 2, 0, SETS, tmp_path, lambda step, steps: None)
    assert read_network(tmp_path / "bare-0.onnx").card.parameters == 10_070 - 8 * 24 - 2 * 48


def test_the_picture_has_a_point_for_every_training(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from scenarios.studies.detectors.window_figure import draw_windows

    rows = [
        train(v, 1, 0, SETS, tmp_path, lambda step, steps: None) for v in window_variants((10, 20))
    ]
    assert np.isfinite([r.accuracy for r in rows]).all()
    out = tmp_path / "windows.svg"
    draw_windows(rows, out)
    assert "window, samples of 10 ms" in out.read_text()
