"""Labelled slip data as the paper recorded it: one fingertip pressed on a surface and stroked."""
