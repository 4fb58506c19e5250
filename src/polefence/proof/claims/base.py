"""Claims: values that read and write themselves, and the one way in which they are proved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.late import Late
from polefence.proof.laws import Evidence, Law, Point
from polefence.proof.matrices import Integers, Rationals, is_positive_definite, is_symmetric
from polefence.proof.motion import Box, is_late, is_moving, motion_text
from polefence.proof.plant import Plant
from polefence.proof.polynomials import Exponent, Polynomial, Sizes, count_of, joint, symmetric
from polefence.proof.reading import Table
from polefence.proof.short import Short
from polefence.proof.work import MAX_WORK, RATIONAL, FormatError, WorkError, counted, spend, tell

MAX_BLOCKS = 200_000  # inequalities of one claim


@dataclass(frozen=True)
class Place(Short):
    """A coefficient of an inequality: of which, at which monomial, in which piece."""

    inequality: str
    powers: Exponent
    sizes: Sizes
    piece: str = ""
    name: str = ""  # where the theorem has one for it

    def __str__(self) -> str:
        if self.name:
            return self.name
        before = f"{self.inequality} at " if self.inequality else "at "
        return before + _monomial(self.powers, self.sizes) + self.piece


def _monomial(e: Exponent, sizes: Sizes) -> str:
    if len(sizes) == 1:
        support = sorted((j for j, p in enumerate(e) if p), key=lambda j: (-e[j], j))
        if sum(e) == 1:
            return f"vertex {support[0] + 1}"
        return " ".join(f"alpha{j + 1}^{e[j]}" for j in support) or "every alpha"
    places = [f"{'abcdefgh'[f]}{j + 1}" for f, size in enumerate(sizes) for j in range(size)]
    named = " ".join(f"{place}^{p}" for place, p in zip(places, e, strict=True) if p)
    return named or "every alpha"


@dataclass(frozen=True)
class Inequality(Short):
    """A symmetric matrix polynomial that is to be positive: every coefficient of it.

    ``rows`` holds its blocks on the diagonal and to its right, ``degrees`` what it is raised to.
    """

    name: str
    rows: list[list[Polynomial]]
    degrees: tuple[int, ...]
    piece: str = ""

    @classmethod
    def raised(
        cls, name: str, rows: list[list[Polynomial]], by: int = 0, piece: str = ""
    ) -> Inequality:
        """Return it at the least degrees that its blocks have, and so much more."""
        least = joint([block for row in rows for block in row])
        return cls(name, rows, tuple(degree + by for degree in least), piece)

    @property
    def size(self) -> int:
        """Number of rows of a coefficient."""
        return sum(row[0].shape[0] for row in self.rows)

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return count_of(self.rows[0][0].sizes, self.degrees)

    def blocks(self) -> Iterator[tuple[Place, Integers]]:
        """Yield each coefficient's place, and it times a positive integer."""
        sizes = self.rows[0][0].sizes
        for e, matrix in symmetric(self.rows, self.degrees):
            yield Place(self.name, e, sizes, self.piece), matrix


@dataclass(frozen=True)
class Verdict(Short):
    """Verdict on a claim.

    Attributes
    ----------
    answer : str
        "proved"; "undecided", which does not refute it; or "refuted".
    reason : str
        How, or why not, in words.
    count : int
        Inequalities that are positive definite.
    place : Place, optional
        The coefficient that is not.
    claim : int
        Number of the claim in its file, from 1; 0 of a claim alone.
    note : str
        What the reason says besides the count.
    """

    answer: str
    reason: str
    count: int = 0
    place: Place | None = None
    claim: int = 0
    note: str = ""

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    def unless(self, fault: str) -> Verdict:
        """Return the verdict of a claim that has another condition; a fault says how it fails."""
        return replace(self, answer="undecided", reason=fault, note="") if fault else self

    def noted(self, note: str) -> Verdict:
        """Return the verdict with a further reason."""
        return replace(self, reason=f"{self.reason}; {note}", note=note)


def untiled(cells: Sequence[Box], total: Fraction | int) -> str:
    """Say how the cells, each in the box, fail to tile it."""
    active: list[Box] = []
    for cell in sorted(cells, key=lambda c: c.low):
        active = [c for c in active if c.high[0] > cell.low[0]]
        spend(RATIONAL * len(active) * len(cell.low), 64, 64)
        if any(_overlap(cell, other) for other in active):
            return "two cells overlap"
        active.append(cell)
    return "" if total == 1 else "the cells do not fill the box"


