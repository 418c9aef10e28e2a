"""Campaigns: a grid of simulated trials, run in parallel, one database row each."""
