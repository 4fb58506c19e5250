"""Description of a car in a plant: which of its signals are what, and which way they count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from polefence.base.errors import PlantError, suggest
from polefence.plant.outputs import Output, disturbances, inputs, rate_of, states
from polefence.plant.parameters import check_label
from polefence.plant.system import Exact, System
from polefence.proof.short import Short
from polefence.proof.text import quoted

if TYPE_CHECKING:
    from polefence.plant.family import UncertainPlant

ACCELERATION = "sprung-mass acceleration"
UNSPRUNG = "unsprung-mass acceleration"
TYRE_FORCE = "tyre force variation"
OF_A_CAR = (ACCELERATION, UNSPRUNG, TYRE_FORCE)
SENSES = {"compression": 1, "extension": -1}


@dataclass(frozen=True)
class Vehicle(Short):
    """A quarter car's signals, by their names without the unit.

    With x1 and x2 the deflections of suspension and tyre, positive in compression, x3 and x4 the
    velocities of sprung and unsprung mass, positive upwards, u the force, up on the sprung mass and
    down on the unsprung, and w the vertical velocity of the road [m/s],

        dx1/dt = x4 - x3,    m1 dx3/dt = k x1 + c (x4 - x3) + u,
        dx2/dt = w - x4,     m2 dx4/dt = -k x1 - c (x4 - x3) + kt x2 - u.

    A plant may have further states. Its matrices say the masses, springs and dampers, and must be
    of this form at every vertex.

    Attributes
    ----------
    suspension_deflection, tyre_deflection, sprung_velocity, unsprung_velocity : str
        States.
    force : str
        Input, or the state behind an actuator that follows an input.
    road : str
        Disturbance, where the plant has any.
    suspension_positive, tyre_positive : "compression" or "extension"
        Which way a deflection counts; in extension the signs of x1, or of x2, are the other way.
    """

    suspension_deflection: str = "suspension deflection"
    tyre_deflection: str = "tyre deflection"
    sprung_velocity: str = "sprung-mass velocity"
    unsprung_velocity: str = "unsprung-mass velocity"
    force: str = "actuator force"
    road: str = "road velocity"
    suspension_positive: str = "compression"
    tyre_positive: str = "compression"

    def __post_init__(self) -> None:
        for field in fields(self):
            check_label(getattr(self, field.name), f"vehicle: {field.name}")
        for key in ("suspension_positive", "tyre_positive"):
            value = getattr(self, key)
            if value not in SENSES:
                raise PlantError(f"vehicle: {key} = {value!r} is unknown; {suggest(value, SENSES)}")

    @property
    def sense(self) -> tuple[int, int]:
        """Of the deflections of suspension and tyre: 1 in compression, -1 in extension."""
        return SENSES[self.suspension_positive], SENSES[self.tyre_positive]

    def places(self, plant: UncertainPlant) -> tuple[int, int, int, int]:
        """Return the numbers of the four states.

        Raises
        ------
        PlantError
            If the plant has no state of a name.
        """
        names = [state.name for state in states(plant)]
        keys = ("suspension_deflection", "tyre_deflection", "sprung_velocity", "unsprung_velocity")
        first, second, third, fourth = (
            _number(getattr(self, key), names, f"{key}: no state") for key in keys
        )
        return first, second, third, fourth

    def lag(self, plant: UncertainPlant) -> int | None:
        """Return the number of the force among the states, None where it is an input."""
        names = [state.name for state in states(plant)]
        return names.index(self.force) if self.force in names else None

    def input(self, plant: UncertainPlant) -> int:
        """Return the number of the input that is the force, or that the force follows.

        Raises
        ------
        PlantError
            If there is none, or several move the force alike.
        """
        place = self.lag(plant)
        if place is None:
            return _number(self.force, [signal.name for signal in inputs(plant)], "force: no input")
        reached, before = {place}, set[int]()
        while reached != before:  # by the fewest integrations
            acting = {
                j for v in plant.vertices for i in reached for j, x in enumerate(v.exact_B[i]) if x
            }
            if len(acting) == 1:
                return acting.pop()
            if acting:
                raise PlantError(f"vehicle: force: {len(acting)} inputs move {quoted(self.force)}")
            before = reached
            reached = before | {
                k for v in plant.vertices for i in before for k, x in enumerate(v.exact_A[i]) if x
            }
        raise PlantError(f"vehicle: force: no input moves the state {quoted(self.force)}")

    def _push(self, plant: UncertainPlant) -> tuple[str, int]:
        """Return the matrix and the column by which the force acts."""
        place = self.lag(plant)
        return ("B", self.input(plant)) if place is None else ("A", place)

    def outputs(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return accelerations and, where the matrices say kt, the variation of the tyre's force.

        Raises
        ------
        PlantError
            If the matrices are not those of the car, naming the first entry that is not.
        """
        self._check(plant)
        _, tyre, sprung, unsprung = self.places(plant)
        known = states(plant)
        outputs = [
            rate_of(plant, known[sprung].name, ACCELERATION),
            rate_of(plant, known[unsprung].name, UNSPRUNG),
        ]
        kt = self._tyre_stiffness(plant)
        if kt is not None:
            row = [self.sense[1] * kt * int(j == tyre) for j in range(plant.shape[0])]
            outputs.append(Output(TYRE_FORCE, "N", C=row))
        return tuple(outputs)

    def _tyre_stiffness(self, plant: UncertainPlant) -> Fraction | None:
        """Return kt where it is the same positive number at every vertex."""
        _, tyre, _, unsprung = self.places(plant)
        letter, force = self._push(plant)
        stiffnesses = {
            self.sense[1] * -v.exact_A[unsprung][tyre] / _exact(v, letter)[unsprung][force]
            for v in plant.vertices
        }
        kt = stiffnesses.pop()
        return None if stiffnesses or kt <= 0 else kt

    def _check(self, plant: UncertainPlant) -> None:
        if plant.sample_time is not None:
            raise PlantError("vehicle: the equations of a car are in continuous time")
        places, push, road = self.places(plant), self._push(plant), self.column(plant)
        self.input(plant)
        for vertex in plant.vertices:
            self._check_kinematics(vertex, places, road)
            _check_forces(vertex, places, push)

    def column(self, plant: UncertainPlant) -> int | None:
        """Return the number of the road among the disturbances, where the plant has any."""
        names = [disturbance.name for disturbance in disturbances(plant)]
        return _number(self.road, names, "road: no disturbance") if names else None

    def _check_kinematics(self, vertex: System, places: Sequence[int], road: int | None) -> None:
        """Refuse rows of the deflections that are not differences of velocities."""
        (x1, x2, x3, x4), (s, t) = places, self.sense
        zero = [Fraction(0)] * max(len(vertex.exact_A), len(vertex.exact_B[0]))
        E = vertex.exact_E
        for i, rates in ((x1, {x3: -s, x4: s}), (x2, {x4: -t})):
            row = [Fraction(rates.get(j, 0)) for j in range(len(vertex.exact_A))]
            _require_row(vertex.exact_A[i], row, f"{vertex.name}: A[{i + 1}]")
            _require_row(vertex.exact_B[i], zero, f"{vertex.name}: B[{i + 1}]")
        if E is not None:
            _require_row(E[x1], [0] * len(E[x1]), f"{vertex.name}: E[{x1 + 1}]")
            wanted = [t * int(k == road) for k in range(len(E[x2]))]
            _require_row(E[x2], wanted, f"{vertex.name}: E[{x2 + 1}]")


