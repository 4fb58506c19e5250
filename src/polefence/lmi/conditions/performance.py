r"""Bounds on signals beside regions: an rms, a peak or a gain, for every alpha.

For x' = (A + B K) x + E w, y = C x + D u, and X = W, N = A W + B Z, Y = C W + D Z, with a scalar
t > 0 for each source of motion, which keeps everything homogeneous:

    noise     white, of intensity S:  -(N + N' + t E S E') > 0, so that X / t > the covariance
    points    motion from each x0:    -(N + N') > 0 and [ t, t x0' ; t x0, X ] > 0; from all x0
              of an ellipsoid x0' X0^-1 x0 <= 1: X - t X0 > 0
              with either, [ g^2 t, Y ; Y', X ] > 0 bounds the rms, or the peak, of y by g
    through   from w to y in L2:      [ -(N + N'), -t E, -Y' ; *, g t I, -t F' ; *, *, g t I ] > 0
              of a part of a region   [ -(L (x) X + M (x) N + M' (x) N'), -t M1 (x) E, -M2' (x) Y' ;
              of L, M = M1 M2:          *, g t I, 0 ; *, *, g t I ] > 0: kept whatever w = D y is of
                                      a D of norm at most 1 / g

The square of the rms of a vector is the sum of its entries': with the rows Y_1, ..., Y_p of Y,

    [ g^2 t, Y_1, ..., Y_p ; Y_1', X, 0 ; ... ; Y_p', 0, X ] > 0

says that sum_j Y_j X^-1 Y_j' < g^2 t, without the variables for tr Y X^-1 Y' that are usual, and at
each coefficient of polynomials as much as they would. Disturbances that are chosen and scaled,
w = diag(s) v, are E diag(s) and F diag(s).

In discrete time all are of the delta form, of a step T: -(N + N') becomes
[ -(N + N'), T^1/2 N ; *, X ], and to the last a further row T^1/2 [ N, E, 0 ], X is added below.

(Scherer, Gahinet & Chilali, 1997; Boyd et al., 1994). Noise of S = e^2 also bounds the peaks under
disturbances of energy e^2. What is minimised is r = (g / level)^2, of a gain g / level. Bounds on a
law that is sought share X with each other and with the region; one on a law that is given has an X
for itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.lmi.conditions.gain_norm import Norm
from polefence.lmi.conditions.pencil import (
    Block,
    Builder,
    Linear,
    Pencil,
    Term,
    block_name,
    multiple,
    put,
)
from polefence.lmi.conditions.saturation import Cut, Sector
from polefence.lmi.conditions.target import NO_REGION, Target
from polefence.plant.boxes import Box, weights
from polefence.plant.polynomial import (
    Domain,
    Exponent,
    Polynomial,
    bernstein,
    binomial,
    degree_of,
    elevated,
    times,
)
from polefence.plant.system import Array
from polefence.region.regions import Region


@dataclass(frozen=True, eq=False)
class Noise:
    """White noise: E S E' of the vertices as a polynomial; see `noise`.

    Where it is constant ``root`` is (n, q), and E S E' its square: there are fewer terms.
    """

    name: str
    EE: Polynomial
    root: Array | None = None

    def changed(self, inverse: Array, rate: float) -> Noise:
        """Return it in coordinates x = T x_s, time in units of 1 / rate."""
        EE = {e: inverse @ P @ inverse.T / rate for e, P in self.EE.items()}
        root = None if self.root is None else inverse @ self.root / np.sqrt(rate)
        return Noise(self.name, EE, root)

    def times(self, share: float) -> Noise:
        """Return noise of so many times the intensity."""
        root = None if self.root is None else np.sqrt(share) * self.root
        return Noise(self.name, {e: share * P for e, P in self.EE.items()}, root)

    def more(self, domain: Domain, S: Array) -> Noise:
        """Return the noise plus independent noise of intensity S (n, n) at every alpha."""
        degree = degree_of(self.EE, domain)
        zero = np.zeros_like(S)
        EE = {
            e: self.EE.get(e, zero) + binomial(domain.sizes, e) * S
            for e in domain.monomials(degree)
        }
        return Noise(self.name, EE)

    def intensity(self, domain: Domain) -> Array:
        """Return the intensity E S E' in the middle of the family, (n, n)."""
        squares = [P / binomial(domain.sizes, e) for e, P in self.EE.items()]
        return np.asarray(np.mean(squares, axis=0))


