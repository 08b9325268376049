"""Render the report's templates: the package's, or a lab's own."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import (
    ChoiceLoader,
    FileSystemLoader,
    PackageLoader,
    PrefixLoader,
    StrictUndefined,
    TemplateError,
    TemplateSyntaxError,
)
from jinja2.sandbox import SandboxedEnvironment

from minihuman.errors import ReportError

REPORT, CAPTIONED_TABLE, STYLE = "report.html.j2", "captioned_table.html.j2", "report.css"
PARTICIPANTS = "participants.html.j2"


def render_template(name: str, shown: Mapping[str, Any], templates: Path | None = None) -> str:
    """Render a template, all that it shows escaped, in Jinja's sandbox: no template reaches the inside of Python.

    Args:
        name: of the template.
        shown: what it shows, by name.
        templates: a folder with a ``report.html.j2`` or a ``report.css`` that is taken instead of the package's.

    Raises:
        ReportError: if the folder has neither file, or a template cannot be rendered.
    """
    package = PackageLoader("minihuman.reporting", "templates")
    loaders = [package, PrefixLoader({"minihuman": package})]
    if templates is not None:
        if not any((templates / own).is_file() for own in (REPORT, STYLE)):
            raise ReportError(f"{templates} contains neither {REPORT} nor {STYLE}; name a folder with one of them")
        loaders.insert(0, FileSystemLoader(templates))
    environment = SandboxedEnvironment(
        autoescape=True, undefined=StrictUndefined, loader=ChoiceLoader(loaders), trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["data_uri"] = _data_uri
    try:
        return environment.get_template(name).render(shown)
    except TemplateError as error:
        line = f":{error.lineno}" if isinstance(error, TemplateSyntaxError) else ""
        raise ReportError(f"{templates}: {name}{line}: {error.message}") from error


def _data_uri(path: Path) -> str:
    """A PNG, to stand inside the page."""
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"
