"""Lift with a policy that does not notice slip, with the reflex and without it.

It needs gymnasium: make install-gym, or elsewhere pip install 'grasp-controller[gym]'.
"""

import gymnasium
import numpy as np

GRIP = np.array([55, 55, 55])  # finger positions of a weak grip of the can


def policy(obs, step):
    """Close to the weak grip, and lift after two seconds, whatever happens."""
    fingers = np.clip((GRIP - obs["fingers"]) / 5, -1, 1)  # targets, in units of 5 counts
    arm = 1.0 if step > 200 else 0.0
    return np.array([*fingers, arm], np.float32)


for reflex in (False, True):
    env = gymnasium.make("grasp.gym:grasp/Lift-v0", object="can", reflex=reflex)
    obs, info = env.reset(seed=0)
    for step in range(600):
        obs, reward, terminated, truncated, info = env.step(policy(obs, step))
        if terminated or truncated:
            break
    print(f"reflex {reflex}: the object is {1e3 * info['height_m']:.0f} mm above the table,")
    print(f"   highest force {info['peak_force_n']:.1f} N")
