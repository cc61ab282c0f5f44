"""HTML of a value in a notebook, which the folder of reports draws."""

import importlib
from typing import Any


def html_of(value: Any) -> str:
    """The HTML of a value, for its `_repr_html_`."""
    # By name: values are below the reports, and a run without a notebook imports none.
    reports: Any = importlib.import_module("jaxthermo.report.notebook")
    return reports.html_of(value)
