"""Singular or non-finite matrices met by NumPy: a search that gave no usable point."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from polefence.base.errors import SolverError


@contextmanager
def singular_is_failure() -> Iterator[None]:
    """Raise `SolverError` in place of NumPy's error; a decorator too.

    Raises
    ------
    SolverError
        If NumPy met a singular matrix, or numbers that are not finite.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SolverError(f"no answer in floats: {str(error).lower()}") from error
