"""MATLAB workspaces with objects in them, written byte by byte: what is numbers is read."""

import struct
import zlib
from fractions import Fraction

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix

from polefence import InputError
from polefence.law.arrays import law_from
from polefence.plant.arrays import plant_from, read_arrays
from polefence.plant.matlab import variables
from support.commands import ran, refused

INT8, INT32, UINT32, DOUBLE, MATRIX, PACKED = 1, 5, 6, 9, 14, 15
STRUCTURE, UINT8, WHOLE, OBJECT, NUMBERS, CELL = 2, 9, 13, 17, 6, 1
HANDLE = 16
A = np.array([[0.0, 1.0], [-2.0, -3.0]])
B = np.array([[0.0], [1.0]])
K = np.array([[-1.0, -2.0]])


class Order:
    """Writes elements in one order of bytes."""

    def __init__(self, order="<"):
        self.order = order

    def ints(self, code, *values):
        return struct.pack(f"{self.order}{len(values)}{code}", *values)

    def element(self, kind, content):
        """MATLAB puts up to four bytes in the place of the length."""
        if 0 < len(content) <= 4 and kind != MATRIX:
            word = len(content) << 16 | kind
            return self.ints("I", word) + content + bytes(-len(content) % 4)
        return self.ints("I", kind, len(content)) + content + bytes(-len(content) % 8)

    def head(self, kind, name, rows=1, columns=1):
        flags = self.element(UINT32, self.ints("I", kind, 0))
        if kind == OBJECT:
            return flags + self.element(INT8, name.encode())
        sizes = self.element(INT32, self.ints("i", rows, columns))
        return flags + sizes + self.element(INT8, name.encode())

    def numbers(self, name, M):
        data = self.element(DOUBLE, self.ints("d", *M.ravel(order="F")))
        return self.element(MATRIX, self.head(NUMBERS, name, *M.shape) + data)

    def opaque(self, name, kind="string"):
        """Write an object as MATLAB does: its class, and where its properties are."""
        where = self.ints("I", 0xDD000000, 2, 1, 1, 1, 1)
        inner = self.head(WHOLE, "", 6, 1) + self.element(UINT32, where)
        words = self.element(INT8, b"MCOS") + self.element(INT8, kind.encode())
        return self.element(MATRIX, self.head(OBJECT, name) + words + self.element(MATRIX, inner))

    def handle(self, name):
        """Write a function handle, which holds a structure."""
        inner = self.numbers("", np.zeros((1, 1)))
        return self.element(MATRIX, self.head(HANDLE, name) + inner)

    def structure(self, name, **fields):
        own = self.head(STRUCTURE, name)
        own += self.element(INT32, self.ints("i", 32))
        own += self.element(INT8, b"".join(key.encode().ljust(32, b"\0") for key in fields))
        return self.element(MATRIX, own + b"".join(fields.values()))

    def workspace(self):
        """Write what MATLAB puts at the end of a file with objects: bytes without a name."""
        bytes_ = self.element(2, bytes(range(200)))
        return self.element(MATRIX, self.head(UINT8, "", 1, 200) + bytes_)

    def packed(self, own):
        content = zlib.compress(own)
        return self.ints("I", PACKED, len(content)) + content

    def file(self, *variables):
        mark = b"IM" if self.order == "<" else b"MI"
        return (
            b"MATLAB 5.0 MAT-file".ljust(124) + self.ints("H", 0x0100) + mark + b"".join(variables)
        )


def objects(w):
    kinds = ("string", "ss", "sym", "table", "containers.Map")
    return [w.opaque(f"thing{k}", kind) for k, kind in enumerate(kinds)]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_numbers_beside_objects_are_read(tmp_path, order, packed, first):
    w = Order(order)
    known = [w.numbers("A", A), w.numbers("B", B), w.numbers("K", K)]
    strange = [*objects(w), w.handle("f")]
    every = [*strange, *known] if first else [*known, *strange]
    every.append(w.workspace())
    every = [w.packed(own) for own in every] if packed else every
    path = tmp_path / "w.mat"
    path.write_bytes(w.file(*every))
    found = read_arrays(path)
    np.testing.assert_array_equal(plant_from(found).A[0], A)
    np.testing.assert_array_equal(law_from(found, plant_from(found)).K, K)
    assert sorted(found.matrices) == ["A", "B", "K"]
    assert found.objects["f"] == "a function handle"
    assert found.objects["thing1"] == "an object of class 'ss'"


