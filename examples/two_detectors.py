"""What two detectors say of the same fingertips, without running anything again."""

import numpy as np

import grasp

lift = grasp.lift(object="box", seed=1)
heard = ~np.isnan(lift.counts).any(axis=(1, 2))  # rest counts had been taken
frames = lift.counts[heard].astype(np.int16)  # (n, 3, taxels)

for name in ("tcn", "energy"):
    detector = grasp.detector(name)
    p = np.array([detector.update(frame) for frame in frames])  # (n, 3), one row in 10 ms
    at = lift.t_s[heard][p.max(axis=1).argmax()]
    print(f"{name}: surest of slip at {at:.2f} s, p = {p.max():.2f}")
print(f"truly slipping since {lift.result.slip_onset_s:.2f} s")
