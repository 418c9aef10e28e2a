"""Run one lift in virtual time, print its verdict and write its HTML page."""

import grasp

lift = grasp.lift(object="can", seed=0)
print(lift.verdict)
print(f"slip registered after {lift.result.detection_latency_ms:.0f} ms")
print(f"highest force of the thumb {lift.true_force_n[:, 0].max():.1f} N")
print(lift.page("can.html"))
