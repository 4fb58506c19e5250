"""Read matrices and plants from files of other tools: MATLAB, NumPy, JSON and CSV."""

from __future__ import annotations

import io
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained
from polefence.base.files import read_bytes
from polefence.plant import matlab, matlab73
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, split
from polefence.plant.system import Exact, read_matrix
from polefence.proof import reading
from polefence.proof.reading import MAX_ENTRIES
from polefence.proof.short import Short
from polefence.proof.text import plural
from polefence.proof.work import FormatError

WANTED = "name a .mat, .npz, .npy, .json or .csv file, or a folder of .csv files"
_NUMBERED = re.compile(r"(.*?[A-Za-z])_?([1-9][0-9]{0,2})")
NO_NAMES: Mapping[str, str] = MappingProxyType({})
HDF5 = b"\x89HDF\r\n\x1a\n"  # behind the first 512 bytes
_BETWEEN = re.compile(r"[,;\t]| +")

Matrix = list[list[Any]]  # of floats, whole numbers, rationals, or texts of these


@dataclass(frozen=True, eq=False)
class Arrays(Short):
    """What a file holds.

    Attributes
    ----------
    place : str
        Path of the file, for messages.
    matrices : dict of name to matrices
        One matrix, or one per vertex.
    words : dict of name to texts
    names : dict of name to name
        The file's own names for some of them.
    faults : dict of name to text
        Why other variables of the file are not matrices; raised when one is asked for.
    objects : dict of name to text
        Variables among these that hold no numbers, and their type.
    structures : dict of name to fields
        Structures and tables as they are: nested lists, arrays and texts by their names.
    """

    place: str
    matrices: Mapping[str, list[Matrix]]
    words: Mapping[str, list[str]] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    faults: Mapping[str, str] = field(default_factory=dict)
    objects: Mapping[str, str] = field(default_factory=dict)
    structures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        """Whether a name is known; `__getitem__` may still raise why it is no matrix."""
        return name in self.matrices or name in self.names or name in self.faults

    def __getitem__(self, name: str) -> list[Exact]:
        """Return the matrices of a name, in exact rationals.

        Raises
        ------
        InputError
            If there are none, one is not a matrix of finite numbers, or shapes differ.
        """
        if name not in self.matrices:
            called, known = self.names.get(name, name), sorted(self.matrices)
            if called in self.faults:
                raise InputError(self.faults[called])
            if self.systems and name in ("A", "B", "K"):
                raise InputError(self.faults[self.systems[0]])
            others = "; ".join(f"{own} is {what}" for own, what in [*self.objects.items()][:4])
            raise InputError(
                f"{self.place}: no matrix {shown(called)}; {suggest(called, known)}"
                + (f"; not read: {others}" if others else "")
            )
        given = self.matrices[name]
        try:
            exact = [
                read_matrix(matrix, name if len(given) == 1 else f"{name}, matrix {k + 1}")
                for k, matrix in enumerate(given)
            ]
        except InputError as problem:
            raise InputError(f"{self.place}: {problem}") from problem
        shapes = sorted({(len(matrix), len(matrix[0])) for matrix in exact})
        if len(shapes) != 1:
            told = " and ".join(f"{n} x {m}" for n, m in shapes) or "none"
            raise InputError(f"{self.place}: {name} holds matrices of different shapes: {told}")
        return exact

    @property
    def systems(self) -> tuple[str, ...]:
        """Names of those objects that are linear systems."""
        return tuple(name for name, what in self.objects.items() if _is_system(what))

    def one(self, name: str) -> Exact:
        """Return the matrix of a name.

        Raises
        ------
        InputError
            If there is none, or more than one.
        """
        matrices = self[name]
        if len(matrices) > 1:
            raise InputError(f"{self.place}: {name} holds {len(matrices)} matrices, not one")
        return matrices[0]

    def listed(self, names: Iterable[str]) -> list[str]:
        """List those names that the file has, with its own name and the number of vertices."""
        texts = []
        for name in names:
            if name in self.matrices:
                original, count = self.names.get(name, name), len(self.matrices[name])
                called = name if original == name else f"{name} (called {shown(original)})"
                texts.append(called if count == 1 else f"{called} of {count} vertices")
        return texts

    def holds(self, name: str) -> bool:
        """Whether a name is there and no object: objects under an optional name are ignored."""
        return name in self and self.names.get(name, name) not in self.objects

    def left_out(self, names: Iterable[str]) -> list[str]:
        """List those of these names that the file has as objects, with their types."""
        called = {name: self.names.get(name, name) for name in names}
        return [
            f"{name} ({self.objects[original]})"
            for name, original in called.items()
            if original in self.objects
        ]

    def only(self, name: str) -> list[Exact]:
        """Return the matrices of a name, or the only matrices of the file.

        Raises
        ------
        InputError
            If the file has several names, and not this one.
        """
        every = list(self.matrices)
        return self[every[0] if name not in self and len(every) == 1 else name]


