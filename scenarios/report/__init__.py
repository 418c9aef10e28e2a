"""What a run looks like afterwards."""
