"""What the gripper does, its time an argument: registers, fingers, motors."""
