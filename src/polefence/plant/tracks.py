r"""Roads in tracks: wheels behind see the same road later, left and right ones see nearly the same.

A road's velocity under the front wheels is the mean of both sides, plus and less half their
difference. With T = width / speed, white noises v and v' and 1 + sT below,

    mean = (1 + beta s T) / (1 + s T) v,     half difference = delta s T / (1 + s T) v',

each side is white, as v is, for beta^2 + delta^2 = 1 in rationals; long waves lift both sides, and
short ones either: the coherence is 1 / (1 + (w T)^2) to two thousandths. That of an isotropic road
of white velocity is x K1(x), x = w distance / speed, with the Bessel function K1; a width of
`SHARE` times the distance of the wheels comes closest to it, to 0.033.

A delay is Pade's approximation, which passes all frequencies alike: each wheel's spectrum is
exactly that of the road, and only the phase between wheels in front and behind is approximate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import comb, factorial
from typing import Any

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, disturbances, states
from polefence.plant.parameters import exact
from polefence.plant.system import Exact, System
from polefence.proof.matrices import ONE, ZERO, product
from polefence.proof.short import Short

BETA, DELTA = Fraction(697, 985), Fraction(696, 985)
SHARE = Fraction("0.845")  # of the distance of left and right wheels
HIGHEST = 8  # order of an approximation
STATE = "road state "  # how names of its states begin
SOURCES = ("road velocity", "road velocity across")

Row = tuple[Fraction, ...]
Rows = list[list[Any]]


@dataclass(frozen=True)
class Tracks(Short):
    """What is white on a road, and what each wheel sees of it.

    Parameters
    ----------
    speed : number
        [m/s]
    order : int
        Of Pade's approximation of the delay between an axle and the next, 1 to 8.
    width : number, optional
        Waves much longer lift left and right wheels alike, much shorter ones each by itself [m];
        default: 0.845 times the distance of the wheels, which comes closest to an isotropic road.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    speed: Any
    order: int = 4
    width: Any = None

    @explained_fields
    def __post_init__(self) -> None:
        for key in ("speed", "width"):
            given = getattr(self, key)
            if given is None and key == "width":
                continue
            value = exact(given, f"tracks: {key}")
            if value <= 0:
                raise InputError(f"tracks: {key} = {shown(given)} must be a positive number")
            object.__setattr__(self, key, value)
        whole = isinstance(self.order, int) and not isinstance(self.order, bool)
        if not whole or not 1 <= self.order <= HIGHEST:
            raise InputError(f"tracks: order = {shown(self.order)} must be 1 to {HIGHEST}")

    def under(self, plant: UncertainPlant, places: Mapping[str, Any]) -> UncertainPlant:
        """Return the plant on such a road: its states are behind those of the plant.

        Parameters
        ----------
        plant : UncertainPlant
        places : mapping of str to (x, y)
            For each disturbance that is a wheel's road its place, ahead and to the left [m].

        Raises
        ------
        InputError
            If there is no such disturbance, or a wheel stands between the tracks.
        """
        names = [disturbance.name for disturbance in disturbances(plant)]
        for name in places:
            if name not in names:
                raise InputError(
                    f"tracks: {plant.name} has no disturbance {name!r}; {suggest(name, names)}"
                )
        at = {name: (exact(x, name), exact(y, name)) for name, (x, y) in places.items()}
        road = self._road(list(at.values()))
        return _behind(plant, [names.index(name) for name in at], road)

    def _road(self, places: Sequence[tuple[Fraction, Fraction]]) -> Filter:
        """Return what makes the wheels' roads of white noise."""
        both = any(y for _, y in places)
        road = self._sides(_width(places)) if both else Filter([], [], [[]], [[ONE]])
        ahead = sorted({x for x, _ in places}, reverse=True)
        axles = [list(range(len(road.c)))]  # outputs that are the road under each
        for first, second in pairwise(ahead):
            k = len(road.c)
            for i in axles[-1]:
                road = road.later(i, (first - second) / self.speed, self.order)
            axles.append(list(range(k, len(road.c))))
        taken = [axles[ahead.index(x)] for x, _ in places]
        signs = [1 if y > 0 else -1 for _, y in places]
        pairs = zip(taken, signs, strict=True)
        picked = [list(zip(axle, (1, sign), strict=False)) for axle, sign in pairs]
        if not road.a:
            raise InputError("tracks: all wheels are in one place; leave tracks out")
        return road.mixed(picked)

    def _sides(self, width: Fraction) -> Filter:
        """Return mean and half difference of two white and partly coherent sides."""
        a = self.speed / (SHARE * width if self.width is None else self.width)
        return Filter(
            [[-a, ZERO], [ZERO, -a]],
            [[a, ZERO], [ZERO, a]],
            [[1 - BETA, ZERO], [ZERO, -DELTA]],
            [[BETA, ZERO], [ZERO, DELTA]],
        )