@explained
def read_arrays(path: str | Path, names: Mapping[str, str] = NO_NAMES) -> Arrays:
    """Read the matrices of a file, or of the CSV files of a folder.

    There may be one matrix per vertex: in MATLAB (n, n, N), a cell array, or ``A1`` to ``AN``;
    in NumPy (N, n, n); in JSON a list of matrices; in CSV one file per matrix. A field of a
    structure array is read as one matrix per element, under the field's name if no variable has
    that name.

    Parameters
    ----------
    names : mapping, optional
        The file's own names for some of them, {new: old}.

    Raises
    ------
    InputError
        If the file cannot be read, is too long, or is not of these kinds.
    """
    arrays = _read_arrays(Path(path))
    matrices = arrays.matrices
    more = {new: matrices[old] for new, old in names.items() if old in matrices}
    rest = {name: value for name, value in matrices.items() if name not in names}
    return replace(arrays, matrices=rest | more, names=names)


def _read_arrays(path: Path) -> Arrays:
    if path.is_dir():
        files = sorted(path.glob("*.csv"))
        if not files or len(files) > 2_000:
            raise InputError(f"{path}: a folder of {len(files)} .csv files; {WANTED}")
        tables = {file.stem: [_csv(file, _read(file))] for file in files}
        return _with_series(Arrays(str(path), tables))
    kind = path.suffix.lower()
    if kind not in (".mat", ".npz", ".npy", ".json", ".csv"):
        raise InputError(f"{path}: not read here; {WANTED}")
    raw = _read(path)
    if kind == ".csv":
        return Arrays(str(path), {path.stem: [_csv(path, raw)]})
    read: Callable[[Path, bytes], Iterable[tuple[str, Any]]]
    read = {".mat": _mat, ".npz": _npz, ".npy": _one_npy, ".json": _json}[kind]
    matrices, words, faults = dict[str, list[Matrix]](), dict[str, list[str]](), dict[str, str]()
    objects, count = dict[str, str](), 0
    structures = dict[str, Mapping[str, Any]]()
    for name, value in read(path, raw):
        if isinstance(value, dict):
            structures[name] = value
            continue
        if isinstance(value, _ObjectError):
            objects[name] = value.what
        if isinstance(value, InputError):
            faults[name] = str(value)
            continue
        if isinstance(value, str) or (value and isinstance(value[0], str)):
            words[name] = [value] if isinstance(value, str) else value
            continue
        matrices[name] = value
        count += sum(len(row) for matrix in value for row in matrix)
        if count > MAX_ENTRIES:
            raise InputError(f"{path}: more than {MAX_ENTRIES} numbers; {WANTED}")
    read_so = Arrays(str(path), matrices, words, {}, faults, objects, structures)
    return _with_series(read_so)


def _read(path: Path) -> bytes:
    return read_bytes(path, reading.MAX_BYTES, InputError)


def _with_series(arrays: Arrays) -> Arrays:
    """Join A1, A2, ..., AN to A where there is no A."""
    series = dict[str, dict[int, Matrix]]()
    for name, matrices in arrays.matrices.items():
        match = _NUMBERED.fullmatch(name)
        if match and len(matrices) == 1:
            series.setdefault(match[1], {})[int(match[2])] = matrices[0]
    more, faults = dict(arrays.matrices), dict(arrays.faults)
    for name, numbered in series.items():
        missing = next((k for k in range(1, max(numbered) + 1) if k not in numbered), None)
        if name in arrays:
            continue
        if missing is None:
            more[name] = [numbered[k] for k in sorted(numbered)]
        else:
            there = f"{name}{max(numbered)} is there, {name}{missing} is missing"
            faults[name] = f"{arrays.place}: {there}; {name}1, {name}2, ... are one a vertex"
    return replace(arrays, matrices=more, faults=faults)


