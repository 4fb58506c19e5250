"""Words for polynomial laws: a formula, what its letters mean, and the gains of its terms."""

from __future__ import annotations

from polefence.law.laws import PolynomialGain
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array


def terms_of(law: PolynomialGain) -> dict[str, Array]:
    """Return the gains by their names: K alone, or K0, K1 and so on, one a term."""
    if law.fixed:
        return {"K": law.gains[0]}
    return {f"K{k}": K for k, K in enumerate(law.gains)}


def formula(law: PolynomialGain) -> str:
    """Return u = (K0 + K1 c1 + K2 c1^2) y, or what else the law is."""
    letter = "y" if law.measured else "x"
    if law.fixed:
        return f"u = K {letter}"
    own = "c" if law.parameters else "alpha"
    sums = [
        " ".join([f"K{k}", *(_power(f"{own}{j + 1}", power) for j, power in enumerate(e) if power)])
        for k, e in enumerate(law.powers)
    ]
    return f"u = ({' + '.join(sums)}) {letter}"


def definitions(law: PolynomialGain) -> list[str]:
    """Describe y, and how each coordinate of the law depends on its parameter."""
    lines = [f"y = {', '.join(own.label for own in law.measured)}"] if law.measured else []
    if law.fixed:
        return lines
    if not law.parameters:
        return [*lines, "alpha1 and so on: the weights of the vertices"]
    looked = [any(e[j] for e in law.powers) for j in range(len(law.parameters))]
    pairs = zip(law.parameters, looked, strict=True)
    return lines + [f"c{j + 1} = {_coordinate(p)}" for j, (p, own) in enumerate(pairs) if own]


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"


def _coordinate(p: Parameter) -> str:
    """Say how a parameter's coordinate, from -1 to 1, is found."""
    low, high = float(p.scheduling(p.low)), float(p.scheduling(p.high))
    middle, half = (low + high) / 2, (high - low) / 2
    own = f"1/{p.name}" if p.inverted else p.name
    first, second = (own, f"{middle:.6g}") if half > 0 else (f"{middle:.6g}", own)
    unit = f" [{p.unit}]" if p.unit else ""
    text = f"({first} - {second})/{abs(half):.6g}" if middle else f"{own}/{half:.6g}"
    text = text.replace("- -", "+ ")
    return f"{text}: -1 at {p.name} = {float(p.low):g}, 1 at {float(p.high):g}{unit}"
