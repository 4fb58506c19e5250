"""State feedback that keeps all poles in a region for all uncertain parameters, proved."""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from polefence.base import VERSION

__version__ = VERSION

# The stub is the one list of public names, which mypy and editors read too.
_MODULES = {
    name.name: str(line.module)
    for line in ast.parse(Path(__file__).with_suffix(".pyi").read_bytes()).body
    if isinstance(line, ast.ImportFrom)
    for name in line.names
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Load what is asked for."""
    if name == "verify":  # which warns when it is called
        return import_module("polefence.certify.given").verify
    if name == "Verified":
        from polefence.base.renamed import warn_renamed

        warn_renamed("Verified", "Analysis")
        return __getattr__("Analysis")
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module 'polefence' has no attribute {name!r}")
    if module == __name__:  # a room
        return import_module(f"{module}.{name}")
    return getattr(__import__(module, fromlist=[name]), name)


def __dir__() -> list[str]:
    """Name what there is, loaded or not, and nothing that is only imported here."""
    return __all__
