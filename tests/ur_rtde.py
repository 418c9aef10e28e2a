"""Mark of tests that drive an arm by ur_rtde, which not every Python and platform has."""

from importlib.util import find_spec

import pytest

needs_ur_rtde = pytest.mark.skipif(
    find_spec("rtde_control") is None, reason="ur-rtde has no wheel for this Python or platform"
)
