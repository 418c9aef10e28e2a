"""The mallet tap (paper, section V-B)."""
