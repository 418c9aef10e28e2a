"""The Python API of `import grasp`: functions that return typed, frozen results with arrays."""
