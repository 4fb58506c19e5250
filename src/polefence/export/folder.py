"""The folder that an export is written into: ours alone, written whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from polefence.errors import OutputError
from polefence.files import make_folder, write_bytes

BUILD = "build"  # what the Makefile makes
HEAD = 400  # bytes in which a file of ours says so


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
        if entry.name not in marks or not _is_ours(entry, marks[entry.name]):
            raise OutputError(
                f"{entry}: not a file of this export; nothing was written: name a folder that is "
                "empty, new, or an earlier export's of the same name"
            )


def _is_ours(path: Path, mark: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return mark in file.read(HEAD)
    except OSError:
        return False


def write_folder(
    directory: Path, files: Mapping[str, bytes], marks: Mapping[str, bytes]
) -> list[Path]:
    """Write files, each whole, and return their paths; an earlier export's others go first.

    Raises
    ------
    OutputError
        If the folder holds files of others, or one cannot be written.
    """
    check_folder(directory, marks)
    folder = make_folder(directory)
    for name in marks.keys() - files.keys():
        (folder / name).unlink(missing_ok=True)
    for name, content in files.items():
        write_bytes(folder / name, content)
    return [folder / name for name in files]
