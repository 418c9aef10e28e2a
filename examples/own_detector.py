"""A detector plugin that measures the vibration of a fingertip.

grasp run lift --object can --detector own_detector.py:Tremble --set plugin.counts=9
"""

import numpy as np


class Tremble:
    """A running mean of the change from frame to frame, as a probability."""

    threshold = 0.5  # probability above which a sample is slip
    memory = 0  # samples that the output depends on; 0: unbounded

    # optional parameters: fingers, taxels, and settings of section `plugin`
    def __init__(self, fingers, counts=12.0):
        self.fingers, self.counts = fingers, counts

    def reset(self):
        self.last, self.mean = None, np.zeros(self.fingers)

    def update(self, counts):  # (fingers, taxels) int16, raw minus rest, every 10 ms
        frame = counts.astype(float)
        change = np.abs(frame - (frame if self.last is None else self.last)).mean(axis=1)
        self.last, self.mean = frame, 0.8 * self.mean + 0.2 * change
        return self.mean**4 / (self.mean**4 + self.counts**4)  # (fingers,), 0 to 1


if __name__ == "__main__":
    import grasp

    for name in ("can", "box"):
        print(grasp.lift(object=name, detector=f"{__file__}:Tremble").verdict)
