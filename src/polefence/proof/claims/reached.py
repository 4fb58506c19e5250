"""Inequalities of what disturbances of bounded energy reach: a signal's peak at all times.

Between samples y' = N y + E w and z = Y y with y = [x; k], as `polefence.proof.storage` says. What
is reached from rest, if int |w|^2 <= e^2, is y'P^-1 y <= 1, with P on stretches of a period, and
s'X^-1 s <= 1 of all states s at samples. For every p and t, with derivatives by time,

    P' - (N P + P N') - e^2 E E' > 0    and    g^2 - Y P Y' > 0:

y'P^-1 y rises by less than |w|^2 / e^2, and |z| < g where it is no more than 1. A law makes
y = J W^-1 s of s, J = [W; Z] or [I; K], and s = G y at the next sample. With X = W Q W', of which
the file holds Q,

    P - J Q J' > 0    at t = 0,    and    W Q W' - G P G' > 0    at t = T:

it never rises at a sample. P is positive definite at t = 0 where Q has no negative eigenvalue, and
later since P' > N P + P N'. Q is positive definite everywhere if it is at one vertex. Suppose that
at some p it first had a null vector. P > 0 there, so W is regular: W Q W' > G P G'. But then
X > M X M', where M moves s by a period, and X has a null vector: zero would exceed what is not
negative.

From initial states at a sample, without disturbances, the same holds with e = 0 where X holds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from polefence.proof.between import Held
from polefence.proof.claims.signal import Rows, Subject
from polefence.proof.claims.storage import Stretched, arriving
from polefence.proof.matrices import ZERO
from polefence.proof.polynomials import Polynomial, Sizes, bernstein, number
from polefence.proof.work import FormatError


def require_reached(subject: Subject, held: Held | None) -> None:
    """Refuse evidence that is not of the form of what is reached.

    Raises
    ------
    FormatError
        Saying what is not.
    """
    evidence = subject.evidence
    if held is None:
        return
    for item in evidence.per_cell:
        if item.dual or not item.X or item.multiple or item.pieces or item.held:
            raise FormatError("held: a peak at all times needs X and a storage function, no more")
        if any(stretch.inverse for stretch in item.storage):
            raise FormatError("storage: what is reached has no inverse form")


def rows_of_reached(
    subject: Subject,
    held: Held,
    parts: Sequence[Stretched],
    square: Fraction,
    energy: Fraction = ZERO,
) -> Rows:
    """Return the blocks that bound a peak at all times, given squares of the level and the norm."""
    sizes = subject.sizes
    Q = bernstein(subject.evidence.X, sizes, subject.evidence.degree)
    law, G = subject.law.form(sizes), arriving(subject, held)
    W = law.part(slice(subject.n))
    first, last = parts[0].stretch.at(sizes, end=False), parts[-1].stretch.at(sizes, end=True)
    rows: Rows = {
        "at a sample": [[first - (law * Q) * law.T]],
        "at the next": [[(W * Q) * W.T - (G * last) * G.T]],
    }
    shown = outputs_of(sizes, parts)
    for k, (stretch, length, (N, E, _, _)) in enumerate(parts):
        form, end = stretch.polynomial(sizes), sum(sizes)
        slope = (form.derivative(end + 1) - form.derivative(end)).times(1 / length)
        NP = N * form
        rising = slope - (NP + NP.T)
        if energy:
            rising = rising - E.half_times(E.T).times(energy)
        rows[f"of the storage, stretch {k + 1}"] = [[rising]]
        rows[f"of the output, stretch {k + 1}"] = [[number(square, form.sizes) - shown[k]]]
    return rows


def outputs_of(sizes: Sizes, parts: Sequence[Stretched]) -> list[Polynomial]:
    """Return Y P Y' in each stretch: what the square of the level must exceed."""
    return [(Y * s.polynomial(sizes)) * Y.T for s, _, (_, _, Y, _) in parts]
