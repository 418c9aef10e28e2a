"""Hook of MkDocs: a link out of `docs/`, to a file of the checkout, is shown as its path."""

import re

OUTSIDE = re.compile(r"\[([^\]]*)\]\((?:\.\./)+([^)#]+)(?:#[^)]*)?\)")


def on_page_markdown(markdown: str, **_: object) -> str:
    """As MkDocs calls it for each page."""
    return OUTSIDE.sub(_as_path, markdown)


def _as_path(link: re.Match[str]) -> str:
    text, path = link[1], link[2]
    return f"`{path}`" if path.endswith(text.strip("`")) else f"{text} (`{path}`)"
