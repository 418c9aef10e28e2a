"""The emulated devices as pytest fixtures, for any project."""
