"""Files from strangers, read within bounds; results, written whole or not at all."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from polefence.base.errors import InputError, OutputError

HEAD = 400  # bytes in which a file says what it is
SHORT = 100  # characters of a file's name in the name of its temporary one


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
    except IsADirectoryError as problem:
        raise error(f"{path}: cannot be read: is a folder; name a file") from problem
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}") from problem
    if len(raw) > limit:
        raise error(f"{path}: longer than {limit} bytes; this is not a Polefence file")
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
        raise error(
            f"{path}: not UTF-8 text; polefence verify reads matrices of other tools, and writes "
            "by -o DIR what other commands read"
        ) from problem


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
        _replace({path: content})
    except OSError as problem:
        raise _refusal(path, problem) from problem


def write_text(path: Path, content: str) -> None:
    """Write a UTF-8 text file whole; see `write_bytes`."""
    write_bytes(path, _encoded(content))


def _encoded(text: str) -> bytes:
    # half a surrogate pair in a stranger's name is no letter: it is written as its number
    return text.encode("utf-8", "backslashreplace")


def write_all(directory: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write files into a folder, made if need be, and return their paths: all of them or none.

    Raises
    ------
    OutputError
        If one cannot be written; nothing is left behind.
    """
    before = directory.exists()
    folder = make_folder(directory)
    try:
        _replace({folder / name: content for name, content in files.items()})
    except BaseException as problem:
        if not before:
            with suppress(OSError):
                folder.rmdir()
        if isinstance(problem, OSError):
            raise _refusal(directory, problem) from problem
        raise
    return [folder / name for name in files]


def write_documents(directory: Path, documents: Mapping[str, str]) -> list[Path]:
    """Write JSON documents of ours as `write_all` does, over none but such.

    Raises
    ------
    OutputError
        As `write_all` and `check_document` raise.
    """
    for name in documents:
        check_document(directory / name)
    return write_all(directory, {name: _encoded(text) for name, text in documents.items()})


def check_document(path: Path) -> None:
    """Find out whether a JSON document of ours may be put there.

    Raises
    ------
    OutputError
        If it is a link, or there is a file of another kind.
    """
    if path.is_symlink():
        raise OutputError(
            f"{path}: is a symbolic link, and links are not written through; name another folder"
        )
    # every JSON document of ours begins so
    if path.is_file() and not begins_with(path, b'"polefence'):
        raise OutputError(f"{path}: not a Polefence file; name another folder, or move it away")


def begins_with(path: Path, mark: bytes) -> bool:
    """Whether the first `HEAD` bytes of a file have this mark; what cannot be read has none."""
    try:
        with path.open("rb") as file:
            return mark in file.read(HEAD)
    except OSError:
        return False


def leftover(name: str) -> str | None:
    """Return the first `SHORT` characters of the name that a temporary file was to have.

    Such files stay behind where a process is killed; None for any other file.
    """
    match = re.fullmatch(r"\.(.+)\.polefence-[a-z0-9_]{8}", name)
    return None if match is None else match[1]


def _replace(files: Mapping[Path, bytes]) -> None:
    """Write all to temporary files beside them, then rename those."""
    written: list[tuple[str, Path]] = []
    try:
        for path, content in files.items():
            handle, temporary = tempfile.mkstemp(
                dir=path.parent, prefix=f".{path.name[:SHORT]}.polefence-"
            )
            written.append((temporary, path))
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.chmod(temporary, 0o666 & ~_umask())
        for temporary, path in written:
            os.replace(temporary, path)
    except BaseException:
        for temporary, _ in written:
            with suppress(OSError):  # some are renamed already
                os.unlink(temporary)
        raise


def _try_writing(folder: Path) -> None:
    with tempfile.TemporaryFile(dir=folder):
        pass


def _refusal(path: Path, problem: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written: {problem.strerror}; choose another place")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
