"""HTML pages from the templates of this package."""

from typing import Any

from v3studio.studio.errors import visible


def rendered(template: str, **values: Any) -> str:
    """The page of a template in `templates/`. Values are escaped; one that the template names and is missing raises."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("v3studio.pipelines.reports", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, finalize=_shown, trim_blocks=True
    )
    return environment.get_template(template).render(**values)


def _shown(value: object) -> object:
    return visible(value) if type(value) is str else value
