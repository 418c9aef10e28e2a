"""Device drivers: one folder a device, the same four files in each."""