@dataclass(frozen=True, eq=False)
class Points:
    """Initial states, each (N, n, 1) at the vertices; and X0 of an ellipsoid of them, (n, n).

    With a ``degree`` above one they are Bernstein coefficients, (count, n, 1).
    """

    name: str
    points: tuple[Array, ...]
    ellipsoid: Array | None = None
    degree: int = 1

    def changed(self, inverse: Array, rate: float) -> Points:  # noqa: ARG002
        """Return them in coordinates x = T x_s."""
        X0 = self.ellipsoid
        X0 = None if X0 is None else np.asarray(inverse @ X0 @ inverse.T)
        return replace(self, points=tuple(inverse @ x for x in self.points), ellipsoid=X0)

    def intensity(self, domain: Domain) -> Array:  # noqa: ARG002
        """Return the sum of x0 x0' in the middle of the family, and X0, (n, n)."""
        means = [p.mean(axis=0) for p in self.points]
        started = [] if self.ellipsoid is None else [self.ellipsoid]
        return np.asarray(sum([x @ x.T for x in means] + started))


@dataclass(frozen=True, eq=False)
class Through:
    """A disturbance whose L2 norm is passed on: Bernstein coefficients of E, (count, n, q)."""

    name: str
    E: Array
    degree: int = 1
    part: Region | None = None  # what is to be kept, in place of the left half-plane
    pair: int = 0  # of its inequalities, which one
    rate: float = 1.0  # the unit of time

    def changed(self, inverse: Array, rate: float) -> Through:
        """Return it in coordinates x = T x_s, time in units of 1 / rate."""
        return replace(self, E=inverse @ self.E / rate, rate=self.rate * rate)

    def intensity(self, domain: Domain) -> Array:  # noqa: ARG002
        """Return E E' in the middle of the family, (n, n)."""
        E = self.E.mean(axis=0)
        return np.asarray(E @ E.T)


Source = Noise | Points | Through


def unit_of(source: Source, rate: float) -> float:
    """Return the factor from X, with time in units of 1 / rate, to X in the original time."""
    return rate if isinstance(source, Through) else 1.0


@dataclass(frozen=True, eq=False)
class Output:
    """An output y = C x + D u, or + F w, of p rows, and the bound on it.

    Attributes
    ----------
    name : str
    source : str
        Name of what moves it.
    C, D : (N, p, n), (N, p, m) arrays
        At every vertex.
    level : float
        The bound where it is fixed; else the unit in which it is measured.
    fixed : bool
        Whether the bound is fixed; else it grows with r.
    F : (count, p, q) array, optional
        For `Through` only: Bernstein coefficients of ``F_degree``.
    square : polynomial, optional
        A positive scalar: the bound's square is level^2 times this, not level^2.
    held : tuple of int
        Numbers of inputs that are held back so that y stays within the bound.
    """

    name: str
    source: str
    C: Array
    D: Array
    level: float
    fixed: bool = True
    F: Array | None = None
    F_degree: int = 1
    square: Polynomial | None = None
    held: tuple[int, ...] = ()

    @property
    def rows(self) -> int:
        """Number of entries, p."""
        return int(self.C.shape[1])

    def changed(self, T: Array, S: Array) -> Output:
        """Return the output of states and inputs in other coordinates, x = T x_s, u = S u_s."""
        return replace(self, C=self.C @ T, D=self.D @ S)