_REMEDY = "check suspension_positive and tyre_positive, or leave the vehicle out"


def _exact(vertex: System, letter: str) -> Exact:
    return vertex.exact_A if letter == "A" else vertex.exact_B


def _check_forces(vertex: System, places: Sequence[int], push: tuple[str, int]) -> None:
    """Refuse forces between the masses that are not equal and opposite, as far as digits say."""
    (x1, x2, x3, x4), A, (letter, force) = places, vertex.exact_A, push
    B = _exact(vertex, letter)
    for i, sign, way in ((x3, 1, "up on the sprung"), (x4, -1, "down on the unsprung")):
        if sign * B[i][force] <= 0:
            raise PlantError(
                f"vehicle: {vertex.name}: {letter}[{i + 1}][{force + 1}] = {_text(B[i][force])}, "
                f"but the force acts {way} mass; change its sign in {letter}"
            )
    for i, j, k, n, sign in ((x3, x1, x4, x1, 1), (x3, x3, x4, x3, 1), (x3, x3, x3, x4, -1)):
        one, other = A[i][j] / B[i][force], sign * A[k][n] / B[k][force]
        # digits of matrices are rounded
        if abs(one - other) > Fraction(1, 100) * max(abs(one), abs(other)):
            minus = "-" if sign < 0 else ""
            raise PlantError(
                f"vehicle: {vertex.name}: spring and damper push both masses alike, but "
                f"A[{i + 1}][{j + 1}] / {letter}[{i + 1}][{force + 1}] = {_text(one)} and {minus}A"
                f"[{k + 1}][{n + 1}] / {letter}[{k + 1}][{force + 1}] = {_text(other)}"
            )
    if A[x3][x2]:
        raise PlantError(
            f"vehicle: {vertex.name}: A[{x3 + 1}][{x2 + 1}] = {_text(A[x3][x2])} must be 0: the "
            "tyre does not push the sprung mass"
        )


def _number(name: str, names: Sequence[str], what: str) -> int:
    if names.count(name) != 1:
        remedy = suggest(name, names) if names else "give them names"
        raise PlantError(f"vehicle: {what} {quoted(name)}; {remedy}")
    return names.index(name)


def _require_row(row: Sequence[Fraction], wanted: Sequence[Any], where: str) -> None:
    for j, (entry, other) in enumerate(zip(row, wanted, strict=False)):
        if entry != other:
            raise PlantError(
                f"vehicle: {where}[{j + 1}] = {_text(entry)}, that of a quarter car is "
                f"{_text(other)}; {_REMEDY}"
            )


def _text(value: Fraction) -> str:
    return f"{float(value):.6g}"
