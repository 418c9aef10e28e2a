"""Apply two detectors to the fingertip data of one recorded lift."""

import numpy as np

import grasp

lift = grasp.lift(object="box", seed=1)
valid = ~np.isnan(lift.counts).any(axis=(1, 2))  # after rest counts were taken
frames = lift.counts[valid].astype(np.int16)  # (n, 3, taxels)

for name in ("tcn", "energy"):
    detector = grasp.detector(name)
    p = np.array([detector.update(frame) for frame in frames])  # (n, 3), one row in 10 ms
    at = lift.t_s[valid][p.max(axis=1).argmax()]
    print(f"{name}: highest probability of slip at {at:.2f} s, p = {p.max():.2f}")
print(f"true onset of slip at {lift.result.slip_onset_s:.2f} s")
