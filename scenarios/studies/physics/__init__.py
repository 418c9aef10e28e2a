"""Contact models compared: scenes, the planner that chooses one, stability, cost of accuracy."""