@pytest.mark.parametrize("name", ["A", "B", "K"])
def test_an_object_that_is_asked_for_is_named_in_one_line(tmp_path, capsys, name):
    w = Order()
    each = {"A": w.numbers("A", A), "B": w.numbers("B", B), "K": w.numbers("K", K)}
    each[name] = w.opaque(name, "sym")
    path = tmp_path / "w.mat"
    path.write_bytes(w.file(*each.values()))
    error = refused(capsys, "verify", path)
    assert f"w.mat: {name} is an object of class 'sym'; only matrices of numbers" in error


def test_outputs_that_are_objects_are_left_out_and_said(tmp_path, capsys):
    """A workspace's F is often a function handle, its D a text."""
    w = Order()
    own = [w.numbers("A", A), w.numbers("B", B), w.numbers("K", K)]
    own += [w.handle("F"), w.opaque("E", "sym"), w.opaque("D")]
    path = tmp_path / "w.mat"
    path.write_bytes(w.file(*map(w.packed, own)))
    out = ran(capsys, "verify", path)
    assert "read: A, B, K from" in out
    assert (
        "not read, no numbers: E (an object of class 'sym'), D (an object of class 'string'), "
        "F (a function handle)"
    ) in out


def test_objects_inside_structures_are_known(tmp_path):
    w = Order()
    inside = w.structure("design", A=w.numbers("", A), B=w.numbers("", B), K=w.opaque("", "tf"))
    path = tmp_path / "w.mat"
    path.write_bytes(w.file(inside, w.opaque("A1"), w.numbers("other", A)))
    found = read_arrays(path)
    np.testing.assert_array_equal(plant_from(found).A[0], A)
    with pytest.raises(InputError, match=r"w\.mat: K is an object of class 'tf'"):
        found["K"]


def test_other_names_of_objects(tmp_path):
    w = Order()
    path = tmp_path / "w.mat"
    path.write_bytes(w.file(w.numbers("A", A), w.opaque("Kss", "ss")))
    found = read_arrays(path, {"K": "Kss"})
    with pytest.raises(InputError, match="Kss is an object of class 'ss'"):
        found["K"]
    assert not found.holds("K")


def said(path):
    """Return what a file is refused with; "" where it is read."""
    try:
        plant_from(read_arrays(path))
    except InputError as problem:
        return str(problem)
    return ""


