"""Laws that others have designed: compensators, tables of these, gains written in the parameters.

A compensator is a gain of the larger plant that has its states; see `plant.larger.with_states`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, shown
from polefence.base.explained import explained, explained_fields
from polefence.law.control import valid_names
from polefence.law.fields import LETTERS as SYSTEM
from polefence.law.fields import WANTED, matrices_of, place, quotients
from polefence.law.fixed import FixedGain
from polefence.law.law import Law
from polefence.law.laws import given_law
from polefence.law.parametric import Entries, Entry, Term, is_polynomial, quotient_gain
from polefence.law.polynomial import PolynomialGain
from polefence.law.structure import Structure
from polefence.law.table import GainTable
from polefence.law.well_posed import taken_off
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import MOST_GIVEN, law_states, with_states
from polefence.plant.outputs import LATE, Output, split, states
from polefence.plant.parameters import exact
from polefence.plant.system import as_array, floats
from polefence.plant.transfer import (
    LETTERS,
    MOST_ENTRIES,
    Quotient,
    letters_in,
    read_quotient,
    realised,
)
from polefence.plant.weights import measurable
from polefence.proof.functions import FUNCTIONS
from polefence.proof.matrices import ZERO
from polefence.proof.plant import WITHOUT
from polefence.proof.short import Short
from polefence.proof.text import milliseconds_text, plural

_NUMBERED = "u["  # how python-control names inputs that have no name

Rows = tuple[tuple[Entry, ...], ...]


@dataclass(frozen=True, eq=False, repr=False)
class Compensator(Short):
    """x_c' = A x_c + B y, u = C x_c + D y: a law that is given, beside any plant that has y.

    In discrete time x_c(t + T) is in place of x_c'. Without A, B and C it is the gain u = D y.

    Parameters
    ----------
    A, B, C, D : (k, k), (k, r), (m, k) and (m, r) matrices
        D is zero where it is left out. Entries are numbers, or texts of expressions that are
        polynomials in the plant's parameters; of a gain D alone also quotients of polynomials. Of
        (N, ...) matrices of numbers there is one at each vertex of the plant, and their mean with
        the weights alpha between.
    measured : sequence of str, optional
        The plant's signals y. By default all states, or all outputs, whichever are as many as the
        columns of D.
    sample_time : number, optional
        [s]; None in continuous time.
    grid : mapping, optional
        Of a table, the knots of each parameter. The matrices have its axes first, in the order of
        the plant's parameters, and are multi-linear between knots.

    Raises
    ------
    InputError
        If the shapes do not fit together, or an entry is no number.
    """

    A: Any = ()
    B: Any = ()
    C: Any = ()
    D: Any = ()
    measured: Sequence[str] | None = None
    sample_time: Any = None
    grid: Mapping[str, Sequence[Any]] | None = None

    @explained_fields
    def __post_init__(self) -> None:
        if self.measured is not None:
            names = (self.measured,) if isinstance(self.measured, str) else tuple(self.measured)
            if not all(isinstance(name, str) for name in names):
                raise InputError("measured must be names of signals, ['A', 'B']")
            object.__setattr__(self, "measured", names)
        if self.sample_time is not None:
            T = exact(self.sample_time, "sample_time")
            if T <= 0:
                raise InputError(f"sample_time = {shown(self.sample_time)} must be positive [s]")
            object.__setattr__(self, "sample_time", T)
        several = self.grid is not None or any(_depth(getattr(self, x)) > 2 for x in SYSTEM)
        read = _read_several if several else _read_rows
        given = {letter: read(getattr(self, letter), letter) for letter in SYSTEM}
        shapes = {letter: np.shape(M)[-2:] for letter, M in given.items() if len(M)}
        if several:
            given = _of_one_length(given)
        missing = [x for x in "ABC" if x not in shapes and {*"ABC"} & shapes.keys()]
        if missing or not shapes:
            raise InputError(f"{(missing or ['D'])[0]} is missing; {WANTED}")
        if shapes.keys() == {"D"}:
            m, r, k = *shapes["D"], 0
        else:
            k, m, r = shapes["A"][0], shapes["C"][0], shapes["B"][1]
        wanted = {"A": (k, k), "B": (k, r), "C": (m, k), "D": (m, r)}
        for letter, shape in shapes.items():
            if shape != wanted[letter]:
                (a, b), (c, d) = shape, wanted[letter]
                raise InputError(f"{letter} is {a} x {b}; beside the others it must be {c} x {d}")
        if k > MOST_GIVEN:
            raise InputError(
                f"the law has {k} states; at most {MOST_GIVEN} are supported: reduce it, by "
                "balred, say, and look at what is proved of that"
            )
        if "D" not in shapes:
            lead = np.shape(given["C"])[:-2]
            given["D"] = np.zeros((*lead, m, r)) if several else ((ZERO,) * r,) * m
        for letter, matrix in given.items():
            object.__setattr__(self, letter, matrix)

    @classmethod
    @explained
    def from_text(
        cls, text: Any, measured: Sequence[str] | None = None, sample_time: Any = None
    ) -> Compensator:
        """Return the compensator of a transfer function as text, ``"(s + 50)/(s + 500)"``.

        Parameters
        ----------
        text : str, or rows of them
            In s, or in z with a sample time: parsed exactly, never executed. Rows are outputs u,
            columns signals y; numbers may be among them.

        Raises
        ------
        InputError
            If it cannot be read, or is improper.
        """
        rows = _as_rows(text)
        if sum(map(len, rows)) > MOST_ENTRIES:
            raise InputError(f"transfer: more than {MOST_ENTRIES} entries")
        read = [
            [read_quotient(entry, place("transfer", i, j, rows)) for j, entry in enumerate(row)]
            for i, row in enumerate(rows)
        ]
        letters = {letter for row in read for _, letter in row if letter}
        if len(letters) > 1:
            raise InputError("a transfer function in s beside one in z; write all in one letter")
        if letters == {"z"} and sample_time is None:
            raise InputError(
                "a transfer function in z, and no sample time; sample the plant by "
                "polefence.at_sample_time, or give sample_time [s]"
            )
        if letters == {"s"} and sample_time is not None:
            raise InputError(
                "a transfer function in s, and a plant in steps of "
                f"{milliseconds_text(sample_time)} ms; write it in z, by c2d or "
                "scipy.signal.cont2discrete"
            )
        return cls._of([[value for value, _ in row] for row in read], measured, sample_time)

    @classmethod
    @explained
    def from_control(cls, system: Any, measured: Sequence[str] | None = None) -> Compensator:
        """Return a ``StateSpace`` or ``TransferFunction`` of python-control as a law u = K y.

        Parameters
        ----------
        measured : sequence of str, optional
            By default the names of the system's inputs, where it was given some.

        Raises
        ------
        InputError
            If it is neither, or in discrete time without a sample time.
        """
        if getattr(system, "dt", None) is True:
            raise InputError("the law is in discrete time without a sample time; give its dt [s]")
        T = getattr(system, "dt", None) or None
        labels = tuple(getattr(system, "input_labels", ()))
        if measured is None and labels and not all(x.startswith(_NUMBERED) for x in labels):
            measured = labels
        if hasattr(system, "nstates") and hasattr(system, "D"):
            matrices = {letter: getattr(system, letter) for letter in SYSTEM}
            if not system.nstates:
                matrices = {"D": system.D}
            return cls(**matrices, measured=measured, sample_time=T)
        if hasattr(system, "num") and hasattr(system, "den"):
            rows = quotients(system.num, system.den, "transfer")
            return cls._of(rows, measured, T)
        raise InputError(
            f"{type(system).__name__} is no linear system; give a StateSpace or a TransferFunction"
        )

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any], what: str = "") -> Compensator:
        """Return the compensator of plain data: a structure of MATLAB, a table of JSON.

        Parameters
        ----------
        fields : mapping
            ``A``, ``B``, ``C``, ``D``; or ``numerator``, ``denominator``, rows of coefficients, or
            lists of such rows; or ``zeros``, ``poles``, ``gain``. Beside these ``sample_time``,
            ``measured`` and ``grid``. Short names and small letters are known too, others not.
        what : str
            What it is called, for messages.

        Raises
        ------
        InputError
            If something is missing or cannot be read.
        """
        given, rows = matrices_of(fields, what or "the law")
        if rows is None:
            return cls(**given)
        return cls._of(rows, given.get("measured"), given["sample_time"])

    @classmethod
    def _of(
        cls, rows: Sequence[Sequence[Quotient]], measured: Sequence[str] | None, T: Any
    ) -> Compensator:
        A, B, C, D = realised(rows, "transfer")
        names = None if measured is None else tuple(measured)
        if not A:
            return cls(D=D, measured=names, sample_time=T)
        return cls(A, B, C, D, names, T)

    def __repr__(self) -> str:
        m, r = np.shape(self.D)[-2:]
        table = ", a table" if self.grid is not None else ", one a vertex" * self._several
        return f"<Compensator {m} x {r}, order {self.order}{table}>"

    @property
    def order(self) -> int:
        """Number of its states."""
        return int(np.shape(self.A)[-1]) if np.size(self.A) else 0

    @property
    def width(self) -> int:
        """Number of the signals that it measures."""
        return int(np.shape(self.D)[-1])

    @property
    def _several(self) -> bool:
        """Whether it holds matrices at knots, or at vertices."""
        return isinstance(self.D, np.ndarray)

    def negated(self) -> Compensator:
        """Return u = -K y: C and D with the other sign."""
        if self._several:
            return replace(self, C=-self.C if self.order else (), D=-self.D)
        C, D = (tuple(tuple(map(_negative, row)) for row in M) for M in (self.C, self.D))
        return replace(self, C=C, D=D)

    @explained
    def signals(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return what it measures of a plant.

        Raises
        ------
        InputError
            If there is no signal of a name, or it is not clear which are meant.
        """
        r = self.width
        if self.measured is None:
            return _by_count(plant, r, self.order == 0)
        if len(self.measured) != r:
            raise InputError(
                f"{plural(len(self.measured), 'signal')} measured by name, and the law takes {r}; "
                "name one for each column of D"
            )
        known = [*states(plant), *plant.every_output]
        control = dict(zip(valid_names(y.name for y in known), known, strict=True))
        names = {y.name for y in known}
        return tuple(
            control[name] if split(name)[0] not in names and name in control
            else plant.signal(split(name)[0])
            for name in self.measured
        )  # fmt: skip

    @explained
    def beside(self, plant: UncertainPlant) -> tuple[UncertainPlant, Law | GainTable]:
        """Return the plant with the states of the compensator, and the gain that it is of that.

        Raises
        ------
        InputError
            If it does not fit the plant: inputs, signals, sample time, parameters.
        """
        self._require_time(plant)
        m, (rows, _) = plant.shape[1], np.shape(self.D)[-2:]
        if rows != m:
            raise InputError(
                f"the law gives {plural(rows, 'input')} u; {plant.name} has {plural(m, 'input')}"
            )
        signals = self.signals(plant)
        if any(y.D for y in signals):
            return self._of_what_is_left(plant, signals).beside(plant)
        every = [y.name for y in signals] == [x.name for x in states(plant)]
        names = None if every else tuple(y.name for y in signals)
        larger = with_states(plant, self.order)
        measured: tuple[Output, ...] = ()
        if names is not None:
            measured = Structure((*names, *law_states(self.order)), ()).outputs(larger)
        if self.grid is not None:
            table = GainTable(plant.parameters, self.grid, self._of_states(larger, measured))
            return larger, table
        return larger, given_law(larger, self._law(plant, measured))

    def _of_what_is_left(self, plant: UncertainPlant, signals: Sequence[Output]) -> Compensator:
        """Return it as a law of signals without what inputs pass straight into them."""
        if self.grid is not None:
            names = " and ".join(repr(y.name) for y in signals if y.D)
            raise InputError(
                f"a table measures {names}, into which an input passes straight; measure states, "
                "or a sensor with a bandwidth"
            )
        for y in signals:
            if not (y.C or y.F):
                raise InputError(
                    f"measured: an input passes straight into {y.name!r}, and nothing else does; "
                    "measure another signal"
                )
        A, B, C, D = taken_off([getattr(self, key) for key in SYSTEM], plant, signals)
        left = tuple(y.name + WITHOUT * bool(y.D) for y in signals)
        return replace(self, A=A, B=B, C=C, D=D, measured=left)

    def _require_time(self, plant: UncertainPlant) -> None:
        T, theirs = self.sample_time, plant.sample_time
        if theirs == T or not self.order:
            return
        if T is None and theirs is not None:
            raise InputError(
                f"the law is in continuous time, and {plant.name} in steps of "
                f"{milliseconds_text(theirs)} ms; make it discrete by c2d, or "
                "scipy.signal.cont2discrete, and give its sample_time"
            )
        if theirs is None:
            raise InputError(
                f"the law moves every {milliseconds_text(T)} ms, and {plant.name} in continuous "
                f"time; sample the plant by polefence.at_sample_time, every {float(T):g} s"
            )
        if abs(T - theirs) <= theirs / 10**12:  # a float is not the decimal
            return
        raise InputError(
            f"the law moves every {milliseconds_text(T)} ms, and {plant.name} every "
            f"{milliseconds_text(theirs)} ms; give both one sample time, by d2d, say"
        )

    def _law(self, plant: UncertainPlant, measured: tuple[Output, ...]) -> Law:
        if self._several:
            gains = self._gains(plant)
            if gains.ndim != 3 or len(gains) != len(plant.vertices):
                raise InputError(
                    f"the law has {len(gains)} vertices; {plant.name} has {len(plant.vertices)}: "
                    "give one at each, or the knots of a table as grid"
                )
            return PolynomialGain(tuple(map(tuple, np.eye(len(gains), dtype=int))), gains, measured)
        if not self.order:
            reader = Entries(plant)
            values = [
                [reader.value(e, f"D[{i + 1}][{j + 1}]") for j, e in enumerate(row)]
                for i, row in enumerate(self.D)
            ]
            if not all(is_polynomial(value) for row in values for value in row):
                return quotient_gain(plant, values, measured)
        terms = self._terms(plant)
        count = len(plant.parameters) or len(plant.vertices)
        powers = sorted({e for _, _, term in terms for e in term} | {(0,) * count})
        k, (m, r) = self.order, np.shape(self.D)
        gains = np.zeros((len(powers), m + k, r + k))
        for i, j, term in terms:
            for e, value in term.items():
                gains[powers.index(e), i, j] = float(value)
        kept = [index for index, e in enumerate(powers) if np.any(gains[index]) or not any(e)]
        powers, gains = [powers[index] for index in kept], gains[kept]
        if len(powers) == 1 and not measured:
            return FixedGain(gains[0])
        return PolynomialGain(tuple(powers), gains, measured, plant.parameters)

    def _terms(self, plant: UncertainPlant) -> list[tuple[int, int, Term]]:
        """Return row, column and polynomial of every entry of [D, C; B, A], of rates A and B."""
        k, (m, _), T = self.order, np.shape(self.D), plant.sample_time
        r = np.shape(self.D)[1]
        reader = Entries(plant)
        terms = []
        places = {"D": (0, 0), "C": (0, r), "B": (m, 0), "A": (m, r)}
        for letter, (top, left) in places.items():
            for i, row in enumerate(getattr(self, letter)):
                for j, entry in enumerate(row):
                    term = reader.term(entry, f"{letter}[{i + 1}][{j + 1}]")
                    if T is not None and letter in "AB" and k:
                        term = _rate(term, letter == "A" and i == j, T, reader.count)
                    terms.append((top + i, left + j, term))
        return terms

    def _gains(self, larger: UncertainPlant) -> Any:
        """Return [D, C; B, A] of what is measured and its states at every knot, or vertex."""
        k, T = self.order, larger.sample_time
        if not k:
            return self.D
        A, B = self.A, self.B
        if T is not None:
            A, B = (A - np.eye(k)) / float(T), B / float(T)
        left, right = (np.concatenate(M, axis=-2) for M in ([self.D, B], [self.C, A]))
        return np.concatenate([left, right], axis=-1)

    def _of_states(self, larger: UncertainPlant, measured: tuple[Output, ...]) -> Any:
        """Return the gains of all states of the larger plant at every knot."""
        gains = self._gains(larger)
        if not measured:
            return gains
        for y in measured:
            if y.F:
                raise InputError(
                    f"a table measures {y.name!r}, into which a disturbance passes straight; "
                    "measure states, or a sensor with a bandwidth"
                )
            if len(y.C) > 1:
                raise InputError(
                    f"a table measures {y.name!r}, whose row changes with the parameters: beside "
                    "it only signals with constant rows are proved; measure states, or a sensor"
                )
        return gains @ as_array(tuple(y.C[0] for y in measured))


