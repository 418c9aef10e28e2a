"""Calibrations for tests of what stands below configuration files."""

from drivers.robotiq.calibration import GripperCalibration

PAPER = GripperCalibration(name="paper", source="Grover et al. 2022", least_force_n=10.0)
MANUAL = GripperCalibration(name="manual", source="manual p. 47", least_force_n=15.0)