def _csv(path: Path, raw: bytes) -> Matrix:
    """Read one matrix, a row per line, with commas, semicolons, tabs or spaces between numbers."""
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise InputError(f"{path}: not UTF-8 text") from problem
    rows, count = list[list[Any]](), 0
    for number, line in enumerate(text.splitlines(), 1):
        line = re.split("[#%]", line, maxsplit=1)[0].strip()
        if not line:
            continue
        words = [word.strip() for word in _BETWEEN.split(line) if word.strip()]
        try:
            rows.append([float(word) for word in words])
        except ValueError as problem:
            raise InputError(f"{path}: line {number}: {shown(line)} are not numbers") from problem
        count += len(words)
        if count > MAX_ENTRIES:
            raise InputError(f"{path}: more than {MAX_ENTRIES} numbers")
    if not rows:
        raise InputError(f"{path}: holds no number")
    return rows


def _json(path: Path, raw: bytes) -> Iterator[tuple[str, Any]]:
    try:
        document = reading.parse(raw.decode("utf-8-sig"))
    except (UnicodeDecodeError, FormatError) as problem:
        raise InputError(f"{path}: {problem}") from problem
    if isinstance(document, list):
        document = {path.stem: document}
    if not isinstance(document, dict):
        raise InputError(f'{path}: must be a table of matrices, {{"A": [[...]], ...}}')
    for name, value in document.items():
        if isinstance(value, str | dict):
            yield name, value
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, [[[value]]]
        elif isinstance(value, list) and value and isinstance(value[0], str):
            yield name, [str(word) for word in value]
        elif isinstance(value, list) and value and isinstance(value[0], list) and value[0]:
            yield name, value if isinstance(value[0][0], list) else [value]


def _npz(path: Path, raw: bytes) -> Iterator[tuple[str, Any]]:
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
            if size > matlab.MAX_INFLATED:
                raise InputError(f"{path}: more than {matlab.MAX_INFLATED} bytes once unpacked")
            for entry in archive.namelist():
                name = entry.removesuffix(".npy")
                value = _npy(f"{path}: {name}", archive.read(entry))
                yield name, _or_fault(_array, f"{path}: {name}", value, True)
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, zlib.error) as problem:
        raise InputError(f"{path}: not an .npz file of plain arrays: {problem}") from problem


def _one_npy(path: Path, raw: bytes) -> Iterator[tuple[str, Any]]:
    yield path.stem, _array(str(path), _npy(str(path), raw), True)


def _npy(where: str, raw: bytes) -> Any:
    """Read an array of NumPy's own format, no larger than its bytes."""
    form, stream = np.lib.format, io.BytesIO(raw)
    try:
        version = form.read_magic(stream)
        header = form.read_array_header_1_0 if version == (1, 0) else form.read_array_header_2_0
        shape, _, kind = header(stream)
        if math.prod(shape) * kind.itemsize > len(raw):
            raise ValueError(f"its header says {' x '.join(map(str, shape))} entries")
        stream.seek(0)
        return form.read_array(stream, allow_pickle=False)
    except (ValueError, EOFError) as problem:
        text = " ".join(str(problem).split())
        raise InputError(f"{where}: not a plain array of NumPy: {shown(text)}") from problem


class _ObjectError(InputError):
    """A variable of MATLAB is no matrix: an object, a function handle."""

    def __init__(self, where: str, what: str) -> None:
        self.what = what
        name = where.rpartition(": ")[2]
        remedy = "only matrices of numbers are read: save it as one, under this name"
        if _is_system(what):
            own = "c" if name[0] in "CK" else ""  # of a law, or of a plant
            letters = [f"{letter}{own}" for letter in "ABCD"]
            saved = ", ".join(f"'{letter}'" for letter in letters)
            remedy = (
                "only MATLAB reads that; there type "
                f"[{', '.join(letters)}] = ssdata(ss({name})); save('{name}.mat', {saved}, '-v7')"
            )
        super().__init__(f"{where} is {what}; {remedy}")


_SYSTEMS = ("ss", "tf", "zpk", "pid", "pidstd", "genss", "idss", "idtf", "idpoly", "idproc")


