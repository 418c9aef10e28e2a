"""Shared by tests of the driver core: a hand with a short activation, and a rig in contact."""

from drivers.interfaces import Detection
from drivers.robotiq.model.gripper import HandSettings

MS = 1_000_000


FAST = 0.11


RIGID = 5000.0


QUICK = HandSettings(activation_s=0.1)


ALL = (True, True, True)


THUMB = (True, False, False)


def gripped(rig, springs, **kwargs):
    """A rig whose three fingers are in contact with rigid objects at force byte 0."""
    made = rig(springs=springs([RIGID] * 3, [0.03] * 3), **kwargs)
    made.driver.close_to_limit(10.0, ALL, (255, 255, 255), FAST)
    made.settle()
    assert [f.detection for f in made.state.fingers] == [Detection.CONTACT_CLOSING] * 3
    return made
