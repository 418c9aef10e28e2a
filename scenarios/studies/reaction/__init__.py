"""What a millisecond of reaction is worth, and where the loop would hunt."""
