"""Equal pieces of the parameters' intervals, in each of which an inequality is proved by itself.

A polynomial's Bernstein coefficients on a piece are nearer to its values than those on the whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

from polefence.proof.claims.base import Inequality
from polefence.proof.polynomials import Polynomial, Sizes, form
from polefence.proof.work import FormatError

MAX_PIECES = 64  # of one parameter's interval
MOST = 256  # of all of them together


def coordinates_in(counts: Sequence[int]) -> Iterator[tuple[tuple[int, ...], list[Polynomial]]]:
    """Yield each piece's numbers, from 0, and the whole box's coordinates as forms in its own."""
    sizes = (2,) * len(counts)
    ends = [[((n - k, n - k - 1), (k, k + 1)) for k in range(n)] for n in counts]
    for numbers in product(*(range(n) for n in counts)):
        forms = [
            form(f, values, sizes, counts[f])
            for f, k in enumerate(numbers)
            for values in ends[f][k]
        ]
        yield numbers, forms


def numbered(numbers: tuple[int, ...]) -> str:
    """Return the numbers of a piece, from one."""
    return ", ".join(str(k + 1) for k in numbers)


def in_pieces(inequality: Inequality, counts: Sequence[int]) -> Iterator[Inequality]:
    """Yield an inequality on the box in each piece of it; as it is where there is one."""
    if math.prod(counts) <= 1:
        yield inequality
        return
    for numbers, forms in coordinates_in(counts):
        moved: dict[int, Polynomial] = {}
        for row in inequality.rows:
            for block in row:  # one may stand in many places
                if id(block) not in moved:
                    moved[id(block)] = block.composed(forms, block.sizes)
        rows = [[moved[id(block)] for block in row] for row in inequality.rows]
        yield replace(
            inequality, rows=rows, piece=f"{inequality.piece} in piece {numbered(numbers)}"
        )


def require_pieces(counts: Sequence[int], sizes: Sizes) -> None:
    """Refuse pieces that are none, or of no box.

    Raises
    ------
    FormatError
    """
    if counts and (sizes != (2,) * len(counts) or not all(1 <= k <= MAX_PIECES for k in counts)):
        raise FormatError(f"pieces must hold one whole number a parameter, 1 to {MAX_PIECES}")
    if math.prod(counts) > MOST:
        raise FormatError(f"there are more than {MOST} pieces")
