"""One trial: run, record, judge, replay."""