@explained
def beside(plant: UncertainPlant, law: Any) -> tuple[UncertainPlant, Law | GainTable]:
    """Return a law in any form, and the plant with the states that the law has.

    Raises
    ------
    InputError
        If it is none, or does not fit.
    """
    if isinstance(law, GainTable):
        return plant, law
    if isinstance(law, Compensator) or _is_system(law) or has_text(law):
        return as_compensator(plant, law).beside(plant)
    return plant, given_law(plant, law)


def as_compensator(plant: UncertainPlant, law: Any) -> Compensator:
    """Return a compensator of a system of python-control, of texts, or as it is."""
    if isinstance(law, Compensator):
        return law
    if not _is_system(law):
        return written(plant, law)
    own = Compensator.from_control(law)
    if own.measured and not own.order and np.shape(own.D)[1] == plant.shape[0]:
        return replace(own, measured=None)  # a gain of all states, whatever it calls them
    return own


def written(plant: UncertainPlant, data: Any) -> Compensator:
    """Return the compensator of a text, or of rows with texts: in s or z, or in the parameters.

    Raises
    ------
    InputError
        If they cannot be read.
    """
    rows = _as_rows(data)
    names = {p.name for p in plant.parameters}
    found = set[str]().union(*(letters_in(e) for row in rows for e in row if isinstance(e, str)))
    functions = sorted((found - names) & FUNCTIONS.keys())
    if functions:
        raise InputError(
            f"{functions[0]} in the law: gains are polynomials in the parameters, or quotients of "
            "these; give one near to it, or a table at knots as grid"
        )
    strange = sorted(found - names - set(LETTERS))
    if strange:
        raise InputError(
            f"unknown name {shown(strange[0])} in the law; known are the parameters "
            f"({', '.join(sorted(names)) or 'none'}), and s or z of a transfer function"
        )
    if found - names:
        return Compensator.from_text(rows, sample_time=plant.sample_time)
    return Compensator(D=rows)


