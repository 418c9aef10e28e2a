"""What a lift does when something fails: generated faults at the devices, in virtual time."""
