"""Command of the checker alone: ``polefence-check.pyz FILE`` proves a file of claims.

Exit status: 0 proved, 1 not proved, 2 the file cannot be read.
"""

from __future__ import annotations

import sys

from polefence.proof.placement import prove, read
from polefence.proof.reading import MAX_BYTES
from polefence.proof.work import FormatError


def main(arguments: list[str]) -> int:
    """Check one design file; see the module's text."""
    if len(arguments) != 1:
        print("usage: polefence-check.pyz design.json", file=sys.stderr)
        return 2
    try:
        with open(arguments[0], encoding="utf-8") as file:
            claim, _ = read(file.read(MAX_BYTES + 1))
        verdict = prove(claim)
    except (OSError, UnicodeDecodeError, FormatError) as error:
        print(f"{arguments[0]}: {error}", file=sys.stderr)
        return 2
    region = " & ".join(
        f"{part.kind}({', '.join(f'{float(v):.17g}' for v in part.numbers)})"
        for part in claim.region
    )
    answer = "proved" if verdict.proved else "not proved"
    where = "simplex of the vertices" if claim.on == "simplex" else "box of the parameters"
    print(f"{answer}: {claim.method}, {region}, on the {where}: {verdict.reason}")
    return 0 if verdict.proved else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
