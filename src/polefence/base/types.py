"""Types of what a caller gives, checked."""

from __future__ import annotations

from polefence.base.errors import InputError


def require_type(value: object, kind: type, name: str, remedy: str) -> None:
    """Refuse a value of another type, with a remedy."""
    if not isinstance(value, kind):
        given = type(value).__name__
        raise InputError(f"{name} must be of type {kind.__name__}, not {given}; {remedy}")
