"""C99 of a law: what the templates are given, and the text they make; texts of strangers in it."""

from __future__ import annotations

import html
import re
import textwrap
import unicodedata
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError
from polefence.export import words
from polefence.export.program import (
    LEAST,
    MOST,
    Fixed,
    Memory,
    Number,
    Polynomial,
    Program,
    Scheduled,
    Share,
    memory_of,
    scales_of,
)
from polefence.plant.polynomial import Exponent
from polefence.proof.claims.words import Scales, largest, two
from polefence.proof.short import Short
from polefence.region.text import digits_down, digits_up

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["MARKER", "Texts", "check_c_name", "context", "environment", "sources"]

MARKER = "Written by polefence export; a new export overwrites it."

WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long main register restrict return short signed sizeof static struct switch typedef union unsigned
void volatile while
"""
# Files of these names hide a standard header, or cannot be made on Windows.
HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar
wchar wctype aux con nul prn
"""
LONGEST = 31  # characters of a name; C tells external names apart by so many
WIDTH = 100  # of a line
# Projections onto each input's states in turn that a start in fixed point takes, of one input and
# of several. Of one the first leaves a thousandth, as its divisor has few bits. Of two whose states
# are the same to the cosine r each leaves r^2: 1e-9 of r = 0.96.
SWEEPS = 8, 256


