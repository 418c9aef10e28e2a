"""A run: the control loop on devices, its clock, signals and recording."""
