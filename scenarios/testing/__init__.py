"""Emulated devices as pytest fixtures, also for other projects."""
