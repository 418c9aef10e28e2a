"""Blows on a held object, as a recording's metadata lists them: what moved it, and what did not."""

import msgspec
import numpy as np

from detector.recordings import Recording

KINDS = frozenset({"near", "mallet", "weak", "elastic"})
WEAK = "weak"  # with 5 to 70 % of what moves it: next to nothing comes of most of these
MOVED_M = 0.001  # for good: a blow that a detector has to register
UNMOVED_M = 0.0005  # within this it stays: one that it must not
WATCHED_S = 0.5  # after a blow, or until the next act
MOTION_S = 0.1  # after a blow its motion begins, or never


class Blow(msgspec.Struct, frozen=True):
    """Samples of a recording: the first after it struck, the first of motion (or the same), and the
    first that is not its own any more."""

    struck: int
    onset: int
    until: int
    moved_m: float
    weak: bool

    @property
    def moved(self) -> bool:
        return self.moved_m >= MOVED_M

    @property
    def unmoved(self) -> bool:
        return self.moved_m < UNMOVED_M


def blows_of(recording: Recording) -> list[Blow]:
    """Every blow of a recording, in the order of time; none where nobody noted any."""
    acts = recording.metadata.acts if recording.metadata else ()
    t_s = recording.t_s - recording.t_s[0]
    starts_s = [act.t_s for act in acts] + [np.inf]
    found = []
    for act, next_s in zip(acts, starts_s[1:], strict=True):
        if act.kind not in KINDS:
            continue
        struck, motion, until = np.searchsorted(
            t_s, [act.t_s, act.t_s + MOTION_S, min(next_s, act.t_s + WATCHED_S)], side="right"
        ).tolist()
        onset = struck
        if recording.slip_true is not None and recording.slip_true[struck:motion].any():
            onset += int(recording.slip_true[struck:motion].argmax())
        if struck < until:
            found.append(Blow(struck, onset, until, act.moved_m, act.kind == WEAK))
    return found
