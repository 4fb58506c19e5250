"""The variables of a MATLAB file: numbers, texts, cells and structures; of others, what they are.

Read here and not by a library, for files come from strangers: every length is looked at before it
is believed, work is counted, and nothing is executed. Objects (strings, tables, systems, symbols)
and function handles hold no numbers that can be read without MATLAB; they are passed over by name.

Sources: "MAT-File Format", The MathWorks, R2019b, chapter 1 (versions 5 to 7) and appendix (4).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.plant.system import Array
from polefence.proof.reading import MAX_ENTRIES

MAX_INFLATED = 64_000_000  # bytes of a file once it is unpacked
MAX_DEPTH, MAX_ELEMENTS = 20, 200_000  # of elements in elements
MI_INT8, MI_MATRIX, MI_COMPRESSED = 1, 14, 15  # types of elements: text, nested, packed
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
NUMBERS |= {13: "u8"}
TEXTS = {1: "latin1", 2: "latin1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
CELL, STRUCTURE, OLD_OBJECT, TEXT, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"}
CLASSES |= {14: "i8", 15: "u8"}
COMPLEX = 0x800  # among the flags of a matrix
OLDER = ("f8", "f4", "i4", "i2", "u2", "u1")  # numbers of version 4


@dataclass(frozen=True)
class Unread:
    """A variable that holds no numbers: ``what`` it is, an object of which class, say."""

    what: str


@dataclass(frozen=True)
class Cells:
    """Values of a cell array, column by column, and its sizes where they are known."""

    values: tuple[Any, ...]
    sizes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Structures:
    """Members of a structure array, each its values by field."""

    members: tuple[dict[str, Any], ...]


class _DamagedError(Exception):
    """The bytes do not say what they should."""


def variables(path: Path, raw: bytes) -> Iterator[tuple[str, Any]]:
    """Yield names and values of a MATLAB file's variables.

    A value is an array, a list of texts (one a row), `Cells`, `Structures` or `Unread`.

    Raises
    ------
    InputError
        If it is no such file, or unpacks to more, or nests deeper, than is read here.
    """
    reader = _Reader(path, "<" if raw[126:128] == b"IM" else ">")
    try:
        if b"\0" in raw[:4]:
            yield from _older(raw)
            return
        if raw[126:128] not in (b"IM", b"MI"):
            raise _DamagedError("it has no header")
        for kind, content in reader.elements(memoryview(raw)[128:]):  # behind the header
            yield from reader.variable(kind, content)
    except _DamagedError as problem:
        raise InputError(f"{path}: no MATLAB file, or a damaged one: {problem}") from problem


class _Reader:
    """What is left of the work that a file may ask for, and the order of its bytes."""

    def __init__(self, path: Path, order: str) -> None:
        self.path, self.order = path, order
        self.left, self.count = MAX_INFLATED, 0
        self.entries = 0  # of all matrices, zeros of sparse ones among them

    def elements(self, raw: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield type and content of the elements that follow one another."""
        at = 0
        while at + 8 <= len(raw):
            self.count += 1
            if self.count > MAX_ELEMENTS:
                raise InputError(f"{self.path}: more than {MAX_ELEMENTS} pieces")
            kind, length = struct.unpack(self.order + "II", raw[at : at + 8])
            if kind >> 16:  # up to four bytes, in the place of the length
                kind, length, begin, step = kind & 0xFFFF, kind >> 16, at + 4, 8
                if length > 4:
                    raise _DamagedError(f"{length} bytes in the place of four")
            else:
                begin = at + 8
                step = 8 + length + (-length % 8 if kind != MI_COMPRESSED else 0)
            if begin + length > len(raw):
                raise _DamagedError(f"{length} bytes are announced, {len(raw) - begin} are there")
            yield kind, raw[begin : begin + length]
            at += step

    def variable(self, kind: int, content: memoryview) -> Iterator[tuple[str, Any]]:
        """Yield a variable; nothing of a workspace, which has no name."""
        if kind == MI_COMPRESSED:
            try:
                content = memoryview(zlib.decompressobj().decompress(content, self.left + 1))
            except zlib.error as problem:
                raise _DamagedError(str(problem)) from problem
            self._take(len(content))
            kind, content = _next(self.elements(content))
        else:
            self._take(len(content))
        if kind != MI_MATRIX:
            raise _DamagedError(f"a variable of type {kind}")
        names: list[str] = []
        try:
            value = self.matrix(content, 0, names)
        except _DamagedError as problem:
            if not names:
                raise
            value = Unread(f"damaged ({problem})")
        if names[0]:
            yield names[0], value

    def _take(self, size: int) -> None:
        self.left -= size
        if self.left < 0:
            raise InputError(f"{self.path}: more than {MAX_INFLATED} bytes once unpacked")

    def matrix(self, content: memoryview, depth: int, name: list[str]) -> Any:
        """Return the value of an element that is one; its name goes where it is asked for."""
        if depth > MAX_DEPTH:
            raise InputError(f"{self.path}: cells in cells, more than {MAX_DEPTH} deep")
        if not content:  # what MATLAB writes for []
            name.append("")
            return np.zeros((0, 0))
        inside = self.elements(content)
        flags = self.numbers(inside)
        kind, marks = int(flags[0]) & 0xFF, int(flags[0])
        if kind == OPAQUE:
            name.append(_text(inside))
            _text(inside)  # MCOS
            return Unread(_object_of(_text(inside)))
        sizes = [int(size) for size in self.numbers(inside)]
        name.append(_text(inside))
        if kind == FUNCTION:
            return Unread("a function handle")
        if kind == OLD_OBJECT:
            return Unread(_object_of(_text(inside)))
        if min(sizes, default=-1) < 0 or len(sizes) < 2:
            raise _DamagedError("no sizes")
        if prod(sizes) > MAX_ENTRIES:
            return Unread(f"larger than {MAX_ENTRIES} entries")
        self.entries += prod(sizes)
        if self.entries > MAX_ENTRIES:
            raise InputError(f"{self.path}: more than {MAX_ENTRIES} entries in all")
        if kind == CELL:
            values = tuple(self._inner(inside, depth) for _ in range(prod(sizes)))
            return Cells(values, tuple(sizes))
        if kind == STRUCTURE:
            return self._structures(inside, prod(sizes), depth)
        if kind == TEXT:
            return self._texts(inside, sizes)
        if kind == SPARSE:
            return self._sparse(inside, sizes, marks)
        if kind in CLASSES:
            return self._array(inside, sizes, CLASSES[kind], marks)
        return Unread(f"a variable of class {kind}")

    def _inner(self, inside: Iterator[tuple[int, memoryview]], depth: int) -> Any:
        kind, content = _next(inside)
        if kind != MI_MATRIX:
            raise _DamagedError(f"a value of type {kind}")
        return self.matrix(content, depth + 1, [])

    def _structures(
        self, inside: Iterator[tuple[int, memoryview]], count: int, depth: int
    ) -> Structures:
        length = int(self.numbers(inside)[0])
        words = bytes(_next(inside)[1])
        if length < 1 or len(words) % length:
            raise _DamagedError("no names of fields")
        names = [
            words[k : k + length].split(b"\0")[0].decode("latin1")
            for k in range(0, len(words), length)
        ]
        if not names:
            return Structures(())
        members = ({name: self._inner(inside, depth) for name in names} for _ in range(count))
        return Structures(tuple(members))

    def _texts(self, inside: Iterator[tuple[int, memoryview]], sizes: list[int]) -> list[str]:
        if not prod(sizes):
            return []
        kind, content = _next(inside)
        code = TEXTS.get(kind)
        if code is None:
            raise _DamagedError(f"text of type {kind}")
        end = {"<": "-le", ">": "-be"}[self.order] if code in ("utf-16", "utf-32") else ""
        text = bytes(content).decode(f"{code}{end}", "replace")
        if len(text) != prod(sizes):
            raise _DamagedError(f"{len(text)} letters in the place of {prod(sizes)}")
        if sizes[0] == 1:
            return [text]
        rows = sizes[0]
        return [text[k::rows].rstrip() for k in range(rows)]

    def _array(
        self, inside: Iterator[tuple[int, memoryview]], sizes: list[int], kind: str, marks: int
    ) -> Array:
        value = self.numbers(inside, prod(sizes)).astype(kind)
        if marks & COMPLEX:
            value = _complex(value, self.numbers(inside, prod(sizes)).astype(kind))
        return value.reshape(sizes, order="F")

    def _sparse(
        self, inside: Iterator[tuple[int, memoryview]], sizes: list[int], marks: int
    ) -> Array:
        """Return it with its zeros."""
        if len(sizes) != 2:
            raise _DamagedError("no sizes")
        rows, columns = sizes
        row = self.numbers(inside, some=True).astype(np.int64)
        begin = self.numbers(inside).astype(np.int64)
        value: Any = self.numbers(inside, some=True).astype("f8")
        if marks & COMPLEX:
            value = _complex(value, self.numbers(inside, len(value)).astype("f8"))
        count = int(begin[-1]) if len(begin) == columns + 1 else -1
        right = 0 <= count <= min(len(row), len(value)) and begin[0] == 0
        if not right or np.any(np.diff(begin) < 0):
            raise _DamagedError("no columns of a sparse matrix")
        row = row[:count]
        if np.any((row < 0) | (row >= rows)):
            raise _DamagedError("no rows of a sparse matrix")
        matrix = np.zeros(sizes, dtype=value.dtype)
        at = row, np.repeat(np.arange(columns), np.diff(begin))
        np.add.at(matrix, at, value[:count])  # as MATLAB adds what stands in one place
        return matrix

    def numbers(
        self,
        inside: Iterator[tuple[int, memoryview]],
        count: int | None = None,
        some: bool = False,
    ) -> np.ndarray[Any, Any]:
        """Return the numbers of the next element, as many as they must be; ``some`` may be none."""
        kind, content = _next(inside)
        if kind not in NUMBERS:
            raise _DamagedError(f"numbers of type {kind}")
        dtype = np.dtype(self.order + NUMBERS[kind])
        if len(content) % dtype.itemsize:
            raise _DamagedError("half a number")
        numbers = np.frombuffer(content, dtype=dtype)
        if len(numbers) != count if count is not None else not (len(numbers) or some):
            raise _DamagedError(f"{len(numbers)} numbers in the place of {count or 1}")
        return numbers


