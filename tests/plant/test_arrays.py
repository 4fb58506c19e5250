"""Files of other tools: the same matrices whatever the format; what is none is one line."""

import io
import json
import struct
import zipfile
import zlib
from fractions import Fraction

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from polefence import InputError
from polefence.law.arrays import law_from
from polefence.plant import matlab
from polefence.plant.arrays import plant_from, read_arrays

A = np.array([[[0.0, 1.0], [-1.0, -0.1]], [[0.0, 1.0], [-3.0, -0.1]], [[0.0, 2.0], [-2.0, 0.3]]])
B = np.array([[0.0], [1.0]])
N = len(A)


def cells(matrices):
    found = np.empty((1, len(matrices)), dtype=object)
    for k, each in enumerate(matrices):
        found[0, k] = each
    return found


def structures(matrices):
    found = np.zeros((1, len(matrices)), dtype=[("A", object), ("B", object)])
    for k, each in enumerate(matrices):
        found[0, k]["A"], found[0, k]["B"] = each, B
    return found


def mat(**variables):
    return lambda path: savemat(path, variables)


def npz(**variables):
    return lambda path: np.savez(path, **variables)


def text(data):
    return lambda path: path.write_text(json.dumps(data))


def folder(path):
    path.mkdir()
    for k in range(N):
        np.savetxt(path / f"A{k + 1}.csv", A[k], delimiter=",")
    (path / "B.csv").write_text("# one column\n0\n\n1 % last\n")


NUMBERED = {f"A{k + 1}": A[k] for k in range(N)}
FILES = {
    "last.mat": mat(A=np.moveaxis(A, 0, 2), B=B),
    "cells.mat": mat(A=cells(A), B=B),
    "numbered.mat": mat(**NUMBERED, B=B),
    "packed.mat": lambda path: savemat(path, {"A": cells(A), "B": B}, do_compression=True),
    "sparse.mat": mat(A=cells([csc_matrix(own) for own in A]), B=csc_matrix(B)),
    "structures.mat": mat(family=structures(A)),
    "dictionaries.mat": mat(family=[{"A": own, "B": B} for own in A]),
    "first.npz": npz(A=A, B=B),
    "numbered.npz": npz(**NUMBERED, B=B),
    "list.json": text({"A": A.tolist(), "B": B.tolist()}),
    "folder": folder,
}


@pytest.mark.parametrize("name", FILES)
def test_every_file_holds_the_same_family(tmp_path, name):
    path = tmp_path / name
    FILES[name](path)
    plant = plant_from(read_arrays(path))
    np.testing.assert_array_equal(plant.A, A)
    np.testing.assert_array_equal(plant.B, np.stack([B] * N))
    assert plant.name == path.stem


def test_names_outputs_and_disturbances_are_read(tmp_path):
    path = tmp_path / "servo.mat"
    savemat(
        path,
        {
            "A": np.moveaxis(A, 0, 2),
            "B": B,
            "E": B,
            "C": np.array([[1.0, 2.0]]),
            "F": np.array([[3.0]]),
            "name": "a servo",
            "states": np.array(["angle [rad]", "speed [rad/s]"], dtype=object),
            "outputs": np.array(["sum [rad]"], dtype=object),
            "sample_time": 0.01,
        },
    )
    plant = plant_from(read_arrays(path))
    assert (plant.name, plant.states) == ("a servo", ("angle [rad]", "speed [rad/s]"))
    assert plant.sample_time == Fraction(0.01)
    (own,) = plant.outputs
    assert (own.name, own.unit) == ("sum", "rad")
    assert (own.C, own.F) == (((1, 2),), ((3,),))


def test_rationals_are_exact(tmp_path):
    path = tmp_path / "thirds.json"
    path.write_text('{"A": [["-1/3", "0.1"], [0, 0.1]], "B": [[1], [1]]}')
    (vertex,) = plant_from(read_arrays(path)).vertices
    assert vertex.exact_A[0] == (Fraction(-1, 3), Fraction(1, 10))
    assert vertex.exact_A[1] == (0, Fraction(0.1))


