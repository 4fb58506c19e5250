"""The variables of a MATLAB file of version 7.3, which is HDF5; needs ``polefence[mat73]``.

Files come from strangers: what lies in other files is not followed, every size is looked at before
it is read, and nothing is executed.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, MissingExtraError, shown
from polefence.plant.matlab import MAX_DEPTH, MAX_ELEMENTS, Cells, Structures, Unread
from polefence.proof.reading import MAX_ENTRIES

# What h5py raises at damaged files.
FAULTS = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, OverflowError)
WIDEST = 16  # bytes of a number
KINDS = ("double", "single", "logical", *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)))


def variables(path: Path, raw: bytes) -> Iterator[tuple[str, Any]]:
    """Yield names and values of a file's variables, as `matlab.variables` does.

    Raises
    ------
    InputError
        If it is damaged, or holds more than is read here.
    MissingExtraError
        If h5py is not installed.
    """
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError(
            f"{path}: MATLAB 7.3 files are HDF5: pip install 'polefence[mat73]', or in MATLAB "
            f"save({path.name!r}, 'A', 'B', 'K', '-v7')"
        ) from error
    try:
        with h5py.File(io.BytesIO(raw), "r") as file:
            yield from _Reader(path, h5py).top(file)
    except InputError:
        raise
    except FAULTS as problem:
        text = " ".join(str(problem).split())
        raise InputError(
            f"{path}: no MATLAB 7.3 file, or a damaged one: {shown(text)}; save it again, by '-v7'"
        ) from problem


class _Reader:
    """What is left of the work that a file may ask for."""

    def __init__(self, path: Path, h5py: Any) -> None:
        self.path, self.h5py = path, h5py
        self.count = self.entries = 0

    def top(self, file: Any) -> Iterator[tuple[str, Any]]:
        """Yield the variables; what MATLAB keeps aside begins with #."""
        for name in file:
            if not name.startswith("#"):
                yield name, self.member(file, name, 0)

    def member(self, group: Any, name: str, depth: int) -> Any:
        """Return what a group has under a name, in this file."""
        if not isinstance(group.get(name, getlink=True), self.h5py.HardLink):
            return Unread("a link to elsewhere")
        return self.value(group[name], depth)

    def value(self, node: Any, depth: int) -> Any:
        """Return the value of a group or an array."""
        self.count += 1
        if self.count > MAX_ELEMENTS or depth > MAX_DEPTH:
            raise InputError(f"{self.path}: more pieces, or deeper ones, than are read here")
        kind = _text(node.attrs.get("MATLAB_class", b""))
        if "MATLAB_object_decode" in node.attrs:
            if kind == "function_handle":
                return Unread("a function handle")
            return Unread(f"an object of class {shown(kind[:63])}")
        if isinstance(node, self.h5py.Group):
            if "MATLAB_sparse" in node.attrs:
                return self.sparse(node)
            return self.structures(node, depth)
        if node.attrs.get("MATLAB_empty", 0):
            return [] if kind == "char" else Cells(()) if kind == "cell" else np.zeros((0, 0))
        if node.dtype == self.h5py.ref_dtype:
            sizes = tuple(reversed(node.shape))
            if node.size > MAX_ELEMENTS:
                return Unread(f"larger than {MAX_ELEMENTS} cells")
            inside = (self.value(node.file[ref], depth + 1) for ref in self.array(node).ravel())
            return Cells(tuple(inside), sizes)
        if kind == "char":
            return _rows(self.array(node))
        if kind in KINDS or (not kind and node.dtype.kind in "fiu"):
            numbers = self.array(node)
            if numbers.dtype.names:
                numbers = _complex(numbers)
            return numbers.T
        return Unread(f"an object of class {shown(kind[:63])}" if kind else "no array of MATLAB")

    def array(self, node: Any) -> Any:
        """Return the numbers of an array, as HDF5 has them: MATLAB's axes the other way round."""
        if node.external or node.is_virtual:
            raise InputError(f"{self.path}: {node.name} lies in another file; save it in this one")
        self._take(prod(node.shape))
        if node.dtype.itemsize > WIDEST:
            raise ValueError(f"{node.name} holds no numbers")
        return np.asarray(node[()])

    def _take(self, entries: int) -> None:
        self.entries += entries
        if self.entries > MAX_ENTRIES:
            raise InputError(f"{self.path}: more than {MAX_ENTRIES} entries in all")

    def structures(self, node: Any, depth: int) -> Any:
        """Return a structure; of an array of them every field holds references."""
        names = list(node)
        fields = {name: self.member(node, name, depth + 1) for name in names}
        several = {
            len(value.values)
            for name, value in fields.items()
            if isinstance(value, Cells) and "MATLAB_class" not in node[name].attrs
        }
        if len(several) != 1 or not all(isinstance(value, Cells) for value in fields.values()):
            return Structures((fields,))
        (count,) = several
        members = ({name: fields[name].values[k] for name in names} for k in range(count))
        return Structures(tuple(members))

    def sparse(self, node: Any) -> Any:
        """Return a sparse matrix with its zeros."""
        rows = int(node.attrs["MATLAB_sparse"])
        begin = self.array(node["jc"]).astype(np.int64).ravel()
        columns = len(begin) - 1
        self._take(rows * columns)
        matrix = np.zeros((rows, columns))
        if "data" not in node:
            return matrix
        values, row = (self.array(node[key]).ravel() for key in ("data", "ir"))
        if values.dtype.names:
            values = _complex(values)
            matrix = matrix.astype(complex)
        if begin[0] or np.any(np.diff(begin) < 0) or not begin[-1] == len(values) == len(row):
            raise ValueError("no columns of a sparse matrix")
        column = np.repeat(np.arange(columns), np.diff(begin))
        np.add.at(matrix, (row.astype(np.int64), column), values)
        return matrix


def _text(value: Any) -> str:
    return value.decode("latin1") if isinstance(value, bytes) else str(value)


def _complex(pairs: Any) -> Any:
    values = np.empty(pairs.shape, dtype=complex)
    values.real, values.imag = pairs["real"], pairs["imag"]
    return values


def _rows(codes: Any) -> list[str]:
    """Return texts of their letters' numbers, a row each."""
    return ["".join(map(chr, row)).rstrip() for row in np.atleast_2d(codes.T).astype(int).tolist()]
