r"""Cars on two or four wheels: a rigid body in heave, pitch and roll, masses, springs and dampers.

Axes as in ISO 8855: x ahead, y to the left, z up; pitch is positive with the nose down, roll with
the left side up. With q the body's heave, pitch and roll, v = dq/dt, a corner at (x, y) of the body
moves up by g q, g = [1, -x, y]; G has a row g for each wheel. With h the body's motion over the
road, t the tyres' deflections (positive in compression), w the roads' velocities under the wheels
and s = -G h - t the suspensions' deflections (in compression),

    dh/dt = v - G^+ w,                    M dv/dt = G' F,
    dt/dt = G G^+ w - (wheels' velocity),    F = k s + c ds/dt + u,

and each wheel is moved by its tyre's force kt t less F. An anti-roll bar adds its stiffness times
the difference of two s to one F and takes it from the other. G^+ = (G'G)^-1 G' fits a plane to the
road under the wheels: under four wheels its twist, which a rigid body cannot follow, is left out.

Braking and cornering push at the centre of gravity, and the road against them: a moment of mass
times acceleration times height, which the springs take up, for links without anti-dive do not.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from fractions import Fraction
from itertools import product as combined
from numbers import Rational
from typing import Any

from polefence.base.errors import PlantError, suggest
from polefence.base.explained import explained, explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter, check_label, exact
from polefence.proof.matrices import identity, product, right_divide, transposed
from polefence.proof.reading import MAX_VERTICES, plain
from polefence.proof.short import Short
from polefence.proof.text import plural

Rows = list[list[Any]]
MOTIONS = {"heave": ("m", "m/s"), "pitch": ("rad", "rad/s"), "roll": ("rad", "rad/s")}
MANOEUVRES = {"pitch": "braking [m/s2]", "roll": "cornering [m/s2]"}
MAX_WHEELS = 8


@dataclass(frozen=True)
class Wheel(Short):
    """A wheel and what is between it and the body.

    Parameters
    ----------
    name : str
        "front left", say: names of its signals begin with it.
    mass : number
        Unsprung mass [kg].
    spring, damper : number
        Of the suspension, in the wheel's place [N/m], [N s/m].
    tyre : number
        Stiffness [N/m].
    x, y : number
        How far ahead of the body's centre of mass, and to its left [m].

    Raises
    ------
    PlantError
        If a number is none, or of a sign that it cannot have.
    """

    name: str
    mass: Any
    spring: Any
    damper: Any
    tyre: Any
    x: Any = 0
    y: Any = 0

    @explained_fields
    def __post_init__(self) -> None:
        check_label(self.name, "name of a wheel")
        for key in ("x", "y"):
            object.__setattr__(self, key, exact(getattr(self, key), f"wheel {self.name}: {key}"))
        for key in ("mass", "spring", "damper", "tyre"):
            what = f"wheel {self.name}: {key}"
            _set(self, key, what, key == "damper")


@dataclass(frozen=True)
class Body(Short):
    """The sprung mass, which moves in heave and about the axes of which it has the inertia.

    Parameters
    ----------
    mass : number
        [kg]
    pitch, roll : number, optional
        Moments of inertia about y and x through the centre of mass [kg m2].
    load : tuple of two numbers, optional
        A point (x, y) [m] at which a load is put on.
    felt : number, optional
        The mass that a vertical force at that point feels, load included [kg]: at least `empty`.
        Through ``"1/felt"`` all entries are affine in it, mass and inertias tied as they are.
    height : number, optional
        Of its centre of gravity over the road [m]: braking and cornering are disturbances then.

    Raises
    ------
    PlantError
        If a number is none, or of a sign that it cannot have.
    """

    mass: Any
    pitch: Any = None
    roll: Any = None
    load: Any = None
    felt: Any = None
    height: Any = None

    @explained_fields
    def __post_init__(self) -> None:
        for key in ("mass", "pitch", "roll", "felt", "height"):
            if getattr(self, key) is not None:
                _set(self, key, f"body: {key}")
        if self.height is not None and len(self.motions) == 1:
            raise PlantError("body: height without inertia in pitch or roll; leave it out")
        if (self.load is None) != (self.felt is None):
            raise PlantError(
                "body: give load (a place) and felt (the effective mass there), or neither"
            )
        if self.load is not None:
            x, y = (exact(value, "body: load") for value in self.load)
            object.__setattr__(self, "load", (x, y))
            if isinstance(self.felt, Rational) and self.felt < self.empty:
                raise PlantError(
                    f"body: felt = {float(self.felt):g} kg is less than the "
                    f"{float(self.empty):g} kg that the empty body has at the load's place"
                )

    @property
    def motions(self) -> tuple[str, ...]:
        """Of "heave", "pitch" and "roll" those that it has."""
        return ("heave", *(key for key in ("pitch", "roll") if getattr(self, key) is not None))

    def corner(self, x: Any, y: Any) -> list[Any]:
        """Return g: how a point of the body moves up."""
        return [{"heave": Fraction(1), "pitch": -x, "roll": y}[key] for key in self.motions]

    @property
    def empty(self) -> Any:
        """The mass that a vertical force at the load's place feels without a load [kg]."""
        g, inverse = self.corner(*self.load), self._unloaded
        return 1 / sum(a * a * b for a, b in zip(g, inverse, strict=True))

    @property
    def _unloaded(self) -> list[Any]:
        return [1 / getattr(self, {"heave": "mass"}.get(key, key)) for key in self.motions]

    @property
    def pushed(self) -> Rows:
        """dv/dt by braking and cornering, a column for each motion that they turn, by its height.

        The moments are those of the empty body: with a load they are not affine.
        """
        if self.height is None:
            return [[] for _ in self.motions]
        moment = self.mass * self.height
        return [[moment * e for e in row[1:]] for row in self.inverse]

    @property
    def inverse(self) -> Rows:
        """M^-1, by the formula of Sherman and Morrison: M is that of the empty body plus l g g'."""
        inertia = self._unloaded
        rows = [[a if i == j else 0 for j in range(len(inertia))] for i, a in enumerate(inertia)]
        if self.load is None:
            return rows
        h = [a * b for a, b in zip(self.corner(*self.load), inertia, strict=True)]
        share = self.empty * (1 - self.empty / self.felt)
        return [[e - share * h[i] * h[j] for j, e in enumerate(row)] for i, row in enumerate(rows)]


