"""Calibrations for tests that use no configuration files."""

from drivers.robotiq.calibration import GripperCalibration

PAPER = GripperCalibration(name="paper", source="Grover et al. 2022", least_force_n=10.0)
PRESSED = ("calibration.pressed_bytes=[0]", "calibration.presses=10")
# the packaged `paper`, as a lab may believe it: whose byte 0 was pressed on a scale
OF_A_LAB = """[calibration]
source = "the emulated hand, which obeys `paper`"
least_force_n = 10.0
pressed_bytes = [0]
presses = 10
"""
MANUAL = GripperCalibration(name="manual", source="manual p. 47", least_force_n=15.0)
