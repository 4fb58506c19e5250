"""A table that nobody changes: a dict, so that it is copied, sent and written as one."""

from __future__ import annotations

from typing import Any, NoReturn, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


class Frozen(dict[Key, Value]):
    """A read-only dict."""

    def _refused(self, *given: Any, **more: Any) -> NoReturn:  # noqa: ARG002
        raise TypeError("this table is read-only; dict(table) is a copy that can be changed")

    __setitem__ = __delitem__ = __ior__ = _refused
    clear = pop = popitem = setdefault = update = _refused

    def __reduce__(self) -> tuple[Any, ...]:
        """Let it be copied and sent to other processes: entry by entry it could not be filled."""
        return type(self), (dict(self),)
