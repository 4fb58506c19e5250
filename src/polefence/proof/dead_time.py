"""Dead times: a signal some time late, as few states and what these leave out.

In s times the dead time T, e^-s is near N(s) / D(s), of degrees n - 1 and n (Pade); with M(s) of
degree n, |e^-s - N(s) / D(s)| < |M(s) / D(s)| on the line Re s = -a, where `require_covered` proves
that for every frequency. All three are without poles to the right of it, so that
delta = (e^-s D - N) / M is a causal system of L2 gain below 1, also if signals are weighted by
e^(a t / T): v(t - T) is in

    T z' = F z + g v,    v_late = c z + delta (b z + mu v),    |delta| <= 1.

A claim that is proved for a parameter delta in [-1, 1] of any rate, with one X, says the same of
every such system: its inequality is L + delta (h e' + e h') > 0 at each alpha, and by Petersen's
lemma (1987) there is a number lambda with L - lambda e e' - h h' / lambda > 0. So what X bounds
falls as it did before but for lambda (p^2 - (e'x)^2), whose integral over time is not positive
where p = delta e'x. Other parameters have to be constant, for lambda depends on them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from polefence.proof import intervals
from polefence.proof.intervals import Interval, enclosing
from polefence.proof.matrices import ZERO
from polefence.proof.reading import Table, plain
from polefence.proof.regions import HalfPlane
from polefence.proof.roots import all_inside
from polefence.proof.short import Short
from polefence.proof.work import RATIONAL, FormatError, spend

ORDERS = (1, 8)
LARGEST = Fraction(1, 2)  # of the dead time times the decay rate
TERMS = 8  # of the series of sine and cosine about the middle of a cell
CELLS, LEAST = 500, Fraction(1, 2**12)  # at most, and the narrowest
SHARE = Fraction(
    1, 16
)  # of (x + y)^2 <= (1 + SHARE) x^2 + (1 + 1 / SHARE) y^2, at high frequencies
HIGHEST = tuple(Fraction(2) ** k for k in range(4, 14))  # where high frequencies may begin

Series = list[Fraction]  # coefficients, that of the constant first


@dataclass(frozen=True)
class Covering(Short):
    """N, D and M of e^-s, for states of a chain.

    Attributes
    ----------
    order : int
        n.
    shift : Fraction
        a.
    floor : Fraction
        b of M(s) = mu d_n (s + a + b)^n.
    gain : Fraction
        mu.
    """

    order: int
    shift: Fraction
    floor: Fraction
    gain: Fraction

    @property
    def pade(self) -> tuple[Series, Series]:
        """N and D."""
        n, f = self.order, math.factorial
        whole = f(2 * n - 1)
        N = [
            Fraction((-1) ** k * f(2 * n - 1 - k) * f(n - 1), whole * f(k) * f(n - 1 - k))
            for k in range(n)
        ]
        D = [Fraction(f(2 * n - 1 - k) * f(n), whole * f(k) * f(n - k)) for k in range(n + 1)]
        return N, D

    @property
    def chain(self) -> tuple[list[list[Fraction]], Series, Series, Series]:
        """F, g, c and b, of states n^n d_n (s / n)^k / D(s) v, k from 0 to n - 1."""
        n, (N, D) = self.order, self.pade
        unit = [Fraction(n) ** k / (D[n] * n**n) for k in range(n)]
        F = [[Fraction(n) if j == i + 1 else ZERO for j in range(n)] for i in range(n - 1)]
        F.append([-n * D[k] * unit[k] for k in range(n)])
        g = [ZERO] * (n - 1) + [Fraction(n)]
        power = [math.comb(n, k) * (self.shift + self.floor) ** (n - k) for k in range(n)]
        b = [self.gain * unit[k] * (D[n] * power[k] - D[k]) for k in range(n)]
        return F, g, [N[k] * unit[k] for k in range(n)], b

    def require_covered(self) -> None:
        """Refuse one of which the bound does not hold, or cannot be shown here.

        Raises
        ------
        FormatError
        """
        if not self.is_sound:
            raise FormatError(
                "dead_time: gain is too small for what the approximation leaves out, or decay is "
                "too fast for its order"
            )

    @cached_property
    def is_sound(self) -> bool:
        """Whether |e^-s D - N|^2 < |M|^2 is shown on the line Re s = -a, D to the left of it."""
        return all_inside(self.chain[0], (HalfPlane(self.shift),)) and self._covers()

    def _covers(self) -> bool:
        n = self.order
        N, D = (_on_line(P, self.shift) for P in self.pade)
        energy, left_out = _square(D), _square(N)
        M = [ZERO] * (2 * n + 1)
        for k in range(n + 1):
            M[2 * k] = (self.gain * self.pade[1][n]) ** 2 * math.comb(n, k)
            M[2 * k] *= self.floor ** (2 * (n - k))
        grown = intervals.exponential(enclosing(self.shift))
        high = _high(M, energy, left_out, intervals.times(grown, grown))
        if high is None:
            return False
        both = (  # real and imaginary parts of D conj(N)
            _sum(_product(D[0], N[0]), _product(D[1], N[1])),
            _sum(_product(D[1], N[0]), [-x for x in _product(D[0], N[1])]),
        )
        cells = [(ZERO, high)]
        for _ in range(CELLS):
            if not cells:
                return True
            low, end = cells.pop()
            if end - low < LEAST:
                return False
            if not _positive(M, energy, left_out, both, grown, (low + end) / 2, (end - low) / 2):
                cells += [(low, (low + end) / 2), ((low + end) / 2, end)]
        return False


def _positive(
    M: Series,
    energy: Series,
    left_out: Series,
    both: tuple[Series, Series],
    grown: Interval,
    middle: Fraction,
    half: Fraction,
) -> bool:
    """Whether |M|^2 - |e^-s D - N|^2 is positive at all frequencies from middle - half on.

    It is |M|^2 - |N|^2 - e^2a |D|^2 + 2 e^a (R cos w + I sin w), D conj(N) = R + i I.
    """
    if half > 1:
        return False
    spend(RATIONAL * 4 * (len(M) + 2 * TERMS) ** 2, 256, 256)
    exact, energy, R, I = (  # noqa: E741
        _scaled(_shifted(P, middle), half) for P in (_sum(M, [-x for x in left_out]), energy, *both)
    )
    cosine, sine = _series(half)
    along = _sum(_product(R, cosine), _product(I, sine))
    across = _sum(_product(I, cosine), [-x for x in _product(R, sine)])
    at = enclosing(middle)
    cos, sin, square = intervals.cosine(at), intervals.sine(at), intervals.times(grown, grown)
    count = max(map(len, (exact, energy, along, across)))
    total = []
    for k in range(count):
        e, d, x, y = (
            enclosing(P[k]) if k < len(P) else intervals.ZERO
            for P in (exact, energy, along, across)
        )
        turned = intervals.times(
            grown, intervals.plus(intervals.times(cos, x), intervals.times(sin, y))
        )
        value = intervals.minus(e, intervals.times(square, d))
        total.append(intervals.plus(value, intervals.plus(turned, turned)))
    # the rest of each series is no more than its first term
    rest = half ** (2 * TERMS) / math.factorial(2 * TERMS)
    rest *= 4 * intervals.size(grown) * sum(map(abs, (*R, *I)))
    most = rest + sum((intervals.size(x) for x in total[1:]), ZERO)
    return Fraction(total[0][0], intervals.ONE) > most


def _series(half: Fraction) -> tuple[Series, Series]:
    """Return the first terms of cos(half x) and sin(half x)."""
    return _alternating([half**k / math.factorial(k) for k in range(2 * TERMS)])


def _high(M: Series, energy: Series, left_out: Series, square: Interval) -> Fraction | None:
    """Return a frequency beyond which M is enough, whatever the phase; None where none is."""
    grown = Fraction(square[1], intervals.ONE)
    more, rest = -(1 + SHARE) * grown, -(1 + 1 / SHARE)
    total = _sum(_sum(M, [more * x for x in energy]), [rest * x for x in left_out])
    total = total[::2]  # of the square of the frequency
    for high in HIGHEST:
        beyond = _shifted(total, high**2)
        if min(beyond) >= 0 and beyond[0] > 0:
            return high
    return None


def _on_line(P: Series, shift: Fraction) -> tuple[Series, Series]:
    """Return the real and the imaginary part of P(-shift + i w), in w."""
    return _alternating(_shifted(P, -shift))


def _alternating(P: Series) -> tuple[Series, Series]:
    """Return the real and the imaginary part of P(i x)."""
    signed = [(-1) ** (k // 2) * x for k, x in enumerate(P)]
    real, imaginary = (
        [x if k % 2 == odd else ZERO for k, x in enumerate(signed)] for odd in (0, 1)
    )
    return real, imaginary


def _square(parts: tuple[Series, Series]) -> Series:
    return _sum(*(_product(P, P) for P in parts))


def _shifted(P: Series, by: Fraction) -> Series:
    """Return P(by + x)."""
    total = list(P)
    for first in range(len(total)):
        for k in range(len(total) - 2, first - 1, -1):
            total[k] += by * total[k + 1]
    return total


def _scaled(P: Series, by: Fraction) -> Series:
    """Return P(by x)."""
    return [x * by**k for k, x in enumerate(P)]


def _product(P: Series, Q: Series) -> Series:
    total = [ZERO] * (len(P) + len(Q) - 1)
    for i, x in enumerate(P):
        for j, y in enumerate(Q) if x else ():
            total[i + j] += x * y
    return total


def _sum(P: Series, Q: Series) -> Series:
    longer, shorter = (P, Q) if len(P) >= len(Q) else (Q, P)
    return [x + (shorter[k] if k < len(shorter) else ZERO) for k, x in enumerate(longer)]


@dataclass(frozen=True)
class DeadTime(Short):
    """What a parameter of any rate in [-1, 1] stands for: see the module.

    Attributes
    ----------
    signal : str
        What is late, by its name.
    time : Fraction or str
        [s]; or the name of the parameter that it is.
    first : int
        Number of the first of its states, counted from 0.
    order : int
        How many there are.
    decay : Fraction
        [1/s]; decay rates up to this one are those of the loop with the dead time.
    floor, gain : Fraction
        See `Covering`.
    """

    signal: str
    time: Fraction | str
    first: int
    order: int
    decay: Fraction
    floor: Fraction
    gain: Fraction

    @property
    def states(self) -> range:
        """Numbers of its states."""
        return range(self.first, self.first + self.order)

    @classmethod
    def read(cls, table: Table) -> DeadTime:
        """Read it; what is malformed is a FormatError. Proves nothing."""
        signal = table.text("signal")
        time: Fraction | str
        time = table.text("parameter") if "parameter" in table else table.number("time")
        first = table.whole("first", None, 1000, 1) - 1
        order = table.whole("order", None, ORDERS[1], ORDERS[0])
        decay, floor, gain = (table.number(key) for key in ("decay", "floor", "gain"))
        if not isinstance(time, str) and time <= 0:
            raise FormatError(f"{table.path('time')} must be positive")
        if decay < 0 or floor <= 0 or gain <= 0:
            raise FormatError(f"{table.where}: floor and gain must be positive, decay not negative")
        return cls(signal, time, first, order, decay, floor, gain)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        key = "parameter" if isinstance(self.time, str) else "time"
        table = {"signal": self.signal, key: self.time if key == "parameter" else plain(self.time)}
        table |= {"first": self.first + 1, "order": self.order}
        return table | {key: plain(getattr(self, key)) for key in ("decay", "floor", "gain")}

    def covering(self, longest: Fraction) -> Covering:
        """Return N, D and M, of a dead time that is no longer than this.

        Raises
        ------
        FormatError
            If that times the decay rate is out of range.
        """
        shift = self.decay * longest
        if shift > LARGEST:
            raise FormatError(f"dead_time: decay times the time must be at most {LARGEST}")
        return Covering(self.order, shift, self.floor, self.gain)
