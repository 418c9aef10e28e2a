"""Find the mass at which a can is too heavy for the force limit: lift cans of different masses."""

import grasp

for mass_kg in (0.3, 1.2, 1.5):
    lift = grasp.lift(object="can", detector="energy", settings={"object.mass_kg": mass_kg})
    print(f"{mass_kg:.1f} kg: {lift.verdict}")
