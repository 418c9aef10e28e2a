"""Experiments by the hundred: a grid of trials, run in parallel, one row each, nothing lost."""