@dataclass(frozen=True, eq=False)
class Demands:
    """Inequalities that are asked of a Lyapunov matrix X, in the coordinates of the condition.

    Attributes
    ----------
    target : Target
        The region; what of it grows with r does.
    sources, outputs : tuples of Source and Output
    norms : pairs of Norm and (count, n, n) array
        Bounds on the law itself, and coefficients of the H0 near which each is tight.
    margin : float
        Added as -2 margin X to the first inequality of noise and points, so that rounding keeps it;
        a small rate.
    step : float
        Of a delta form, in the condition's own unit of time; zero in continuous time.
    pieces : tuple of Box
        Parts of the box in each of which the inequalities are asked for by themselves.
    """

    target: Target = NO_REGION
    sources: tuple[Source, ...] = ()
    outputs: tuple[Output, ...] = ()
    norms: tuple[tuple[Norm, Array], ...] = ()
    margin: float = 0.0
    step: float = 0.0
    pieces: tuple[Box, ...] = ()

    def degree(self, domain: Domain) -> int:
        """Return the highest degree of what is asked, in each simplex; at least 1."""
        degrees = [degree_of(s.EE, domain) for s in self.sources if isinstance(s, Noise)]
        degrees += [s.degree for s in self.sources if isinstance(s, Points | Through)]
        squares = [o.square for o in self.outputs if o.square is not None]
        return max([1, *degrees, *(degree_of(P, domain) for P in squares)])


@dataclass(frozen=True)
class Form:
    """Coefficients at one exponent: X, N and one Y an output.

    ``floor`` is what a region's first block has to exceed, ``name`` that of the exponent's blocks.
    ``moved`` holds half of dX/dt, or of X's change in a sample, at every extreme of the rates,
    where parameters move; ``cut`` what outputs that are inputs cut off ask for, by their names.
    """

    exponent: Exponent
    X: Linear
    N: Linear
    Y: tuple[Linear, ...] = ()
    floor: Linear | None = None
    name: str = ""
    moved: tuple[Linear, ...] = ()
    cut: Mapping[str, Cut] = field(default_factory=dict)

    @property
    def motions(self) -> Iterator[tuple[str, Linear]]:
        """Yield each half of dX/dt with the ending of its block's name; zero without motion."""
        yield from ((f", rates {k}" * (k > 0), H) for k, H in enumerate(self.moved or (Linear(),)))


def split_rows(n: int, outputs: Iterable[Output]) -> list[Array]:
    """Return the selectors of the n rows of the dynamics and of each output in their stack."""
    counts = np.cumsum([n, *(output.rows for output in outputs)])
    return np.split(np.eye(counts[-1]), counts[:-1])


def noise(name: str, domain: Domain, E: Array, intensity: float, degree: int = 1) -> Noise:
    """Return white noise through E, given by Bernstein coefficients; constant where E is."""
    if np.all(E[:1] == E):
        EE = {(0,) * sum(domain.sizes): intensity * E[0] @ E[0].T}
        return Noise(name, EE, np.sqrt(intensity) * E[0])
    P = bernstein(domain, E, degree)
    transposed = {e: intensity * p.T for e, p in P.items()}
    return Noise(name, times(P, transposed))


