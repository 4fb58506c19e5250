"""Where pages save: each page in folders of its own, whoever else saves beside it."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from polefence.base.errors import InputError, OutputError, shown
from polefence.base.files import begins_with, read_text
from polefence.show.report import MARK
from polefence.studio.session import DESIGN, MOST_BYTES, SESSION
from polefence.studio.taking import CODE, REPORT


class TakenError(InputError):
    """Another session is saved in a folder.

    Attributes
    ----------
    free : str
        A name under which none is.
    """

    def __init__(self, folder: Path, free: str) -> None:
        super().__init__(
            f"{folder}: another session is saved there, and stays as it is; save under another "
            f"name, as {free}"
        )
        self.free = free


@dataclass(eq=False)
class _Own:
    """What a page has: the folder that is kept free for it, and the sessions that it saved."""

    kept: Path
    saved: dict[Path, str | None] = field(default_factory=dict)
    lock: Any = field(default_factory=threading.Lock)


class Folders:
    """Folders of the pages of one server, side by side.

    A folder is a page's own once the page has made it, or has found nothing of a studio there, and
    as long as nobody else saves a session there: another tab, or another studio in the same place.

    Parameters
    ----------
    first : Path
        That of the first page.
    session : Path, optional
        The session that was opened: the first page goes on with it, where it lies in that folder.
    """

    def __init__(self, first: Path, session: Path | None = None) -> None:
        self.first = first
        self._lock = threading.Lock()
        self._pages: WeakKeyDictionary[Any, _Own] = WeakKeyDictionary()
        self._opened: str | None = None
        if session is not None and session.resolve() == (first / SESSION).resolve():
            self._opened = _session(first)

    def begin(self, page: Any) -> str:
        """Return the name under which a page saves until it is given another."""
        with self._lock:
            goes_on, self._opened = self._opened, None
            if goes_on is not None:
                self._pages[page] = _Own(self.first, {self.first: goes_on})
            else:
                self._pages[page] = _Own(self._free(page))
            return self._called(self._pages[page].kept)

    def end(self, page: Any) -> None:
        """Leave what is kept free for a page to others."""
        with self._lock:
            self._pages.pop(page, None)

    @contextmanager
    def writing(self, page: Any, name: str) -> Iterator[Path]:
        """Have a page write into the folder of a name, which is then its own.

        Raises
        ------
        InputError
            If it is no name, or another session is saved there; with a name that is free.
        """
        entry = self._pages[page]
        with entry.lock:
            with self._lock:
                folder = self._claimed(page, entry, name)
            try:
                yield folder
            finally:
                entry.saved[folder] = _session(folder)

    def _claimed(self, page: Any, entry: _Own, name: str) -> Path:
        if not re.fullmatch(r"\w[\w .-]{0,79}", name) or name != name.strip(" ."):
            raise InputError(
                f"name = {shown(name)} must be letters, digits, spaces, dots, - and _; it is that "
                "of a folder"
            )
        folder = self._named(name)
        if folder.is_symlink():
            raise OutputError(
                f"{folder}: is a symbolic link, and links are not written through; move it away"
            )
        if folder in entry.saved and entry.saved[folder] == _session(folder):
            return folder
        if not self._is_free(folder, page):
            raise TakenError(folder, self._called(self._free(page)))
        try:
            folder.mkdir(parents=True)  # of two that find it free one makes it
        except FileExistsError:
            if not folder.is_dir() or not self._is_free(folder, page):
                raise TakenError(folder, self._called(self._free(page))) from None
        except OSError as error:
            why = f"{error.strerror}; choose another place"
            raise OutputError(f"{folder}: cannot be written: {why}") from error
        entry.saved[folder] = None
        return folder

    def _called(self, folder: Path) -> str:
        return folder.name or folder.resolve().name or "studio"

    def _named(self, name: str) -> Path:
        if name == self._called(self.first):
            return self.first
        return self.first.with_name(name) if self.first.name else self.first / name

    def _free(self, page: Any) -> Path:
        first = self._called(self.first)
        names = (first if k == 1 else f"{first}-{k}" for k in count(1))
        kept = {entry.kept for other, entry in self._pages.items() if other is not page}
        folders = (folder for folder in map(self._named, names) if folder not in kept)
        return next(folder for folder in folders if self._is_free(folder, page))

    def _is_free(self, folder: Path, page: Any) -> bool:
        """Whether no other page saved there, and nothing of a studio lies there."""
        if any(folder in entry.saved for other, entry in self._pages.items() if other is not page):
            return False
        if folder.is_file() or folder.is_symlink():
            return False
        report = folder / REPORT
        if not report.is_symlink() and begins_with(report, MARK):
            return False
        # what is a stranger's, or a link, is refused where it would be written
        written = (folder / name for name in (SESSION, DESIGN, CODE))
        return not any(path.exists() and not path.is_symlink() for path in written)


def _session(folder: Path) -> str | None:
    """Return the session that is saved in a folder; None where none is, or none can be read."""
    try:
        return read_text(folder / SESSION, MOST_BYTES, InputError)
    except InputError:
        return None
