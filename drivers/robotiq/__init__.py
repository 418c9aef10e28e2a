"""Robotiq 3-Finger Adaptive Gripper: registers, driver core and a model of the hand."""