def assembled(
    pencil: Builder, forms: Iterable[Form], demands: Demands, domain: Domain, degree: int
) -> Pencil:
    """Build the demands on polynomials X, N and Y of a degree, exponent by exponent."""
    sources, outputs, target = demands.sources, demands.outputs, demands.target
    t = {source.name: pencil.positive(f"t {source.name}") for source in sources}
    by_name = {source.name: source for source in sources}
    q = max([1, *(o.F.shape[2] for o in outputs if o.F is not None)])
    moved = {s.name: raised(s, domain, degree, q) for s in sources}
    bounds = {o.name: squares(o, domain, degree) for o in outputs}
    through = {
        o.name: _raised_F(o, domain, degree, way.E.shape[2])
        for o in outputs
        if isinstance(way := by_name[o.source], Through)
    }
    # of a gain alone nothing else makes X positive
    gains = bool(sources) and all(isinstance(source, Through) for source in sources)
    for form, data_at in _in_pieces(forms, demands, domain, degree):
        e, name = form.exponent, form.name or block_name(form.exponent, domain)
        weight = binomial(domain.sizes, e)
        for source, (more, half) in product(sources, form.motions):
            if not isinstance(source, Through):
                data = data_at(moved[source.name])
                sector = _sector_of(source, outputs, form)
                if sector is not None:
                    at = form.X, form.N, half, demands.step
                    driven = t[source.name], data, weight
                    pencil.blocks.append(_recovering(source, name + more, at, sector, driven))
                    continue
                for k, added in enumerate(_added(source, outputs, form)):
                    N = form.N + added
                    N = N + demands.margin * form.X if demands.margin else N
                    label = f"{name}{more}" + f", cut off {k}" * (k > 0)
                    at = form.X, N, half, demands.step
                    pencil.blocks.append(_moved(source, label, at, t[source.name], data, weight))
        for source in sources:
            if isinstance(source, Points):
                pencil.blocks += _started(
                    source, name, form.X, t[source.name], data_at(moved[source.name]), weight
                )
        for output, Y in zip(outputs, form.Y, strict=True):
            source, level = by_name[output.source], t[output.source]
            label = f"{output.name}, {name}"
            if isinstance(source, Through):
                if source.part is not None:
                    E = data_at(moved[source.name])
                    pencil.blocks.append(_kept(label, form, Y, level, E, weight, source))
                    continue
                E, F = data_at(moved[source.name]), data_at(through[output.name])
                for more, half in form.motions:
                    at = form.X, form.N, half, demands.step
                    pencil.blocks.append(_passed(label + more, at, Y, level, E, F, weight, output))
            elif output.held:
                square = data_at(bounds[output.name].__getitem__)
                pencil.blocks += _held(label, form, level, square, output)
            else:
                square = data_at(bounds[output.name].__getitem__)
                pencil.blocks.append(_bound(label, form.X, Y, level, square, output))
        for label, side in target.named(name):
            still = [("", Linear())]
            for more, half in form.motions if side.is_about(target.motion) else still:
                pencil.region(label + more, form.X, form.N, side, form.floor, half)
        if target.positive or gains:
            pencil.positive_definite(f"X at {name}", form.X)
    return pencil.build()


# What takes a polynomial, as its coefficients by exponents, to one coefficient on a part.
At = Callable[[Callable[[Exponent], Any]], Any]


def _in_pieces(
    forms: Iterable[Form], demands: Demands, domain: Domain, degree: int
) -> Iterator[tuple[Form, At]]:
    """Yield the forms on each part of the box, with the map of other polynomials to it."""
    if not demands.pieces:
        for form in forms:
            yield form, partial(_weighted, {form.exponent: 1.0})
        return
    whole = {form.exponent: form for form in forms}
    for number, box in enumerate(demands.pieces, 1):
        for e, shares in weights(box, domain, degree).items():
            name = f"{block_name(e, domain)} in piece {number}"
            yield _mixed(whole, shares, name, e), partial(_weighted, shares)


def _weighted(shares: Mapping[Exponent, float], table: Callable[[Exponent], Any]) -> Any:
    """Return the weighted sum of coefficients."""
    (first, weight), *others = shares.items()
    if not others and weight == 1:
        return table(first)
    total = weight * table(first)
    for e, weight in others:
        total = total + weight * table(e)
    return total


