"""Sphinx configuration: MyST pages, the furo theme, the package's own docstrings."""

import re
from typing import Any

import polefence

project = "polefence"
author = "The Polefence developers"
copyright = "2026, The Polefence developers"
version = release = polefence.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"polefence {release}"

myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3

# Primes and dashes in formulas stay as written.
smartquotes = False
# The docstrings' single backticks are code.
default_role = "literal"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
# The studio's pages need its docstrings, not the extra `studio`: nothing of it is run here.
autodoc_mock_imports = ["bokeh", "panel", "tornado"]
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False


def _escape_bars(
    _app: Any, _what: str, _name: str, _item: Any, _opt: Any, lines: list[str]
) -> None:
    """Keep |z| a magnitude: reStructuredText would take it for a substitution."""
    for i, line in enumerate(lines):
        parts = re.split(r"(``.*?``)", line)
        lines[i] = "".join(p if p.startswith("``") else p.replace("|", r"\|") for p in parts)


def setup(app: Any) -> None:
    """Register the one hook."""
    app.connect("autodoc-process-docstring", _escape_bars)
