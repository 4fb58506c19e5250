"""Measurements y = C(alpha) x from names or matrices, the dual plant, and what y sees of x."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, UnobservableError, suggest
from polefence.certify.checks import is_stability, modes_outside, stable_region, weight_outside
from polefence.plant.controllability import fixed_modes
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, states
from polefence.plant.system import Exact, System, read_matrix
from polefence.proof.plant import OF_WEIGHT
from polefence.region.regions import Region

HOW = "give names of states or outputs, a matrix C of p rows and n columns, or one C a vertex"

DUAL = "(dual, observer)"  # how the names of dual plants end


def read_measured(
    plant: UncertainPlant, measured: Any
) -> tuple[tuple[Exact, ...], tuple[str, ...]]:
    """Return C of every vertex exactly, and the measured signals' names where they are known.

    Parameters
    ----------
    plant : UncertainPlant
    measured : sequence of str, (p, n) matrix or N of them
        Names of states and outputs, with or without their unit; numbers, Fractions or strings such
        as "1/3".

    Raises
    ------
    InputError
        If a name is unknown or stands twice, an output has an input in it, a matrix has another
        shape, an entry is no finite number, or C is zero.
    """
    items = _items([measured] if isinstance(measured, str) else measured)
    if any(isinstance(item, str) for item in items):
        chosen = [_signal(plant, item) for item in items]
        if len(set(chosen)) < len(chosen):
            raise InputError("measured: a signal is named twice; name each once")
        rows = [signal.exact(plant)[0] for signal in chosen]
        return tuple(zip(*rows, strict=True)), tuple(signal.label for signal in chosen)
    return _matrices(plant, items), ()


def _items(value: Any) -> list[Any]:
    items = list(value) if _iterable(value) else []
    if not items:
        raise InputError(f"measured = {value!r} names nothing; {HOW}")
    return items


def _signal(plant: UncertainPlant, word: Any) -> Output:
    """Return a state or an output given by its name, or by its name without the unit."""
    if not isinstance(word, str):
        raise InputError(f"measured: {word!r} among names; {HOW}")
    known = (*states(plant), *plant.every_output)
    for key in ("label", "name"):
        signals = [signal for signal in known if getattr(signal, key) == word.strip()]
        if len(signals) > 1:
            raise InputError(f"measured: {word!r} names {len(signals)} signals; write the unit too")
        if signals and signals[0].D:
            raise InputError(
                f"measured: {word!r} depends on an input, but an observer takes y = C x; give an "
                "output without D, or measure a state"
            )
        if signals:
            return signals[0]
    names = [signal.name for signal in known]
    raise InputError(f"measured: unknown signal {word!r}; {suggest(word, names)}")


def _matrices(plant: UncertainPlant, items: list[Any]) -> tuple[Exact, ...]:
    N, (n, _) = len(plant.vertices), plant.shape
    depth = _depth(items)
    if depth == 2:
        Cs: tuple[Exact, ...] = (read_matrix(items, "C"),) * N
    elif depth == 3:
        if len(items) != N:
            raise InputError(f"measured: {len(items)} matrices C; {plant.name} has {N} vertices")
        Cs = tuple(read_matrix(C, f"C of vertex {j + 1}") for j, C in enumerate(items))
    else:
        raise InputError(f"measured is not a list of rows; {HOW}, for example [[1, 0, 0]]")
    for j, C in enumerate(Cs):
        if len(C[0]) != n:
            raise InputError(f"measured: C has {len(C[0])} columns; {plant.name} has {n} states")
        if len(C) != len(Cs[0]):
            raise InputError(
                f"measured: C of vertex {j + 1} has {len(C)} rows, that of vertex 1 {len(Cs[0])}"
            )
        if not any(any(row) for row in C):
            where = f" of vertex {j + 1}" if depth == 3 else ""
            raise InputError(f"measured: C{where} is zero, so nothing is measured; {HOW}")
    return Cs


def _depth(value: Any) -> int:
    depth = 0
    while _iterable(value):
        value = next(iter(value), None)
        depth += 1
    return depth


def _iterable(value: Any) -> bool:
    """Whether it holds entries; a text is one, and so is an array of no dimension."""
    return (
        isinstance(value, Iterable)
        and not isinstance(value, str)
        and getattr(value, "ndim", 1) != 0
    )


def transposed(matrix: Exact) -> Exact:
    """Return the transpose."""
    return tuple(zip(*matrix, strict=True))


def dual_plant(
    plant: UncertainPlant, C: tuple[Exact, ...], names: tuple[str, ...]
) -> UncertainPlant:
    """Return the plant (A', C'), of the same parameters, at rest, and time.

    Its states keep the plant's names: the dual's state i belongs to the correction of state i.
    """
    remainder = plant.remainder and plant.remainder.transposed(plant.shape[0], len(C[0]))
    vertices = tuple(
        System(transposed(v.exact_A), transposed(c), None, v.name)
        for v, c in zip(plant.vertices, C, strict=True)
    )
    return UncertainPlant(
        vertices,
        tuple(replace(parameter, rate=None) for parameter in plant.parameters),
        f"{plant.name} {DUAL}",
        plant.states,
        names,
        sample_time=plant.sample_time,
        remainder=remainder,
        data=plant.data,
    )


def require_observable(
    plant: UncertainPlant,
    C: tuple[Exact, ...],
    names: tuple[str, ...],
    region: Region | None = None,
) -> None:
    """Refuse what is measured where the pole of an unseen mode is not in the region.

    Parameters
    ----------
    region : Region, optional
        Where it is not given, what is stable for the plant's kind of time.

    Raises
    ------
    UnobservableError
        Saying how much of the state is seen, which eigenvalues are not, whether the pair is at
        least detectable, and what to measure besides.
    """
    asked, stable = region or stable_region(plant), stable_region(plant)
    worst = None
    for vertex in dual_plant(plant, C, names).vertices:
        if modes_outside(vertex.fixed, asked) is None:
            continue
        detectable = modes_outside(vertex.fixed, stable) is None
        if worst is None or not detectable:
            worst = vertex, detectable
            if not detectable:
                break
    if worst is not None:
        raise UnobservableError(_message(plant, C, names, *worst))


def require_detectable(
    plant: UncertainPlant, measured: Sequence[Output], region: Region | None = None
) -> None:
    """Refuse signals that do not see a mode of the plant that is not in the region.

    No law that feeds them back moves it, whatever its order. It is looked for at the vertices and
    in the middle of them.

    Parameters
    ----------
    measured : sequence of Output
        Of states alone.
    region : Region, optional
        Where it is not given, what is stable for the plant's kind of time.

    Raises
    ------
    UnobservableError
        Naming the pole, and what to measure besides.
    """
    asked = stable_region(plant) if region is None else region
    rows = [signal.exact(plant)[0] for signal in measured]
    C: tuple[Exact, ...] = tuple(zip(*rows, strict=True))
    A = tuple(vertex.exact_A for vertex in plant.vertices)
    places = [*zip([v.name for v in plant.vertices], A, C, strict=True)]
    if len(A) > 1:
        places.append(("the middle of its vertices", _mean(A), _mean(C)))
    for where, dynamics, seen in places:
        outside = modes_outside(fixed_modes(transposed(dynamics), transposed(seen)), asked)
        if outside is not None:
            weight = weight_outside(plant, asked, [signal.name for signal in measured])
            if weight is not None:
                raise UnobservableError(
                    f"{plant.name}: {weight[1]}, and a law that does not measure its states "
                    "cannot move it; widen the region, move the pole of the weight, or measure "
                    f"'{OF_WEIGHT}1 of {weight[0]}'"
                )
            where_not = "not stable" if is_stability(plant, asked) else f"not in {asked}"
            names, helps = " and ".join(repr(s.name) for s in measured), _remedy(plant, C)
            raise UnobservableError(
                f"{plant.name}, {where}: not detectable: the measured "
                f"signals ({names}) do not show "
                f"the pole {outside}, {where_not}, so no law that feeds them back can move it; "
                "measure more" + (f", for example also {helps}" if helps else "")
            )


def _mean(matrices: tuple[Exact, ...]) -> Exact:
    share = Fraction(1, len(matrices))
    return tuple(
        tuple(share * sum(entries, Fraction(0)) for entries in zip(*rows, strict=True))
        for rows in zip(*matrices, strict=True)
    )


def _message(
    plant: UncertainPlant,
    C: tuple[Exact, ...],
    names: tuple[str, ...],
    vertex: System,
    stable: bool,
) -> str:
    n, unseen = plant.shape[0], vertex.fixed.count
    seen = " and ".join(map(repr, names)) or "C"
    fate = (
        "detectable only: an estimation error there dies out at its own pace, which no observer "
        "changes"
        if stable
        else "not even detectable: an estimation error there never dies out, whatever the observer"
    )
    helps = _remedy(plant, C)
    return (
        f"{plant.name}, {vertex.name}: not observable: what is measured ({seen}) sees "
        f"{n - unseen} of {n} state dimensions; the unseen part has the "
        f"eigenvalue{'s' if unseen > 1 else ''} {vertex.fixed}, and the pair is {fate}; "
        "measure more" + (f", for example also {helps}" if helps else "")
    )


def _remedy(plant: UncertainPlant, C: tuple[Exact, ...]) -> str | None:
    """Return the name of a state that makes the pair observable if measured too, where one does."""
    n = plant.shape[0]
    if n > 20:  # every try is an exact rank at every vertex
        return None
    for i in range(n):
        row = tuple(Fraction(int(i == j)) for j in range(n))
        pairs = zip(plant.vertices, C, strict=True)
        if all(
            not fixed_modes(transposed(v.exact_A), transposed((*c, row))).count for v, c in pairs
        ):
            return repr(states(plant)[i].label)
    return None