def _mixed(
    whole: Mapping[Exponent, Form], shares: Mapping[Exponent, float], name: str, e: Exponent
) -> Form:
    """Return the weighted sum of forms."""

    def total(part: Callable[[Form], Linear]) -> Linear:
        linear: Linear = _weighted(shares, lambda d: part(whole[d]))
        return linear

    def totals(parts: Callable[[Form], Sequence[Linear]], count: int) -> tuple[Linear, ...]:
        return tuple(total(lambda form, k=k: parts(form)[k]) for k in range(count))  # type: ignore[misc]

    first = whole[next(iter(shares))]
    cut = {
        key: Cut(
            total(lambda form, key=key: form.cut[key].Y),  # type: ignore[misc]
            totals(lambda form, key=key: form.cut[key].added, len(first.cut[key].added)),  # type: ignore[misc]
        )
        for key in first.cut
    }
    return Form(
        e,
        total(lambda form: form.X),
        total(lambda form: form.N),
        totals(lambda form: form.Y, len(first.Y)),
        name=name,
        moved=totals(lambda form: form.moved, len(first.moved)),
        cut=cut,
    )


def raised(source: Source, domain: Domain, degree: int, q: int) -> Callable[[Exponent], Array]:
    """Return the source's coefficients, elevated to a degree: E S E', points side by side, or E."""
    if isinstance(source, Noise):
        P, columns = source.EE, len(next(iter(source.EE.values())))
    elif isinstance(source, Points) and not source.points:
        return lambda _: np.zeros((0, 0))
    elif isinstance(source, Points):
        P, columns = bernstein(domain, np.concatenate(source.points, axis=2), source.degree), q
    else:
        P, columns = bernstein(domain, source.E, source.degree), q
    zero = np.zeros((len(next(iter(P.values()))), columns))
    table = elevated(P, domain, degree - degree_of(P, domain))
    return lambda e: table.get(e, zero)


def squares(output: Output, domain: Domain, degree: int) -> dict[Exponent, float]:
    """Return the coefficients of the bound's square over level^2."""
    if output.square is None:
        return {e: float(binomial(domain.sizes, e)) for e in domain.monomials(degree)}
    table = elevated(output.square, domain, degree - degree_of(output.square, domain))
    return {e: table[e].item() for e in domain.monomials(degree)}


def _raised_F(output: Output, domain: Domain, degree: int, q: int) -> Callable[[Exponent], Array]:
    if output.F is None:
        return lambda _: np.zeros((output.rows, q))
    table = bernstein(domain, output.F, output.F_degree)
    table = elevated(table, domain, degree - output.F_degree)
    return lambda e: table[e]


def _moved(
    source: Source,
    name: str,
    at: tuple[Linear, Linear, Linear, float],
    t: Linear,
    data: Array,
    weight: float,
) -> Block:
    """Return the block of a source and the dynamics; ``at`` holds X, N, half of dX/dt, the step."""
    X, N, half, step = at
    n = X.terms[0].left.shape[0]
    size = 2 * n if step else n
    eye, below = np.eye(size)[:, :n], np.eye(size)[:, n:]
    driven = put(_corner(N, half, step), eye, eye)
    if step:  # the rows below in units in which X is one
        root = np.sqrt(step)
        driven += put(N, -root * eye, below) + put(X, -0.5 * below, below)
    driven += _of_noise(source, t, data, weight, eye)
    return Block(f"{source.name}, {name}", size, (), driven)


def _of_noise(
    source: Source, t: Linear, data: Array, weight: float, eye: Array
) -> tuple[Term, ...]:
    """Return what noise adds; nothing of another source."""
    if not isinstance(source, Noise):
        return ()
    if source.root is None:
        # columns of zeros ask for work and for nothing else
        entering = np.any(data, axis=0)
        return put(multiple(t, data[:, entering] / 2), eye, eye[:, entering])
    terms: tuple[Term, ...] = ()
    for column in source.root.T[:, :, None]:
        terms += put(t, weight / 2 * eye @ column, eye @ column)
    return terms


def _corner(N: Linear, half: Linear, step: float) -> Linear:
    """Return N minus half of dX/dt, or of the change of X in a step over the step."""
    return N - (1 / step if step else 1.0) * half if half.terms else N