def has_text(law: Any) -> bool:
    """Whether a law is a text, or rows with texts among their entries."""
    if isinstance(law, str):
        return True
    if not isinstance(law, list | tuple):
        return False
    return any(isinstance(e, str) for row in law if isinstance(row, list | tuple) for e in row)


def _is_system(law: Any) -> bool:
    return hasattr(law, "ninputs") and hasattr(law, "dt")


def _by_count(plant: UncertainPlant, r: int, gain: bool) -> tuple[Output, ...]:
    """Return all states, or all outputs, whichever are r; of a gain states, as u = K x has it."""
    every = states(plant)
    known = measurable(plant)
    own = tuple(x for x in every if x.name in known and not x.name.endswith(LATE))
    choices = [signals for signals in (own, plant.outputs) if len(signals) == r]
    if gain and len(every) == r:
        return every
    if len(choices) == 1:
        return choices[0]
    there = "both have" if choices else "neither has"
    names = ", ".join(y.name for y in (*own, *plant.outputs)[:12])
    raise InputError(
        f"the law measures {plural(r, 'signal')}; {plant.name} has {plural(len(own), 'state')} and "
        f"{plural(len(plant.outputs), 'output')}: {there} as many; name what it measures by "
        f"measured=['A', 'B'], of: {names}"
    )