@dataclass(frozen=True)
class Bar(Short):
    """An anti-roll bar between two wheels.

    Parameters
    ----------
    name : str
        For people.
    between : tuple of two str
        Names of the wheels.
    stiffness : number
        Force at each wheel by the difference of their suspensions' deflections [N/m].

    Raises
    ------
    PlantError
        If the stiffness is none, or not two wheels are named.
    """

    name: str
    between: Sequence[str]
    stiffness: Any

    @explained_fields
    def __post_init__(self) -> None:
        check_label(self.name, "name of an anti-roll bar")
        object.__setattr__(self, "between", tuple(self.between))
        if len(set(self.between)) != 2 or len(self.between) != 2:
            raise PlantError(f"bar {self.name}: between must name two wheels")
        _set(self, "stiffness", f"bar {self.name}: stiffness")


@dataclass(frozen=True)
class Car(Short):
    """A body on wheels.

    Parameters
    ----------
    body : Body
    wheels : sequence of Wheel
        As many as the body has motions, or more.
    seats : mapping of str to (x, y)
        Points of the body whose vertical acceleration is an output [m].
    bars : sequence of Bar

    Raises
    ------
    PlantError
        If wheels are missing, have one name, stand in a line, or not around the centre of mass, or
        a bar is between others.
    """

    body: Body
    wheels: Sequence[Wheel]
    seats: Mapping[str, Any] = field(default_factory=dict)
    bars: Sequence[Bar] = ()

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "wheels", tuple(self.wheels))
        object.__setattr__(self, "bars", tuple(self.bars))
        names = [wheel.name for wheel in self.wheels]
        many = len(self.body.motions)
        if not many <= len(names) <= MAX_WHEELS:
            raise PlantError(
                f"car: {plural(len(names), 'wheel')}; {' and '.join(self.body.motions)} "
                f"need {many} to {MAX_WHEELS}"
            )
        if len(set(names)) < len(names):
            raise PlantError("car: two wheels have one name")
        for bar in self.bars:
            for name in bar.between:
                if name not in names:
                    raise PlantError(f"bar {bar.name}: no wheel {name!r}; {suggest(name, names)}")
        for axis, motion in (("x", "pitch"), ("y", "roll")):
            places = [getattr(wheel, axis) for wheel in self.wheels]
            if motion in self.body.motions and not min(places) < 0 < max(places):
                raise PlantError(
                    f"car: no two wheels have the body's centre of mass between them in {axis}; "
                    f"{axis} counts from there"
                )
            if motion not in self.body.motions and any(places):
                raise PlantError(f"car: wheels have {axis}, and the body no inertia in {motion}")
        _ = self.plane

    def document(self) -> dict[str, Any]:
        """Return it as plain data, for a file: numbers, or "p/q" where no double holds one."""
        parts = {"wheels": self.wheels, "bars": self.bars}
        return {
            "body": _plain(self.body),
            **{key: [_plain(part) for part in same] for key, same in parts.items()},
            "seats": {name: plain(list(place)) for name, place in self.seats.items()},
        }

    @classmethod
    def of(cls, document: Any) -> Car:
        """Return the car of a file.

        Raises
        ------
        TypeError, ValueError
            If the data are of another form; as a `PlantError` where a number is wrong.
        """
        body, wheels, bars, seats = (document[key] for key in ("body", "wheels", "bars", "seats"))
        return cls(
            Body(**_exact(body)),
            [Wheel(**_exact(wheel)) for wheel in wheels],
            {name: tuple(map(Fraction, place)) for name, place in seats.items()},
            [Bar(**_exact(bar)) for bar in bars],
        )

    @property
    def G(self) -> Rows:
        """A row for each wheel: how the body above it moves up."""
        return [self.body.corner(wheel.x, wheel.y) for wheel in self.wheels]

    @property
    def plane(self) -> Rows:
        """G^+: heave, pitch and roll of the plane that fits the road under the wheels.

        Raises
        ------
        PlantError
            If the wheels stand in a line.
        """
        across: Rows = transposed(self.G)
        turned: Rows | None = right_divide(self.G, product(across, self.G))
        if turned is None:
            raise PlantError("car: its wheels stand in a line")
        return transposed(turned)

    @property
    def signals(self) -> dict[str, tuple[str, ...]]:
        """Names of states, inputs and disturbances."""
        motions, wheels = self.body.motions, [wheel.name for wheel in self.wheels]
        return {
            "states": (
                *(f"{name} over the road [{MOTIONS[name][0]}]" for name in motions),
                *(f"{name} tyre deflection [m]" for name in wheels),
                *(f"{name} rate [{MOTIONS[name][1]}]" for name in motions),
                *(f"{name} wheel velocity [m/s]" for name in wheels),
            ),
            "inputs": tuple(f"{name} force [N]" for name in wheels),
            "disturbances": (*(f"{name} [m/s]" for name in self.places), *self.manoeuvres),
        }

    @property
    def places(self) -> dict[str, tuple[Any, Any]]:
        """Where each road is, by the name of the disturbance: of its wheel, (x, y) [m]."""
        return {f"{wheel.name} road velocity": (wheel.x, wheel.y) for wheel in self.wheels}

    @property
    def manoeuvres(self) -> tuple[str, ...]:
        """Disturbances that push the body: deceleration, and acceleration to the left."""
        if self.body.height is None:
            return ()
        return tuple(MANOEUVRES[motion] for motion in self.body.motions[1:])

    @property
    def matrices(self) -> tuple[Rows, Rows, Rows, dict[str, dict[str, Any]]]:
        """Matrices of the plant, and its outputs, as `UncertainPlant.from_function` takes them."""
        k, m = len(self.body.motions), len(self.wheels)
        deflection = self._deflections
        force, push = self._forces(deflection), identity(m)
        moved, pushed = self._moved(force), self._moved(push)
        plane = self.plane
        n = 2 * (k + m)
        A = [[int(j == k + m + i) for j in range(n)] for i in range(k)]
        A += [[-int(j == 2 * k + m + i) for j in range(n)] for i in range(m)]
        A += moved
        B = [[0] * m for _ in range(k + m)] + pushed
        for i, wheel in enumerate(self.wheels):
            tyre = [wheel.tyre * int(j == k + i) for j in range(n)]
            A.append([(a - b) / wheel.mass for a, b in zip(tyre, force[i], strict=True)])
            B.append([-int(j == i) / wheel.mass for j in range(m)])
        turned = self.body.pushed
        none = [0] * len(self.manoeuvres)
        E = [[-e for e in row] + none for row in plane]
        E += [row + none for row in product(self.G, plane)]
        E += [[0] * m + row for row in turned] + [[0] * m + none for _ in range(m)]
        return A, B, E, self._outputs(deflection, moved, pushed)

    @property
    def _deflections(self) -> Rows:
        """Return s by the states: -G h - t."""
        k, m = len(self.body.motions), len(self.wheels)
        return [
            [-g for g in row] + [-int(j == i) for j in range(m)] + [0] * (k + m)
            for i, row in enumerate(self.G)
        ]

    def _forces(self, deflection: Rows) -> Rows:
        """F without the inputs, by the states: ds/dt = (wheel's velocity) - G v."""
        k, m, forces = len(self.body.motions), len(self.wheels), []
        for i, (wheel, row) in enumerate(zip(self.wheels, self.G, strict=True)):
            rate = [0] * (k + m) + [-g for g in row] + [int(j == i) for j in range(m)]
            pairs = zip(deflection[i], rate, strict=True)
            forces.append([wheel.spring * s + wheel.damper * r for s, r in pairs])
        names = [wheel.name for wheel in self.wheels]
        for bar in self.bars:
            one, other = (names.index(name) for name in bar.between)
            apart = [a - b for a, b in zip(deflection[one], deflection[other], strict=True)]
            for i, sign in ((one, 1), (other, -1)):
                pairs = zip(forces[i], apart, strict=True)
                forces[i] = [f + sign * bar.stiffness * s for f, s in pairs]
        return forces

    def _moved(self, force: Rows) -> Rows:
        """dv/dt = M^-1 G' F."""
        return _product(self.body.inverse, _product(transposed(self.G), force))

    def _outputs(self, deflection: Rows, moved: Rows, pushed: Rows) -> dict[str, dict[str, Any]]:
        k, outputs = len(self.body.motions), dict[str, dict[str, Any]]()
        turned = [[0] * len(self.wheels) + row for row in self.body.pushed]
        for i, motion in enumerate(self.body.motions):
            label = f"{motion} acceleration [{MOTIONS[motion][1]}2]"
            outputs[label] = self._row(moved[i], pushed[i], turned[i])
        for name, place in self.seats.items():
            x, y = (exact(value, f"seat {name}") for value in place)
            g = [self.body.corner(x, y)]
            rows = (_product(g, part)[0] for part in (moved, pushed, turned))
            outputs[f"{name} acceleration [m/s2]"] = self._row(*rows)
        for i, wheel in enumerate(self.wheels):
            outputs[f"{wheel.name} suspension deflection [m]"] = {"C": deflection[i]}
            row = [wheel.tyre * int(j == k + i) for j in range(len(deflection[0]))]
            outputs[f"{wheel.name} tyre force variation [N]"] = {"C": row}
        return outputs

    def _row(self, C: list[Any], D: list[Any], F: list[Any]) -> dict[str, Any]:
        """Return an acceleration; manoeuvres pass straight into it."""
        return {"C": C, "D": D} | ({"F": F} if self.manoeuvres else {})


