"""The board model behind USB transfers."""
