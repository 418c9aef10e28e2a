"""What `import grasp` offers: calls of one line that return typed, frozen results with arrays."""
