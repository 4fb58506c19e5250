"""A design as a MATLAB 5 file: the vertices, and the law's polynomials or its gain."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, cast

import numpy as np

from polefence.base.explained import explained
from polefence.base.files import write_bytes
from polefence.certify.design import Design
from polefence.export.memory import kept, with_rates
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import binomial
from polefence.plant.system import Array
from polefence.proof.text import visible

# In place of scipy's own text, which has a date: the same design makes the same file.
HEADER = b"MATLAB 5.0 MAT-file, written by polefence"
HEADER_LENGTH = 116


@explained
def mat(design: Design, path: str | Path) -> Path:
    """Write a design as a MATLAB 5 file, which MATLAB, GNU Octave and SciPy load.

    Its variables: ``A`` (n, n, N), ``B`` (n, m, N), ``E`` (n, d, N) of the vertices, in SI units;
    ``K`` (m, n) of one gain, else ``T`` (n, n), ``W`` (n, n, count) and ``Z`` (m, n, count), the
    Bernstein coefficients where W is the identity in the middle of the family, K = Z W^-1 T, see
    `ScheduledGain`, with ``degree``, ``exponents`` (count, coordinates) and ``multinomials``
    (count, 1) of their terms, and ``sizes``, the corners of each simplex of the coordinates; of a
    polynomial law ``gains`` (m, r, terms), ``powers`` (terms, coordinates), ``measured``, the names
    of the signals y, and ``C`` (r, n, 1 or N), y = C x, see `PolynomialGain`; of a law with states
    of its own ``order``, how many of the last states they are, their rates the last inputs;
    ``parameters``, a structure array (``name``, ``low``, ``high``, ``unit``, ``inverted`` where the
    plant is affine in 1/p); cell arrays ``states``, ``inputs``, ``disturbances`` of names; texts
    ``name``, ``method``, ``region``, ``statement``; and ``sample_time`` [s], in discrete time.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    OutputError
        If it cannot be written; nothing is left half-written.
    """
    where = Path(path)
    write_bytes(where, mat_bytes(design))
    return where


def mat_bytes(design: Design) -> bytes:
    """Return the content of such a file; the same design makes the same bytes."""
    from scipy.io import savemat  # deferred: slow to import

    stream = io.BytesIO()
    savemat(cast(Any, stream), variables(design), oned_as="row")
    return HEADER.ljust(HEADER_LENGTH) + stream.getvalue()[HEADER_LENGTH:]


def variables(design: Design) -> dict[str, Any]:
    """Return the variables of the file, by their names in MATLAB."""
    design = with_rates(design)
    plant = design.plant
    variables: dict[str, Any] = {
        "A": _stacked(plant.A),
        "B": _stacked(plant.B),
        "name": visible(plant.name),
        "states": _cells(plant.states),
        "inputs": _cells(plant.inputs),
        "disturbances": _cells(plant.disturbances),
        "parameters": _parameters(plant),
        "region": str(design.region),
        "method": design.method,
        "statement": statement(design),
    }
    if plant.vertices[0].E is not None:
        variables["E"] = _stacked(np.array([vertex.E for vertex in plant.vertices]))
    if plant.sample_time is not None:
        variables["sample_time"] = float(plant.sample_time)
    return variables | _law(design)


def statement(design: Design) -> str:
    """Say what the design's certificate proves."""
    if not design.proved:
        return f"NOT PROVED to keep all poles of A + B K in {design.region}."
    return (
        f"Proved in exact arithmetic: all poles of A(alpha) + B(alpha) K(alpha) lie in "
        f"{design.region}, for every constant alpha of the family, of the numbers of design.json. "
        "Rounding, here and in MATLAB, sampling and delay are not in it."
        f"{' ' if design.note else ''}{design.note}"
        f"{'' if design.plant.data is None else f' {visible(design.plant.data.note)}'}"
    )


def _law(design: Design) -> dict[str, Any]:
    law = design.law
    order = {"order": float(kept(design))} if kept(design) else {}
    if law.K is not None:
        return order | {"K": np.array(law.K)}
    if law.gains is not None:
        measured = tuple(signal.label for signal in law.measured) or design.plant.states
        return order | {
            "gains": _stacked(law.gains),
            "powers": np.array(law.powers, dtype=float),
            "measured": _cells(measured),
            "C": _stacked(law.C),
            **({} if law.anti_windup is None else {"anti_windup": np.array(law.anti_windup)}),
        }
    sizes, exponents = law.domain.sizes, law.domain.monomials(law.degree)
    W, Z = law.even
    return {
        "T": law.coordinates.T,
        "W": _stacked(W),
        "Z": _stacked(Z),
        "degree": float(law.degree),
        "sizes": np.array(sizes, dtype=float),
        "exponents": np.array(exponents, dtype=float),
        "multinomials": np.array([[binomial(sizes, e)] for e in exponents], dtype=float),
    }


def _stacked(matrices: Array) -> Array:
    """Return matrices side by side in the third dimension, as MATLAB has them."""
    return np.moveaxis(np.asarray(matrices), 0, -1)


def _cells(names: tuple[str, ...]) -> Any:
    cells = np.empty((1, len(names)), dtype=object)
    cells[0, :] = list(map(visible, names))
    return cells


def _parameters(plant: UncertainPlant) -> Any:
    kinds = [(key, object) for key in ("name", "low", "high", "unit", "inverted")]
    table = np.empty((1, len(plant.parameters)), dtype=kinds)
    for k, p in enumerate(plant.parameters):
        table[0, k] = (p.name, float(p.low), float(p.high), visible(p.unit), p.inverted)
    return table
