"""Old names, which warn for one version."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from polefence.base.files import write_documents, write_text

GONE = "0.3"  # the version without them


def warn_renamed(old: str, new: str, depth: int = 1) -> None:
    """Warn the caller, so many calls above who asks for it, of a name that has changed."""
    text = f"{old} is now {new}; the old name goes in version {GONE}"
    warnings.warn(text, DeprecationWarning, stacklevel=depth + 2)


def with_old_keys(data: Any) -> Any:
    """Return plain data for a summary with "status" beside each "answer", as it was called."""
    if isinstance(data, Mapping):
        both = dict[str, Any]()
        for key, value in data.items():
            both[key] = with_old_keys(value)
            if key == "answer":
                both["status"] = both[key]
        return both
    return [with_old_keys(value) for value in data] if isinstance(data, list | tuple) else data


def without_old_keys(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of a file without its old keys."""
    return {key: value for key, value in row.items() if key != "status" or "answer" not in row}


def write_in(place: str | Path, name: str, text: str) -> Path:
    """Write a document into a folder, or, as version 0.1 did, to a path that ends in .json."""
    path = Path(place)
    if path.suffix != ".json" or path.is_dir():
        return write_documents(path, {name: text})[0]
    warn_renamed("save(FILE.json)", f"save(FOLDER), which writes {name} there", depth=2)
    write_text(path, text)
    return path
