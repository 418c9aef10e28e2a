"""Scores of detectors: samples, events, intervals, sweeps and the paper's tables."""
