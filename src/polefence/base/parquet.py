"""Parquet in memory, by pyarrow, which is an extra; in this thread alone.

Threads of pyarrow that let go of Python's memory while the interpreter ends abort the process.
"""

from __future__ import annotations

from typing import Any

from polefence.base.errors import InputError, MissingExtraError


def arrow(remedy: str) -> Any:
    """Return pyarrow.

    Raises
    ------
    MissingExtraError
        With the remedy, where it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError(
            f"Parquet needs pyarrow, which is not installed; {remedy}"
        ) from error
    return pyarrow


def read_table(content: bytes, source: str, remedy: str, error: type[InputError]) -> Any:
    """Return the table of a file.

    Raises
    ------
    InputError
        Of the given class, if it is no Parquet.
    """
    pa = arrow(remedy)
    try:
        file = pa.parquet.ParquetFile(pa.BufferReader(content), pre_buffer=False)
        return file.read(use_threads=False)
    except pa.ArrowException as problem:
        raise error(f"{source}: not a Parquet file: {str(problem).splitlines()[0]}") from problem


def table_bytes(table: Any, remedy: str) -> bytes:
    """Return a table as a file."""
    pa = arrow(remedy)
    sink = pa.BufferOutputStream()
    pa.parquet.write_table(table, sink)
    return bytes(sink.getvalue().to_pybytes())
