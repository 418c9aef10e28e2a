"""The application: a grasp controller that feels slip. Importing this package imports nothing."""
