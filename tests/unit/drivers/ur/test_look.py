"""What an arm says of itself is doubted where it cannot be."""

import math

import msgspec

from drivers.ur.link.preflight import ArmLook, doubts

STANDS = ArmLook(1.0, (0.1, -1.5, 1.6, -1.6, -1.5, 0.0), (0.5, 0.1, 0.3, 0.0, 3.1, 0.0),
                 (0.0,) * 6, 7, 1, 1, 0.5)  # fmt: skip
LATER = msgspec.structs.replace(STANDS, t_s=1.08)
replace = msgspec.structs.replace


def test_what_no_arm_says_is_doubted() -> None:
    for said, word in [
        (replace(LATER, t_s=1.0), "stands still"),
        (replace(LATER, joints_rad=(0.0,) * 6), "exactly 0"),
        (replace(LATER, pose=(math.nan, *STANDS.pose[1:])), "no numbers"),
        (replace(LATER, pose=(0.5, 3.0, *STANDS.pose[2:])), "beyond any arm's reach"),
        (replace(LATER, pose=(0.6, *STANDS.pose[1:])), "100 mm at no speed"),
    ]:
        assert any(word in doubt for doubt in doubts(said, STANDS)), (said, word)
