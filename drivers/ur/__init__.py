"""Universal Robots UR10 arm (CB3)."""
