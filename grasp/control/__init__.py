"""The computation of a control step: from an observation to admitted commands.

Nothing here reads a clock, a device or a file.
"""
