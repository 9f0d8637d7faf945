"""The report as one HTML file that opens offline: everything it needs is inside, and it may ask the network nothing."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from ..schemas.project import Project
from ..schemas.store import publish_text
from .blocks import Figure, Section
from .sections import Content

if TYPE_CHECKING:
    from markupsafe import Markup


def write_report(project: Project) -> Path:
    """Write `report/index.html` from what the project holds; what is not there yet is said on the page.

    Args:
        project: The project; only its manifest, tables, events, results and models are read.

    Returns:
        The file. The same project and versions give the same bytes.

    Raises:
        InputError: The project file or the manifest is missing or wrong. Other wrong files are problems on the page.
    """
    content = Content(project)
    publish_text(project.report_file, render(content.config.vehicle.name, content.sections()))
    return project.report_file


def render(title: str, sections: Sequence[Section]) -> str:
    """Return the page; all text is escaped, and only the two scripts that are part of it may run."""
    from jinja2 import Environment, StrictUndefined
    from plotly.offline import get_plotlyjs

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"figure_json": figure_json, "prose": prose, "source_hash": source_hash}
    template = environment.from_string((files(__package__) / "page.html").read_text(encoding="utf-8"))
    return template.render(title=title, sections=sections, plotly=get_plotlyjs())


def figure_json(figure: Figure) -> str:
    """Return a plotly figure as JSON that may stand within a script element whatever its names hold."""
    from plotly.io import to_json

    encoded: str = to_json(figure.figure, validate=False)
    return encoded.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


def prose(text: str) -> Markup:
    """Return a sentence, escaped, with what stands between backticks as code."""
    from markupsafe import Markup

    parts = text.split("`")
    whole = len(parts) % 2 == 1
    return Markup().join(  # It escapes what is not Markup.
        Markup("<code>{}</code>").format(part) if whole and number % 2 else part for number, part in enumerate(parts)
    )


def source_hash(script: str) -> Markup:
    """Return a script's source expression for the content security policy, which then lets no other script run."""
    from markupsafe import Markup

    return Markup(f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'")  # noqa: S704
