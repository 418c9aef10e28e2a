"""Training and export of networks: the one place that needs torch."""
