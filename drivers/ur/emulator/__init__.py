"""Emulated UR10 controller on a loopback address: RTDE, dashboard and URScript."""
