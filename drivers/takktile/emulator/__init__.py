"""Emulated board: the model behind USB transfers."""
