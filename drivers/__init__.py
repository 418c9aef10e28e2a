"""Device drivers, one folder a device, the same names in each; what holds nothing is left out.

``protocol``: bytes and nothing else. ``driver``: the client that a lab uses, a core without thread,
clock or sleep. ``link/``: from that core to the wire. ``model``: what the device does, its time an
argument. ``emulator/``: the model behind the real wire. The first three import neither of the last.
"""
