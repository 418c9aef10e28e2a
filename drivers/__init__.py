"""Device drivers, one folder per device, with the same module names in each.

``protocol``: encoding of bytes. ``driver``: the client, without thread, clock or sleep. ``link``:
connection of the driver to the wire. ``model``: simulation of the device; time is an argument.
``emulator``: the model behind the real wire. The first three import neither model nor emulator.
"""
