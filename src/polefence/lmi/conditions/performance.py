r"""Bounds on signals beside regions: an rms, a peak or a gain, for every alpha.

For x' = (A + B K) x + E w, y = C x + D u with one row, and X = W, N = A W + B Z, Y = C W + D Z,
with a scalar t > 0 for each source of motion, which keeps everything homogeneous:

    noise     white, of intensity S:  -(N + N' + t E S E') > 0, so that X / t > the covariance
    points    motion from each x0:    -(N + N') > 0 and [ t, t x0' ; t x0, X ] > 0; from all x0
              of an ellipsoid x0' X0^-1 x0 <= 1: X - t X0 > 0
              with either, [ g^2 t, Y ; Y', X ] > 0 bounds the rms, or the peak, of y by g
    through   from w to y in L2:      [ -(N + N'), -t E, -Y' ; *, g t, -t F' ; *, *, g t ] > 0

(Scherer, Gahinet & Chilali, 1997; Boyd et al., 1994). Noise of S = e^2 also bounds the peaks under
disturbances of energy e^2. What is minimised is r = (g / level)^2, of a gain g / level. In a
`design` all bounds and the region share X; `given` has a law that is fixed, and an X for one bound
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from polefence.lmi.conditions.gain_norm import Norm, add_norm
from polefence.lmi.conditions.linear import Linear, Term, multiple
from polefence.lmi.conditions.lyapunov import Loop, multiples, products
from polefence.lmi.conditions.parameter_dependent import block_name
from polefence.lmi.conditions.pencil import Block, Builder, Pencil
from polefence.lmi.conditions.target import Target
from polefence.plant.polynomial import (
    Domain,
    Exponent,
    Polynomial,
    bernstein,
    binomial,
    elevated,
    times,
)
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Noise:
    """White noise: E S E' of the vertices as a polynomial; see `noise`."""

    name: str
    EE: Polynomial

    def changed(self, inverse: Array, rate: float) -> Noise:
        """Return it in coordinates x = T x_s, time in units of 1 / rate."""
        EE = {e: inverse @ P @ inverse.T / rate for e, P in self.EE.items()}
        return Noise(self.name, EE)


@dataclass(frozen=True, eq=False)
class Points:
    """Initial states, each (N, n, 1) at the vertices; and X0 of an ellipsoid of them, (n, n)."""

    name: str
    points: tuple[Array, ...]
    ellipsoid: Array | None = None

    def changed(self, inverse: Array, rate: float) -> Points:  # noqa: ARG002
        """Return them in coordinates x = T x_s."""
        X0 = self.ellipsoid
        X0 = None if X0 is None else np.asarray(inverse @ X0 @ inverse.T)
        return Points(self.name, tuple(inverse @ x for x in self.points), X0)


@dataclass(frozen=True, eq=False)
class Through:
    """A disturbance whose L2 norm is passed on: E (N, n, q)."""

    name: str
    E: Array

    def changed(self, inverse: Array, rate: float) -> Through:
        """Return it in coordinates x = T x_s, time in units of 1 / rate."""
        return Through(self.name, inverse @ self.E / rate)


Source = Noise | Points | Through


def unit_of(source: Source, rate: float) -> float:
    """Return what X is in the original time, of X = 1 with time in units of 1 / rate."""
    return rate if isinstance(source, Through) else 1.0


@dataclass(frozen=True, eq=False)
class Output:
    """A scalar output y = C x + D u, or + F w, and the bound on it.

    Attributes
    ----------
    name : str
    source : str
        Name of what moves it.
    C, D : (N, 1, n), (N, 1, m) arrays
        At every vertex.
    level : float
        The bound where it is fixed; else the unit in which it is measured.
    fixed : bool
        Whether the bound is fixed; else it grows with r.
    F : (N, 1, q) array, optional
        For `Through` only.
    square : polynomial, optional
        A positive scalar: the bound's square is level^2 times this, not level^2.
    """

    name: str
    source: str
    C: Array
    D: Array
    level: float
    fixed: bool = True
    F: Array | None = None
    square: Polynomial | None = None

    def changed(self, T: Array, S: Array) -> Output:
        """Return the output of states and inputs in other coordinates, x = T x_s, u = S u_s."""
        return replace(self, C=self.C @ T, D=self.D @ S)


