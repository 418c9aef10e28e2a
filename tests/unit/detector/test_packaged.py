"""The networks that come with the project load, answer, and know where they are from."""

import numpy as np
import pytest

from detector.interface import DETECTORS, load_detector
from detector.network_file import packaged_networks, read_network, weights_path
from grasp.settings import names


def test_every_packaged_detector_has_its_settings_and_none_is_missing() -> None:
    assert set(names("detectors")) == set(DETECTORS)
    assert {"tcn", "gru", "tcn-paper"} <= set(packaged_networks())


@pytest.mark.parametrize("name", packaged_networks())
def test_a_packaged_network_answers_for_three_fingers(name: str) -> None:
    card = read_network(weights_path(name)).card
    assert card.name == name
    assert card.data_digest
    assert weights_path(name).stat().st_size < 1_000_000
    detector = load_detector(name, {}, 3)
    p = [detector.update(np.zeros((3, 6), np.int16)) for _ in range(120)]
    assert np.all((np.array(p) >= 0) & (np.array(p) <= 1))
