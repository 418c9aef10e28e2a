"""How heavy may a can be? The same lift with more and more in it."""

import grasp

for mass_kg in (0.1, 0.3, 0.6):
    lift = grasp.lift(object="can", detector="energy", settings={"object.mass_kg": mass_kg})
    print(f"{mass_kg:.1f} kg: {lift.verdict}")