def _started(
    source: Points, name: str, X: Linear, t: Linear, data: Array, weight: float
) -> Iterator[Block]:
    """Yield that X holds the initial states."""
    n = X.terms[0].left.shape[0]
    first, rest = np.eye(n + 1)[:, :1], np.eye(n + 1)[:, 1:]
    for k, x0 in enumerate(data.T[:, :, None]):
        corner = put((-weight / 2) * t, first, first)
        side = put(-1.0 * t, rest @ x0, first)
        below = put(-0.5 * X, rest, rest)
        yield Block(f"{source.name} {k + 1}, {name}", n + 1, (), corner + side + below)
    if source.ellipsoid is not None:
        X0, eye = source.ellipsoid, np.eye(n)
        entering = np.any(X0, axis=0)
        above = put(multiple(t, weight / 2 * X0[:, entering]), eye, eye[:, entering])
        name = f"{source.name} of the ellipsoid, {name}"
        yield Block(name, n, (), above + put(-0.5 * X, eye, eye))


def _bound(name: str, X: Linear, Y: Linear, t: Linear, weight: float, output: Output) -> Block:
    """Return [ weight level^2 t, Y ; Y', X ] > 0, the first entry times r unless it is fixed.

    With more rows they stand side by side, and X below each.
    """
    n, p = X.terms[0].left.shape[0], output.rows
    first, *rests = np.split(np.eye(1 + p * n), 1 + n * np.arange(p), axis=1)
    size = weight * output.level**2 / 2
    others: tuple[Term, ...] = ()
    for row, rest in zip(np.eye(p)[:, None], rests, strict=True):
        others += put(row @ Y, -first, rest) + put(X, -0.5 * rest, rest)
    if output.fixed:
        return Block(name, 1 + p * n, (), put(-size * t, first, first) + others)
    return Block(name, 1 + p * n, put(size * t, first, first), others)


def _added(source: Source, outputs: tuple[Output, ...], form: Form) -> tuple[Linear, ...]:
    """Return the terms added to N for each part of the saturated inputs of a source."""
    added = [form.cut[o.name].added for o in outputs if o.held and o.source == source.name]
    return added[0] if added else (Linear(),)


def _sector_of(source: Source, outputs: tuple[Output, ...], form: Form) -> Sector | None:
    """Return the terms of a source's saturated inputs where an anti-windup gain is sought."""
    sectors = (form.cut[o.name].sector for o in outputs if o.held and o.source == source.name)
    return next(sectors, None)


def _recovering(
    source: Source,
    name: str,
    at: tuple[Linear, Linear, Linear, float],
    sector: Sector,
    driven: tuple[Linear, Array, float],
) -> Block:
    """Return the block of the decay whatever is cut off; ``at`` as `_moved` has it.

    With a step it ends with X of the next sample. What noise adds there is left out: the gain that
    is found is proved as one that is given.
    """
    (X, N, half, step), (t, data, weight) = at, driven
    n, k = X.terms[0].left.shape[0], sector.S.terms[0].left.shape[0]
    size = n + k + (n if step else 0)
    x, q, z = np.split(np.eye(size), [n, n + k], axis=1)
    half_M = put(_corner(N, half, step), x, x) + put(-1.0 * sector.S, q, q)
    half_M += put(-1.0 * sector.entering, x, q) + put(sector.excess, q, x)
    if step:
        root = np.sqrt(step)
        half_M += put(N, -root * z, x) + put(sector.entering, root * z, q)
        half_M += put(X, -0.5 * z, z)
    half_M += _of_noise(source, t, data, weight, x)
    return Block(f"{source.name}, {name}", size, (), half_M)


