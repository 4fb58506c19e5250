"""The largest value of a signal from rest, for disturbances that are bounded at all times.

With |w_i(t)| <= s_i the signal y = C x + F w is at most

    sum over i of   integral over t of |h_i(t)|  +  |F_i| s_i ,    h_i(t) = C exp(A t) E_i s_i ,

and for a w that switches it comes as near to that as one likes. From x(0) = E_i s_i the motion is
followed over steps of time by polynomials, see `polefence.proof.response`; so is h, and with how
far errors reach, `polefence.proof.claims.followed`, on a step of length d

    integral of |h|  <=  integral of |H|  +  d kappa |e|_Q ,

H a polynomial in time and in the parameters g. In Bernstein polynomials B_j of g it is the sum of
b_j(t) B_j(g); these are not negative, and so for all g

    integral of |H|  <=  the sum of (integral of |b_j|) B_j(g) .

Each b_j is a polynomial in time alone: of a degree n its own Bernstein coefficients c_k on an
interval of length l have integral of |b_j| <= l / (n + 1) sum |c_k|, which is exact where they are
of one sign, and else the interval is halved. All steps are summed for each j before the largest is
taken, for their worst parameters are not the same. After the last step, at time T,

    integral of |h|  <=  kappa |x(T)|_Q / beta .
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import ClassVar

from polefence.proof.claims.followed import Followed, Run, Sums
from polefence.proof.matrices import ONE, ZERO
from polefence.proof.plant import Plant, split
from polefence.proof.response import Centred, Follower, Form, Series, Step, in_bernstein
from polefence.proof.short import Short
from polefence.proof.text import digits_down, quoted
from polefence.proof.work import FormatError, spend

HALVINGS = 5  # of a step


@dataclass(frozen=True)
class PeakToPeak(Followed):
    """|y| from rest is at most ``level`` while each disturbance is within its scale."""

    kind: ClassVar[str] = "peak to peak"

    def require_extra(self) -> None:
        """Refuse a law of which motions do not start where disturbances act."""
        super().require_extra()
        if self.subject.law.W is not None:
            raise FormatError(f"{self.kind}: of a law that is no Z W^-1")

    @property
    def under(self) -> str:
        """From where it starts."""
        return " from rest"

    def acting_words(self, plant: Plant) -> str:
        """Say how large each disturbance is at most, rounded down."""
        sizes, said, labels = self.scales or (ONE,) * self.subject.q, [], plant.disturbances
        for k in self.acting:
            name = f"{quoted(split(labels[k])[0])} = " if k < len(labels) else ""
            said.append(f"|{name}w{k + 1}| <= {digits_down(sizes[k])}")
        alone = "" if all(sizes) else " alone"
        return f" for all {' and '.join(said)}{alone}"

    def missed(self) -> str:
        """Say what is not proved; "" where all is."""
        return "" if sum(self.bound()) <= self.level else "it is not proved to be so small"

    def bound(self) -> tuple[Fraction, Fraction]:
        """Return what y is at most in one part of the box, in two parts.

        Of the polynomials that are followed, and of what they are off.
        """
        return _Responses.of(self).bound()


@dataclass(frozen=True)
class _Responses(Short):
    """The responses to impulses of all disturbances in one part of the box."""

    claim: PeakToPeak
    run: Run
    E: tuple[Centred, ...]  # a column each, of those that act
    F: Centred | None
    follower: Follower
    degrees: tuple[int, ...]

    @classmethod
    def of(cls, claim: PeakToPeak) -> _Responses:
        """Return them."""
        run, own, subject = claim.run, claim.following[0], claim.subject
        E = subject.driving(claim.scales, subject.sizes)
        columns = tuple(Centred.of(E.part(slice(None), slice(k, k + 1))) for k in range(subject.q))
        F = subject.through(claim.outputs, claim.scales)
        through = None if F is None else Centred.of(F)
        series = Series(own.terms, own.degree, own.bits)
        none, norm = Centred({}, 1), run.follower.norm
        follower = Follower(run.A, none, series, subject.sizes, norm, own.rate, None, ())
        most = [own.degree] * len(follower.variables)
        shown = [max((e[k] for e in run.C.terms), default=0) for k in range(len(most))]
        degrees = [a + b for a, b in zip(most, shown, strict=True)]
        if through is not None:
            degrees = [max(d, *(e[k] for e in through.terms)) for k, d in enumerate(degrees)]
        return cls(claim, run, columns, through, follower, tuple(degrees))

    def bound(self) -> tuple[Fraction, Fraction]:
        """Return what y is at most: of what is followed, and of what that is off."""
        totals = [ZERO] * math.prod(d + 1 for d in self.degrees)
        slack = ZERO
        for column in self.E:
            if column.terms:
                own, more = self._of(column)
                totals = list(map(Fraction.__add__, totals, own))
                slack += more
        for passed in self._passing():
            totals = list(map(Fraction.__add__, totals, passed))
        return max(totals), slack

    def _passing(self) -> list[list[Fraction]]:
        """Return Bernstein coefficients of F, without signs, of each disturbance."""
        if self.F is None:
            return []
        every = list[list[Fraction]]()
        for k in range(self.claim.subject.q):
            form = {(0, *e): M[0][k] for e, M in self.F.terms.items()}
            values, scale = in_bernstein(form, (0, *self.degrees), self.follower.variables)
            every.append([Fraction(abs(x), scale * self.F.whole) for x in values])
        return every

    def _of(self, column: Centred) -> tuple[list[Fraction], Fraction]:
        """Return the integral of |H| as Bernstein coefficients of g, and what is beside it."""
        own, follower = self.claim.following[0], self.follower
        whole = 1 << own.bits
        start: Form = {
            e: [(row[0] << own.bits) // column.whole for row in M] for e, M in column.terms.items()
        }
        rounded = Fraction(len(start), whole) * sum(follower.norm)
        count = math.prod(d + 1 for d in self.degrees)
        sums, beside = [0] * count, ZERO
        lengths = [units for units, many in own.lengths for _ in range(many)]
        last, scale = Step(ZERO, ZERO, (start,), rounded), 1
        for units, step in zip(lengths, follower.steps(start, own.every, rounded), strict=True):
            y, off = self._along(step)
            values, scale = in_bernstein(y, (own.terms, *self.degrees), follower.variables)
            for j in range(count):
                sums[j] += units * _size(values[j::count], HALVINGS)
            beside += units * own.unit * (own.reach * step.error + off)
            last = step
        far = follower.size(last.last) / whole + last.error
        shared = own.unit / (scale * whole * (own.terms + 1) << (own.terms + 1) * HALVINGS)
        return [x * shared for x in sums], beside + own.reach * far / own.rate

    def _along(self, step: Step) -> tuple[Sums, Fraction]:
        """Return H over a step, over 2^bits, in T_i of time and in powers of g; its rounding."""
        total, off = Sums(), ZERO
        for i, form in enumerate(step.forms):
            y, rounded = self.run.output(form, ())
            off += rounded
            total |= {(i, *e): v for e, v in y.items()}
        return total, off


def _size(c: Sequence[int], halvings: int) -> int:
    """Return no less than (n + 1) 2^((n + 1) halvings) times the integral of |b| over [0, 1].

    Parameters
    ----------
    c : sequence of int
        The n + 1 Bernstein coefficients of b there.
    """
    if not halvings or min(c) >= 0 or max(c) <= 0:
        return sum(map(abs, c)) << len(c) * halvings
    spend(len(c) ** 2 // 2, 128)
    left, right, last, high = [c[0]], [c[-1]], list(c), len(c) - 1
    for _ in range(high):  # without halving, so that numbers stay whole
        last = [a + b for a, b in pairwise(last)]
        left.append(last[0])
        right.append(last[-1])
    halves = ([x << high - k for k, x in enumerate(half)] for half in (left, right))
    return sum(_size(half, halvings - 1) for half in halves)
