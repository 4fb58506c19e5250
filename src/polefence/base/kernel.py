"""The compiled kernel, where it was built."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_kernel: Any
try:
    _kernel = import_module("polefence._kernel")
except ImportError:  # installed without a compiler
    _kernel = None


def kernel() -> Any:
    """Return the compiled kernel, None where it was not built."""
    return _kernel
