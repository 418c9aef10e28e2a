"""Detectors compared on data sets, tuned and drawn."""
