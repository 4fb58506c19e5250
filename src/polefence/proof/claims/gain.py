"""L2 gain from the disturbances to a signal, by the bounded real lemma.

X > 0 and, with z = C x + D u + F w of p rows and q disturbances,
[ -(N + N'), -E, -Y' ; *, g I_q, -F' ; *, *, g I_p ] > 0; in the dual form with N = Q (A + B K),
Y = C + D K and Q E in place of E, or -(N + N' + (Q E E'Q + Y'Y) / g) > 0 where F is zero: a
polynomial whose coefficients prove more than those of the blocks. In discrete time what a step T
adds, T |N x + E w|^2 in the metric of X, is a further row [ N, E, 0, X / T ]; in the dual form it
is T [N, E]'Q [N, E], taken from the first two blocks.

In a ``band`` it is the largest singular value of the transfer function there alone, which the
transfer function itself proves: see `proof.transfer`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.bands import Band
from polefence.proof.claims.held import StoredClaim
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    Rows,
    Subject,
    below_kappa,
    with_remainder,
)
from polefence.proof.claims.storage import least_of_storage, rows_of_storage
from polefence.proof.matrices import identity
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, constant, diagonal
from polefence.proof.reading import Table, plain
from polefence.proof.transfer import (
    Tensor,
    Transfer,
    gain_polynomial,
    passes,
    passes_at,
    pole_polynomial,
)
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Gain(StoredClaim):
    """The L2 gain from w to z = C x + D u + F w, its H-infinity norm, is less than ``level``.

    With ``held`` w and z are those at all times, of the plant of which this one is the samples.
    With a ``band`` it is the largest amplification of a sine of a frequency in the band, whatever
    its direction: the largest singular value of the transfer function there; the loop is stable.
    """

    kind: ClassVar[str] = "gain"
    late_as: ClassVar[str | None] = "gain"
    direct: ClassVar[bool] = True
    most: ClassVar[int] = MAX_ENTRIES
    has_dual: ClassVar[bool] = True
    has_transfer: ClassVar[bool] = True
    along_motions: ClassVar[bool] = True
    has_passing: ClassVar[bool] = True

    band: Band | None = field(default=None, kw_only=True)

    @classmethod
    def read_extra(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read what is sampled, and the band."""
        known = super().read_extra(table, subject, outputs)
        return known | ({"band": Band.of(table.numbers("band", 2))} if "band" in table else {})

    def write_extra(self) -> dict[str, Any]:
        """Return what is sampled, and the band."""
        band = self.band
        more = {} if band is None else {"band": [plain(band.low), plain(band.high)]}
        return super().write_extra() | more

    def require_extra(self) -> None:
        """Refuse what is sampled, a storage function, or a band where it does not fit."""
        super().require_extra()
        subject = self.subject
        if self.band is not None:
            self._require_band(self.band)
        dual = any(item.dual for item in subject.evidence.per_cell)
        if dual and not subject.step and subject.law.F and subject.remainder is not None:
            raise FormatError(
                "law.measured: where a disturbance passes straight into it, a gain of a plant with "
                "a remainder is not proved in the dual form, but in discrete time"
            )
        if self.held is not None and not all(item.dual for item in self.subject.evidence.per_cell):
            raise FormatError("held: a gain at all times needs Q of the dual form in every part")

    def _require_band(self, band: Band) -> None:
        if not self.subject.evidence.transfer:
            raise FormatError("band: a gain in a band is proved by the transfer function alone")
        if self.held is not None:
            raise FormatError("band: at all times a sampled plant has no frequency response")
        band.require(self.subject.step)

    @property
    def more_work(self) -> int:
        """Of a storage function, the least that it takes."""
        if self.held is None:
            return 0
        return least_of_storage(self.subject, self.subject.q + len(self.outputs))

    @property
    def least_degree(self) -> int:
        """None."""
        return 0

    @property
    def largest(self) -> int:
        """Rows of the lemma, or of the inequalities of a storage function."""
        n, supply = self.subject.n, self.subject.q + len(self.outputs)
        if self.held is not None:
            return n + self.subject.m + max(n, supply)
        return (2 * n if self.subject.step else n) + supply

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return X, and the bounded real lemma."""
        E, step = self.subject.driving(self.scales, X.sizes), self.subject.step
        lemma = self._lemma(self.subject.minus(N), E, Y)
        below, beside = X.times(1 / step) if step else None, N.T
        spread, slope = self.subject.evidence.spread, self.subject.slope
        if below is not None and slope is not None:  # x(t + T)'X(p(t + T))^-1 x(t + T) is less
            below, beside = below + slope, beside - slope
        if spread is not None:
            # [ -H; 0; 0; H ] Delta [ V, 0, 0, 0; 0, G, 0, 0 ] and its transpose
            entering, times = constant(spread.entering(2), X.sizes), self._times
            lemma[0][0] = lemma[0][0] - entering - constant(spread.omega, X.sizes).times(times)
            lost = [times * x * x for x in self.subject.off(self.scales)]
            lemma[1][0] = lemma[1][0] - diagonal(lost, X.sizes)
            below = None if below is None else below - entering
        if below is not None:
            none = constant([[Fraction(0)] * self.subject.n for _ in self.outputs], X.sizes)
            ends = (beside, E.T, none, below)
            lemma = [[*row, end] for row, end in zip([*lemma, []], ends, strict=True)]
        return {"of X": [[X]], "of the gain": lemma}

    def dual_rows(self) -> Rows:
        """Return the lemma of the dual form."""
        if self.held is not None:
            return rows_of_storage(self.subject, self.outputs, self.scales, self.held, self.level)
        loop = self.subject.dual_loop(self.outputs)
        Q, M, Y, both = loop.Q, loop.M, loop.Y, loop.falling
        if self.subject.change is not None:  # x'Q x is the energy that is left, along a motion too
            both = both + self.subject.change
        entering, step = self.subject.driving(self.scales, Q.sizes), self.subject.step
        E = loop.WQ * entering
        spread = self.subject.evidence.spread
        through = self.subject.through(self.outputs, self.scales)
        if not step and through is None and self.level:
            products = self._products(both, E, Y)
            if products is not None:
                if spread is None:
                    return {"of the gain": [[products]]}
                form = self.subject.law.form(Q.sizes)
                blocks = with_remainder(products, loop, spread, form)
                return {"of the gain": blocks} | below_kappa(Q, spread)
        if not step and spread is None:
            return {"of the gain": self._lemma(-both, E, Y)}
        QE = (Q * entering).times(step)
        lemma = self._lemma(-both, E + M.T * QE, Y)
        lemma[1][0] = lemma[1][0] - entering.T * QE
        if spread is None:
            return {"of the gain": lemma}
        loss, PH = loop.loss(spread, self.subject.law.form(loop.Q.sizes))
        share = self._times * (1 + step * spread.kappa)
        driven = [share * x * x for x in self.subject.off(self.scales)]
        lemma[0][0] = lemma[0][0] - loss.times(self._times)
        lemma[1][0] = lemma[1][0] - diagonal(driven, Q.sizes)
        H = diagonal(spread.rows, Q.sizes)
        none = constant([[Fraction(0)] * self.subject.n for _ in self.outputs], Q.sizes)
        ends = (PH, QE.T * H, none, constant(identity(self.subject.n), Q.sizes))
        lemma = [[*row, end] for row, end in zip([*lemma, []], ends, strict=True)]
        return {"of the gain": lemma} | below_kappa(Q, spread)

    def _products(self, both: Polynomial, E: Polynomial, Y: Polynomial) -> Polynomial | None:
        """Return -(N + N' + Q E (g - d)^-1 E'Q + Y'Y / g), d what a remainder takes of g.

        None where that is too much.
        """
        spread, q = self.subject.evidence.spread, self.subject.q
        driven = spread.driving(self.scales, q) if spread else (Fraction(0),) * q
        rest = [self.level - x * x for x in driven]
        if min(rest) <= 0:
            return None
        moved = E.half_times((E * diagonal([1 / x for x in rest], E.sizes)).T)
        return -(both + moved + Y.T.half_times(Y).times(1 / self.level))

    @property
    def _times(self) -> int:
        """How many times |V x|^2 and |G w|^2 count in discrete time, of |V x + G w|^2.

        Where w passes into what the law measures both have B's columns; else none is in both. In
        continuous time one of twice H H' is for each.
        """
        return 2 if self.subject.step and self.subject.law.F else 1

    @property
    def power(self) -> int:
        """Of det(g^2 I - G*G) |a|^2, for one channel; no less for more."""
        return 2

    def polynomials(self, transfer: Transfer) -> Iterator[tuple[str, Tensor]]:
        """Yield det(g^2 I - G*G) |a|^2 over the frequency and the parameters."""
        if self.band is not None:
            ends = self.band.outside(self.subject.step)
            yield "of the poles", pole_polynomial(transfer)
            if passes_at(transfer, self.level, ends[0]):
                yield "of the gain in the band", gain_polynomial(transfer, self.level, ends)
            else:
                yield "of the gain at the band's lower end", Tensor([0], (1,))
            return
        if passes(transfer, self.level):
            yield "of the gain", gain_polynomial(transfer, self.level)
        else:
            yield "of what passes straight through", Tensor([0], (1,))

    def _lemma(self, minus: Polynomial, E: Polynomial, Y: Polynomial) -> list[list[Polynomial]]:
        sizes, q = minus.sizes, self.subject.q
        F = self.subject.through(self.outputs, self.scales)
        F = constant([[Fraction(0)] * q for _ in self.outputs], sizes) if F is None else F
        return [
            [minus, E.times(-1), Y.T.times(-1)],
            [diagonal([self.level] * q, sizes), F.T.times(-1)],
            [diagonal([self.level] * len(self.outputs), sizes)],
        ]

    @property
    def under(self) -> str:
        """The band; nothing where it is every disturbance."""
        return "" if self.band is None else f" at every frequency {self.band.text}"