def _overlap(one: Box, other: Box) -> bool:
    sides = zip(one.low, one.high, other.low, other.high, strict=True)
    return all(max(a, c) < min(b, d) for a, b, c, d in sides)


def in_cells(evidence: Sequence[Evidence], decide: Callable[[], Verdict]) -> Verdict:
    """Decide a claim of which some evidence has cells, which must make up the box."""
    divided = [item.cells for item in evidence if item.cells]
    for cells in divided:
        fault = untiled(cells, sum(cell.volume for cell in cells))
        if fault:
            return undecided(fault)
    verdict, most = decide(), max(map(len, divided), default=1)
    return verdict.noted(f"in {most} parts of the box") if verdict.proved and most > 1 else verdict


def undecided(reason: str) -> Verdict:
    """Return that nothing is proved."""
    return Verdict("undecided", reason)


def counting(count: int) -> str:
    """Say how many inequalities hold."""
    return f"{count} inequalities positive definite in exact arithmetic"


class Claim:
    """One claim about a plant, or about a loop that a law closes around it.

    A kind of claim is a frozen dataclass with these methods; `document.KINDS` lists it.
    """

    kind: ClassVar[str]  # in a file
    letters: ClassVar[str] = "AB"  # the matrices of the plant that it is about
    moves: ClassVar[bool] = False  # whether it holds while parameters move
    motion_note: ClassVar[str] = ""  # what it asks of these motions
    of_law: ClassVar[bool] = True  # whether it is about the file's law

    @property
    def inner_points(self) -> list[Point]:
        """Nodes of the parts of the box that it is proved in, but its corners."""
        return []

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read a claim; what is malformed or missing is a FormatError. Proves nothing.

        ``on`` is the domain of a scheduled law, "" for a gain.
        """
        raise NotImplementedError

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        raise NotImplementedError

    def require(self) -> None:
        """Refuse what is incomplete, inconsistent, or more work than is done."""
        raise NotImplementedError

    def inequalities(self) -> Iterator[Inequality]:
        """Yield what proves the claim."""
        raise NotImplementedError

    def statement(self, plant: Plant) -> str:
        """Say in a line what is claimed, rounded so that it says no more than is proved."""
        raise NotImplementedError

    def said(self, plant: Plant) -> str:
        """Say in a line what is claimed, and of which parameters where some of them move."""
        text = self.statement(plant)
        if not is_moving(plant.ranges):
            return text
        if is_late(plant.ranges):
            return f"{text}, {motion_text(plant.ranges)}"
        if not self.moves:
            return f"{text}, for constant parameters"
        return f"{text}, {motion_text(plant.ranges)}{self.motion_note}"

    def require_late(self, late: Late) -> None:  # noqa: ARG002
        """Refuse a claim that does not hold for the dead time itself.

        Raises
        ------
        FormatError
            Saying which claims do.
        """
        raise FormatError(
            f"{self.kind}: of a plant with a dead time, claims are about poles in a half-plane, "
            "rms, gain and energy peak"
        )

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say what the rest of the file has that contradicts the claim; "" where nothing does."""
        return ""

    @property
    def allowed(self) -> int | None:
        """The most work that it may take to prove; None: `MAX_WORK`."""
        return None

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield the names of matrices that ought to be symmetric, and them."""
        yield from ()

    def blocks(self) -> Iterator[tuple[Place, Integers]]:
        """Yield each coefficient's place, and its matrix times a positive integer."""
        for inequality in self.inequalities():
            yield from inequality.blocks()

    def decided(self) -> Verdict:
        """Prove a claim that is consistent."""
        for name, form in self.symmetric():
            if not is_symmetric(form):
                return undecided(f"{name} is not symmetric")
        count = 0
        for place, matrix in self.blocks():
            tell(count + 1)
            if not is_positive_definite(matrix):
                reason = f"inequality {place} is not positive definite"
                return Verdict("undecided", reason, count, place)
            count += 1
        return Verdict("proved", counting(count), count)


def prove(claim: Claim) -> Verdict:
    """Decide in exact arithmetic whether its evidence proves a claim.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    with counted(claim.allowed):
        claim.require()
        try:
            return claim.decided()
        finally:
            tell(0)


def require_work(least: int, most: int | None = None) -> None:
    """Refuse, before any is done, more work than is done here."""
    if least > (MAX_WORK if most is None else most):
        raise WorkError("the inequalities are too many, or too large, to be checked here")


def require_law(law: Any, kind: str) -> Law:
    """Return the law of a file."""
    if not isinstance(law, Law):
        raise FormatError(f"law: a claim of kind {kind} needs a law, fixed or scheduled")
    return law
