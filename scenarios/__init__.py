"""Experiments: scripted scenarios, their scoring, and the world they run in."""