def _complex(real: Array, imaginary: Array) -> Array:
    """Return complex numbers of their parts; infinite ones stay apart."""
    values = np.empty(real.shape, dtype=complex)
    values.real, values.imag = real, imaginary
    return values


def _next(inside: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    element = next(inside, None)
    if element is None:
        raise _DamagedError("it ends too early")
    return element


def _text(inside: Iterator[tuple[int, memoryview]]) -> str:
    kind, content = _next(inside)
    if kind != MI_INT8:
        raise _DamagedError(f"a name of type {kind}")
    return bytes(content).decode("latin1")


def _object_of(kind: str) -> str:
    return f"an object of class {shown(kind[:63])}"  # letters, as MATLAB has them


def _older(raw: bytes) -> Iterator[tuple[str, Any]]:
    """Yield the variables of a file of version 4: a header, a name and numbers each."""
    at = 0
    while at < len(raw):
        order = next((o for o in "<>" if _kind_of(raw, at, o) in (0, 1)), None)
        if order is None or at + 20 > len(raw):
            raise _DamagedError("no header of version 4")
        kind, rows, columns, imaginary, length = struct.unpack(order + "5i", raw[at : at + 20])
        precision, what = kind // 10 % 10, kind % 10
        if precision >= len(OLDER) or what > 2 or min(rows, columns, length - 1) < 0:
            raise _DamagedError("no header of version 4")
        if max(rows, columns, rows * columns) > MAX_ENTRIES:
            raise _DamagedError(f"more than {MAX_ENTRIES} entries")
        dtype = np.dtype(order + OLDER[precision])
        begin = at + 20 + length
        size = rows * columns * dtype.itemsize
        at = begin + size * (2 if imaginary else 1)
        if at > len(raw):
            raise _DamagedError("it ends too early")
        name = raw[begin - length : begin].split(b"\0")[0].decode("latin1")
        value = np.frombuffer(raw[begin : begin + size], dtype).reshape((rows, columns), order="F")
        if imaginary:
            more = np.frombuffer(raw[begin + size : at], dtype)
            value = _complex(value, more.reshape((rows, columns), order="F"))
        if what == 2:
            yield name, Unread("a sparse matrix of MATLAB 4")
        else:
            yield name, value if what == 0 else _rows(value)


def _kind_of(raw: bytes, at: int, order: str) -> int:
    """Return which machine wrote a header of version 4: 0 little end first, 1 big; else not."""
    if at + 4 > len(raw):
        return -1
    (kind,) = struct.unpack(order + "i", raw[at : at + 4])
    machine = {0: "<", 1: ">"}.get(kind // 1000)
    return kind // 1000 if machine == order and kind // 100 % 10 == 0 else -1


def _rows(codes: np.ndarray[Any, Any]) -> list[str]:
    """Return texts of their letters' numbers."""
    inside = np.clip(np.nan_to_num(codes.real), 0, 0x10FFFF).astype(int)
    return ["".join(map(chr, row)).rstrip() for row in inside.tolist()]
