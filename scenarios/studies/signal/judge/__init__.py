"""Judges a data set beside a real clip: its statistics, and whether one can tell the two apart."""