@explained
def car_family(
    make: Callable[..., Car],
    parameters: Parameter | Sequence[Parameter],
    more: Callable[[], dict[str, dict[str, Any]]] = dict,
    **names: Any,
) -> UncertainPlant:
    """Return the cars ``make(**parameters)`` as a family of plants.

    Parameters
    ----------
    make : callable
        Returns a `Car` for values of the parameters: numbers, or symbols that add, multiply and
        divide.
    parameters : Parameter or sequence of them
    more : callable, optional
        Returns further outputs, as `UncertainPlant.from_expressions` takes them, for the values
        with which ``make`` was called last.
    names
        Of `UncertainPlant`: ``name`` and so on.

    Raises
    ------
    PlantError
        If there is no such car.
    MultiAffinityError
        If an entry is not multi-affine in the scheduling variables; the entry is named.
    """
    parameters = (parameters,) if isinstance(parameters, Parameter) else tuple(parameters)
    if len(parameters) >= MAX_VERTICES.bit_length():
        raise PlantError(f"{len(parameters)} parameters; at most {MAX_VERTICES.bit_length() - 1}")
    corners = combined(
        *(
            [(parameter.name, end) for end in (parameter.low, parameter.high)]
            for parameter in parameters
        )
    )
    cars = [make(**dict(corner)) for corner in corners]  # symbols have no sign

    def matrices(**values: Any) -> tuple[Rows, Rows, Rows, dict[str, dict[str, Any]]]:
        A, B, E, outputs = make(**values).matrices
        others = more()
        for label in others:
            if label in outputs:
                raise PlantError(
                    f"output {label!r} is a name that the car has already; choose another"
                )
        return A, B, E, outputs | others

    return UncertainPlant.from_function(matrices, parameters, **(cars[0].signals | names))


