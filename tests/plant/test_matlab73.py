"""MATLAB files of version 7.3, written as MATLAB lays them out in HDF5, and hostile ones."""

import contextlib
import sys

import numpy as np
import pytest

from polefence import InputError
from polefence.base.errors import MissingExtraError
from polefence.law.arrays import compensator_from, law_from
from polefence.plant.arrays import plant_from, read_arrays
from support.commands import ran, refused
from support.needed import absent

try:
    import h5py
except ImportError:
    absent("h5py")

A = np.array([[[0.0, 1.0], [1.0, -1.0]], [[0.0, 1.0], [3.0, -1.0]]])
B, K = np.array([[0.0], [1.0]]), np.array([[-5.0, -2.0]])
HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"


class File:
    """A file as MATLAB writes it: axes the other way round, classes as attributes."""

    def __init__(self, path):
        self.path, self.count = path, 0
        self.file = h5py.File(path, "w", userblock_size=512)

    def put(self, group, name, value, kind="double"):
        node = group.create_dataset(name, data=np.asarray(value).T)
        node.attrs["MATLAB_class"] = np.bytes_(kind)
        return node

    def refer(self, value, kind="double"):
        group = self.file.require_group("#refs#")
        self.count += 1
        return self.put(group, f"r{self.count}", value, kind).ref

    def cell(self, group, name, values):
        refs = np.array([self.refer(value) for value in values], dtype=h5py.ref_dtype)
        node = group.create_dataset(name, data=refs.reshape(-1, 1))
        node.attrs["MATLAB_class"] = np.bytes_("cell")

    def structure(self, name, group=None):
        node = (group or self.file).create_group(name)
        node.attrs["MATLAB_class"] = np.bytes_("struct")
        return node

    def text(self, group, name, value):
        codes = np.array([[ord(letter) for letter in value]], dtype=np.uint16)
        self.put(group, name, codes, "char")

    def close(self, header=HEADER):
        self.file.close()
        with self.path.open("r+b") as file:
            file.write(header)


@pytest.fixture
def new(tmp_path):
    return File(tmp_path / "new.mat")


def test_arrays_cells_and_texts(new):
    new.put(new.file, "A", np.moveaxis(A, 0, 2))
    new.cell(new.file, "B", [B, 2 * B])
    new.put(new.file, "K", K.astype("f4"), "single")
    new.text(new.file, "name", "arm")
    new.put(new.file, "flag", np.array([[1]], dtype="u1"), "logical")
    new.close()
    found = read_arrays(new.path)
    plant = plant_from(found)
    assert np.array_equal(plant.A, A)
    assert np.array_equal(plant.B, [B, 2 * B])
    assert plant.name == "arm"
    assert np.array_equal(law_from(found, plant).K, K)


@pytest.mark.parametrize(
    "header", [HEADER, b"MATLAB 7.0 MAT-file, by libmatio".ljust(124) + b"\x00\x02IM"]
)
def test_structures_sparse_and_empty(new, header):
    K_ = new.structure("K")
    for letter, value in {"A": -30, "B": 32, "C": 33.75, "D": -40}.items():
        new.put(K_, letter, [[value]])
    empty = K_.create_dataset("E", data=np.array([0, 0], dtype="u8"))
    empty.attrs["MATLAB_class"], empty.attrs["MATLAB_empty"] = np.bytes_("double"), np.uint8(1)
    sparse = new.file.create_group("A")
    sparse.attrs["MATLAB_class"], sparse.attrs["MATLAB_sparse"] = np.bytes_("double"), np.uint64(2)
    for name, own in {"data": [1.0, 1.0, -1.0], "ir": [1, 0, 1], "jc": [0, 1, 3]}.items():
        sparse.create_dataset(name, data=own)
    new.put(new.file, "B", B)
    new.put(new.file, "C", [[1.0, 0.0]])
    new.close(header)
    found = read_arrays(new.path)
    assert np.array_equal(plant_from(found).A[0], A[0])
    law, names = compensator_from(found, alone=False)
    assert names == ("K",)
    assert law.order == 1


