"""Experiments: scripted scenarios, their scoring, and the simulated world they run in."""

from grasp.files import use_writable_cache

use_writable_cache()  # before a module below is compiled
