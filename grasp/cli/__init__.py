"""The `grasp` command: `main` reads it, one file a group of verbs."""
