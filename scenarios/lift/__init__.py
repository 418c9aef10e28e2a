"""The object lift (paper, section V-C)."""