def _rate(term: Term, diagonal: bool, T: Fraction, count: int) -> Term:
    """Return an entry of (A - I) / T or B / T."""
    zero = (0,) * count
    if diagonal:
        term = term | {zero: term.get(zero, ZERO) - 1}
    return {e: value / T for e, value in term.items() if value}


def _negative(entry: Entry) -> Entry:
    return f"-({entry})" if isinstance(entry, str) else -entry


def _read_rows(value: Any, letter: str) -> Rows:
    rows = _as_rows(value)
    widths = {len(row) for row in rows}
    if len(widths) > 1:
        raise InputError(f"{letter} is ragged: rows of {' and '.join(map(str, sorted(widths)))}")
    return tuple(
        tuple(_entry(e, f"{letter}[{i + 1}][{j + 1}]") for j, e in enumerate(row))
        for i, row in enumerate(rows)
    )


def _read_several(value: Any, letter: str) -> Any:
    if not np.size(np.asarray(value, dtype=object)):
        return ()
    array = floats(value, letter)
    if array.ndim < 2 or not np.all(np.isfinite(array)):
        raise InputError(f"{letter} must be finite matrices, one at every knot or vertex")
    return array


def _of_one_length(given: dict[str, Any]) -> dict[str, Any]:
    """Return matrices at the same knots or vertices; one alone is the same at all."""
    leads = {np.shape(M)[:-2] for M in given.values() if len(M) and np.ndim(M) > 2}
    if len(leads) > 1:
        told = " and ".join(" x ".join(map(str, lead)) for lead in sorted(leads))
        raise InputError(f"A, B, C and D are of different numbers of knots or vertices: {told}")
    lead = next(iter(leads), ())
    return {
        x: np.broadcast_to(M, (*lead, *np.shape(M)[-2:])) if len(M) else M for x, M in given.items()
    }


def _depth(value: Any) -> int:
    """Return how deep lists or arrays are nested."""
    if isinstance(value, list | tuple):
        return 1 + (_depth(value[0]) if value else 0)
    return int(np.ndim(value))


def _entry(value: Any, what: str) -> Entry:
    if isinstance(value, str):
        try:
            return exact(value, what)
        except PlantError:
            return value
    return exact(value.item() if isinstance(value, np.generic) else value, what)


def _as_rows(value: Any) -> list[list[Any]]:
    """Return rows of entries; one number or text is one row of one."""
    if isinstance(value, str):
        return [[value]]
    array = value if isinstance(value, list | tuple) else np.asarray(value).tolist()
    if not isinstance(array, list | tuple):
        return [[array]]
    rows = [list(row) if isinstance(row, list | tuple | np.ndarray) else [row] for row in array]
    if array and not any(isinstance(row, list | tuple | np.ndarray) for row in array):
        return [list(array)]
    return [row for row in rows if row]