def mutated(whole, count, random):
    """Cut anywhere, or with a few bytes that are others."""
    yield from (whole[:k] for k in range(0, len(whole), 1 + len(whole) // 200))
    for _ in range(count):
        own = bytearray(whole)
        for at in random.integers(0, len(whole), random.integers(1, 4)):
            own[at] = random.choice([0, 1, 4, 5, 14, 15, 127, 255, random.integers(256)])
        yield bytes(own)


@pytest.mark.parametrize("packed", [False, True])
def test_any_part_of_such_a_file_is_read_or_refused_in_one_line(tmp_path, packed):
    w = Order()
    own = [w.opaque("s"), w.numbers("A", A), w.handle("f"), w.numbers("B", B), w.opaque("K", "ss")]
    own.append(w.structure("t", x=w.numbers("", A), y=w.opaque("", "tf")))
    path, random = tmp_path / "w.mat", np.random.default_rng(3)
    answers = list[str]()
    for part in mutated(w.file(*(map(w.packed, own) if packed else own)), 600, random):
        path.write_bytes(part)
        answers.append(said(path))
    assert any(answers)
    assert not all(answers)
    assert not any("\n" in one or len(one) > 400 for one in answers)


KINDS = {
    "double": A,
    "one": np.array([[3.0]]),
    "single": A.astype("f4"),
    "whole": np.arange(6, dtype="i8").reshape(2, 3),
    "bytes": np.array([[1, 200]], dtype="u1"),
    "logical": A > 0,
    "complex": A + 2j,
    "stack": np.arange(24.0).reshape(2, 3, 4),
    "sparse": csc_matrix(A),
    "text": "größer als K",
    "rows": np.array(["one", "three"]),
}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_what_scipy_writes_is_read_as_scipy_reads_it(tmp_path, kind, packed):
    path = tmp_path / "w.mat"
    savemat(path, {"x": KINDS[kind], "A": A}, do_compression=packed)
    found, wanted = dict(variables(path, path.read_bytes())), loadmat(path)
    np.testing.assert_array_equal(found["A"], A)
    if kind in ("text", "rows"):
        assert found["x"] == [str(word).rstrip() for word in wanted["x"]]
        return
    own = wanted["x"].toarray() if kind == "sparse" else wanted["x"]
    np.testing.assert_array_equal(found["x"], own)


@pytest.mark.parametrize("order", ["<", ">"])
def test_files_of_version_4(tmp_path, order):
    path = tmp_path / "old.mat"
    savemat(path, {"A": A, "B": B, "K": K, "z": A + 1j, "name": "plant"}, format="4")
    if order == ">":  # as a workstation wrote it
        own = b""
        for name, M in (("A", A), ("B", B), ("K", K)):
            head = struct.pack(">5i", 1000, *M.shape, 0, 2)
            own += head + name.encode() + b"\0" + struct.pack(f">{M.size}d", *M.ravel(order="F"))
        path.write_bytes(own)
    found = read_arrays(path)
    np.testing.assert_array_equal(plant_from(found).A[0], A)
    np.testing.assert_array_equal(law_from(found, plant_from(found)).K, K)
    whole, random = path.read_bytes(), np.random.default_rng(4)
    for part in mutated(whole, 300, random):
        path.write_bytes(part)
        assert "\n" not in said(path)


def test_a_sparse_matrix_that_says_wrong_places_is_refused(tmp_path):
    path, random = tmp_path / "w.mat", np.random.default_rng(5)
    savemat(path, {"A": csc_matrix(A), "B": B})
    refused = list[str]()
    for part in mutated(path.read_bytes(), 600, random):
        path.write_bytes(part)
        try:
            found = read_arrays(path)
        except InputError as problem:
            refused.append(str(problem))
        else:
            refused += found.faults.values()
    assert any("rows of a sparse" in one for one in refused)
    assert not any("\n" in one or len(one) > 400 for one in refused)


def test_a_matrix_is_not_made_larger_than_is_read(tmp_path):
    """A sparse one of one entry says any size."""
    path = tmp_path / "w.mat"
    savemat(path, {"A": csc_matrix(([1.0], ([0], [0])), shape=(10**6, 10**6)), "B": B})
    with pytest.raises(InputError, match="A is larger than 2000000 entries"):
        read_arrays(path)["A"]


def test_what_stands_twice_in_a_sparse_matrix_is_added(tmp_path):
    """As MATLAB and SciPy have it; and one without entries is zero."""
    path = tmp_path / "w.mat"
    twice = csc_matrix((np.array([-1.0, -2.0]), np.array([0, 0]), np.array([0, 2])), shape=(1, 1))
    savemat(path, {"A": twice, "B": csc_matrix((1, 1))})
    found = read_arrays(path)
    assert found["A"][0][0][0] == -3
    assert found["B"][0][0][0] == 0


def test_short_files_that_announce_much_are_refused(tmp_path):
    """Text of two thousand million rows in 22 bytes; many large sparse matrices without entries."""
    path = tmp_path / "w.mat"
    path.write_bytes(struct.pack("<5i", 1, 2**31 - 1, 0, 0, 2) + b"A\0")
    with pytest.raises(InputError, match="more than 2000000 entries"):
        read_arrays(path)
    savemat(path, {f"A{k}": csc_matrix((1_000_000, 1)) for k in range(4)})
    with pytest.raises(InputError, match="more than 2000000 entries in all"):
        read_arrays(path)


def test_systems_are_refused_with_what_to_type(tmp_path, capsys):
    """A file that holds a system alone, its law or its plant, is no law of zero."""
    w = Order()
    plant = tmp_path / "plant.mat"
    plant.write_bytes(w.file(w.numbers("A", A), w.numbers("B", B)))
    for name, kind in (("C", "pid"), ("K", "ss"), ("K", "tf")):
        law = tmp_path / "law.mat"
        law.write_bytes(w.file(w.opaque(name, kind)))
        line = refused(capsys, "verify", plant, "--gain", law)
        assert f"law.mat: {name} is an object of class '{kind}'; only MATLAB reads that" in line
        assert f"[Ac, Bc, Cc, Dc] = ssdata(ss({name})); save('{name}.mat', 'Ac', 'Bc'" in line
    law.write_bytes(w.file(w.opaque("ctrl", "zpk"), w.numbers("w", np.ones((9, 1)))))
    assert "ctrl is an object of class 'zpk'" in refused(capsys, "verify", plant, "--gain", law)
    plant.write_bytes(w.file(w.opaque("sys", "idss"), w.numbers("t", np.ones((9, 1)))))
    line = refused(capsys, "verify", plant)
    assert "[A, B, C, D] = ssdata(ss(sys)); save('sys.mat', 'A', 'B', 'C', 'D', '-v7')" in line


def test_a_law_file_without_a_law_is_refused(tmp_path, capsys):
    """Matrices of two names, neither a law's: it was taken for no law, u = 0."""
    w = Order()
    plant, law = tmp_path / "plant.mat", tmp_path / "law.mat"
    plant.write_bytes(w.file(w.numbers("A", A), w.numbers("B", B)))
    law.write_bytes(w.file(w.numbers("t", np.ones((9, 1))), w.numbers("y", np.ones((9, 1)))))
    line = refused(capsys, "verify", plant, "--gain", law)
    assert "law.mat: holds neither a gain K nor W and Z, nor a compensator" in line
    law.write_bytes(w.file(w.numbers("K1", K), w.numbers("K21", K)))
    line = refused(capsys, "verify", plant, "--gain", law)
    assert "K21 is there, K2 is missing; K1, K2, ... are one a vertex" in line


def test_rows_that_are_of_no_outputs_are_left_out_and_said(tmp_path, capsys):
    """A workspace's D is often of something else: then C alone is no output either."""
    w = Order()
    path = tmp_path / "w.mat"
    every = [w.numbers("A", A), w.numbers("B", B), w.numbers("K", K)]
    every += [w.numbers("C", np.ones((1, 2))), w.numbers("D", np.ones((1, 3)))]
    path.write_bytes(w.file(*every))
    out = ran(capsys, "verify", path)
    assert "read: A, B, K from" in out
    assert "left out, no outputs: D has 3 columns, and the plant 1 input" in out
    assert not plant_from(read_arrays(path)).outputs


@pytest.mark.parametrize("step", [0.0, 0.02])
def test_structures_of_linmod_are_plants(tmp_path, capsys, step):
    """Simulink has small letters; of dlinmod Ts is the sample time, of linmod zero."""
    stable = A / 4 if step else A
    own = {"a": stable, "b": B, "c": np.eye(2)[:1], "d": np.zeros((1, 1)), "Ts": step}
    own |= {"StateName": np.array(["m/x", "m/v"], dtype=object)}
    path = tmp_path / "w.mat"
    savemat(path, {"sys": own, "K": K / 8 if step else K})
    plant = plant_from(read_arrays(path))
    assert plant.period == (Fraction(step) if step else 0)
    assert np.array_equal(plant.A[0], stable)
    assert [y.name for y in plant.outputs] == ["y1"]
    region = "disk(0, 1)" if step else "half_plane(0)"
    assert f"in {region} for" in ran(capsys, "verify", path)


def test_one_zero_is_a_whole_matrix_of_zeros(tmp_path):
    """As ss(A, B, C, 0) has it."""
    path = tmp_path / "w.mat"
    savemat(path, {"A": A, "B": np.hstack([B, B]), "C": np.eye(2), "D": 0.0})
    outputs = plant_from(read_arrays(path)).outputs
    assert [y.name for y in outputs] == ["y1", "y2"]
    assert not any(y.D for y in outputs)


def test_a_sample_time_that_is_not_read_is_said(tmp_path, capsys):
    path = tmp_path / "w.mat"
    savemat(path, {"A": A, "B": B, "K": K, "Ts": 0.1})
    said = ran(capsys, "verify", path)
    assert "Ts is not read: --name sample_time=Ts if the plant is in discrete time" in said
    said = ran(capsys, "verify", path, "--name", "sample_time=Ts", status=1)
    assert "in disk(0, 1)" in said
    assert "Ts is not" not in said
