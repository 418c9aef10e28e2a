"""The parts of a session that records labelled slip data: press, motion, rigs, world."""
