"""What can be wrong with the link to a board, in words: one place for every kind of link."""

from drivers.errors import DeviceFault, LinkLost

HUNG = "the tactile board hangs: its firmware waits on the sensor bus for ever"
HUNG_REMEDY = "unplug the board, plug it in again, open it again"


def unplugged() -> LinkLost:
    return LinkLost(
        "the tactile board is unplugged", "check its USB cable and plug it in, then start again"
    )


def stalled() -> DeviceFault:
    return DeviceFault(
        "the tactile board refused a USB transfer (STALL)",
        "open it again; if that fails, update its firmware",
    )
