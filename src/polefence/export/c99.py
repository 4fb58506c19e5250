"""C99 of a law: what the templates are given, and the text they make of it."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.errors import InputError
from polefence.export.number import Number
from polefence.export.program import Fixed, Program, Scheduled, Share
from polefence.polynomial import Exponent

if TYPE_CHECKING:
    from jinja2 import Environment

MARKER = "Written by polefence export; a new export overwrites it."
WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long main register restrict return short signed sizeof static struct switch typedef union unsigned
void volatile while
"""


@dataclass(frozen=True)
class Texts:
    """What the code says of itself, and its limits.

    Attributes
    ----------
    name : str
        Begins the names of files and functions.
    title : str
    statement : tuple of str
        What is guaranteed, in lines.
    states, inputs : tuple of str
        Names with units.
    limits : tuple of float
        Largest absolute value of each input; empty for none.
    """

    name: str
    title: str
    statement: tuple[str, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    limits: tuple[float, ...] = ()


def check_c_name(name: str) -> None:
    """Refuse what cannot begin the names of C functions.

    Raises
    ------
    InputError
        If it is no C identifier, a word of C, or reserved.
    """
    if not re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]{0,30}", name) or name in WORDS.split():
        raise InputError(
            f"name = {name!r} cannot begin C names; use at most 31 letters, digits and _, a letter "
            "first, and no word of C"
        )


def environment() -> Environment:
    """Return the templates, strict about undefined names."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # deferred: slow to import

    found = Environment(  # noqa: S701  (C, not HTML)
        loader=PackageLoader("polefence.export"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    found.filters["comment"] = comment
    found.filters["wrap"] = wrap
    return found


def comment(text: str) -> str:
    """Return text that cannot end a C comment, in one line of ASCII."""
    plain = re.sub(r"\s+", " ", text).encode("ascii", "replace").decode()
    plain = "".join(c if c.isprintable() else "?" for c in plain)
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace("??", "? ?")


def wrap(text: str) -> str:
    """Break a long list of constants into lines."""
    return ("\n" + 6 * " ").join(textwrap.wrap(text, 92))


def context(program: Program, texts: Texts) -> dict[str, Any]:
    """Return what every template is given."""
    number, name = program.number, texts.name
    signature = [
        f"const {name}_real x[{name.upper()}_STATES]",
        f"{name}_real u[{name.upper()}_INPUTS]",
    ]
    common: dict[str, Any] = {
        "marker": MARKER,
        "name": name,
        "NAME": name.upper(),
        "title": texts.title,
        "statement": texts.statement,
        "states": texts.states,
        "inputs": texts.inputs,
        "number": number,
        "limits": [number.text(v) for v in number.nearest(np.array(texts.limits))],
        "K": [],
        "T": [],
        "given": [],
        "GIVEN": "",
        "by_parameters": False,
        "letter": "",
    }
    common |= {key: number.text(v) for key, v in (("zero", 0.0), ("half", 0.5), ("one", 1.0))}
    if isinstance(program, Fixed):
        common |= {"formula": "u = K x, the same for every parameter value."}
        common |= {"K": rows(number, program.K)}
    else:
        common |= _scheduled(program)
        array = f"{common['letter']}[{name.upper()}_{common['GIVEN']}]"
        signature.insert(0, f"const {name}_real {array}")
    return common | {"signature": ", ".join(signature)}


def _scheduled(program: Scheduled) -> dict[str, Any]:
    number, (n, _) = program.number, program.shape
    lower = np.tril_indices(n)
    by_parameters = bool(program.shares)
    given = [_given(share) for share in program.shares] or [
        f"weight of vertex {j + 1}" for j in range(program.domain.corners)
    ]
    return {
        "formula": "u = Z(alpha) W(alpha)^-1 T x"
        + (", alpha from the parameters." if by_parameters else "."),
        "T": [number.text(v) for v in program.T[lower]],
        "W": rows(number, program.W[:, lower[0], lower[1]].T),
        "Z": rows(number, program.Z.reshape(len(program.Z), -1).T),
        "given": given,
        "by_parameters": by_parameters,
        "loose": number.text(1e-4 if number.bits == 32 else 1e-9),
        "least": number.text(1e-30),
        "equal": number.text(1 / program.domain.corners),
        "GIVEN": "PARAMETERS" if by_parameters else "VERTICES",
        "letter": "p" if by_parameters else "alpha",
        "given_what": "the parameters p" if by_parameters else "the weights alpha of the vertices",
        "clamped": "a parameter was outside its interval, or beyond: its bound was taken"
        if by_parameters
        else "alpha was off the simplex: cut at 0 and scaled to sum to 1",
        "not_a_number": "a parameter was NaN: the middle of its interval was taken"
        if by_parameters
        else "alpha had NaN, or no weight: equal weights were taken",
        "weighing": weighing(program),
        "terms": [_term(number, each, e) for each, e in program.weights()],
    }


def rows(number: Number, table: Any) -> list[list[str]]:
    """Return a table of numbers as C constants."""
    return [[number.text(float(v)) for v in row] for row in table]


def _given(share: Share) -> str:
    p = share.parameter
    unit = f" [{p.unit}]" if p.unit else ""
    return f"{p.name}{unit}, {float(p.low):g} to {float(p.high):g}"


def weighing(program: Scheduled) -> list[str]:
    """Return the lines of C that find c, the coordinates in the law's simplices."""
    sizes = program.domain.sizes
    if not program.shares:
        lines = [f"real a[{program.domain.corners}];", f"real c[{sum(sizes)}];"]
        return [*lines, "flags |= onto_simplex(alpha, a);", *_sums(sizes)]
    own = sizes == (2,) * len(program.shares)  # a simplex a parameter
    m = "c" if own else "m"
    lines = [f"real {name}[{size}];" for name, size in _arrays(program, own)]
    for k, share in enumerate(program.shares):
        lines += _placed(program.number, k, share, m)
    return lines if own else lines + _products(len(program.shares))


