"""A lab's first days: devices found, looked at, moved by hand in small steps, calibrated."""
