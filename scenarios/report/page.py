"""Pages that open from disk: template, style, scripts and data in one file that asks for nothing.

Whatever a recording says is a stranger's text: Jinja escapes it, data travel as JSON that holds no
`<`, and the page's own policy lets a browser run nothing but the scripts that were put in here.
"""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

PARTS = Path(__file__).parent / "page"
BEGINS = "<!doctype html>\n<!-- made by grasp report -->"  # how a page of ours is told from others
STYLES = ("uplot/uPlot.min.css", "page.css")


def render(template: str, scripts: Sequence[str], connect: str = "'none'", **context: Any) -> str:
    """The page of a template in `page/`, with these scripts of there; most need `data.js` first.

    ``connect``: the one address that they may speak to. ``context`` goes to the template; `data` of
    it becomes JSON for the scripts (`data.js`).
    """
    style = "\n".join(_part(name) for name in STYLES)
    script = "\n".join(_part(name) for name in scripts)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_fingerprint(style)}; "
        f"script-src {_fingerprint(script)}; connect-src {connect}; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _templates().get_template(template)
    # none of this is foreign text
    own = {"begins": Markup(BEGINS), "style": Markup(style), "script": Markup(script)}
    return page.render(**own, policy=Markup(policy), **context)


@cache
def _part(name: str) -> str:
    return (PARTS / name).read_text("utf-8").strip()


def _fingerprint(text: str) -> str:
    """As a content security policy names an inline style or script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _templates() -> Environment:
    return Environment(
        loader=FileSystemLoader(PARTS), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