def test_a_structure_array_is_one_matrix_a_vertex(new):
    own = new.structure("family")
    for name, values in {"A": list(A), "B": [B, B]}.items():
        refs = np.array([new.refer(value) for value in values], dtype=h5py.ref_dtype)
        own.create_dataset(name, data=refs.reshape(-1, 1))
    new.put(new.file, "K", K)
    new.close()
    found = read_arrays(new.path)
    assert np.array_equal(plant_from(found).A, A)


def test_the_command_reads_it(new, capsys):
    new.put(new.file, "A", np.moveaxis(A, 0, 2))
    new.put(new.file, "B", B)
    new.put(new.file, "K", K)
    new.close()
    assert ran(capsys, "verify", new.path).startswith("proved: ")


def test_objects_are_named(new, capsys):
    new.put(new.file, "A", A[0])
    new.put(new.file, "B", B)
    node = new.put(new.file, "K", np.zeros((6, 1), dtype="u4"), "ss")
    node.attrs["MATLAB_object_decode"] = np.int32(3)
    new.close()
    line = refused(capsys, "verify", new.path)
    assert "K is an object of class 'ss'; only MATLAB reads that; there type [Ac, Bc, Cc, D" in line


def test_what_lies_in_other_files_is_not_followed(new, tmp_path):
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file.create_dataset("A", data=np.eye(2))
    new.file["A"] = h5py.ExternalLink(str(other), "/A")
    new.file["B"] = h5py.SoftLink("/A")
    raw = tmp_path / "raw.bin"
    np.eye(2).tofile(raw)
    space = h5py.h5s.create_simple((2, 2))
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_external(str(raw).encode(), 0, 32)
    h5py.h5d.create(new.file.id, b"K", h5py.h5t.IEEE_F64LE, space, how)
    new.close()
    with pytest.raises(InputError, match="K lies in another file; save it in this one"):
        read_arrays(new.path)


def test_links_are_no_matrices(new, tmp_path):
    new.file["A"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/A")
    new.close()
    with pytest.raises(InputError, match="A is a link to elsewhere"):
        plant_from(read_arrays(new.path))


def test_sizes_are_looked_at_first(new):
    new.file.create_dataset("A", shape=(10**7, 10**7), dtype="f8", chunks=(1, 100), fillvalue=0)
    new.close()
    with pytest.raises(InputError, match="more than 2000000 entries in all"):
        read_arrays(new.path)


def test_cells_in_themselves_end(new):
    node = new.file.create_dataset("A", (1, 1), dtype=h5py.ref_dtype)
    node.attrs["MATLAB_class"] = np.bytes_("cell")
    node[0, 0] = node.ref
    new.close()
    with pytest.raises(InputError, match="more pieces, or deeper ones"):
        read_arrays(new.path)


@pytest.mark.parametrize("cut", [0, 7, 300, 1000])
def test_damaged_files_are_refused_in_one_line(new, cut):
    new.put(new.file, "A", A[0])
    new.close()
    raw = new.path.read_bytes()
    new.path.write_bytes(raw[: 520 + cut])
    with pytest.raises(InputError, match="no MATLAB 7.3 file, or a damaged one") as no:
        read_arrays(new.path)
    assert "\n" not in str(no.value)


@pytest.mark.parametrize("seed", range(30))
def test_flipped_bytes_are_read_or_refused(new, seed):
    own = new.structure("G")
    new.put(own, "A", A[0])
    new.cell(new.file, "B", [B])
    new.close()
    raw, rng = bytearray(new.path.read_bytes()), np.random.default_rng(seed)
    for place in rng.integers(520, len(raw), 12):
        raw[place] ^= 1 << rng.integers(8)
    new.path.write_bytes(raw)
    with contextlib.suppress(InputError):
        read_arrays(new.path)


def test_without_h5py_it_says_what_to_do(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = tmp_path / "new.mat"
    path.write_bytes(HEADER.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(
        MissingExtraError, match=r"pip install 'polefence\[mat73\]', or in MATLAB sav"
    ):
        read_arrays(path)
    assert "-v7" in refused(capsys, "verify", path)