def test_closed_loops_alone_are_a_family(tmp_path):
    path = tmp_path / "loops.npz"
    np.savez(path, A=A)
    np.testing.assert_array_equal(plant_from(read_arrays(path)).B[0], np.eye(2))


def test_other_names_are_told(tmp_path):
    path = tmp_path / "mine.npz"
    np.savez(path, Acl=A[0], Bu=B)
    found = read_arrays(path, {"A": "Acl", "B": "Bu", "P": "Xopt"})
    np.testing.assert_array_equal(plant_from(found).A[0], A[0])
    with pytest.raises(InputError, match=r"mine.npz: no matrix 'Xopt'"):
        found["P"]


def test_what_is_not_asked_for_may_be_anything(tmp_path):
    """As in a whole workspace that was saved."""
    others = {"z": A[0] * 1j, "tmp3": A[0], "four": np.zeros((2, 2, 2, 2)), "words": "a", "s": []}
    savemat(tmp_path / "w.mat", {"A": cells(A), "B": B} | others)
    np.savez(tmp_path / "w.npz", A=A, B=B, z=A[0] * 1j, tmp3=A[0])
    for name in ("w.mat", "w.npz"):
        found = read_arrays(tmp_path / name)
        np.testing.assert_array_equal(plant_from(found).A, A)
        for fault, said in (("z", "z has complex entries"), ("tmp", "tmp3 is there, tmp1 is")):
            with pytest.raises(InputError, match=said):
                found[fault]


def pickled(path):
    np.savez(path, A=np.array([{}], dtype=object))


def cut(path):
    savemat(path, {"A": A[0], "B": B})
    path.write_bytes(path.read_bytes()[:200])


def bomb(path):
    packed = zlib.compress(bytes(matlab.MAX_INFLATED + 10), 9)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(header + struct.pack("<II", matlab.MI_COMPRESSED, len(packed)) + packed)


def zip_bomb(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("A.npy", bytes(matlab.MAX_INFLATED + 10))


def nested(depth):
    """Write cells in cells, as no variable that anybody saves; SciPy alone ends the process."""

    def element(kind, content):
        return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)

    def head(kind, name=b""):
        flags, sizes = struct.pack("<II", kind, 0), struct.pack("<ii", 1, 1)
        return element(6, flags) + element(5, sizes) + element(1, name)

    def write(path):
        inner = element(matlab.MI_MATRIX, head(6) + element(9, struct.pack("<d", 1.0)))
        size, parts = len(inner), [inner]
        for k in range(depth):
            own = head(1, b"A" if k == depth - 1 else b"")
            parts.append(struct.pack("<II", matlab.MI_MATRIX, len(own) + size) + own)
            size += len(own) + 8
        header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
        path.write_bytes(header + b"".join(reversed(parts)))

    return write


