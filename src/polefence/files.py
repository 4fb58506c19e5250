"""Files from strangers, read within bounds; results, written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from polefence.errors import InputError, OutputError


def read_bytes(path: Path, limit: int, error: type[InputError]) -> bytes:
    """Read a small file.

    Raises
    ------
    InputError
        Of the given class, if the file cannot be read, or is longer than ``limit`` bytes.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(limit + 1)
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}") from problem
    if len(raw) > limit:
        raise error(f"{path}: longer than {limit} bytes; this is no file of ours")
    return raw


def read_text(path: Path, limit: int, error: type[InputError]) -> str:
    """Read a small UTF-8 text file.

    Raises
    ------
    InputError
        Of the given class, if the file cannot be read, is longer than ``limit`` bytes, or no text.
    """
    raw = read_bytes(path, limit, error)
    try:
        return raw.decode("utf-8-sig")  # some editors begin with a mark
    except UnicodeDecodeError as problem:
        raise error(f"{path}: not UTF-8 text") from problem


def check_target(path: Path) -> None:
    """Find out before work begins whether a file can be written; creates nothing.

    Raises
    ------
    OutputError
        If it is a folder, or the nearest folder that exists cannot be written.
    """
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written: is a folder; name a file")
    nearest = next((p for p in path.absolute().parents if p.exists()), Path("/"))
    try:
        _try_writing(nearest)
    except OSError as problem:
        raise _refusal(path, problem) from problem


def make_folder(path: Path) -> Path:
    """Create a folder for results, or find that it cannot be written, before work begins.

    Raises
    ------
    OutputError
        If it cannot be created or written.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        _try_writing(path)
    except OSError as problem:
        raise _refusal(path, problem) from problem
    return path


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole: to a temporary one beside it, then renamed.

    Links are followed; what is no regular file (a terminal, a pipe) is written to directly.

    Raises
    ------
    OutputError
        If it cannot be written; nothing is left behind.
    """
    path = path.resolve()
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)
            return
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.chmod(temporary, 0o666 & ~_umask())
            os.replace(temporary, path)
        except BaseException:
            with suppress(FileNotFoundError):  # renamed already when an interrupt came
                os.unlink(temporary)
            raise
    except OSError as problem:
        raise _refusal(path, problem) from problem


def write_text(path: Path, content: str) -> None:
    """Write a UTF-8 text file whole; see `write_bytes`."""
    # half a surrogate pair in a stranger's name is no letter: it is written as its number
    write_bytes(path, content.encode("utf-8", "backslashreplace"))


def _try_writing(folder: Path) -> None:
    with tempfile.TemporaryFile(dir=folder):
        pass


def _refusal(path: Path, problem: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written: {problem.strerror}; choose another place")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