@dataclass(frozen=True)
class Form:
    """Coefficients at one exponent: X, N and one Y an output."""

    exponent: Exponent
    X: Linear
    N: Linear
    Y: tuple[Linear, ...]


def noise(name: str, domain: Domain, E: Array, intensity: float) -> Noise:
    """Return white noise through the vertices' E (N, n, q); constant where E is."""
    if np.all(E[:1] == E):
        return Noise(name, {(0,) * sum(domain.sizes): intensity * E[0] @ E[0].T})
    P = bernstein(domain, E, 1)
    transposed = {e: intensity * p.T for e, p in P.items()}
    return Noise(name, times(P, transposed))


def degree_of(P: Polynomial, domain: Domain) -> int:
    """Return the degree in each simplex."""
    return sum(next(iter(P))[: domain.sizes[0]])


def _own_degrees(
    sources: tuple[Source, ...], outputs: tuple[Output, ...], domain: Domain
) -> Iterator[int]:
    for source in sources:
        yield degree_of(source.EE, domain) if isinstance(source, Noise) else 1
    for output in outputs:
        yield 0 if output.square is None else degree_of(output.square, domain)


def design(
    A: Array,
    B: Array,
    sources: tuple[Source, ...],
    outputs: tuple[Output, ...],
    target: Target | None,
    domain: Domain,
    degree: int,
    elevation: int,
    margin: float = 0.0,
    norms: Sequence[tuple[Norm, Array]] = (),
) -> Pencil:
    """Build the condition for a law K = Z W^-1 that keeps all outputs' bounds and a region.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    target : Target, optional
        The region; what of it grows with r does.
    margin : float
        Added as -2 margin X to the first inequality of noise and points, so that rounding keeps it;
        a small rate.
    norms : pairs of Norm and (count, n, n) array
        Bounds on the law itself, and coefficients of the H0 near which each is tight.
    """
    n, m = A.shape[1], B.shape[2]
    pencil = Builder("performance")
    names = [str(k + 1) for k in range(domain.count(degree))]
    W = [pencil.symmetric(f"W{name}", n) for name in names]
    Z = [pencil.full(f"Z{name}", (m, n), "u") for name in names]
    natural = max([degree + 1, *_own_degrees(sources, outputs, domain)])
    extra = natural - degree - 1 + elevation
    for norm, near in norms:
        add_norm(pencil, W, Z, norm, near, domain, degree, elevation)
    AC = np.concatenate([A, *(o.C for o in outputs)], axis=1)
    BD = np.concatenate([B, *(o.D for o in outputs)], axis=1)
    parts = np.split(np.eye(AC.shape[1]), n + np.arange(len(outputs)))

    def forms() -> Iterator[Form]:
        tables = domain.pairs(degree, extra), domain.elevated(degree, 1 + extra)
        for e, pairs, sums in zip(domain.monomials(natural + elevation), *tables, strict=True):
            X = Linear()
            for k, weight in sums.items():
                X = X + float(weight) * W[k]
            NY = _combined(AC, BD, pairs, W, Z)
            N, *Y = (part @ NY for part in parts)
            yield Form(e, X, N, tuple(Y))

    return _assembled(pencil, forms(), sources, outputs, target, domain, margin)


def _combined(
    A: Array, B: Array, pairs: dict[tuple[int, int], int], W: list[Linear], Z: list[Linear]
) -> Linear:
    """Return the sum of weights times A_j W_k + B_j Z_k."""
    total = Linear()
    for k in dict.fromkeys(k for _, k in pairs):
        weights = {j: w for (j, other), w in pairs.items() if other == k}
        total = total + sum(w * A[j] for j, w in weights.items()) @ W[k]
        if np.any(B):
            total = total + sum(w * B[j] for j, w in weights.items()) @ Z[k]
    return total


