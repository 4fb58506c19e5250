"""What is not installed: its tests skip, or fail where POLEFENCE_TEST_TARGET=1 promises it."""

import os
import shutil
from collections.abc import Iterable

import pytest


def absent(what: str) -> None:
    """End a test that needs what is not there."""
    if os.environ.get("POLEFENCE_TEST_TARGET") == "1":
        pytest.fail(f"{what} is not installed, and POLEFENCE_TEST_TARGET=1 promises it")
    pytest.skip(f"{what} is not installed", allow_module_level=True)


def require(missing: Iterable[str]) -> None:
    """End a test where anything is missing."""
    names = ", ".join(missing)
    if names:
        absent(names)


def need(tool: str) -> str:
    """Return the path of a program; end the test where there is none."""
    found = shutil.which(tool)
    if found is None:
        absent(tool)
    return str(found)
