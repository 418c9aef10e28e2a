"""From the gripper driver to the wire: Modbus, the thread that pumps, and how long replies take."""
