"""All poles in a region: the claim of a design.

All eigenvalues of A(alpha) + B(alpha) K(alpha) lie in the region, for every alpha of the simplex;
or, on a box, for every product alpha of points of the parameters' own intervals. A region is an
intersection of parts { z : L + M z + M' conj(z) < 0 }. With X(alpha) > 0 and
N(alpha) = (A + B K) X, both polynomials, it is enough (Chilali-Gahinet) that

    F(alpha) = -( L (x) X(alpha) + M (x) N(alpha) + M' (x) N(alpha)' ) > 0     for every part,

and for that, that every coefficient of F(alpha) (sum of alpha)^d is > 0 (Polya). The methods are

    quadratic   X constant, K constant
    scheduled   X = W(alpha), K = Z(alpha) W(alpha)^-1, of any degree; at degree 1 and d = 1 and
                for a disk this is Leite & Peres (2005), (15)-(17), there with tau times a form
                that is nonnegative on the simplex
    lyapunov    K given, constant or scheduled, and X for each part: a polynomial, for a scheduled
                law W (multiple + X W), so that N is a polynomial too; of the box, or of each of
                some cells that make it up
    slack       K constant, P(alpha) and one G (not symmetric): for the disk |z + sigma| < r
                [ r P, M ; M', r (G + G' - P) ] > 0 with M = (A + B K + sigma I) G; for other parts
                F + [ e ] bordered, see `_slack`
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import (
    Claim,
    Inequality,
    Place,
    Verdict,
    in_cells,
    require_law,
    undecided,
)
from polefence.proof.late import Late
from polefence.proof.laws import (
    DOMAINS,
    Evidence,
    Law,
    Piece,
    Point,
    add,
    degree_of,
    inner_points,
    lifted,
    on_part,
    read_cells,
    read_evidence,
    require_continuous,
    require_terms,
    used_nodes,
)
from polefence.proof.matrices import (
    LONGEST,
    MAX_BITS,
    ONE,
    Integers,
    Rationals,
    common_denominator,
    identity,
    least_work,
    mix,
    multiplied,
    right_divide,
    whole_numbers,
)
from polefence.proof.motion import (
    changes,
    is_late,
    is_moving,
    motion_text,
    require_late_cells,
    require_motion,
)
from polefence.proof.pieces import in_pieces, require_pieces
from polefence.proof.plant import Node, Plant, sizes_of
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Exponent,
    Polynomial,
    Sizes,
    basis,
    bernstein,
    constant,
    coordinates,
    count_of,
    monomials,
)
from polefence.proof.ranges import Range, narrowed
from polefence.proof.reading import Table, plain
from polefence.proof.regions import (
    MAX_PARTS,
    Disk,
    HalfPlane,
    Part,
    factors,
    lyapunov,
    read_region,
    read_whole,
    require_region,
    write_region,
)
from polefence.proof.remainder import Remainder
from polefence.proof.roots import all_inside
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up, output_text, quoted, region_text
from polefence.proof.work import LARGE, MAX_IN_PARTS, MAX_WORK, FormatError, WorkError

METHODS = ("quadratic", "slack", "scheduled", "lyapunov")


@dataclass(frozen=True)
class Poles(Short, Claim):
    """All poles of every plant of the family lie in the region, by this law and evidence.

    ``evidence`` has one entry, for "lyapunov" one a part of the region. ``on`` is "simplex" or
    "box". With ``weights`` the plant is A(alpha) / q(alpha), B(alpha) / q(alpha), q > 0
    multi-affine with these values at the corners. With a ``remainder`` the plant is only near
    that, and the evidence, of "lyapunov", has a spread. ``motion`` holds the parameters where some
    of them move: along all motions the loop then decays as a half-plane among the parts says, in
    discrete time, of a ``step`` that is not zero, as a disk about zero does.
    """

    kind: ClassVar[str] = "region"

    method: str
    A: list[Rationals]
    B: list[Rationals]
    region: tuple[Part, ...]
    law: Law
    evidence: tuple[Evidence, ...]
    on: str = "simplex"
    weights: tuple[Fraction, ...] = ()
    remainder: Remainder | None = None
    motion: tuple[Range, ...] = ()
    step: Fraction = Fraction(0)
    nodes: tuple[Node, ...] = ()

    @property
    def sizes(self) -> Sizes:
        """Corners of each simplex."""
        return sizes_of(len(self.A), self.on)

    @property
    def AB(self) -> Polynomial:
        """[A, B], with the curve of a remainder."""
        AB = plant_form(self.A, self.B, self.sizes)
        return AB if self.remainder is None else self.remainder.curved(AB)

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read region, method and evidence; the region is one of the plant's time, as a whole."""
        read_whole(table.table("region"), plant.sample_time is not None)
        return cls.read_part(table, plant, law, on)

    @classmethod
    def read_part(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read a claim about a part of a region, which alone may be none of a file."""
        law, region = require_law(law, cls.kind), read_region(table.table("region"))
        method, below = table.word("method", METHODS), table.table("evidence")
        allowed = {"scheduled": law.scheduled, "lyapunov": True}.get(method, law.fixed)
        if not allowed:
            raise FormatError(f"law.kind does not belong to method {method!r}")
        if law.fixed:
            free = method in ("lyapunov", "slack")
            on = below.word("on", DOMAINS, "simplex") if free else "simplex"
        blank = cls(method, plant.A, plant.B, region, law, (), plant.domain(on))
        motion = plant.ranges if is_moving(plant.ranges) else ()
        blank = replace(blank, remainder=plant.remainder, motion=motion, step=plant.step)
        if law.W is not None and len(law.W) != count_of(blank.sizes, law.degree):
            count = count_of(blank.sizes, law.degree)
            raise FormatError(f"law.W holds {len(law.W)} matrices; the plant needs {count}")
        evidence = _EVIDENCE[method](below, blank, plant.n)
        claim = replace(blank, evidence=evidence, nodes=used_nodes(plant, evidence))
        claim.require_shapes()  # `prove` asks the rest, which takes work
        return claim

    @property
    def inner_points(self) -> list[Point]:
        """Nodes of the parts of the box that it is proved in, but its corners."""
        return inner_points(self.evidence, self.remainder)

    def write(self) -> dict[str, Any]:
        """Return region, method and evidence."""
        first, free = self.evidence[0], {"on": self.on} if self.on != "simplex" else {}
        if self.method == "quadratic":
            table = {"W": plain(first.X[0])}
        elif self.method == "scheduled":
            table = {"tau": plain(first.tau)}
            table |= {"elevation": first.elevation} if first.elevation != 1 else {}
        elif self.method == "slack":
            table = {"P": plain(first.X), "G": plain(first.G)}
            if (first.degree, first.elevation) != (1, 0):
                table |= {"degree": first.degree, "elevation": first.elevation}
            table |= ({"epsilon": plain(first.epsilon)} if first.epsilon else {}) | free
        else:
            table = {"parts": [proof.write() for proof in self.evidence]}
            table |= free if self.law.fixed else {}
        region = write_region(self.region)
        return {"kind": self.kind, "region": region, "method": self.method, "evidence": table}

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say where all poles are, under which law, for which alpha."""
        return f"poles in {region_text(self.region)}, of A + B K with {self.under}"

    def said(self, plant: Plant) -> str:
        """Say too what holds of motions where parameters move."""
        text, decays = super().said(plant), [p for p in self.region if p.decays(self.step)]
        if not is_moving(plant.ranges) or is_late(plant.ranges) or not decays:
            return text
        if self.step:
            factor = min(part.numbers[1] for part in decays)
            fast = f"decay by {digits_up(factor)}^k in k samples"
            how = fast if factor < 1 else "exponentially stable"
        else:
            decay = max(part.numbers[0] for part in decays)
            how = f"decay rate {digits_down(decay, 4)} 1/s" if decay else "exponentially stable"
        return f"{text}; {how} with {motion_text(plant.ranges)}"

    def require_late(self, late: Late) -> None:
        """Refuse other regions than half-planes that the dead time allows, and laws of delta."""
        decay = late.dead_time.decay
        for part in self.region:
            if not isinstance(part, HalfPlane) or part.decay > decay:
                raise FormatError(
                    "region: with a dead time there are infinitely many poles; take half_plane(a), "
                    f"a at most {digits_down(decay, 4)} 1/s, the decay of the dead time"
                )
        m = len(self.B[0][0])
        late.require_law(self.law, self.sizes, m, len(late.entering[0]) - len(self.A[0]) - m)

    @property
    def under(self) -> str:
        """The law, the domain and the method in words."""
        law = law_text(self.law)
        domain = f"the simplex of {len(self.A)} vertices"
        if self.on == "box":
            domain = f"the box of {len(self.sizes)} parameters"
        return f"{law}, on {domain}, method {self.method}"

    def require(self) -> None:
        """Refuse what is incomplete or inconsistent, or more work than is done."""
        self.require_shapes()
        self._require_motion()

    def require_shapes(self) -> None:
        """Refuse it as far as that takes no work: all but motions."""
        N, law = len(self.A), self.law
        if self.method not in METHODS:
            raise FormatError(f"method {self.method!r} is not one of {', '.join(METHODS)}")
        if not self.A or len(self.B) != N or not self.region:
            raise FormatError("vertices or the region are missing")
        require_region(self.region)
        if self.on not in DOMAINS or (self.on == "box" and N & (N - 1)):
            raise FormatError(f"{N} vertices do not make a {self.on}")
        free = law.scheduled or law.fixed or law.polynomial
        belongs = {"scheduled": law.scheduled, "lyapunov": free}
        wanted = len(self.region) if self.method == "lyapunov" else 1
        if not belongs.get(self.method, law.fixed) or len(self.evidence) != wanted:
            raise FormatError(f"law and evidence do not belong to method {self.method!r}")
        if any((e.G is not None) != (self.method == "slack") for e in self._each):
            raise FormatError(f"G does not belong to method {self.method!r}")
        weighted = self.weights
        if weighted and (len(weighted) != N or self.method != "lyapunov" or law.scheduled):
            raise FormatError("weights do not belong here")
        if law.polynomial:
            require_terms(law, self.sizes)
        elif law.K is not None and len(law.K) not in (
            (1, N) if self.method == "lyapunov" else (1,)
        ):
            raise FormatError("a fixed law has one K")
        if any(proof.dual for proof in (*self.evidence, *self._each)):
            raise FormatError("a region has no dual form of its inequalities")
        for proof in self._each:
            require_pieces(proof.pieces, self.sizes)
            if proof.pieces and self.method != "lyapunov":
                raise FormatError("pieces belong to the method lyapunov")
        for proof in self.evidence:
            proof.require_cells(self.sizes)
            if proof.cells and (self.method != "lyapunov" or self.weights):
                raise FormatError("cells belong to the method lyapunov")
        self._require_remainder()
        self._require_counts()
        if self.least > (self.allowed or MAX_WORK):
            raise WorkError(
                f"{self.count} inequalities of this size are too many to be checked here"
            )

    def _require_remainder(self) -> None:
        """Refuse a remainder without its evidence, and evidence without a remainder."""
        for proof in self._each:
            if (proof.spread is None) != (self.remainder is None):
                raise FormatError("a remainder has evidence of its own, in every part")
        if self.remainder is None:
            return
        if self.method != "lyapunov" or self.weights:
            raise FormatError("a plant with a remainder is proved by the method lyapunov")
        n, m = len(self.A[0]), len(self.B[0][0])
        entries = self.remainder.entries
        self.remainder.require(n, m, len(entries[0]) - n - m if entries else 0, self.sizes)
        for proof, remainder in self._each_with_remainder:
            if proof.spread is not None:
                proof.spread.require(remainder)

    def _require_motion(self) -> None:
        """Reject evidence that does not cover moving parameters where the region sets a rate."""
        if not self.motion or not any(part.decays(self.step) for part in self.region):
            return
        late = is_late(self.motion)
        for proof in self.evidence if late else ():
            require_late_cells(self.motion, proof.cells)
        divided = not late and any(proof.cells for proof in self.evidence)
        whole = self.step or self.law.K is None  # of these X is one
        if self.method == "slack" or self.weights or (divided and whole):
            what = "disk about zero" if self.step else "half-plane"
            raise FormatError(
                f"a {what} needs one X for the whole box while parameters move; slack has none"
            )
        if self.remainder is not None and self.remainder.source is None:
            raise FormatError("sampled plants with a remainder need constant parameters")
        for proof, parts in self._each_with_parts:
            if any(part.decays(self.step) for part in parts):
                if not late and proof.cells:
                    require_continuous(proof.cells, self.motion)
                pieces = [(self.law.inside(p.low, p.high), p.evidence) for p in proof.cells]
                for law, item in pieces or [(self.law, proof)]:
                    X = lifted(law, item, self.sizes).part(slice(len(self.A[0])))
                    require_motion(X, self.motion, self.step)

    @property
    def _each_with_remainder(self) -> Iterator[tuple[Evidence, Remainder]]:
        """Evidence of each cell, with what is left of a remainder there."""
        if self.remainder is not None:
            for proof in self.evidence:
                for piece in proof.cells:
                    yield piece.evidence, self.remainder.inside_alone(piece.low, piece.high)
                if not proof.cells:
                    yield proof, self.remainder

    @property
    def _each_with_parts(self) -> Iterator[tuple[Evidence, tuple[Part, ...]]]:
        """Each evidence, with the parts of the region that it is for."""
        for number, proof in enumerate(self.evidence):
            yield (
                proof,
                self.region[number : number + 1] if self.method == "lyapunov" else self.region,
            )

    def _require_counts(self) -> None:
        """Refuse degrees and numbers of matrices that do not fit."""
        law, sizes, first = self.law, self.sizes, self.evidence[0]
        counts = [(law.degree, len(law.W or [])), (law.degree, len(law.Z or []))]
        counts = counts if law.scheduled else []
        counts += [(e.degree, len(e.X)) for e in self._each if self.method != "scheduled"]
        counts += [(e.degree, len(e.multiple)) for e in self._each if e.multiple]
        degrees = [law.degree, *(d for e in self._each for d in (e.degree, e.elevation))]
        if any(not 0 <= degree <= MAX_DEGREE for degree in degrees):
            raise FormatError(f"degrees must be 0 to {MAX_DEGREE}")
        if any(count != count_of(sizes, degree) for degree, count in counts):
            raise FormatError("matrices are missing: one W, Z, P or X a coefficient")
        if self.method == "quadratic" and first.degree:
            raise FormatError("one Lyapunov matrix is what the method quadratic has")
        if self.method == "scheduled" and (first.X or first.multiple):
            raise FormatError("the method scheduled has no Lyapunov matrices but W")
        multiples = law.scheduled and self.method == "lyapunov"
        if any(e.multiple for e in self._each) and not multiples:
            raise FormatError("multiples belong to scheduled laws given")
        if any(e.tau for e in self._each) and not self._is_theorem_1:
            raise FormatError("tau belongs to the right-hand sides of Theorem 1")

    @property
    def allowed(self) -> int | None:
        """The most work that it may take: more in parts of the box, and of large plants."""
        large = any(len(A) > LARGE for A in self.A[:1])
        more = large or any(proof.cells for proof in self.evidence)
        return MAX_IN_PARTS if more else None

    @property
    def least(self) -> int:
        """The least that it takes to prove, whatever its numbers."""
        sides = 2 * len(self.A[0]) * (2 if self.method == "slack" else 1)
        return least_work(self.count, sides)

    @property
    def count(self) -> int:
        """Number of coefficients of the inequalities of all parts of the region."""
        return sum(
            count_of(self.sizes, self.degree(proof)) * math.prod(proof.pieces) * len(parts)
            for evidence, parts in self._each_with_parts
            for proof in evidence.per_cell
        )

    @property
    def _each(self) -> list[Evidence]:
        """Evidence of each part of the region, and of the box."""
        return [proof for evidence in self.evidence for proof in evidence.per_cell]

    def degree(self, evidence: Evidence) -> int:
        """Return the least degree of the inequalities' polynomials in each simplex."""
        if self.method == "slack":
            return max(evidence.degree, 1) + evidence.elevation
        plant_degree = 1
        if self.remainder is not None:
            cells = any(proof.cells for proof in self.evidence)
            plant_degree = self.remainder.parts_degree if cells else self.remainder.degree
            if cells and self.remainder.third and self.law.K is not None:
                # of inputs that are the same in all of a part
                plant_degree = max(plant_degree - self.law.form_degree, 0)
        return degree_of(self.law, evidence) + plant_degree + evidence.elevation

    @property
    def _is_theorem_1(self) -> bool:
        shape = self.law.degree, self.evidence[0].elevation, self.on
        disk = [type(part) for part in self.region] == [Disk]
        return self.method == "scheduled" and shape == (1, 1, "simplex") and disk

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield the Lyapunov matrices."""
        for evidence in self._each:
            for k, X in enumerate(evidence.X):
                yield f"Lyapunov matrix {k + 1}", X
        for k, W in enumerate(self.law.W or []):
            yield f"W {k + 1}", W

    def decided(self) -> Verdict:
        """Prove it, where tau, the weights and the cells are those of a proof."""
        if any(evidence.tau < 0 for evidence in self.evidence):
            return undecided("tau is negative")
        if any(q <= 0 for q in self.weights):
            return undecided("a weight is not positive")
        return in_cells(self.evidence, super().decided)

    def inequalities(self) -> Iterator[Inequality]:
        """Yield X > 0 and F > 0 of every part of the region, and of the box."""
        AB = self.AB
        for evidence, mine in self._each_with_parts:
            for k, piece in enumerate(evidence.cells):
                claim = self.inside(piece)
                for inequality in claim._lyapunov(claim.AB, piece.evidence, mine):
                    yield replace(inequality, piece=f", cell {k + 1}")
            if not evidence.cells:
                written = self._slack if self.method == "slack" else self._lyapunov
                for inequality in written(AB, evidence, mine):
                    yield from in_pieces(inequality, evidence.pieces)

    def inside(self, piece: Piece) -> Self:
        """Return the claim about a part of the box, with its evidence for the first of the region.

        Raises
        ------
        FormatError
            If the law is one gain a vertex, or a node at a corner is missing.
        """
        low, high = piece.low, piece.high
        law, evidence = self.law.inside(low, high), (piece.evidence,)
        (A, B), remainder = on_part((self.A, self.B), self.nodes, self.remainder, low, high)
        motion = tuple(map(narrowed, self.motion, low, high)) if self.motion else ()
        inner = replace(self, A=A, B=B, law=law, evidence=evidence, remainder=remainder, nodes=())
        return replace(inner, motion=motion)

    def _lyapunov(
        self, AB: Polynomial, evidence: Evidence, parts: tuple[Part, ...]
    ) -> Iterator[Inequality]:
        sizes, n = self.sizes, len(self.A[0])
        XKX = lifted(self.law, evidence, sizes)
        X, N = XKX.part(slice(n)), AB * XKX
        if self.law.K is not None and self.remainder and self.remainder.same_inputs(self.B):
            X = bernstein(evidence.X, sizes, evidence.degree)
            A, B = AB.part(slice(n), slice(n)), constant(self.B[0], sizes)
            N = A * X + B * XKX.part(slice(n, None))
        if self.weights:
            X = bernstein([[[q]] for q in self.weights], sizes, 1) * X
        degrees = tuple(degree + evidence.elevation for degree in N.degrees)
        if any(not part.definite for part in parts):
            yield Inequality("of X", [[X]], degrees)
        spread = evidence.spread
        if spread is not None:
            blocks = spread.bounding(spread.moving(XKX))
            yield Inequality.raised("of the remainder", blocks, evidence.elevation)
        for part in parts:
            name = part.kind if len(self.region) > 1 else ""
            motion = self.motion if part.decays(self.step) else ()
            for more, change in changes(XKX.part(slice(n)), motion, self.step):
                for L, M in part.pairs:
                    F = lyapunov(L, M, X, N)
                    if change is not None:
                        F = F + change.beside(_corner(L, bool(self.step)))
                    if spread is not None:
                        F = F - constant(spread.of_region(factors(M)), sizes)
                    if evidence.tau:
                        F = F - _floor(evidence.tau, n, sizes)
                    kind = _Theorem1 if self._is_theorem_1 else Inequality
                    yield kind(name + more, [[F]], degrees)

    def _slack(
        self, AB: Polynomial, evidence: Evidence, parts: tuple[Part, ...]
    ) -> Iterator[Inequality]:
        """Yield the inequalities with slack, for other parts than a disk these.

        -[ L (x) P + M' (x) N + *, M (x) (P - G') + e I (x) N ; *, -e I (x) (G + G') ] > 0.

        It implies L (x) P + M' (x) A_c P + M (x) P A_c' < 0, of which the region is the same as
        with M and M' exchanged: multiply by [ I, I (x) A_c ] from the left and by its transpose.
        """
        sizes, e = self.sizes, evidence.epsilon
        P, G = bernstein(evidence.X, sizes, evidence.degree), constant(evidence.G or [], sizes)
        N = AB * (self.law.form(sizes) * G)
        degrees = (self.degree(evidence),) * len(sizes)
        N, P, G = (form.raised(degrees) for form in (N, P, G))
        for part in parts:
            for L, M in part.pairs:
                if part.circle is not None:
                    centre, r = part.circle
                    upper = N.times(-1) + G.times(centre)
                    rows = [[P.times(r), upper], [(G + G.T - P).times(r)]]
                else:
                    eye, T = identity(len(L)), [list(row) for row in zip(*M, strict=True)]
                    corner = (P - G.T).beside(M) + N.beside(eye).times(e)
                    last = (G + G.T).beside(eye).times(e)
                    rows = [[lyapunov(L, T, P, N), -corner], [last]]
                yield Inequality(part.kind if len(self.region) > 1 else "", rows, degrees)
        if any(not part.definite for part in parts):
            yield Inequality("of P", [[P]], degrees)

    # --- one alpha -------------------------------------------------------------------------------

    def fraction_at(self, alpha: list[Fraction]) -> tuple[Rationals, Rationals]:
        """Return N and W of the closed loop N W^-1 at one alpha; W = I for a fixed law.

        Raises
        ------
        ValueError
            If alpha is not a point of the simplex, or for a box no product.
        """
        if len(alpha) != len(self.A) or min(alpha) < 0 or sum(alpha) != 1:
            raise ValueError("alpha is not a point of the simplex")
        A, B = mix(alpha, self.A), mix(alpha, self.B)
        law, at = self.law, coordinates(alpha, self.sizes)
        source = self.remainder and self.remainder.source
        if source:
            more, n = source.at(tuple(at[1::2]))[0], len(A)
            A = add(A, [row[:n] for row in more])
            B = add(B, [row[n : n + len(B[0])] for row in more])
        elif self.remainder is not None and self.remainder.curve:
            values, n = basis(at, self.sizes, self.remainder.degree), len(A)
            more = mix(values, [list(map(list, M)) for M in self.remainder.curve])
            A = add(A, [row[:n] for row in more])
            B = add(B, [row[n : n + len(B[0])] for row in more])
        if law.K is not None:
            W = identity(len(A))
            Z = law.gain(alpha, at)
        else:
            values = basis(at, self.sizes, law.degree)
            W, Z = mix(values, law.W or []), mix(values, law.Z or [])
        weights = self.weights or (ONE,) * len(alpha)
        q = sum((a * w for a, w in zip(alpha, weights, strict=True)), Fraction(0))
        whole, common = (common_denominator(pair, LONGEST) for pair in ((A, B), (W, Z)))
        pairs = zip(whole_numbers(A, whole), whole_numbers(B, whole), strict=True)
        N = multiplied(
            [a + b for a, b in pairs], whole_numbers(W, common) + whole_numbers(Z, common)
        )
        return [[Fraction(e, whole * common) for e in row] for row in N], [
            [q * e for e in r] for r in W
        ]

    def off_at(self, alpha: list[Fraction]) -> Fraction:
        """Return what entries of N in `fraction_at` are off by, of functions without a rational."""
        source = self.remainder and self.remainder.source
        if not source:
            return Fraction(0)
        at = coordinates(alpha, self.sizes)
        off = source.at(tuple(at[1::2]))[1]
        if not off:
            return off
        law = self.law
        if law.K is not None:
            W, Z = identity(len(self.A[0])), law.gain(alpha, at)
        else:
            values = basis(at, self.sizes, law.degree)
            W, Z = mix(values, law.W or []), mix(values, law.Z or [])
        columns = zip(*[*W, *Z], strict=True)
        return off * max(sum(map(abs, column), Fraction(0)) for column in columns)

    def closed_loop(self, alpha: list[Fraction]) -> Rationals | None:
        """Return A + B K at one alpha, None where the law is undefined."""
        N, W = self.fraction_at(alpha)
        if self.law.K is None:
            return right_divide(N, W)
        return [[e / W[0][0] for e in row] for row in N]

    def poles_inside(self, alpha: list[Fraction]) -> bool:
        """Decide exactly whether all poles at one alpha lie in the region; False is always right.

        An ellipse is replaced by the polygon of its tangents, which contains it. A law that is
        undefined at alpha keeps no pole anywhere.

        Raises
        ------
        ValueError
            If alpha is not a point of the simplex, or for a box no product; or the numbers of the
            region make none.
        FormatError
            If a count of the work says that it is too much.
        """
        require_region(self.region)
        closed = self.closed_loop(alpha)
        return closed is not None and all_inside(closed, self.region)


class _Theorem1(Inequality):
    """Inequalities that the paper numbers."""

    def blocks(self) -> Iterator[tuple[Place, Integers]]:
        """Yield (15) to (17)."""
        for place, matrix in super().blocks():
            yield replace(place, name=_numbered(place.powers)), matrix


def law_text(law: Law) -> str:
    """Say of which form a law is, and what it measures."""
    if law.fixed:
        return "one gain K"
    if law.scheduled:
        return f"K(alpha) = Z W^-1 of degree {law.degree}"
    none: list[Rationals] = [[[]]] * len(law.C)
    named = []
    for k, name in enumerate(law.measured):
        C, F = ([[rows[k]] for rows in M] for M in (law.C, law.F))
        named.append(f"{quoted(name)} = {output_text(C, none, F)}")
    what = ", ".join(named) or "all states"
    gain = f"a polynomial gain of degree {law.degree}" if law.degree else "one gain"
    return f"{gain} of {what}"


def _numbered(e: Exponent) -> str:
    support = sorted((j for j, p in enumerate(e) if p), key=lambda j: (-e[j], j))
    pairs = zip("jkl", support, strict=False)
    return f"({14 + len(support)}) " + " ".join(f"{letter}={j + 1}" for letter, j in pairs)


def _corner(L: Rationals, disk: bool) -> Rationals:
    """Return what dX/dt of a half-plane is times, or of a disk the change of X in a step.

    Its first block r X becomes r X(p(t + T)).
    """
    if not disk:
        return [[ONE]]
    none = Fraction(0)
    return [[-L[0][0], none], [none, none]]


def plant_form(A: list[Rationals], B: list[Rationals], sizes: Sizes) -> Polynomial:
    """Return [A, B]."""
    both = [[a + b for a, b in zip(*pair, strict=True)] for pair in zip(A, B, strict=True)]
    return bernstein(both, sizes, 1, MAX_BITS)


def _floor(tau: Fraction, n: int, sizes: Sizes) -> Polynomial:
    """Return what (15) has to exceed, and (16), (17) need less for: in the first block tau times.

    sum a_j^3 - (sum a_j^2 a_k + 6 sum a_j a_k a_l) / (N-1)^2 >= 0.
    """
    square = max(sizes[0] - 1, 1) ** 2
    share = {3: ONE, 2: Fraction(-1, square), 1: Fraction(-6, square)}
    # the coefficient of a monomial, whatever multinomial is in it
    terms = {e: share[max(e)] * tau for e in monomials(sizes, 3)}
    whole = common_denominator([[list(terms.values())]])
    block = constant([[ONE * (i == j < n) for j in range(2 * n)] for i in range(2 * n)], sizes)
    form = {e: [[int(value * whole)]] for e, value in terms.items()}
    return Polynomial(form, sizes, (3,), whole) * block


# --- evidence of each method ---------------------------------------------------------------------


def _quadratic(table: Table, _: Poles, n: int) -> tuple[Evidence, ...]:
    return (Evidence([table.matrix("W", n, n)]),)


def _scheduled(table: Table, _: Poles, n: int) -> tuple[Evidence, ...]:  # noqa: ARG001
    return (Evidence([], elevation=table.whole("elevation", 1), tau=table.number("tau")),)


def _slack(table: Table, blank: Poles, n: int) -> tuple[Evidence, ...]:
    evidence, G = read_evidence(table, n, blank.sizes, "P", 1), table.matrix("G", n, n)
    return (replace(evidence, G=G, epsilon=table.number("epsilon", 0)),)


def _lyapunov(table: Table, blank: Poles, n: int) -> tuple[Evidence, ...]:
    multiple = blank.law.scheduled
    return tuple(
        read_cells(part, n, blank.sizes, multiple=multiple)
        if "cells" in part
        else read_evidence(part, n, blank.sizes, multiple=multiple)
        for part in table.tables("parts", MAX_PARTS)
    )


_EVIDENCE = {
    "quadratic": _quadratic,
    "scheduled": _scheduled,
    "slack": _slack,
    "lyapunov": _lyapunov,
}
