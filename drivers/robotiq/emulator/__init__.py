"""The gripper model behind real wires, with framing of its own."""
