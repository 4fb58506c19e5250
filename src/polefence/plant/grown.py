"""A family on other ranges of its parameters, also beyond its own.

Entries are multi-affine in the scheduling variables, and are the same polynomials beyond the box;
functions of the parameters are read on the new box afresh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from polefence.base.errors import PlantError
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.system import Exact, System
from polefence.proof.approximation import Functions
from polefence.proof.laws import add
from polefence.proof.matrices import Rationals, mix
from polefence.proof.remainder import Remainder, Source
from polefence.proof.work import FormatError

Point = tuple[Fraction, ...]
Ends = Mapping[str, tuple[Fraction, Fraction]]


def resized(parameters: Sequence[Parameter], ends: Ends) -> tuple[Parameter, ...]:
    """Return parameters on other ranges; those that are not named as they are.

    Raises
    ------
    PlantError
        If one has no value somewhere.
    """
    return tuple(
        replace(p, low=ends[p.name][0], high=ends[p.name][1]) if p.name in ends else p
        for p in parameters
    )


def weights_of_ends(old: Sequence[Parameter], new: Sequence[Parameter]) -> tuple[Point, Point]:
    """Return the weights of the old upper ends at the new lower and upper ones, beyond 0 and 1."""
    pairs = [[_weight(p, end) for end in (q.low, q.high)] for p, q in zip(old, new, strict=True)]
    low, high = zip(*pairs, strict=True)
    return low, high


def _weight(parameter: Parameter, value: Fraction) -> Fraction:
    first, last = (parameter.scheduling(end) for end in (parameter.low, parameter.high))
    return (parameter.scheduling(value) - first) / (last - first)


def at_ends(vertices: Sequence[Rationals], low: Point, high: Point) -> list[Rationals]:
    """Return what is multi-affine on a box at the corners of another, one axis after the other."""
    found = list(vertices)
    for axis, (first, last) in enumerate(zip(low, high, strict=True)):
        bit = 1 << (len(low) - 1 - axis)
        same = first == 0 and last == 1
        for j in range(0 if same else len(found)):
            if not j & bit:
                pair = found[j], found[j | bit]
                found[j], found[j | bit] = (_along(*pair, end) for end in (first, last))
    return found


def _along(one: Rationals, other: Rationals, share: Fraction) -> Rationals:
    """Return a point of the line through two matrices."""
    return [
        [x if x == y else x + (y - x) * share for x, y in zip(*rows, strict=True)]
        for rows in zip(one, other, strict=True)
    ]


def grown(plant: UncertainPlant, ends: Ends) -> UncertainPlant:
    """Return the family with other ranges of some of its parameters.

    Raises
    ------
    PlantError
        If an entry has no value somewhere in them, or the plant is the samples of another one.
    """
    if plant.remainder is not None and plant.functions is None:
        raise PlantError(f"{plant.name}: what its samples are of is not known")
    parameters = resized(plant.parameters, ends)
    low, high = weights_of_ends(plant.parameters, parameters)
    try:
        functions = None if plant.functions is None else _on(plant.functions, ends)
        vertices = _vertices(plant, functions, low, high)
        near = _enclosed(plant.remainder, functions)
        outputs = tuple(_output(plant, y, functions, low, high) for y in plant.outputs)
    except FormatError as error:
        raise PlantError(str(error)) from error
    return replace(
        plant,
        vertices=vertices,
        parameters=parameters,
        outputs=outputs,
        remainder=near,
        functions=functions,
        car=None,  # described at the old lower ends
    )


def _on(functions: Functions, ends: Ends) -> Functions:
    """Return functions on other ranges."""
    ranges = tuple(
        replace(r, low=ends[r.name][0], high=ends[r.name][1]) if r.name in ends else r
        for r in functions.ranges
    )
    return Functions(ranges, functions.trees, functions.tables)


def _enclosed(remainder: Remainder | None, functions: Functions | None) -> Remainder | None:
    source = remainder and remainder.source
    if not source or functions is None:
        return None
    return Source(functions, source.directions).on_box


def _vertices(
    plant: UncertainPlant, functions: Functions | None, low: Point, high: Point
) -> tuple[System, ...]:
    """Return the corners of the new box."""
    widths = (*plant.shape, plant.disturbance_count)
    none: Exact = ((),) * plant.shape[0]
    wide = [
        [[*a, *b, *e] for a, b, e in zip(v.exact_A, v.exact_B, v.exact_E or none, strict=True)]
        for v in plant.vertices
    ]
    first, second = widths[0], sum(widths[:2])
    systems = list[System]()
    for k, M in enumerate(_corners(wide, plant.remainder, functions, low, high)):
        A, B, E = (
            tuple(tuple(row[a:b]) for row in M)
            for a, b in ((0, first), (first, second), (second, sum(widths)))
        )
        systems.append(System(A, B, E if widths[2] else None, f"vertex {k + 1}"))
    return tuple(systems)


def _output(
    plant: UncertainPlant, output: Output, functions: Functions | None, low: Point, high: Point
) -> Output:
    """Return an output at the corners of the new box."""
    n, m = plant.shape
    C, D, F = output.exact(plant)
    F = F if plant.disturbance_count else ((),) * len(C)
    wide = [[[*c, *d, *f]] for c, d, f in zip(C, D, F, strict=True)]
    rows = [M[0] for M in _corners(wide, output.near, functions, low, high)]
    if all(row == rows[0] for row in rows) and output.near is None:
        rows = rows[:1]
    parts = ((0, n), (n, n + m), (n + m, len(rows[0])))
    C, D, F = (tuple(tuple(row[a:b]) for row in rows) for a, b in parts)
    F = F if any(map(any, F)) or output.near is not None else ()
    return replace(output, C=C, D=D, F=F, near=_enclosed(output.near, functions))


def _corners(
    matrices: list[Rationals],
    remainder: Remainder | None,
    functions: Functions | None,
    low: Point,
    high: Point,
) -> list[Rationals]:
    """Return matrices at the new corners: what is multi-affine goes on, functions are read anew."""
    source = remainder and remainder.source
    if not source or functions is None:
        return at_ends(matrices, low, high)
    directions = [list(map(list, M)) for M in source.directions]
    before, after = (
        [[f.corners[j] for f in own.on_box[1]] for j in range(len(matrices))]
        for own in (source.functions, functions)
    )
    rest = [
        add(M, mix([-x for x in values], directions))
        for M, values in zip(matrices, before, strict=True)
    ]
    return [
        add(M, mix(values, directions))
        for M, values in zip(at_ends(rest, low, high), after, strict=True)
    ]
