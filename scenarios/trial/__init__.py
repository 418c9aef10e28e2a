"""One trial: execution, recording, verdict, replay."""
