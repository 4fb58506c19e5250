"""The one door to what draws: it stands above what is drawn, and is slow to import."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def pictures() -> Any:
    """Return the module that makes pictures of designs and regions, imported when first asked."""
    return import_module("polefence.show.pictures")
