"""Command of the checker alone: ``polefence-check.pyz FILE`` proves a file of claims.

Exit status: 0 proved, 1 not proved, 2 the file cannot be read.
"""

from __future__ import annotations

import sys
from typing import TextIO

from polefence.proof.document import check, loads
from polefence.proof.reading import MAX_BYTES
from polefence.proof.text import visible
from polefence.proof.work import FormatError

PROVED, NOT_PROVED, BAD_INPUT = 0, 1, 2


def main(arguments: list[str]) -> int:
    """Check one file; see the module's text."""
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print("usage: polefence-check.pyz FILE", file=sys.stderr)
        return BAD_INPUT
    (path,) = arguments
    try:
        with open(path, encoding="utf-8-sig") as file:
            document = loads(file.read(MAX_BYTES + 1))
        result = check(document)
    except (OSError, UnicodeDecodeError, FormatError) as error:
        _say(f"{path}: {error}", sys.stderr)
        return BAD_INPUT
    answer = "not proved" if result.answer == "undecided" else result.answer
    _say(f"{path}: {answer}: {result.reason}")
    for claim in result.claims:
        _say(f"  {'' if result.proved else 'claimed, not proved: '}{claim}")
    if document.plant.data is not None:
        _say(document.plant.data.note)
    return PROVED if result.proved else NOT_PROVED


def _say(text: str, file: TextIO | None = None) -> None:
    line = visible(" ".join(text.split()) if file else text)
    print(line.encode("utf-8", "backslashreplace").decode(), file=file or sys.stdout)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
