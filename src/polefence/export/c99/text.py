"""Texts of strangers in C: names that C takes, and comments that nothing leaks out of."""

from __future__ import annotations

import html
import re
import textwrap
import unicodedata

from polefence.base.errors import InputError

WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long main register restrict return short signed sizeof static struct switch typedef union unsigned
void volatile while
"""
# Files of these names hide a standard header, or cannot be made on Windows.
HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar
wchar wctype aux con nul prn
"""
LONGEST = 31  # characters of a name; C tells external names apart by so many
WIDTH = 100  # of a line


def check_c_name(name: str) -> None:
    """Refuse what cannot begin the names of C functions.

    Raises
    ------
    InputError
        If it is no C identifier, a word of C or C++, reserved, or a standard header's name.
    """
    # C++ reserves all names with two underscores in a row, and NAME_STATES shall not have them
    plain = re.fullmatch(r"[a-zA-Z](_?[a-zA-Z0-9])*", name) and len(name) <= LONGEST
    if not plain or name in WORDS.split():
        raise InputError(
            f"name = {shorten(name)} cannot begin C names; use at most {LONGEST} letters, digits "
            "and single _ between them, a letter first, and no word of C"
        )
    if name.lower() in HEADERS.split():
        raise InputError(
            f"name = {name!r} would hide the standard header {name.lower()}.h, or is no name of a "
            "file on Windows; use another"
        )


def shorten(text: str) -> str:
    """Quote a text for a message."""
    return repr(text if len(text) <= 2 * LONGEST else text[: 2 * LONGEST] + "...")


def comment(text: str) -> str:
    """Return text that can stand in a C comment, in one line of ASCII.

    Accents are dropped; what ends or begins a comment, continues a line, or is a trigraph, broken.
    """
    decomposed = unicodedata.normalize("NFKD", re.sub(r"\s+", " ", text))
    letters = "".join(c for c in decomposed if not unicodedata.combining(c))
    plain = re.sub(r"[^ -~]", "?", letters).replace("\\", "/")
    return re.sub(r"/(?=[/*])|\*(?=/)|\?(?=\?)", r"\g<0> ", plain).strip()


def block(text: str, label: str = "") -> str:
    """Return text as lines of a C comment's inside, under a label."""
    first = " * " + ("  " if label else "") + label
    rest = " * " + " " * (len(first) - 3)
    lines = textwrap.wrap(comment(text), WIDTH - len(first)) or [""]
    return "\n".join((rest if k else first) + line for k, line in enumerate(lines)).rstrip()


def prose(text: str) -> str:
    """Return text for Markdown, in which it is no tag, no link and no picture."""
    return html.escape(comment(text), quote=False).replace("](", "] (").replace("][", "] [")


def cell(text: str) -> str:
    """Return text for a table of Markdown."""
    return prose(text).replace("|", "/")


def wrap(text: str) -> str:
    """Break a long list of constants into lines."""
    return ("\n" + 6 * " ").join(textwrap.wrap(text, WIDTH - 8))
