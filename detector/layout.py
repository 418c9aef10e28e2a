"""What a detector says of fingertips that it was not made for."""

from drivers.errors import UsageError


def check_layout(name: str, made_for: int, taxels: int) -> None:
    """Raises UsageError when a detector for fingertips of so many taxels meets others."""
    if made_for != taxels:
        raise UsageError(
            f"detector {name!r} was made for fingertips of {made_for} taxels, not of {taxels}",
            "train one on recordings of this layout (`grasp detector train`), or take `energy`",
        )
