"""A black box as the text of a spec, whose coefficients say what they are in the middle."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from polefence.data.shape import Basis, Shape
from polefence.plant.outputs import split
from polefence.plant.parameters import Parameter
from polefence.plant.spec import toml_text
from polefence.plant.system import Array

REMARK = (
    "# Fitted to measurements, see [data]. The states are those of the fit: a law that is to run",
    "# measures outputs, as [law] measured = [...] says.",
)


@dataclass(frozen=True)
class Labels:
    """Names with units."""

    name: str
    inputs: tuple[str, ...]
    disturbances: tuple[str, ...]
    outputs: tuple[str, ...]


def black_box(shape: Shape, basis: Basis, theta: Array, labels: Labels) -> str:
    """Return the spec of coefficients (entries, monomials)."""
    names = _variables(basis.parameters)
    texts = _texts(shape, basis, theta, names)
    m, own = len(labels.inputs), _own_states(shape)
    lines = [*REMARK, "", f"name = {toml_text(labels.name)}"]
    states = _states(labels, own, len(texts["A"]))
    for key, signals in (("states", states), ("inputs", labels.inputs),
                         ("disturbances", labels.disturbances)):  # fmt: skip
        lines += [f"{key} = {_row(map(toml_text, signals))}"] if signals else []
    for p in basis.parameters if basis.degree else ():
        lines += ["", *_parameter(p)]
    if names and basis.degree:
        lines += ["", "[definitions]  # from -1 to 1 over each range"]
        lines += [_definition(p, names[k]) for k, p in enumerate(basis.parameters)]
    lines += ["", "[matrices]", f"A = {_matrix(texts['A'])}"]
    lines += [f"B = {_matrix([row[:m] for row in texts['B']])}"]
    if labels.disturbances:
        lines += [f"E = {_matrix([row[m:] for row in texts['B']])}"]
    rows = [i for i in range(len(labels.outputs)) if i not in own.values()]
    if rows:
        lines += ["", "[outputs]"]
    for i in rows:
        parts = {"C": texts["C"][i], "D": texts["D"][i][:m], "F": texts["D"][i][m:]}
        given = {key: row for key, row in parts.items() if any(text != "0" for text in row)}
        inner = ", ".join(f"{key} = {_row(row)}" for key, row in given.items())
        lines.append(f"{toml_text(labels.outputs[i])} = {{{inner}}}")
    return "\n".join(lines) + "\n"


def _own_states(shape: Shape) -> dict[int, int]:
    """Return which states are outputs: the first of a chain without what passes straight."""
    pairs = enumerate(zip(shape.firsts, shape.chains, strict=True))
    return {
        first: i for i, (first, length) in pairs if length and not shape.signals.direct[i].any()
    }


def _states(labels: Labels, own: dict[int, int], count: int) -> list[str]:
    """Return names of states: of outputs, or others that no signal has."""
    every = (*labels.inputs, *labels.disturbances, *labels.outputs)
    taken = {split(label)[0] for label in every}
    free = (name for k in itertools.count(1) if (name := f"x{k}") not in taken)
    return [labels.outputs[own[k]] if k in own else next(free) for k in range(count)]


def _variables(parameters: tuple[Parameter, ...]) -> list[str]:
    """Return names of what runs from -1 to 1, none of which is a parameter's."""
    taken, found = {p.name for p in parameters}, list[str]()
    for p in parameters:
        name = f"{p.name}_z"
        while name in taken:
            name += "z"
        taken.add(name)
        found.append(name)
    return found


def _definition(p: Parameter, name: str) -> str:
    middle, half = Basis.ends(p)
    return f"{name} = {toml_text(f'({p.through} - {middle!r})/{half!r}')}"


def _parameter(p: Parameter) -> list[str]:
    lines = [f"[parameter.{p.name}]", f"range = [{float(p.low)!r}, {float(p.high)!r}]"]
    for key in ("label", "unit"):
        lines += [f"{key} = {toml_text(getattr(p, key))}"] if getattr(p, key) else []
    return lines + ([f"through = {toml_text(p.through)}"] if p.inverted else [])


def _texts(
    shape: Shape, basis: Basis, theta: Array, names: list[str]
) -> dict[str, list[list[str]]]:
    """Return the entries of matrices as texts."""
    texts = {key: [[number(value) for value in row] for row in M] for key, M in shape.fixed.items()}
    for (letter, i, j), coefficients in zip(shape.places, theta, strict=True):
        texts[letter][i][j] = _polynomial(coefficients, basis, names)
    return texts


def _polynomial(coefficients: Array, basis: Basis, names: list[str]) -> str:
    terms = list[str]()
    for value, powers in zip(coefficients, basis.powers, strict=True):
        text = number(value)
        if text != "0":
            terms.append("*".join([text, *(names[k] for k in powers)]))
    if len(terms) <= 1 and not (np.any(coefficients[1:])):
        return terms[0] if terms else "0"
    return toml_text(" + ".join(terms).replace(" + -", " - "))


def number(value: float) -> str:
    """Return a number in twelve digits."""
    text = f"{value:.12g}"
    return "0" if float(text) == 0 else text


def _row(texts: Iterable[str]) -> str:
    return f"[{', '.join(texts)}]"


def _matrix(rows: list[list[str]]) -> str:
    return "[\n" + "".join(f"    {_row(row)},\n" for row in rows) + "]"
