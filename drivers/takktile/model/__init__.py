"""Simulation model of a TakkTile board: firmware, bytes, and a link without a wire."""
