"""Of the tests here that move hand and arm: a lab, started once a file, its hand not yet active."""

from collections.abc import Iterator

import pytest

from tests.wire.scenarios.lab.bench import Lab
from tests.wire.scenarios.test_rigs import emulate


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate("--set", "hand.activation_s=3") as endpoints:
        found = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        yield found
        found.cell.close()


@pytest.fixture
def ready(lab: Lab) -> Lab:
    """With an active hand, whichever test was first."""
    lab.done("gripper", "activate", "--empty")
    return lab