def _plain(part: Any) -> dict[str, Any]:
    """Return the fields of a part of a car that are given."""
    values = ((field.name, getattr(part, field.name)) for field in fields(part))
    return {name: plain(value) for name, value in values if value is not None}


def _exact(value: Any) -> Any:
    """Return what `plain` wrote, with "p/q" as rationals."""
    if isinstance(value, dict):
        return {name: _exact(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_exact(entry) for entry in value]
    quotient = isinstance(value, str) and re.fullmatch(r"-?[0-9]{1,300}/[0-9]{1,300}", value)
    return Fraction(value) if quotient else value


def _set(part: Any, key: str, what: str, may_vanish: bool = False) -> None:
    """Make a number exact and check its sign; a symbol has none."""
    value = getattr(part, key)
    if isinstance(value, Rational | float | int | str):
        value = exact(value, what)
        if value < 0 or (value == 0 and not may_vanish):
            few = "negative" if value < 0 else "zero"
            must = "zero or more" if may_vanish else "positive"
            raise PlantError(f"{what} = {float(value):g} is {few}; it must be {must}")
        object.__setattr__(part, key, value)


def _product(X: Rows, Y: Rows) -> Rows:
    """Return the product of matrices of which one may hold symbols."""
    columns = transposed(Y)
    return [
        [sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for column in columns]
        for row in X
    ]
