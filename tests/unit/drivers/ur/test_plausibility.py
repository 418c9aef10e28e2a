"""Plausibility of an arm's status."""

import math

import msgspec

from drivers.ur.link.preflight import ArmStatus, implausible_values

AT_REST = ArmStatus(1.0, (0.1, -1.5, 1.6, -1.6, -1.5, 0.0), (0.5, 0.1, 0.3, 0.0, 3.1, 0.0),
                 (0.0,) * 6, 7, 1, 1, 0.5)  # fmt: skip
LATER = msgspec.structs.replace(AT_REST, t_s=1.08)
replace = msgspec.structs.replace


def test_impossible_values_are_found() -> None:
    for status, text in [
        (replace(LATER, t_s=1.0), "stands still"),
        (replace(LATER, joints_rad=(0.0,) * 6), "exactly 0"),
        (replace(LATER, pose=(math.nan, *AT_REST.pose[1:])), "not numbers"),
        (replace(LATER, pose=(0.5, 3.0, *AT_REST.pose[2:])), "beyond any arm's reach"),
        (replace(LATER, pose=(0.6, *AT_REST.pose[1:])), "100 mm at no speed"),
    ]:
        found = implausible_values(status, AT_REST)
        assert any(text in finding for finding in found), (status, text)