def given(loop: Loop, source: Source, output: Output, degree: int, elevation: int) -> Pencil:
    """Build the condition for a Lyapunov polynomial of a loop that is given.

    Parameters
    ----------
    loop : Loop
        Its C has the output's row below the n of the dynamics.
    """
    domain, n = loop.domain, len(next(iter(loop.E.values())))
    pencil = Builder("performance, given")
    Q = [pencil.symmetric(f"Q{k + 1}", n) for k in range(domain.count(degree))]
    natural = loop.degree + degree
    elevation += max(0, *(d - natural for d in _own_degrees((source,), (output,), domain)))
    E, C = (elevated(P, domain, elevation) for P in (loop.E, loop.C))
    X, NY = products(E, Q, loop, degree), products(C, Q, loop, degree)
    if loop.R is not None:
        scalars = [pencil.full(f"s{k + 1}", (1, 1), "") for k in range(len(Q))]
        extra = degree_of(loop.R, domain)
        for total, P in ((X, E), (NY, C)):
            for e, more in multiples(elevated(P, domain, extra), scalars, domain, degree).items():
                total[e] = total.get(e, Linear()) + more
    rows = np.eye(n + 1)
    forms = (
        Form(e, X[e], rows[:n] @ NY[e], (rows[n:] @ NY[e],))
        for e in domain.monomials(natural + elevation)
    )
    return _assembled(pencil, forms, (source,), (output,), None, domain)


def _assembled(
    pencil: Builder,
    forms: Iterable[Form],
    sources: tuple[Source, ...],
    outputs: tuple[Output, ...],
    target: Target | None,
    domain: Domain,
    margin: float = 0.0,
) -> Pencil:
    t = {source.name: pencil.positive(f"t {source.name}") for source in sources}
    by_name = {source.name: source for source in sources}
    degree, raised = -1, dict[str, Callable[[Exponent], Array]]()
    squares: dict[str, dict[Exponent, float]] = {}
    for form in forms:
        e, n = form.exponent, form.X.terms[0].left.shape[0]
        if degree < 0:
            degree = sum(e[: domain.sizes[0]])
            tops = [1, *(o.F.shape[2] for o in outputs if o.F is not None)]
            raised = {s.name: _raised(s, domain, degree, n, max(tops)) for s in sources}
            squares = {o.name: _square(o, domain, degree) for o in outputs}
        name = block_name(e, domain, -1, -1)
        weight = binomial(domain.sizes, e)
        motion = form.N + margin * form.X if margin else form.N
        for source in sources:
            if not isinstance(source, Through):
                data = raised[source.name](e)
                pencil.blocks += _moved(source, name, form.X, motion, t[source.name], data, weight)
        for output, Y in zip(outputs, form.Y, strict=True):
            source, own = by_name[output.source], t[output.source]
            label = f"{output.name}, {name}"
            if isinstance(source, Through):
                E = raised[source.name](e)
                F = _raised_F(output, domain, degree, E.shape[1])(e)
                pencil.blocks.append(_passed(label, form.N, Y, own, E, F, weight, output))
            else:
                pencil.blocks.append(_bound(label, form.X, Y, own, squares[output.name][e], output))
        for number, side in enumerate(() if target is None else target.sides):
            pencil.region(f"region, part {number + 1}, {name}", form.X, form.N, side)
        # of a gain alone nothing else makes X positive
        if all(isinstance(source, Through) for source in sources):
            pencil.positive_definite(f"X at {name}", form.X)
    return pencil.build()


def _raised(
    source: Source, domain: Domain, degree: int, n: int, q: int
) -> Callable[[Exponent], Array]:
    """Return the source's coefficients, elevated to a degree: E S E', points side by side, or E."""
    if isinstance(source, Noise):
        P, zero = source.EE, np.zeros((n, n))
    elif isinstance(source, Points) and not source.points:
        return lambda _: np.zeros((n, 0))
    else:
        E = np.concatenate(source.points, axis=2) if isinstance(source, Points) else source.E
        P, zero = bernstein(domain, E, 1), np.zeros((n, q))
    table = elevated(P, domain, degree - degree_of(P, domain))
    return lambda e: table.get(e, zero)


