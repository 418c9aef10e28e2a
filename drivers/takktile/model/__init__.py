"""What a TakkTile board does, its time an argument: firmware, bytes, and a link without a wire."""
