"""Training and export of networks. Only this package needs torch."""