def _square(output: Output, domain: Domain, degree: int) -> dict[Exponent, float]:
    """Return the coefficients of the bound's square over level^2."""
    if output.square is None:
        return {e: float(binomial(domain.sizes, e)) for e in domain.monomials(degree)}
    table = elevated(output.square, domain, degree - degree_of(output.square, domain))
    return {e: table[e].item() for e in domain.monomials(degree)}


def _raised_F(output: Output, domain: Domain, degree: int, q: int) -> Callable[[Exponent], Array]:
    if output.F is None:
        return lambda _: np.zeros((1, q))
    table = elevated(bernstein(domain, output.F, 1), domain, degree - 1)
    return lambda e: table[e]


def _moved(
    source: Source,
    name: str,
    X: Linear,
    N: Linear,
    t: Linear,
    data: Array,
    weight: float,
) -> Iterator[Block]:
    """Yield what a source asks of X, whatever is looked at."""
    n = X.terms[0].left.shape[0]
    eye = np.eye(n)
    driven = _put(N, eye, eye)
    if isinstance(source, Noise):
        # columns of zeros ask for work and for nothing else
        own = np.any(data, axis=0)
        driven += _put(multiple(t, data[:, own] / 2), eye, eye[:, own])
    yield Block(f"{source.name}, {name}", n, (), driven)
    if isinstance(source, Points):
        first, rest = np.eye(n + 1)[:, :1], np.eye(n + 1)[:, 1:]
        for k, x0 in enumerate(data.T[:, :, None]):
            corner = _put((-weight / 2) * t, first, first)
            side = _put(-1.0 * t, rest @ x0, first)
            yield Block(
                f"{source.name} {k + 1}, {name}",
                n + 1,
                (),
                corner + side + _put(-0.5 * X, rest, rest),
            )
        if source.ellipsoid is not None:
            X0 = source.ellipsoid
            own = np.any(X0, axis=0)
            above = _put(multiple(t, weight / 2 * X0[:, own]), eye, eye[:, own])
            name = f"{source.name} of the ellipsoid, {name}"
            yield Block(name, n, (), above + _put(-0.5 * X, eye, eye))


def _bound(name: str, X: Linear, Y: Linear, t: Linear, weight: float, output: Output) -> Block:
    """Return [ weight level^2 t, Y ; Y', X ] > 0, the first entry times r unless it is fixed."""
    n = X.terms[0].left.shape[0]
    first, rest = np.eye(n + 1)[:, :1], np.eye(n + 1)[:, 1:]
    size = weight * output.level**2 / 2
    others = _put(Y, -first, rest) + _put(X, -0.5 * rest, rest)
    if output.fixed:
        return Block(name, n + 1, (), _put(-size * t, first, first) + others)
    return Block(name, n + 1, _put(size * t, first, first), others)


def _passed(
    name: str,
    N: Linear,
    Y: Linear,
    t: Linear,
    E: Array,
    F: Array,
    weight: float,
    output: Output,
) -> Block:
    """Return the block of a gain, E and y over the root of the level."""
    n, q = E.shape
    size = n + q + 1
    x, w, y = np.split(np.eye(size), [n, n + q], axis=1)
    root = np.sqrt(output.level)
    M = _put(N, x, x) + _put(1.0 / root * Y, y, x)
    for k in range(q):
        M += _put(t, x @ E[:, k : k + 1] / root, w[:, k : k + 1])
        M += _put(t, y * F[0, k] / output.level, w[:, k : k + 1])
    ends = np.concatenate([w, y], axis=1)
    gain: tuple[Term, ...] = ()
    for column in ends.T[:, :, None]:
        gain += _put((weight / 2) * t, column, column)
    if output.fixed:
        return Block(name, size, (), M + tuple(Term(g.name, -g.left, g.right) for g in gain))
    return Block(name, size, gain, M)


def _put(part: Linear, rows: Array, columns: Array) -> tuple[Term, ...]:
    """Return the terms of rows @ part @ columns'."""
    return tuple(
        Term(t.name, rows @ t.left, columns if t.right is None else columns @ t.right)
        for t in part.terms
    )
