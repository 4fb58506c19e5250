"""Variants of specs: what they change and nothing else, as many as were asked for, all decimals."""

import re
from fractions import Fraction

import numpy as np
import pytest

from polefence import SpecError
from polefence.fleet.variants import MOST, read_variants
from polefence.plant.expression import decimal, decimal_text

KNOWN = {name: Fraction(1) for name in ("a", "b", "c.low", "c.high")}


def test_grids_lists_and_random_ones_multiply(tmp_path):
    (tmp_path / "v.csv").write_text('label,b\nsmall,0.1\n"large, heavy",\n')
    random = {"count": 7, "seed": 3, "of": {"c.low": [-1, 1], "c.high": [10, Fraction("20.5")]}}
    table = {"grid": {"a": [1, Fraction("2.5")]}, "list": "v.csv", "random": random}
    found = read_variants(table, tmp_path, KNOWN)
    assert found.names == ("a", "b", "c.low", "c.high")
    assert len(found) == 2 * 2 * 7
    assert found.values(0)["b"] == Fraction("0.1")
    assert "b" not in found.values(7)  # its cell is empty: as in the base
    assert [found.label(k) for k in (0, 7)] == ["small", "large, heavy"]
    assert found.rows == read_variants(table, tmp_path, KNOWN).rows
    other = read_variants(table | {"random": random | {"seed": 4}}, tmp_path, KNOWN)
    assert found.rows != other.rows


@pytest.mark.parametrize("by", ["latin hypercube", "uniform"])
def test_a_latin_hypercube_has_one_in_each_slice(by, tmp_path):
    random = {"count": 40, "of": {"a": [2, 6], "b": [0, 1]}, "by": by}
    found = read_variants({"random": random}, tmp_path, KNOWN)
    values = np.array([[float(x) for x in row] for row in found.rows])
    shares = (values - [2, 0]) / [4, 1]
    assert shares.min() >= 0
    assert shares.max() <= 1
    slices = [sorted((own * 40).astype(int)) for own in shares.T]
    assert (slices == [list(range(40))] * 2) == (by == "latin hypercube")
    for row in found.rows:
        for value in row:
            assert decimal(decimal_text(value)) == value


def test_parquet_lists_are_read_like_csv(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    table = pyarrow.table({"label": ["x", "y"], "a": [0.1, None], "b": [3, 4]})
    parquet.write_table(table, tmp_path / "v.parquet")
    (tmp_path / "v.csv").write_text("label,a,b\nx,0.1,3\ny,,4\n")
    one, two = (read_variants({"list": f"v.{end}"}, tmp_path, KNOWN) for end in ("parquet", "csv"))
    assert (one.names, one.rows, one.labels) == (two.names, two.rows, two.labels)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (None, "variants must be a table with grid, list or random"),
        ({}, "variants must be a table"),
        ({"grids": {}}, "variants: unknown key 'grids'"),
        ({"grid": {"a": []}}, "variants.grid.a must be a list of numbers"),
        ({"grid": {"a": ["1"]}}, "variants.grid.a: '1' must be a finite number"),
        ({"grid": {"q": [1]}}, "variants: the base has no number 'q'"),
        ({"grid": {"a": [1] * 1001, "b": [1] * 1001}}, f"a study has at most {MOST}"),
        ({"grid": {"a": [1]}, "random": {"count": 2, "of": {"a": [1, 2]}}}, "'a' varies twice"),
        ({"random": {"count": 10**9, "of": {"a": [1, 2]}}}, "variants: 1000000000 of them"),
        ({"random": {"count": 0, "of": {"a": [1, 2]}}}, "a list is empty"),
        ({"random": {"count": 2, "of": {"a": [2, 1]}}}, "a: 2 must be below 1"),
        ({"random": {"count": 2, "of": {"a": [2]}}}, "of.a must be [LOW, HIGH]"),
        ({"random": {"count": -1, "of": {"a": [1, 2]}}}, "count = -1 must be a whole number"),
        ({"random": {"count": 1}}, "of is missing"),
        ({"random": {"count": 1, "of": {"a": [1, 2]}, "by": "x"}}, "by = 'x' is unknown"),
        ({"random": {"count": 1, "of": {"a": [1, 2]}, "sead": 1}}, "unknown key 'sead'"),
        ({"list": "v.txt"}, "must name a .csv or a .parquet file"),
        ({"list": "none.csv"}, "none.csv: cannot be read"),
        ({"list": "text.csv"}, "row 1: a: 'x' is not a finite decimal number; write a number"),
        ({"list": "long.csv"}, "row 1 has 2 cells in place of 1"),
        ({"list": "twice.csv"}, "two columns have the same name"),
        ({"list": "empty.csv"}, "cannot be read"),
        ({"list": "head.csv"}, "a list is empty"),
        ({"list": "bad.parquet"}, "not a Parquet file"),
    ],
)
def test_variants_that_cannot_be_are_refused(table, said, tmp_path):
    files = {
        "text": "a\nx\n",
        "long": "a\n1,2\n",
        "twice": "a,a\n1,2\n",
        "empty": "",
        "head": "a\n",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text)
    (tmp_path / "bad.parquet").write_text("no")
    with pytest.raises(SpecError, match=re.escape(said)) as error:
        read_variants(table, tmp_path, KNOWN)
    assert "\n" not in str(error.value)
