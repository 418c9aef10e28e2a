"""Whole data sets: what they hold, in what order of chance, and how they are made."""