def _is_system(what: str) -> bool:
    """Whether an object of MATLAB is a linear system."""
    return what.removeprefix("an object of class ").strip("'") in _SYSTEMS


def _or_fault(read: Callable[..., Any], *given: Any) -> Any:
    """Return the value, or the fault: it is raised only if this variable is asked for."""
    try:
        return read(*given)
    except InputError as problem:
        return problem


def _array(where: str, value: Any, first: bool) -> Any:
    """Return an array's matrices, with the vertices on its first or last axis, or its texts."""
    value = np.asarray(value)
    if value.dtype.kind in "US":
        return [str(word) for word in value.ravel()]
    if value.dtype.kind == "c":
        if np.any(value.imag):
            raise InputError(f"{where} has complex entries")
        value = value.real
    if value.dtype.kind not in "biuf" or value.ndim > 3:
        raise InputError(f"{where} is neither a matrix nor a list of matrices")
    value = np.atleast_2d(value)
    if not value.size:
        raise InputError(f"{where} is empty")
    if value.ndim == 2:
        return [value.tolist()]
    return (value if first else np.moveaxis(value, 2, 0)).tolist()


# Fields of a structure that is a system; linmod of Simulink has small letters.
_SYSTEM = (frozenset("ABC"), frozenset("abcd"))


def _mat(path: Path, raw: bytes) -> Iterator[tuple[str, Any]]:
    given, structures = dict[str, Any](), dict[str, tuple[dict[str, Any], ...]]()
    fields = dict[str, list[Any]]()
    new = raw.startswith(b"MATLAB 7.3") or raw[512:520] == HDF5
    for name, value in (matlab73 if new else matlab).variables(path, raw):
        members = _members(value)
        if len(members) == 1:
            yield name, _plain(members[0])
        if members:
            structures[name] = members
        else:
            given[name] = value
    systems = {
        name: named
        for name, members in structures.items()
        for named in _SYSTEM
        if named <= members[0].keys()
    }
    laws = systems if "A" in given else {"K"} if len(systems) > 1 else ()  # beside their plant
    for name, members in structures.items():
        for own in () if name in systems and name in laws else members[0]:
            key, values = own, [member[own] for member in members]
            value = values[0] if len(values) == 1 else matlab.Cells(tuple(values))
            if name in systems:
                key = _key_of(key, value, systems[name])
            fields.setdefault(key, []).append(value)
    for key, lists in fields.items():
        if len(lists) == 1 and key not in given:
            given[key] = lists[0]
    for name, value in given.items():
        matrices = _or_fault(_of_matlab, f"{path}: {name}", value)
        if matrices is not None:
            yield name, matrices


def _key_of(key: str, value: Any, letters: frozenset[str]) -> str:
    """Return what a field of a system is called here: of linmod A for a; Ts of a discrete one."""
    if key == "Ts" and isinstance(value, np.ndarray) and value.size == 1 and value.item() > 0:
        return "sample_time"
    return key.upper() if key in letters else key


