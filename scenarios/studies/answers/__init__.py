"""What an answer to slip is worth: force against slip, and success against severity."""
