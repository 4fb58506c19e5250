"""The folder that an export is written into: ours alone, written whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from polefence.base.errors import OutputError
from polefence.base.files import SHORT, begins_with, leftover, write_all

BUILD = "build"  # what the Makefile makes


def check_folder(directory: Path, marks: Mapping[str, bytes]) -> None:
    """Refuse a folder that holds files of others, before any work.

    Parameters
    ----------
    marks : mapping
        For each name that will be written, what such a file of ours has in its first bytes.

    Raises
    ------
    OutputError
        If it is no folder, or has a file of another name, or one of ours by name alone.
    """
    if not directory.exists():
        return
    if not directory.is_dir():
        raise OutputError(f"{directory}: is a file; name a folder")
    for entry in sorted(directory.iterdir()):
        if entry.name == BUILD and entry.is_dir():
            continue
        if not (_is_leftover(entry, marks) or _is_ours(entry, marks)):
            raise OutputError(
                f"{entry}: not a file of this export; nothing was written: name a folder that is "
                "empty, new, or an earlier export's of the same name"
            )


def _is_ours(entry: Path, marks: Mapping[str, bytes]) -> bool:
    known = entry.name in marks and not entry.is_symlink()
    return known and begins_with(entry, marks[entry.name])


def _is_leftover(entry: Path, marks: Mapping[str, bytes]) -> bool:
    """Whether an export that was killed left this behind."""
    name = leftover(entry.name)
    return name is not None and not entry.is_dir() and any(own[:SHORT] == name for own in marks)


def write_folder(
    directory: Path, files: Mapping[str, bytes], marks: Mapping[str, bytes]
) -> list[Path]:
    """Write files, all or none, and return their paths; an earlier export's others are removed.

    Raises
    ------
    OutputError
        If the folder holds files of others, or one cannot be written.
    """
    check_folder(directory, marks)
    if directory.exists():
        for entry in [each for each in directory.iterdir() if _is_leftover(each, marks)]:
            entry.unlink(missing_ok=True)
    paths = write_all(directory, files)
    for name in marks.keys() - files.keys():
        (directory / name).unlink(missing_ok=True)
    return paths
