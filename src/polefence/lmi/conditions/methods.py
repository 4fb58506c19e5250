"""Methods that a user can name: the theorem of each, as a pencil, and its work, counted beforehand.

Quadratic and scheduled: gain K(alpha) = Z(alpha) W(alpha)^-1, W and Z polynomials in alpha. One
theorem for all regions, degrees and domains. For X = W and N = A W + B Z,
-(L (x) X + M (x) N + M' (x) N') > 0 for every part of the region places the poles (Chilali &
Gahinet, 1996); it holds for all alpha if, times (sum of alpha)^elevation, all of its coefficients
are positive definite (Polya). Degree 0 is Lemma 1, quadratic stabilisability, equation (8) of Leite
& Peres (2005); degree 1 and elevation 1 on the simplex, for a disk, Theorem 1, (15)-(17).
The paper's right-hand sides (+I, -I/(N-1)^2, -6 I/(N-1)^2 here, on the first block) are kept
homogeneous by a free scalar tau in place of 1, which scales with (W, Z) and changes nothing.

Slack: one slack matrix G for a Lyapunov polynomial P(alpha); fixed gain K = L G^-1.
Disks: [[r P, N + sigma G], [*, r (G + G' - P)]] > 0 with N = A G + B L, for P affine in alpha
Lemma 2, equation (10) of Leite & Peres (2005). Other parts { z : L + M z + M' conj(z) < 0 }:
-[[L (x) P + M' (x) N + *, M (x) (P - G') + e I (x) N], [*, -e I (x) (G + G')]] > 0, which implies
the inequality of the part with A_c P in place of N (multiply by [I, I (x) A_c]); as e tends to zero
it contains Lemma 1 (Peaucelle, Arzelier, Bachelier & Bernussou, 2000).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained, explained_fields
from polefence.law.structure import MAX_DEGREE
from polefence.lmi.conditions.coefficients import inside, weighted
from polefence.lmi.conditions.gain_norm import add_norm
from polefence.lmi.conditions.motion import halves
from polefence.lmi.conditions.pencil import Builder, Linear, Pencil, Piece, block_name, multiple
from polefence.lmi.conditions.performance import Demands, Form, Output, assembled, split_rows
from polefence.lmi.conditions.saturation import Cut, cuts, held_name
from polefence.lmi.conditions.target import Side, Target, disks
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, Exponent, bernstein
from polefence.plant.system import Array
from polefence.proof.laws import DOMAINS
from polefence.proof.short import Short

METHODS = ("quadratic", "slack", "scheduled")
# Inequalities, and multiplications of one step of the search, of which there are some dozens.
MOST_BLOCKS, MOST_STEP = 20_000, 2e11
# A plain "scheduled" is asked for on the box where a step on the simplex takes many seconds, or the
# simplex has so many times as many inequalities: with five parameters or more.
LONG_STEP = 3e10


@dataclass(frozen=True)
class Scheduled(Short):
    """A gain K(alpha) = Z(alpha) W(alpha)^-1 and its options; Theorem 1 unless others are given.

    Parameters
    ----------
    degree : int or "auto"
        Degree of W(alpha), Z(alpha); 0 is the method "quadratic", one gain. "auto" (for `place`)
        raises degree and elevation until the region is proved, refuted, or the next is too large.
    elevation : int
        Degree of the multiplier (sum of alpha)^elevation: more blocks, less conservative.
    on : "simplex" or "box"
        "box" uses that alpha is a product of the parameters' own coordinates: fewer blocks, and a
        gain that is a polynomial in each parameter's coordinate.
    right_hand_sides : bool
        Keep the right-hand sides of the paper's (15)-(17); degree and elevation 1, simplex, disk.
    budget : float, optional
        For "auto": time after which no higher degree is begun [s]; none by default.

    Raises
    ------
    InputError
        For a degree, elevation or domain that there is not.
    """

    degree: int | str = 1
    elevation: int = 1
    on: str = "simplex"
    right_hand_sides: bool = False
    budget: float | None = None

    @explained_fields
    def __post_init__(self) -> None:
        _check(self)
        theorem_1 = (self.degree, self.elevation, self.on) == (1, 1, "simplex")
        if self.right_hand_sides and not theorem_1:
            raise InputError("right_hand_sides belong to degree=1, elevation=1, on='simplex'")
        budget = 0.0 if self.budget is None else self.budget
        if not _is_number(budget) or not budget >= 0:
            raise InputError(f"budget = {self.budget!r} must be a number of seconds, at least 0")


@dataclass(frozen=True)
class Slack(Short):
    """One gain K = L G^-1 with a Lyapunov function P(alpha) of any degree; Lemma 2 by default.

    Parameters
    ----------
    degree : int
        Of P(alpha).
    elevation : int
        See `Scheduled`.
    on : "simplex" or "box"
        See `Scheduled`.
    epsilon : float
        For parts of a region that are no disk: the smaller, the nearer to the method "quadratic".

    Raises
    ------
    InputError
        For a degree, elevation or domain that there is not.
    """

    degree: int = 1
    elevation: int = 0
    on: str = "simplex"
    epsilon: float = 0.03

    @explained_fields
    def __post_init__(self) -> None:
        _check(self)
        if not _is_number(self.epsilon) or not 0 < self.epsilon <= 100:
            raise InputError(f"epsilon = {self.epsilon!r} must be positive, at most 100")


Method = str | Scheduled | Slack


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _check(method: Scheduled | Slack) -> None:
    for name in ("degree", "elevation"):
        value = getattr(method, name)
        if name == "degree" and value == "auto" and isinstance(method, Scheduled):
            continue
        if type(value) is not int or not 0 <= value <= MAX_DEGREE:
            raise InputError(f"{name} = {value!r} must be a whole number, 0 to {MAX_DEGREE}")
    if method.on not in DOMAINS:
        raise InputError(f"on = {method.on!r} is unknown; {suggest(str(method.on), DOMAINS)}")


def method_name(method: Method) -> str:
    """Return the name of the method's family, one of `METHODS`.

    Raises
    ------
    InputError
        If there is no such method.
    """
    method = normal(method)
    if isinstance(method, str):
        return method
    return "slack" if isinstance(method, Slack) else "scheduled"


def normal(method: Method) -> Method:
    """Return the plain name where a method is one of the paper's, so that each has one form.

    Raises
    ------
    InputError
        If there is no such method.
    """
    if isinstance(method, Scheduled):
        if method.degree == 0:
            return "quadratic"
        return "scheduled" if method == Scheduled() else method
    if isinstance(method, Slack):
        return "slack" if method == Slack() else method
    if method not in METHODS:
        raise InputError(f"method = {method!r} is unknown; {suggest(str(method), METHODS)}")
    return method


def degree_hint(method: Method) -> str:
    """Return the end of a remedy: which option of a method to change, else which method to take."""
    if method_name(method) == "quadratic":
        return ", or the method scheduled"
    return ", a higher degree or another method"


def method_label(method: Method) -> str:
    """Return a short text that tells methods apart: "scheduled(2, 1, box)"."""
    method = normal(method)
    if isinstance(method, str):
        return method
    domain = ", box" if method.on == "box" else ""
    if getattr(method, "right_hand_sides", False):
        return method_name(method)
    return f"{method_name(method)}({method.degree}, {method.elevation}{domain})"


def options(method: Method) -> Scheduled | Slack:
    """Return degree, elevation and domain of any method."""
    method = normal(method)
    return _OPTIONS[method] if isinstance(method, str) else method


_OPTIONS: dict[str, Scheduled | Slack] = {
    "quadratic": Scheduled(0, 0),
    "slack": Slack(),
    "scheduled": Scheduled(),
}


@explained
def build(
    method: Method, A: Array, B: Array, sigma: float | Target, unit: Array | None = None
) -> Pencil:
    """Return the pencil of a method for vertices A (N, n, n), B (N, n, m) and centre -sigma.

    Parameters
    ----------
    sigma : float or Target
        A target in place of the centre asks for other regions.
    unit : (n, n) array, optional
        The identity of the original coordinates as it reads in those of A; only the paper's
        right-hand sides need it.
    """
    target = sigma if isinstance(sigma, Target) else disks(sigma)
    o = options(method)
    domain = Domain.of(o.on, len(A))
    if isinstance(o, Slack):
        return slack(A, B, target, domain, o.degree, o.elevation, o.epsilon)
    if o.degree == "auto":
        raise InputError("degree = 'auto' is for place; give a number here")
    identity = np.eye(A.shape[1]) if unit is None else unit
    wanted = identity if o.right_hand_sides else None
    return parameter_dependent(A, B, target, domain, int(o.degree), o.elevation, wanted)


def blocks(plant: UncertainPlant, method: Method) -> int:
    """Return the number of inequalities that a method has for one part of a region."""
    o, domain = options(method), Domain.of(options(method).on, len(plant.vertices))
    return domain.count(_natural(o) + o.elevation)


def step_work(plant: UncertainPlant, method: Method) -> float:
    """Return about how many multiplications one step of the interior point takes.

    Factoring the Newton matrix, and adding up its entries: each inequality has one for every two
    unknowns in it. Of a polynomial's coefficients only those are in an inequality whose exponents
    are no larger than its own.
    """
    o, (n, m) = options(method), plant.shape
    domain = Domain.of(o.on, len(plant.vertices))
    degree, total = int(o.degree), _natural(o) + o.elevation
    scalars = n * (n + 1) // 2
    extra = n * (n + m) if isinstance(o, Slack) else 0
    scalars += 0 if isinstance(o, Slack) else m * n
    unknowns = domain.count(degree) * scalars + extra
    together = 1.0
    for size in domain.sizes:
        if size == 2:
            inside = [min(e, degree) - max(0, e - total + degree) + 1 for e in range(total + 1)]
            together *= sum(k * k for k in inside) / (total + 1)
        else:
            together *= min(comb(total, degree), comb(size + degree - 1, degree)) ** 2
    entries = blocks(plant, method) * (together * scalars**2 + extra**2)
    return unknowns**3 / 3 + entries * (4 * n + 50)


def is_searchable(plant: UncertainPlant, method: Method, most: float = MOST_STEP) -> bool:
    """Whether the search accepts a problem of this size."""
    return blocks(plant, method) <= MOST_BLOCKS and step_work(plant, method) <= most


def fitting(plant: UncertainPlant, method: Method) -> Method:
    """Return the method, a plain "scheduled" one on the box where that problem is far smaller.

    So it is where parameters move: their rates are those of the box. With elevation 1 the box is
    never worse: each of its inequalities is a sum of Theorem 1's.
    """
    if method != "scheduled" or not plant.parameters:
        return method
    wide = Scheduled(1, 1, "box")
    many = bool(plant.moving) or blocks(plant, method) > 5 * blocks(plant, wide)
    if many or not is_searchable(plant, method, LONG_STEP):
        for box in (wide, Scheduled(1, 0, "box")):
            if is_searchable(plant, box, LONG_STEP):
                return box
    return method


def _natural(o: Scheduled | Slack) -> int:
    """Return the degree of the inequality before elevation."""
    return max(int(o.degree), 1) if isinstance(o, Slack) else int(o.degree) + 1


def parameter_dependent(
    A: Array,
    B: Array | None,
    target: Target,
    domain: Domain,
    degree: int = 1,
    elevation: int = 1,
    right_hand_side: Array | None = None,
) -> Pencil:
    """Build the condition for vertices A (N, n, n), B (N, n, m) and regions that grow with r.

    Parameters
    ----------
    B : (N, n, m) array, optional
        Without it A is a closed loop, and the condition one of analysis, W its Lyapunov matrix.
    right_hand_side : (n, n) array, optional
        The paper's I, in the coordinates of A; without it the right-hand sides are zero.
    """
    n = A.shape[1]
    B = np.zeros((len(A), n, 0)) if B is None else B
    m = B.shape[2]
    pencil = Builder("quadratic" if degree == 0 else "scheduled")
    names = [str(k + 1) for k in range(domain.count(degree))] if degree else [""]
    W, Z = list[Linear](), list[Linear]()
    for name, first in zip(names, target.motion.like(domain, degree), strict=True):
        W.append(pencil.symmetric(f"W{name}", n, f"W{names[first]}"))
        if m:
            Z.append(pencil.full(f"Z{name}", (m, n), "u"))
    tau = None if right_hand_side is None else multiple(pencil.positive("tau"), right_hand_side)
    if target.patches:
        forms = _estimated((A, B), (W, Z), target, domain, degree, elevation)
        return assembled(pencil, forms, Demands(target), domain, degree + 1 + elevation)
    forms = (
        replace(
            form,
            name=block_name(form.exponent, domain, degree, elevation),
            floor=None if tau is None else right_hand_share(form.exponent) * tau,
        )
        for form in _forms((A, B), (W, Z), Demands(target), domain, degree, elevation)
    )
    return assembled(pencil, forms, Demands(target), domain, degree + 1 + elevation)


def _estimated(
    plant: tuple[Array, Array],
    law: tuple[list[Linear], list[Linear]],
    target: Target,
    domain: Domain,
    degree: int,
    elevation: int,
) -> Iterator[Form]:
    """Yield the coefficients on each patch of parameters p beside their estimates q.

    X = W(q), N = A(p) W(q) + B(p) Z(q).
    """
    for number, patch in enumerate(target.patches, 1):
        A, B = (np.tensordot(patch.plant, M, 1) for M in plant)
        W, Z = (inside(part, patch.box, domain, degree) for part in law)
        for form in _forms((A, B), (W, Z), Demands(target), domain, degree, elevation):
            yield replace(form, name=f"{block_name(form.exponent, domain)} in patch {number}")


def design(
    A: Array, B: Array, demands: Demands, domain: Domain, degree: int, elevation: int
) -> Pencil:
    """Build the condition for a law K = Z W^-1 that keeps all bounds and a region.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    """
    n, m = A.shape[1], B.shape[2]
    pencil = Builder("performance")
    names = [str(k + 1) for k in range(domain.count(degree))]
    first = demands.target.motion.like(domain, degree)
    W = [
        pencil.symmetric(f"W{name}", n, f"W{names[k]}")
        for name, k in zip(names, first, strict=True)
    ]
    Z = [pencil.full(f"Z{name}", (m, n), "u") for name in names]
    held = {
        o.name: [pencil.full(f"{held_name(o.name)}{name}", (m, n), "u") for name in names]
        for o in demands.outputs
        if o.held
    }
    for norm, near in demands.norms:
        add_norm(pencil, W, Z, norm, near, domain, degree, elevation)
    extra = max(degree + 1, demands.degree(domain)) - degree - 1 + elevation
    forms: Iterable[Form] = _forms((A, B), (W, Z), demands, domain, degree, extra)
    if held:
        forms = _cut_off(forms, (B, Z, held), demands, domain, degree)
    return assembled(pencil, forms, demands, domain, degree + 1 + extra)


def _cut_off(
    forms: Iterable[Form],
    law: tuple[Array, list[Linear], dict[str, list[Linear]]],
    demands: Demands,
    domain: Domain,
    degree: int,
) -> Iterator[Form]:
    """Yield forms with the terms of saturated inputs."""
    (B, Z, held), formed = law, list(forms)
    total = sum(formed[0].exponent[: domain.sizes[0]])
    KX, saturated = weighted(Z, domain, degree), dict[str, dict[Exponent, Cut]]()
    for output in demands.outputs:
        if output.held:
            Y = weighted(held[output.name], domain, degree)
            P = bernstein(domain, B, 1)
            saturated[output.name] = cuts(P, KX, Y, output.held, domain, total)
    for form in formed:
        yield replace(
            form, cut={name: cuts_of[form.exponent] for name, cuts_of in saturated.items()}
        )


def _forms(
    plant: tuple[Array, Array],
    law: tuple[list[Linear], list[Linear]],
    demands: Demands,
    domain: Domain,
    degree: int,
    extra: int,
) -> Iterator[Form]:
    """Yield the coefficients of X = W, N = A W + B Z and Y = C W + D Z, of motions too."""
    forms = list(_still(plant, law, demands.outputs, domain, degree, extra))
    if demands.target.motion.moves:
        X = weighted(law[0], domain, degree)
        moved = halves(demands.target.motion, X, domain, degree + 1 + extra)
        forms = [replace(form, moved=moved.get(form.exponent, ())) for form in forms]
    yield from forms


def _still(
    plant: tuple[Array, Array],
    law: tuple[list[Linear], list[Linear]],
    outputs: tuple[Output, ...],
    domain: Domain,
    degree: int,
    extra: int,
) -> Iterator[Form]:
    """Yield the coefficients of X, N and Y."""
    (A, B), (W, Z) = plant, law
    n = A.shape[1]
    AC = np.concatenate([A, *(o.C for o in outputs)], axis=1)
    BD = np.concatenate([B, *(o.D for o in outputs)], axis=1)
    parts = split_rows(n, outputs)
    tables = domain.pairs(degree, extra), domain.elevated(degree, 1 + extra)
    for e, pairs, sums in zip(domain.monomials(degree + 1 + extra), *tables, strict=True):
        X, NY = Linear(), Linear()
        for k, weight in sums.items():
            X = X + float(weight) * W[k]
            # all corners that meet this coefficient, at once
            weights = {j: w for (j, other), w in pairs.items() if other == k}
            NY = NY + sum(w * AC[j] for j, w in weights.items()) @ W[k]
            if np.any(BD):
                NY = NY + sum(w * BD[j] for j, w in weights.items()) @ Z[k]
        N, *Y = (part @ NY for part in parts) if outputs else (NY,)
        yield Form(e, X, N, tuple(Y))


def right_hand_share(exponent: Exponent) -> float:
    """Return the multiple of I on the right-hand sides of (15), (16), (17)."""
    square = max(len(exponent) - 1, 1) ** 2
    return {3: 1.0, 2: -1 / square, 1: -6 / square}[max(exponent)]


def slack(
    A: Array,
    B: Array,
    target: Target,
    domain: Domain,
    degree: int = 1,
    elevation: int = 0,
    epsilon: float = 0.0,
) -> Pencil:
    """Build the condition for vertices A (N, n, n), B (N, n, m) and regions that grow with r.

    Parameters
    ----------
    epsilon : float
        The e above, in units of 1 / rate; disks do not need it.
    """
    n, m = B.shape[1:]
    pencil = Builder("slack")
    P = [pencil.symmetric(f"P{k + 1}", n) for k in range(domain.count(degree))]
    G, L = pencil.full("G", (n, n), "x"), pencil.full("L", (m, n), "u")
    top = max(degree, 1) + elevation
    exponents = domain.monomials(top)
    tables = domain.pairs(0, top - 1), domain.elevated(degree, top - degree)
    for exponent, products, sums in zip(exponents, *tables, strict=True):
        total = float(sum(products.values()))
        p = Linear()
        for k, weight in sums.items():
            p = p + float(weight) * P[k]
        N = sum(w * A[j] for (j, _), w in products.items()) @ G
        N = N + sum(w * B[j] for (j, _), w in products.items()) @ L
        g = total * G
        name = f"(10) j={exponent.index(1) + 1}" if top == 1 and len(domain.sizes) == 1 else ""
        name = name or block_name(exponent, domain)
        for label, side in target.named(name):
            if _is_disk(side):
                _disk(pencil, label, side, (p, N, g))
            else:
                _bordered(pencil, label, side, (p, N, g), epsilon)
        if target.positive:
            pencil.positive_definite(f"P at {name}", p)
    return pencil.build()


def _is_disk(side: Side) -> bool:
    """Whether the part is [[-r, z - c], [*, -r]] < 0, r perhaps shifted."""
    upper = side.M0.shape == (2, 2) and np.count_nonzero(side.M0) == 1 and side.M0[0, 1]
    return bool(upper) and not side.M1.any()


def _disk(pencil: Builder, name: str, side: Side, matrices: tuple[Linear, Linear, Linear]) -> None:
    p, N, g = matrices
    lower = 2.0 * g - p  # its symmetric part counts
    radius, shift = -side.L1[0, 0], -side.L0[0, 0]
    D: list[Piece] = [(0, 0, 0.5 * radius * p), (1, 1, 0.5 * radius * lower)]
    M: list[Piece] = [(0, 1, N + side.L0[0, 1] * g)]
    if shift:
        M += [(0, 0, -0.5 * shift * p), (1, 1, -0.5 * shift * lower)]
    pencil.block(name, 2, D, M)


def _bordered(
    pencil: Builder,
    name: str,
    side: Side,
    matrices: tuple[Linear, Linear, Linear],
    epsilon: float,
) -> None:
    p, N, g = matrices
    d = len(side.L0)
    D, M = list[Piece](), list[Piece]()
    for a in range(d):
        for b in range(d):
            if a == b:
                D.append((a, a, -0.5 * side.L1[a, a] * p))
                M.append((a, a, 0.5 * side.L0[a, a] * p))
                M.append((a, d + a, epsilon * N))
                M.append((d + a, d + a, -epsilon * g))
            elif a < b:
                D.append((a, b, -side.L1[a, b] * p))
                M.append((a, b, side.L0[a, b] * p))
            if side.M0[b, a]:
                M.append((a, b, side.M0[b, a] * N))
            if side.M0[a, b]:
                M.append((a, d + b, side.M0[a, b] * p))
                # M (x) G' above the diagonal is M' (x) G below it
                M.append((d + b, a, -side.M0[a, b] * g))
    pencil.block(name, 2 * d, D, M)
