"""Pages that follow a run while it lasts."""
