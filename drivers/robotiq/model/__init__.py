"""Simulation model of the gripper: registers, fingers, motors. Time is an argument."""