def _plain(value: Any) -> Any:
    """Return a value of MATLAB as nested lists and tables; objects by what they are."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, matlab.Structures):
        members = [_plain(member) for member in value.members]
        return members[0] if len(members) == 1 else members
    if isinstance(value, matlab.Cells):
        cells = [_plain(entry) for entry in value.values]
        rows = value.sizes[0] if len(value.sizes) == 2 and value.sizes[0] > 0 else 1
        return [cells[i::rows] for i in range(rows)]
    if isinstance(value, list):
        return value[0] if len(value) == 1 else value
    if isinstance(value, np.ndarray) and value.ndim == 3:
        return np.moveaxis(value, 2, 0)  # one matrix a vertex
    return None if isinstance(value, matlab.Unread) else value


def _members(value: Any) -> tuple[dict[str, Any], ...]:
    """Return the members of a structure array, or of cells with one structure in every cell."""
    if isinstance(value, matlab.Structures):
        return value.members
    if not isinstance(value, matlab.Cells):
        return ()
    alone = [cell.members for cell in value.values if isinstance(cell, matlab.Structures)]
    if len(alone) < len(value.values) or any(len(structures) != 1 for structures in alone):
        return ()
    members = tuple(structures[0] for structures in alone)
    return members if len({tuple(member) for member in members}) == 1 else ()


def _of_matlab(where: str, value: Any) -> Any:
    """Return the matrices or texts of a variable; None if it holds neither."""
    if isinstance(value, matlab.Unread):
        raise _ObjectError(where, value.what)
    if isinstance(value, list):
        return value[0] if len(value) == 1 else value or None
    if isinstance(value, np.ndarray):
        return _array(where, value, first=False) if value.size else None
    if not isinstance(value, matlab.Cells) or not value.values:
        return None
    if any(isinstance(member, matlab.Cells) for member in value.values):
        return None
    members = [_of_matlab(where, member) for member in value.values]
    if all(isinstance(member, str) for member in members):
        return members
    if all(isinstance(member, list) and len(member) == 1 for member in members):
        return [member[0] for member in members]
    return None


@explained
def plant_from(arrays: Arrays, name: str = "") -> UncertainPlant:
    """Return the family with the vertices A, B and, where the file has them, E, C, D and F.

    Rows of C, D and F are outputs. Texts ``states``, ``inputs``, ``disturbances``, ``outputs`` and
    ``name`` name them, ``sample_time`` makes the plant discrete [s]. Without a B the
    matrices A are closed loops.

    Raises
    ------
    InputError
        If A is missing, or the matrices do not fit together.
    """
    A = arrays["A"]
    n = len(A[0])
    B = arrays["B"] if "B" in arrays else [np.eye(n, dtype=int).tolist()]
    E = arrays["E"] if arrays.holds("E") else None
    N = max(len(matrices) for matrices in (A, B, E or A))
    words = {key: tuple(arrays.words.get(key, ())) for key in ("states", "inputs", "disturbances")}
    label = name or next(iter(arrays.words.get("name", ())), "") or Path(arrays.place).stem
    seconds = arrays.one("sample_time")[0][0] if "sample_time" in arrays else None
    try:
        plant = UncertainPlant.from_vertices(
            _each(A, N), _each(B, N), None if E is None else _each(E, N), name=label, **words,
            sample_time=seconds,
        )  # fmt: skip
        return replace(plant, outputs=tuple(_outputs(plant, arrays)))
    except InputError as problem:
        raise type(problem)(f"{arrays.place}: {problem}") from problem


def _each(matrices: list[Any], N: int) -> list[Any]:
    """Repeat a matrix that is the same at all vertices."""
    return matrices * N if len(matrices) == 1 else matrices


def _rows(arrays: Arrays) -> dict[str, list[Exact]]:
    """Return C, D and F; a D or F of zeros says nothing, whatever its shape: often it is one 0."""
    given = {key: arrays[key] for key in "CDF" if arrays.holds(key)}
    zero = [key for key in given if not any(x for M in given[key] for row in M for x in row)]
    return {key: M for key, M in given.items() if key == "C" or key not in zero}


def misfit(arrays: Arrays) -> str:
    """Return why C, D and F of a file are no rows of outputs of its plant; "" where they are."""
    n = len(arrays["A"][0])
    m = len(arrays["B"][0][0]) if "B" in arrays else n
    q = len(arrays["E"][0][0]) if arrays.holds("E") else 0
    given = _rows(arrays)
    for key, width, what in (("C", n, "state"), ("D", m, "input"), ("F", q, "disturbance")):
        columns = len(given[key][0][0]) if key in given else width
        if columns != width:
            return f"{key} has {plural(columns, 'column')}, and the plant {plural(width, what)}"
    return ""


def _outputs(plant: UncertainPlant, arrays: Arrays) -> Iterator[Output]:
    """Yield the rows of C, D and F as outputs."""
    given = _rows(arrays)
    if misfit(arrays):
        return
    counts = {len(matrices[0]) for matrices in given.values()}
    if len(counts) > 1:
        raise InputError(f"{', '.join(given)} must have as many rows each, one an output")
    count = max(counts, default=0)
    labels = arrays.words.get("outputs", ()) or [f"y{i + 1}" for i in range(count)]
    if len(labels) != count:
        raise InputError(f"outputs names {len(labels)} signals; C has {count} rows")
    known = {signal.name for signal in plant.signals}
    for i, label in enumerate(labels):
        output, unit = split(label)
        if output not in known:
            blocks: dict[str, Any] = {key: [M[i] for M in rows] for key, rows in given.items()}
            yield Output(output, unit, **blocks)