def _held(name: str, form: Form, t: Linear, weight: float, output: Output) -> Iterator[Block]:
    """Yield the bound on each signal under H, and on the inputs without saturation.

    Of those Y is free, and a block keeps it near K X.
    """
    (Y, X), (n, m) = (form.cut[output.name].Y, form.X), (output.C.shape[2], output.D.shape[2])
    free = np.delete(np.eye(m), output.held, axis=0)
    D = np.concatenate([output.D[0], free])
    C = np.concatenate([output.C[0], np.zeros((len(free), n))])
    for k, (c, d) in enumerate(zip(C[:, None], D[:, None], strict=True)):
        signal = c @ X + d @ Y if np.any(c) else d @ Y
        fixed = output.fixed or k >= output.rows
        row_output = replace(output, C=output.C[:, :1], D=output.D[:, :1], fixed=fixed)
        yield _bound(f"{name}, row {k + 1}", X, signal, t, weight, row_output)


def _kept(
    name: str, form: Form, Y: Linear, t: Linear, E: Array, weight: float, source: Through
) -> Block:
    """Return the block of a part of a region that is kept under every bounded feedback."""
    if source.part is None:
        raise InputError("no region is to be kept")
    L, M = source.part.pairs(source.rate)[source.pair]
    kept = np.flatnonzero(M.any(axis=0))
    M1, M2 = M[:, kept], np.eye(len(M))[kept]
    (n, q), p, k, rank = E.shape, Y.terms[0].left.shape[0], len(L), len(kept)
    size = k * n + rank * (q + p)
    cuts = np.cumsum([n] * k + [q] * rank + [p] * rank)[:-1]
    places = np.split(np.eye(size), cuts, axis=1)
    x, w, y = places[:k], places[k : k + rank], places[k + rank :]
    half: tuple[Term, ...] = ()
    for a, b in product(range(k), repeat=2):
        half += put(M[a, b] * form.N, x[a], x[b]) if M[a, b] else ()
        half += put(0.5 * L[a, b] * form.X, x[a], x[b]) if L[a, b] else ()
    for c, a in product(range(rank), range(k)):
        if M1[a, c]:
            for j in range(q):
                half += put(t, M1[a, c] * x[a] @ E[:, j : j + 1], w[c][:, j : j + 1])
        half += put(M2[c, a] * Y, y[c], x[a]) if M2[c, a] else ()
    gain: tuple[Term, ...] = ()
    for column in np.concatenate([*w, *y], axis=1).T[:, :, None]:
        gain += put((weight / 2) * t, column, column)
    return Block(name, size, gain, half)


def _passed(
    name: str,
    at: tuple[Linear, Linear, Linear, float],
    Y: Linear,
    t: Linear,
    E: Array,
    F: Array,
    weight: float,
    output: Output,
) -> Block:
    """Return the block of a gain, E and y over the root of the level; ``at`` as `_moved` has it."""
    (X, N, half, step), (n, q), p = at, E.shape, output.rows
    size = n + q + p + (n if step else 0)
    x, w, y, z = np.split(np.eye(size), [n, n + q, n + q + p], axis=1)
    root = np.sqrt(output.level)
    M = put(_corner(N, half, step), x, x) + put(1.0 / root * Y, y, x)
    if step:  # below it is X of the next sample
        late = np.sqrt(step)
        beside, below = (N - (2 / step) * half, X + 2.0 * half) if half.terms else (N, X)
        M += put(beside, -late * z, x) + put(below, -0.5 * z, z)
        for k in range(q):
            M += put(t, -late * z @ E[:, k : k + 1] / root, w[:, k : k + 1])
    for k in range(q):
        M += put(t, x @ E[:, k : k + 1] / root, w[:, k : k + 1])
        M += put(t, y @ F[:, k : k + 1] / output.level, w[:, k : k + 1])
    ends = np.concatenate([w, y], axis=1)
    gain: tuple[Term, ...] = ()
    for column in ends.T[:, :, None]:
        gain += put((weight / 2) * t, column, column)
    if output.fixed:
        return Block(name, size, (), M + tuple(Term(g.name, -g.left, g.right) for g in gain))
    return Block(name, size, gain, M)
