"""From when on a device is not believed (``grasp.doubt``)."""

from typing import Annotated

import msgspec
from msgspec import Meta


class DoubtSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """From when on a device is not believed. "measured": in docs/faults.md, with margins."""

    frozen_samples: Annotated[
        int,
        Meta(ge=2, le=1000, description="repeats in a row of all codes of all fingertips; measured "
             "on the simulated fingertip, which is quieter than the real recording"),
    ] = 8  # fmt: skip
    dead_samples: Annotated[
        int,
        Meta(ge=2, le=10000, description="repeats in a row of all codes of one fingertip that is "
             "loaded; measured likewise: 11 come by chance in a firm grip"),
    ] = 16  # fmt: skip
    dead_unloaded_samples: Annotated[
        int,
        Meta(ge=2, le=10000, description="of one that is not: quiet by itself; "
             "assumed, from the noise of the real one, 0.21 counts"),
    ] = 50  # fmt: skip
    repeat_chance: Annotated[
        float,
        Meta(gt=0.0, le=0.1, description="a fingertip, or a hand in the air, is doubted no sooner "
             "than after repeats as unlikely as this, by how often its codes have changed in the "
             "run: a quiet sensor is no frozen one; a loaded one before stuck_samples anyhow. "
             "Assumed"),
    ] = 1e-7  # fmt: skip
    loaded_counts: Annotated[
        int, Meta(ge=5, le=500, description="a taxel so far from its rest, and not at a rail, is "
                  "loaded; assumed, twice what warming up shifts it")
    ] = 30  # fmt: skip
    stuck_samples: Annotated[
        int,
        Meta(ge=10, le=10000, description="a taxel that has repeated itself so often in a row "
             "cannot tell; assumed: at 0.3 counts of noise it comes by chance once in a day"),
    ] = 100  # fmt: skip
    living_share: Annotated[
        float,
        Meta(ge=0.0, le=1.0, description="of each fingertip's taxels, so many live or the arm does "
             "not lift; assumed: detectors learn with one of six dead, next to never with four"),
    ] = 0.5  # fmt: skip
    rail_samples: Annotated[
        int,
        Meta(ge=1, le=100, description="samples in a row with a whole fingertip at code 0 or 1023; "
             "assumed"),
    ] = 3  # fmt: skip
    jump_counts: Annotated[
        int,
        Meta(ge=5, le=1023, description="by which all taxels of all fingertips change one way from "
             "one sample to the next; measured: contact and taps leave some nearly as they were"),
    ] = 40  # fmt: skip
    detector_s: Annotated[
        float, Meta(ge=0.01, le=10.0, description="a step, its detector above all, may take; "
                    "assumed, five times the paper's 0.021 s")
    ] = 0.1  # fmt: skip
    standstill_s: Annotated[
        float, Meta(ge=0.02, le=10.0, description="a step may begin later than it should; assumed, "
                    "half of the shortest standstill that has been seen to lose an object")
    ] = 0.15  # fmt: skip
    echo_s: Annotated[
        float, Meta(ge=0.03, le=10.0, description="until the gripper's status speaks of a command; "
                    "assumed: two exchanges and two register refreshes are 0.04 s")
    ] = 0.15  # fmt: skip
    finger_start_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="a finger that reports motion may keep its count "
                    "after a request; assumed: latency up to 0.15 s, two refreshes, lag, a count")
    ] = 0.3  # fmt: skip
    stands_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="one that is under way may: a count at least "
                    "speed takes 0.035 s, from stall to contact 0.03 s, two refreshes; assumed")
    ] = 0.15  # fmt: skip
    pressing_ma: Annotated[
        int, Meta(ge=0, le=3000, description="a finger whose motor draws so much presses on "
                  "something; manual p. 68-73: 110-160 mA moving freely")
    ] = 200  # fmt: skip
    pressing_s: Annotated[
        float, Meta(ge=0.05, le=30.0, description="one that presses may keep its count: at its "
                    "force it creeps, above 0.001 m/s at times, or it would report contact; "
                    "assumed, a count at half that")
    ] = 2.0  # fmt: skip
    target_counts: Annotated[
        int, Meta(ge=1, le=100, description="a finger 'at target' may be off it; a zero is off by "
                  "up to 5, manual p. 74")
    ] = 8  # fmt: skip
    contact_counts: Annotated[
        int, Meta(ge=1, le=100, description="a finger that reports contact stands; it may move by "
                  "this while it does; assumed")
    ] = 3  # fmt: skip
    soft_low_counts: Annotated[
        int, Meta(ge=0, le=100, description="targets below are cut by a software limit of opening")
    ] = 20
    soft_high_counts: Annotated[
        int, Meta(ge=100, le=255, description="targets above are cut by one of closing")
    ] = 200
    finger_counts_ps: Annotated[
        float, Meta(ge=50.0, le=5000.0, description="no finger is faster; twice full speed, "
                    "manual: 0.11 m/s, some 143 counts/s")
    ] = 300.0  # fmt: skip
    arm_start_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="from a command until the arm moves; assumed")
    ] = 0.25
    arm_frozen_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="an arm on its way may keep its place, beside the "
                    "time that it takes to turn round; assumed, seven controller cycles")
    ] = 0.06  # fmt: skip
    arm_moved_m: Annotated[
        float, Meta(ge=1e-6, le=0.01, description="less than this is no motion; assumed: a "
                    "third of what the slowest way covers in arm_frozen_s")
    ] = 0.0001  # fmt: skip
    arm_standing_mps: Annotated[
        float, Meta(ge=1e-5, le=0.05, description="an arm that stands reports no more; assumed, as "
                    "the arm's link")
    ] = 0.001  # fmt: skip
    arm_line_m: Annotated[
        float, Meta(ge=1e-5, le=0.05, description="a target that is no further aside from where "
                    "the arm is going lies ahead: it need not turn round; assumed")
    ] = 0.001  # fmt: skip
    arm_there_m: Annotated[
        float,
        Meta(ge=1e-4, le=0.01, description="so close to its target it need not move: not more "
             "than the 1 mm of grasp/lift_line.py; assumed"),
    ] = 0.001  # fmt: skip
    arm_astray_m: Annotated[
        float, Meta(ge=5e-4, le=0.1, description="away from its target, beyond braking; assumed")
    ] = 0.002
    arm_fastest_mps: Annotated[
        float, Meta(ge=0.1, le=10.0, description="no arm of this kind is faster; UR manual: 1 m/s")
    ] = 1.0
    arm_jump_m: Annotated[
        float, Meta(ge=1e-3, le=0.5, description="beside that: samples come late; assumed")
    ] = 0.01
    arm_slider_s: Annotated[
        float, Meta(ge=0.01, le=30.0, description="an arm may need to come from standing to full "
                    "pace once its speed slider is turned up; assumed")
    ] = 1.0  # fmt: skip
