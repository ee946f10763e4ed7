"""One HTML page without network access, from a template of this package, with every figure inside it."""

import base64
from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def page(template: str, figures: Mapping[str, bytes], **content: Any) -> str:
    """The page; `figures` maps a caption or a name to an SVG. Every text is escaped by the template engine."""
    loader = PackageLoader("thermohyd.identify", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    inside = {name: base64.b64encode(svg).decode("ascii") for name, svg in figures.items()}
    return environment.get_template(template).render(figures=inside, **content)
