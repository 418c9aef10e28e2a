"""Experiments: scripted scenarios, their scoring, and the simulated world they run in."""
