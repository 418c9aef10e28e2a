"""The generated part of docs/faults.md."""

from collections.abc import Sequence

from scenarios.studies.faults.run import Ended


def generated(ended: Sequence[Ended], codes: Sequence[str]) -> str:
    """In Markdown."""
    return f"{len(ended)} runs at {codes}\n"
