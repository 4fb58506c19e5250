"""Methods that a user can name: the pencil each builds, and its work, counted before it begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.lmi.conditions.parameter_dependent import parameter_dependent
from polefence.lmi.conditions.pencil import Pencil
from polefence.lmi.conditions.slack import slack
from polefence.lmi.conditions.target import Target, disks
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import DOMAINS, Domain
from polefence.plant.system import Array

METHODS = ("quadratic", "slack", "scheduled")
MAX_DEGREE = 8
# Inequalities, and multiplications of one step of the search, of which there are some dozens.
MOST_BLOCKS, MOST_STEP = 20_000, 2e11
# Beyond this a step takes many seconds: a plain "scheduled" is then asked for on the box.
LONG_STEP = 3e10


@dataclass(frozen=True)
class Scheduled:
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

    def __post_init__(self) -> None:
        _check(self)
        theorem_1 = (self.degree, self.elevation, self.on) == (1, 1, "simplex")
        if self.right_hand_sides and not theorem_1:
            raise InputError("right_hand_sides belong to degree=1, elevation=1, on='simplex'")
        budget = 0.0 if self.budget is None else self.budget
        if not _is_number(budget) or not budget >= 0:
            raise InputError(f"budget = {self.budget!r} must be a number of seconds, at least 0")


@dataclass(frozen=True)
class Slack:
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
    """End a remedy that has begun: what of a method may be changed, else which one to take."""
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
    if method == "quadratic":
        return replace(Scheduled(), degree=0, elevation=0)
    if isinstance(method, str):
        return Slack() if method == "slack" else Scheduled()
    return method


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
    each = n * (n + 1) // 2
    extra = n * (n + m) if isinstance(o, Slack) else 0
    each += 0 if isinstance(o, Slack) else m * n
    unknowns = domain.count(degree) * each + extra
    together = 1.0
    for size in domain.sizes:
        if size == 2:
            inside = [min(e, degree) - max(0, e - total + degree) + 1 for e in range(total + 1)]
            together *= sum(k * k for k in inside) / (total + 1)
        else:
            together *= min(comb(total, degree), comb(size + degree - 1, degree)) ** 2
    entries = blocks(plant, method) * (together * each**2 + extra**2)
    return unknowns**3 / 3 + entries * (4 * n + 50)


def is_searchable(plant: UncertainPlant, method: Method, most: float = MOST_STEP) -> bool:
    """Whether the search takes on as much."""
    return blocks(plant, method) <= MOST_BLOCKS and step_work(plant, method) <= most


def fitting(plant: UncertainPlant, method: Method) -> Method:
    """Return the method; for a plain "scheduled" that is too large, one on the box that is not."""
    if method != "scheduled" or is_searchable(plant, method, LONG_STEP):
        return method
    for elevation in (1, 0) if plant.parameters else ():
        box = Scheduled(1, elevation, "box")
        if is_searchable(plant, box, LONG_STEP):
            return box
    return method


def _natural(o: Scheduled | Slack) -> int:
    """Return the degree of the inequality before elevation."""
    return max(int(o.degree), 1) if isinstance(o, Slack) else int(o.degree) + 1