@dataclass(frozen=True)
class Filter(Short):
    """z' = a z + b v, and the outputs c z + d v."""

    a: Rows
    b: Rows
    c: Rows
    d: Rows

    def later(self, i: int, delay: Fraction, order: int) -> Filter:
        """Return it with one more output: another, later."""
        p, q, r, t = pade(delay, order)
        none = [ZERO] * order
        a = [row + none for row in self.a]
        a += [[f * e for e in self.c[i]] + row for f, row in zip(q, p, strict=True)]
        b = self.b + [[f * e for e in self.d[i]] for f in q]
        c = [row + none for row in self.c] + [[t * e for e in self.c[i]] + r]
        return Filter(a, b, c, [*self.d, [t * e for e in self.d[i]]])

    def mixed(self, picked: Sequence[Sequence[tuple[int, int]]]) -> Filter:
        """Return it with sums of its outputs in their place."""

        def sums(rows: Rows) -> Rows:
            return [
                [sum((s * rows[i][j] for i, s in terms), ZERO) for j in range(len(rows[0]))]
                for terms in picked
            ]

        return replace(self, c=sums(self.c), d=sums(self.d))


def pade(delay: Fraction, order: int) -> tuple[Rows, list[Fraction], list[Fraction], Fraction]:
    """Return a, b, c, d of Pade's approximation of a delay, N(-s)/N(s) of one order [s]."""
    k = order
    # N(s) = sum of these times (s delay)^j; a state is one of its terms times 1/N
    terms = [Fraction(factorial(2 * k - j) * comb(k, j), factorial(k)) for j in range(k + 1)]
    rates = [terms[j] / terms[j + 1] / delay for j in range(k)]
    a = [[rates[i] * int(j == i + 1) for j in range(k)] for i in range(k - 1)]
    a.append([-rates[-1]] * k)
    b = [ZERO] * (k - 1) + [rates[-1]]
    sign = Fraction((-1) ** k)
    c = [(-1) ** j - sign for j in range(k)]
    return a, b, c, sign


def _width(places: Sequence[tuple[Fraction, Fraction]]) -> Fraction:
    """Return the mean distance of left and right wheels."""
    left, right = [y for _, y in places if y > 0], [y for _, y in places if y < 0]
    if not (left and right) or len(left) + len(right) < len(places):
        raise InputError(
            "tracks: a wheel is neither left nor right (y = 0), or all are on one side; leave "
            "tracks out, and name independent roads by under"
        )
    return sum(left, ZERO) / len(left) - sum(right, ZERO) / len(right)


def _behind(plant: UncertainPlant, wheels: Sequence[int], road: Filter) -> UncertainPlant:
    """Return the plant with a road in place of the disturbances with these numbers."""
    others = [j for j in range(plant.disturbance_count) if j not in wheels]
    n, m = plant.shape
    k, count = len(road.a), len(road.d[0])
    labels = [f"{name} [m/s]" for name in SOURCES[:count]]
    kept = [disturbances(plant)[j].label for j in others]
    none, vertices = (ZERO,) * len(others), []
    for vertex in plant.vertices:
        E = vertex.exact_E or ()
        colour, white = _through(E, wheels, road.c), _through(E, wheels, road.d)
        A = [(*row, *more) for row, more in zip(vertex.exact_A, colour, strict=True)]
        A += [(*(ZERO,) * n, *row) for row in road.a]
        B = (*vertex.exact_B, *((ZERO,) * m for _ in range(k)))
        rows = [(*w, *(row[j] for j in others)) for w, row in zip(white, E, strict=True)]
        rows += [(*row, *none) for row in road.b]
        vertices.append(System(tuple(A), B, tuple(rows), vertex.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        states=(*(y.label for y in states(plant)), *(f"{STATE}{i + 1}" for i in range(k))),
        disturbances=(*labels, *kept),
        outputs=tuple(_on(plant, y, wheels, others, road) for y in plant.outputs),
    )


def _on(
    plant: UncertainPlant, output: Output, wheels: Sequence[int], others: list[int], road: Filter
) -> Output:
    """Return an output of the plant on a road."""
    C, _, F = output.exact(plant)
    colour, white = _through(F, wheels, road.c), _through(F, wheels, road.d)
    on_road = replace(
        output,
        C=[(*c, *more) for c, more in zip(C, colour, strict=True)],
        F=[(*w, *(f[j] for j in others)) for w, f in zip(white, F, strict=True)],
    )
    return on_road if any(map(any, on_road.F)) else replace(on_road, F=())


def _through(E: Exact, wheels: Sequence[int], rows: Rows) -> list[Row]:
    """Return columns of E times what they are of a road."""
    return [tuple(row) for row in product([[row[j] for j in wheels] for row in E], rows)]
