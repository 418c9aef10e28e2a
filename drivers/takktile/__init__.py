"""TakkTile barometric fingertips on the TakkTile USB board."""