@dataclass(frozen=True)
class Texts(Short):
    """Words of the code about itself, and its limits.

    Attributes
    ----------
    name : str
        Begins the names of files and functions.
    title : str
    statement : tuple of str
        What is guaranteed, in lines.
    states, inputs : tuple of str
        Names with units; of a law of measured signals theirs in place of the states'.
    sample_time : float, optional
        From one update to the next [s], where one is known; then also the delay from x to u in
        samples.
    limits : tuple of float
        Largest absolute value of each input; empty for none.
    rates : tuple of float
        How fast each input may move, a second; empty for none.
    """

    name: str
    title: str
    statement: tuple[str, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    limits: tuple[float, ...] = ()
    sample_time: float | None = None
    delay: int = 0
    rates: tuple[float, ...] = ()

    @property
    def steps(self) -> tuple[float, ...]:
        """How far each input may move in an update."""
        return tuple(rate * (self.sample_time or 0.0) for rate in self.rates)


@cache
def environment() -> Environment:
    """Return the templates, strict about undefined names."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # deferred: slow to import

    templates = Environment(  # noqa: S701  (C, not HTML)
        loader=PackageLoader("polefence.export"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters["comment"] = comment
    templates.filters["block"] = block
    templates.filters["wrap"] = wrap
    templates.filters["cell"] = cell
    templates.filters["prose"] = prose
    return templates


def context(program: Program, texts: Texts) -> dict[str, Any]:
    """Return the context of every template."""
    if program.scales is not None:
        return _of_words(program, program.scales, texts)
    number, name, memory = program.number, texts.name, memory_of(program)
    head, arguments = _head(program, texts, f"{name}_real")
    vector = head["vector"]
    time = memory.step if memory else texts.sample_time
    common: dict[str, Any] = head | {
        "fixed": False,
        "number": number,
        "prefix": number.largest[:3],
        "digits": 24 if number.bits == 32 else 53,
        "limits": [number.text(number.outward(Fraction(v), up=False)) for v in texts.limits],
        "steps": [number.text(number.outward(Fraction(v), up=False)) for v in texts.steps],
        "plain_rates": [f"{rate:g}" for rate in texts.rates],
        "plain_steps": [f"{step:g}" for step in texts.steps],
        "sample_time": "" if time is None else number.text(time),
        "G": _anti_windup(number, memory),
        "K": [],
        "T": [],
        "gains": [],
        "bounds": [],
    }
    common |= {key: number.text(v) for key, v in (("zero", 0.0), ("half", 0.5), ("one", 1.0))}
    if isinstance(program, Fixed):
        form = f"u = K {vector}"
        if memory:
            form = f"(u, v) = K ({vector}, z), z its own states and v their rates"
        common |= {"formula": f"{form}, the same for every parameter value."}
        common |= {"K": rows(number, program.K)}
    else:
        common |= _varying(program, name) | _tables(program, vector)
        array = f"{common['letter']}[{name.upper()}_{common['GIVEN']}]"
        arguments.insert(0, f"const {name}_real {array}")
    if memory or texts.steps:
        arguments.insert(0, f"{name}_memory *memory")
        terms = len(common["gains"][0]) if common["gains"] else 0
        counts = 4 * (program.shape[0] + terms + 4)
        common |= {
            "dependent": number.text(float(number.unit)),
            "rounding": number.text(counts * float(number.unit)),
        }
    return common | _arguments(arguments)


def _head(program: Program, texts: Texts, real: str) -> tuple[dict[str, Any], list[str]]:
    """Return what floats and integers share: names and words, and the arguments, of a type."""
    name, memory = texts.name, memory_of(program)
    measured = not isinstance(program, Scheduled) and program.measured
    vector, width = ("y", "MEASURED") if measured else ("x", "STATES")
    head = {
        "marker": MARKER,
        "name": name,
        "NAME": name.upper(),
        "title": texts.title,
        "statement": texts.statement,
        "states": texts.states,
        "inputs": texts.inputs,
        "vector": vector,
        "WIDTH": width,
        "signals": "measured signals" if measured else "states",
        "delay": texts.delay,
        "order": memory.states if memory else 0,
        "plain_limits": [f"{limit:g}" for limit in texts.limits],
        "given": [],
        "GIVEN": "",
        "letter": "",
        "by_parameters": False,
    }
    arguments = [
        f"const {real} {vector}[{name.upper()}_{width}]",
        f"{real} u[{name.upper()}_INPUTS]",
    ]
    return head, arguments


def _anti_windup(number: Number, memory: Memory | None) -> list[list[str]]:
    """Return the anti-windup gain as C constants, where the code has one."""
    gain = None if memory is None else memory.anti_windup
    return [] if gain is None else rows(number, gain)


def _of_words(program: Program, scales: Scales, texts: Texts) -> dict[str, Any]:
    """Return the context of the templates in fixed point."""
    name, memory, bits = texts.name, memory_of(program), program.number.bits
    word = f"{name}_word"
    head, arguments = _head(program, texts, word)
    vector, states = head["vector"], head["order"]
    gain, of = ("K", "") if isinstance(program, Fixed) else ("K(c)", ", K a polynomial")
    form = f"u = {gain} {vector}{of}."
    if memory:
        form = f"(u, T v) = {gain} ({vector}, z), z its own states and v their rates{of}."
    if isinstance(program, Scheduled):
        form = "u = (M + Z(c) W(c)^-1 T) x."
    time = memory.sample_time if memory else texts.sample_time
    microseconds = None if time is None else 10**6 * Fraction(time)
    values: dict[str, Any] = head | {
        "formula": form,
        "solved": isinstance(program, Scheduled),
        "sample_time_us": None if microseconds is None else round(microseconds),
        "rounded_time": microseconds is not None and microseconds != round(microseconds),
        "limits": head["plain_limits"],
        "steps": [],
        "divides": False,
        "fixed": True,
    }
    values |= words.constants(program, texts.limits)
    top = largest(bits)
    cuts = zip(values["cuts"], scales.answers, strict=False)
    reach = [digits_down(top * two(-s), 3) for s in scales.signals]
    values |= {
        "top": top,
        "one": 1 << (bits - 2),
        "wide_type": values["wide"],
        "reach": reach,
        "answers": [digits_down(cut * two(-t), 3) for cut, t in cuts],
        "exponents": {"u": scales.answers, "vector": scales.signals, "given": scales.given},
    }
    if not isinstance(program, Fixed):
        common = _given(program)
        lines = words.weighing(program, f"{name.upper()}_OK")
        powers = words.powers(program)
        array = f"{common['letter']}[{name.upper()}_{common['GIVEN']}]"
        arguments.insert(0, f"const {word} {array}")
        values |= common | {
            "terms": len(program.weights()),
            "weighing": lines,
            "powers": powers,
            "multiplies": any("times(" in line for line in (*lines, *powers)),
            "divides": not program.shares or any(s.parameter.inverted for s in program.shares),
        }
    if isinstance(program, Scheduled):
        values |= words.solving(program)
    if isinstance(program, Polynomial):
        values["table"] = [entry for row in values["table"] for entry in row]
    else:
        values["table"] = [[entry[0] for entry in row] for row in values["table"]]
    if memory:
        arguments.insert(0, f"{name}_memory *memory")
        values |= {"sweeps": SWEEPS[len(scales.rows) - states > 1], "halves": _halves(states)}
    return values | _arguments(arguments)


def _arguments(arguments: list[str]) -> dict[str, list[str]]:
    """Return the arguments of an update, and of a start: what acts now in place of the answer."""
    return {"arguments": arguments, "start_arguments": [*arguments[:-1], f"const {arguments[-1]}"]}


def _halves(states: int) -> int:
    """Return how often a row of so many words is halved for the sum of its squares to have room."""
    return ((states - 1).bit_length() + 1) // 2


def _tables(program: Polynomial | Scheduled, vector: str) -> dict[str, Any]:
    """Return the formula of a law that varies, and its constants."""
    number, (n, _) = program.number, program.shape
    if isinstance(program, Polynomial):
        source = ", c from the parameters, -1 to 1" if program.shares else " of alpha"
        how = f"u = K(c) {vector}, K a polynomial{source}."
        if program.memory:
            states = "z its own states and v their rates"
            how = f"(u, v) = K(c) ({vector}, z), {states}, K a polynomial{source}."
        flat = program.gains.reshape(len(program.gains), -1).T
        return {"formula": how, "gains": rows(number, flat), "terms": len(flat[0])}
    lower = np.tril_indices(n)
    return {
        "formula": f"u = {'' if program.L is None else '(L + '}Z(alpha) W(alpha)^-1"
        f"{'' if program.L is None else ')'} T x"
        + (", alpha from the parameters." if program.shares else "."),
        "L": [] if program.L is None else rows(number, program.L),
        "T": [number.text(v) for v in program.T[lower]],
        "W": rows(number, program.W[:, lower[0], lower[1]].T),
        "Z": rows(number, program.Z.reshape(len(program.Z), -1).T),
        "terms": len(program.W),
    }


def _varying(program: Polynomial | Scheduled, name: str) -> dict[str, Any]:
    """Return the context about the parameters, or alpha."""
    number = program.number
    return _given(program) | {
        "loose": number.text(1e-4 if number.bits == 32 else 1e-9),
        "least": number.text(1e-30),
        "most": number.text(1e30),
        "bounds": [_bounds(number, share) for share in program.shares],
        "equal": number.text(1 / program.domain.corners),
        "weighing": weighing(program, f"{name}_real"),
        "weights": []
        if _straight(program)
        else [_term(number, weight, e) for weight, e in program.weights()],
    }


def _given(program: Polynomial | Scheduled) -> dict[str, Any]:
    """Return the words about the parameters, or alpha."""
    by_parameters = bool(program.shares)
    return {
        "given": [_interval_text(share) for share in program.shares]
        or [f"weight of vertex {j + 1}" for j in range(program.domain.corners)],
        "by_parameters": by_parameters,
        "GIVEN": "PARAMETERS" if by_parameters else "VERTICES",
        "letter": "p" if by_parameters else "alpha",
        "given_what": "the parameters p" if by_parameters else "the weights alpha of the vertices",
        "clamped": "a parameter was outside its interval: the nearer bound was taken"
        if by_parameters
        else "alpha was off the simplex by more than rounding: cut at 0, scaled to sum to 1",
        "not_a_number": "a parameter was NaN: the middle of its interval was taken"
        if by_parameters
        else "alpha had NaN, infinity or no weight: equal weights were taken",
    }


def rows(number: Number, table: Any) -> list[list[str]]:
    """Return a table of numbers as C constants."""
    return [[number.text(float(v)) for v in row] for row in table]


def _interval_text(share: Share) -> str:
    p = share.parameter
    unit = f" [{p.unit}]" if p.unit else ""
    return f"{p.name}{unit}, {digits_up(p.low)} to {digits_down(p.high)}"


def _bounds(number: Number, share: Share) -> dict[str, str]:
    return {
        "text": _interval_text(share),
        "low": _signed(number, share.low),
        "high": _signed(number, share.high),
        "scale": number.text(share.scale),
    }


def _signed(number: Number, value: float) -> str:
    text = number.text(value)
    return f"({text})" if text.startswith("-") else text


def weighing(program: Polynomial | Scheduled, real: str) -> list[str]:
    """Return the lines of C that find the coordinates in the law's simplices.

    They are c, or at once the weights w where these are the coordinates. Coordinates of parameters
    from -1 to 1 are the differences of the weights of the parameters' ends.
    """
    if not (isinstance(program, Polynomial) and program.signed):
        return _weighing(program, real, "w" if _straight(program) else "c")
    count = len(program.powers[0])
    lines = [f"{real} c[{count}];", *_weighing(program, real, "ends"), ""]
    return lines + [f"c[{k}] = ends[{2 * k + 1}] - ends[{2 * k}];" for k in range(count)]


def _weighing(program: Polynomial | Scheduled, real: str, c: str) -> list[str]:
    sizes, count = program.domain.sizes, len(program.shares)
    arrays = [] if c == "w" else [f"{real} {c}[{sum(sizes)}];"]
    if not program.shares:
        if len(sizes) == 1:
            return [*arrays, f"const uint32_t flags = onto_simplex(alpha, {c});"]
        arrays.append(f"{real} a[{program.domain.corners}];")
        return [*arrays, "const uint32_t flags = onto_simplex(alpha, a);", "", *_sums(sizes, c)]
    inside = [
        f"const {real} p{k} = inside(p[{k}], P{k}_LOW, P{k}_HIGH, &flags);" for k in range(count)
    ]
    box = sizes == (2,) * count  # a simplex a parameter
    if not box:
        arrays.append(f"{real} m[{2 * count}]; /* of each parameter: how near to low, to high */")
    lines = [*inside, *arrays, ""]
    for k, share in enumerate(program.shares):
        lines += _placed(program.number, k, share, c if box else "m")
    return lines if box else lines + _products(c, count)


def _straight(program: Polynomial | Scheduled) -> bool:
    one = isinstance(program, Scheduled) and program.degree == 1
    return one and len(program.domain.sizes) == 1


def _placed(number: Number, k: int, share: Share, m: str) -> list[str]:
    """Return the lines that find a parameter's two weights."""
    over = f" / p{k}" if share.parameter.inverted else ""
    return [
        f"{m}[{2 * k + 1}] = fraction(P{k}_SCALE * (p{k} - P{k}_LOW){over});",
        f"{m}[{2 * k}] = {number.text(1.0)} - {m}[{2 * k + 1}];",
    ]


def _products(c: str, count: int) -> list[str]:
    """Return the lines that make alpha of the parameters' weights."""
    corners = product(*((2 * k, 2 * k + 1) for k in range(count)))
    return [
        f"{c}[{j}] = {' * '.join(f'm[{k}]' for k in corner)};" for j, corner in enumerate(corners)
    ]


def _sums(sizes: tuple[int, ...], c: str) -> list[str]:
    """Return the lines that make the coordinates of alpha: on a box, its marginals."""
    corners = list(product(*(range(size) for size in sizes)))
    lines, start = list[str](), 0
    for axis, size in enumerate(sizes):
        for value in range(size):
            terms = [f"a[{j}]" for j, corner in enumerate(corners) if corner[axis] == value]
            lines.append(f"{c}[{start + value}] = {' + '.join(terms)};")
        start += size
    return lines


def _term(number: Number, multinomial: int, exponent: Exponent) -> str:
    factors = [f"c[{j}]" for j, power in enumerate(exponent) for _ in range(power)]
    if multinomial != 1:
        factors.insert(0, number.text(float(multinomial)))
    return " * ".join(factors) or number.text(1.0)


def sources(program: Program, texts: Texts) -> dict[str, str]:
    """Return the law's header and source, by the files' names.

    Raises
    ------
    InputError
        If the name cannot begin C names, a text is missing, or a limit is no positive number.
    """
    check_c_name(texts.name)
    _check(program, texts)
    kind = "law" if scales_of(program) is None else "fixed"
    templates, given = environment(), context(program, texts)
    return {
        f"{texts.name}.{ending}": templates.get_template(f"{kind}.{ending}.j2").render(given)
        for ending in "hc"
    }


def _check(program: Program, texts: Texts) -> None:
    """Refuse texts that are not those of the program: the header counts them."""
    n, m = program.shape
    memory = memory_of(program)
    if memory:
        n, m = n - memory.states, m - memory.states
    if (len(texts.states), len(texts.inputs)) != (n, m):
        raise InputError(
            f"{len(texts.states)} states and {len(texts.inputs)} inputs are named; the law has "
            f"{n} and {m}"
        )
    if texts.limits and len(texts.limits) != m:
        raise InputError(f"{len(texts.limits)} limits are given; the law has {m} inputs")
    if texts.rates and len(texts.rates) != m:
        raise InputError(f"{len(texts.rates)} rates are given; the law has {m} inputs")
    if texts.rates and (texts.sample_time is None or program.scales is not None):
        raise InputError("a rate limit is of code in floats, with a sample time")
    for limit in (*texts.limits, *texts.rates, *texts.steps):
        if not LEAST <= limit <= MOST:
            raise InputError(f"limit = {limit!r} must be a number from {LEAST:g} to {MOST:g}")


def check_c_name(name: str) -> None:
    """Refuse what cannot begin the names of C functions.

    Raises
    ------
    InputError
        If it is no C identifier, a word of C or C++, reserved, or a standard header's name.
    """
    # C++ reserves all names with two underscores in a row, and NAME_STATES shall not have them
    plain = re.fullmatch(r"[a-zA-Z](_?[a-zA-Z0-9])*", name) and len(name) <= LONGEST
    if not plain or name in WORDS.split():
        raise InputError(
            f"name = {shorten(name)} cannot begin C names; use at most {LONGEST} letters, digits "
            "and single _ between them, a letter first, and no word of C"
        )
    if name.lower() in HEADERS.split():
        raise InputError(
            f"name = {name!r} would hide the standard header "
            f"{name.lower()}.h, or is not a name of a "
            "file on Windows; use another"
        )


def shorten(text: str) -> str:
    """Quote a text for a message."""
    return repr(text if len(text) <= 2 * LONGEST else text[: 2 * LONGEST] + "...")


def comment(text: str) -> str:
    """Return text that can stand in a C comment, in one line of ASCII.

    Accents are dropped; what ends or begins a comment, continues a line, or is a trigraph, broken.
    """
    decomposed = unicodedata.normalize("NFKD", re.sub(r"\s+", " ", text))
    letters = "".join(c for c in decomposed if not unicodedata.combining(c))
    plain = re.sub(r"[^ -~]", "?", letters).replace("\\", "/")
    return re.sub(r"/(?=[/*])|\*(?=/)|\?(?=\?)", r"\g<0> ", plain).strip()


def block(text: str, label: str = "") -> str:
    """Return text as lines of a C comment's inside, under a label."""
    first = " * " + ("  " if label else "") + label
    rest = " * " + " " * (len(first) - 3)
    lines = textwrap.wrap(comment(text), WIDTH - len(first)) or [""]
    return "\n".join((rest if k else first) + line for k, line in enumerate(lines)).rstrip()


def prose(text: str) -> str:
    """Return text for Markdown, in which it is no tag, no link and no picture."""
    return html.escape(comment(text), quote=False).replace("](", "] (").replace("][", "] [")


def cell(text: str) -> str:
    """Return text for a table of Markdown."""
    return prose(text).replace("|", "/")


def wrap(text: str) -> str:
    """Break a long list of constants into lines."""
    return ("\n" + 6 * " ").join(textwrap.wrap(text, WIDTH - 8))