def _arrays(program: Scheduled, own: bool) -> list[tuple[str, int]]:
    count = 2 * len(program.shares)
    return [("c", count)] if own else [("m", count), ("c", program.domain.corners)]


def _placed(number: Number, k: int, share: Share, m: str) -> list[str]:
    """Return the lines that clamp a parameter and find its two weights."""
    text = number.text
    low, high, scale = (text(v) for v in (share.low, share.high, share.scale))
    from_low = f"(p{k} - {low})" if share.low >= 0 else f"(p{k} + {text(-share.low)})"
    where = f"{scale} * {from_low}" + (f" / p{k}" if share.parameter.inverted else "")
    return [
        f"const real p{k} = inside(p[{k}], {low}, {high}, &flags);",
        f"{m}[{2 * k + 1}] = fraction({where});",
        f"{m}[{2 * k}] = {text(1.0)} - {m}[{2 * k + 1}];",
    ]


def _products(count: int) -> list[str]:
    """Return the lines that make alpha of the parameters' weights."""
    corners = product(*((2 * k, 2 * k + 1) for k in range(count)))
    return [
        f"c[{j}] = {' * '.join(f'm[{k}]' for k in corner)};" for j, corner in enumerate(corners)
    ]


def _sums(sizes: tuple[int, ...]) -> list[str]:
    """Return the lines that make the coordinates of alpha: on a box, its marginals."""
    corners = list(product(*(range(size) for size in sizes)))
    lines, start = list[str](), 0
    for axis, size in enumerate(sizes):
        for value in range(size):
            own = [f"a[{j}]" for j, corner in enumerate(corners) if corner[axis] == value]
            lines.append(f"c[{start + value}] = {' + '.join(own)};")
        start += size
    return lines


def _term(number: Number, multinomial: int, exponent: Exponent) -> str:
    factors = [f"c[{j}]" for j, power in enumerate(exponent) for _ in range(power)]
    if multinomial != 1:
        factors.insert(0, number.text(float(multinomial)))
    return " * ".join(factors)


def sources(program: Program, texts: Texts) -> dict[str, str]:
    """Return the law's header and source, by the files' names."""
    check_c_name(texts.name)
    templates, given = environment(), context(program, texts)
    return {
        f"{texts.name}.{ending}": templates.get_template(f"law.{ending}.j2").render(given)
        for ending in "hc"
    }
