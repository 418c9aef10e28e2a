"""Plausibility checks of what devices report. ``checks`` has the table of all of them."""
