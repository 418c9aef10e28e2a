"""The simulated fingertip beside a real one: strokes, their statistics, the fit."""
