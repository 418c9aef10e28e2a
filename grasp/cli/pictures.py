"""Pictures that verbs draw, and the numbers in them, beside them as JSON."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli.places import file_to_write
from grasp.files import write_whole

PICTURES = (".svg", ".png", ".pdf")


def picture(text: str) -> Path:
    """Reads the name of a picture: one of a kind that can be drawn, before anything is computed."""
    path = Path(text)
    if path.suffix not in PICTURES:
        kinds = f"{', '.join(PICTURES[:-1])} or {PICTURES[-1]}"
        raise argparse.ArgumentTypeError(f"{text!r}: a name that ends in {kinds}")
    return file_to_write(text)


def add_picture(parser: argparse.ArgumentParser, name: str, beside: str = "its numbers go") -> None:
    """`--out FILE`, with a picture of that name where none is said."""
    parser.add_argument(
        "--out", type=picture, default=f"{name}.svg", metavar="FILE",
        help=f"picture to write, .svg, .png or .pdf; {beside} beside it as .json "
        "(default: %(default)s)",
    )  # fmt: skip


def write_numbers(out: Path, numbers: Any) -> None:
    """What a picture shows, beside it as .json."""
    import msgspec

    text = msgspec.json.format(msgspec.json.encode(numbers), indent=1)
    write_whole(out.with_suffix(".json"), text + b"\n")