def claiming(*shape):
    """Write an archive whose array has fewer numbers than its header says."""

    def write(path):
        own = io.BytesIO()
        header = {"descr": "<f8", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(own, header)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("A.npy", own.getvalue())

    return write


def saved_alone(path):
    np.save(path, A[0])


def written(content):
    return lambda path: path.write_bytes(content)


BAD = {
    "pickled.npz": (pickled, "A: not a plain array of NumPy"),
    "huge.npz": (claiming(10**6, 10**6), "its header says 1000000 x 1000000"),
    "negative.npz": (claiming(-1, 4), "A: not a plain array of NumPy"),
    "short.npz": (claiming(1, 3), "A: not a plain array of NumPy"),
    "short.npy": (written(b"\x93NUMPY\x01\x00"), "not a plain array of NumPy"),
    "one.npy": (saved_alone, "no matrix 'A'; known: one"),
    "cut.mat": (cut, "a damaged one"),
    "bomb.mat": (bomb, "once unpacked"),
    "bomb.npz": (zip_bomb, "once unpacked"),
    "empty.mat": (written(b""), "damaged"),
    "no.npz": (written(b"PK"), "not an .npz file"),
    "words.csv": (written(b"1, 2\n3, x\n"), "line 2: '3, x' are not numbers"),
    "empty.csv": (written(b"# nothing\n"), "holds no number"),
    "bytes.csv": (written(b"\xff\xfe1"), "not UTF-8"),
    "list.json": (written(b"[1, 2"), "JSON"),
    "number.json": (written(b"3"), "must be a table of matrices"),
    "other.txt": (written(b"1"), "name a .mat"),
    "gap.npz": (npz(A1=A[0], A3=A[1], B=B), "A3 is there, A2 is missing"),
    "complex.npz": (npz(A=A[0] * 1j, B=B), "A has complex entries"),
    "four.npz": (
        npz(A=np.zeros((2, 2, 2, 2)), B=B),
        "A is neither a matrix nor a list of matrices",
    ),
    "nothing.npz": (npz(K=B.T), "no matrix 'A'; known: K"),
    "shapes.npz": (npz(A=A, B=np.ones((3, 1))), r"shapes.npz: vertex 1: B has 3 rows"),
    "counts.npz": (npz(A=A, B=np.ones((2, 2, 1))), r"counts.npz: 3 matrices A, 2 B"),
    "nan.npz": (npz(A=A[0] * np.nan, B=B), r"nan.npz: A\[1\]\[1\] = nan must be a finite number"),
    "outputs.json": (
        text({"A": A[0].tolist(), "B": B.tolist(), "C": [[1, 0]], "outputs": ["a", "b"]}),
        "outputs names 2 signals",
    ),
    "none.npz": (npz(A=np.zeros((0, 2, 2)), B=B), "A is empty"),
    "rows.json": (
        text({"A": A[0].tolist(), "B": B.tolist(), "C": [[1, 0]], "D": [[0], [1]]}),
        "C, D must have as many rows",
    ),
    "two.json": (text({"A": [[[1]], [[1, 2]]], "B": [[1]]}), "A holds matrices of different"),
    "cells.mat": (nested(3), "no matrix 'A'"),
    "abyss.mat": (nested(300_000), "cells in cells, more than 20 deep"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_plant_is_one_line(tmp_path, name):
    write, said = BAD[name]
    write(tmp_path / name)
    with pytest.raises(InputError, match=said) as caught:
        plant_from(read_arrays(tmp_path / name))
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / name))


VALUES = [None, True, 7, "x", "1/0", [], [[]], [[[]]], {}, [1, 2], [[1], [2, 3]], [["y"]], -1]
VALUES += [[[[0.0, 1.0]]], [[[[1]]]], "", [None], [[None]], [{"A": 1}], [[True, 2], [3, 4]]]
WHOLE = {
    "A": A.tolist(), "B": B.tolist(), "E": B.tolist(), "C": [[1.0, 0.0]], "D": [[0.0]],
    "F": [[1.0]], "K": [[1.0, 2.0]], "name": "n", "states": ["a", "b"], "outputs": ["y"],
    "sample_time": 0.1,
}  # fmt: skip


@pytest.mark.parametrize("key", WHOLE)
def test_any_value_of_any_key_is_read_or_refused(tmp_path, key):
    path, refused = tmp_path / "file.json", list[str]()
    for value in VALUES:
        path.write_text(json.dumps(WHOLE | {key: value}))
        try:
            arrays = read_arrays(path)
            law_from(arrays, plant_from(arrays))
        except InputError as problem:
            refused.append(str(problem))
    assert refused or key in ("name", "outputs")  # texts, of which there are fewer wrong ones
    assert not any("\n" in said for said in refused)


def test_an_empty_folder_is_said(tmp_path):
    with pytest.raises(InputError, match=r"a folder of 0 .csv files"):
        read_arrays(tmp_path)
