"""Properties of a recording that make its scores worthless, in words for a user."""

from detector.recordings import Recording
from drivers.interfaces import FINGER_NAMES

MOST_NOISE_COUNTS = 5  # of an unloaded taxel, at most


def suspicions(recording: Recording) -> list[str]:
    """One line for each suspicious property; empty for an ordinary recording."""
    counts = recording.counts
    flat = counts.reshape(len(counts), -1)
    found = []
    means = counts.mean(axis=2)
    highest, lowest = means.max(axis=0), means.min(axis=0)
    if (raised := (highest > MOST_NOISE_COUNTS) & (highest > -lowest)).any():
        i = int(raised.argmax())
        found.append(
            f"the mean of {FINGER_NAMES[i]}'s counts goes up to {highest[i]:.0f} and down to "
            f"{lowest[i]:.0f}: pressing must lower the counts. Rest is not subtracted, or the sign "
            "is opposite (`grasp dataset import` --rest-seconds, --sign)"
        )
    same = (flat == flat[0]).all(axis=0)
    if same.any():
        taxels = [f"p{i}" for i in range(recording.taxels)]
        names = [f"{f} {p}" for f in FINGER_NAMES[: recording.fingers] for p in taxels]
        names = taxels if recording.fingers == 1 else names
        stuck = ", ".join(name for name, each in zip(names, same, strict=True) if each)
        found.append(f"channels that never change: {stuck}. Check their cables and columns")
    repeated = (flat[1:] == flat[:-1]).all(axis=1)
    if 0.4 < repeated.mean() < 0.6 and (repeated[1:] & repeated[:-1]).mean() < 0.05:
        found.append("frames repeat in pairs: 50 Hz held to 100 Hz. Detectors are made for 100 Hz")
    if recording.labelled and recording.slip.all() == recording.slip.any():
        value = int(recording.slip[0])
        found.append(f"the label `slip` is {value} throughout: scores of slips mean nothing")
    return [f"{recording.source}: {line}" for line in found]
