"""Opens hands: simulated, emulated, hardware; and what a trial's seed makes of the world."""
