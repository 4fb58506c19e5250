"""A law with states of its own takes over without a bump: its first answer is the one asked for."""

import ctypes

import numpy as np
import pytest

from polefence.export.program import Memory, number, with_memory
from polefence.export.program import program as program_of
from polefence.export.sources import Texts, sources
from polefence.export.words import in_words
from polefence.law.laws import PolynomialGain
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.proof.claims.words import largest
from support.cortex import run
from support.memories import CORNER, TIME, Code, exported, spring
from support.shapes_of_laws import SANITIZED, STRICT

OK, NO_CONTROL, LIMITED, SATURATED, BUMP = 0, 4, 8, 16, 64
BOUNDS = (Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m"))
AFFINE = ((0, 0), (1, 0), (0, 1))


def law_of(random, inputs, order, measured=2, varies=True):
    """A random law of so many inputs, own states and signals, affine in two parameters."""
    n, m = measured + order, inputs + order
    K = random.normal(size=(m, n)) * 10.0 ** random.uniform(-1, 2, (m, 1))
    K[inputs:, measured:] = -np.diag(random.uniform(1, 20, order))  # alone it is stable
    y = tuple(
        Output(f"y{j + 1}", C=[[float(i == j) for i in range(n)]], D=[[0.0] * m]) for j in range(n)
    )
    if not varies:
        return PolynomialGain(((0, 0),), K[None], y, BOUNDS)
    less = K * np.array([0.1] * inputs + [0.0] * order)[:, None]
    return PolynomialGain(AFFINE, np.array([K, less, -less]), y, BOUNDS)


class Started:
    """The C of a program, whose law is started and updated."""

    def __init__(self, program, folder, limits=(), real=None, wide=None):
        memory, (n, m) = program.memory, program.shape
        self.order, self.n, self.m = memory.states, n - memory.states, m - memory.states
        names = [[f"{letter}{k}" for k in range(count)] for letter, count in
                 (("y", self.n), ("u", self.m))]  # fmt: skip
        texts = Texts("law", "random", ("Tried.",), *map(tuple, names), limits, TIME)
        for name, text in sources(program, texts).items():
            (folder / name).write_text(text)
        flags = ["-std=c99", "-ffp-contract=off", "-shared", "-fPIC", "-O1", "-Wall", "-Werror"]
        run("gcc", *flags, "-o", "law.so", "law.c", cwd=folder)
        self.library = ctypes.CDLL(str(folder / "law.so"))
        floats = {32: ctypes.c_float, 64: ctypes.c_double}
        self.real = real or floats[program.number.bits]
        self.memory = ((wide or self.real) * self.order)()
        self.given = bool(getattr(program, "shares", ()))

    def _arrays(self, *lists):
        return [(self.real * len(v))(*v) for v in lists if len(v)]

    def start(self, p, y, u):
        return self.library.law_start(self.memory, *self._arrays(p if self.given else (), y, u))

    def update(self, p, y):
        u = (self.real * self.m)()
        flags = self.library.law_update(self.memory, *self._arrays(p if self.given else (), y), u)
        return np.array(u), flags


def gain_at(law, p):
    """Return the gain at values of the parameters."""
    c = [2 * (p[1] - 4) / 16 - 1]
    c.insert(0, 1 - 2 * (1 / p[0] - 0.5) / 0.5)
    return sum(np.prod(np.array(c) ** e) * K for e, K in zip(law.powers, law.gains, strict=True))


SHAPES = [(1, 1), (1, 3), (2, 2), (2, 4), (3, 3), (4, 6)]


@pytest.mark.parametrize("varies", [False, True])
@pytest.mark.parametrize(("inputs", "order"), SHAPES)
@pytest.mark.parametrize("bits", [32, 64])
def test_the_first_answer_is_the_one_asked_for(
    host_compiler, tmp_path, bits, inputs, order, varies
):
    random = np.random.default_rng(100 * inputs + order)
    law = law_of(random, inputs, order, varies=varies)
    made = program_of(law, BOUNDS, number(bits))
    code = Started(with_memory(made, order, TIME), tmp_path)
    unit = float(made.number.unit)
    for _ in range(60):
        p = [random.uniform(1, 2), random.uniform(4, 20)]
        y, u, before = (made.number.nearest(random.normal(size=size) * 10)
                        for size in (code.n, inputs, order))  # fmt: skip
        code.memory[:] = before
        assert code.start(p, y, u) == OK
        after = np.array(code.memory)
        K = gain_at(law, p)[:inputs]
        size = np.abs(u) + np.abs(K) @ np.abs([*y, *after])
        # off by rounding; and as near to where they were as any that answer it
        first, flags = code.update(p, y)
        assert flags == OK
        assert np.all(np.abs(first - u) <= 4 * (code.n + order + len(law.gains) + 4) * unit * size)
        C, D = K[:, code.n :], K[:, : code.n]
        nearest = before + np.linalg.pinv(C) @ (u - D @ y - C @ before)
        scale = np.linalg.norm(np.linalg.pinv(C)) * np.abs(size).max()
        np.testing.assert_allclose(after, nearest, rtol=0, atol=1e3 * unit * scale)


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize(("inputs", "order"), [(1, 1), (1, 3), (2, 2), (2, 3)])
@pytest.mark.parametrize("varies", [False, True])
def test_in_integers_it_is_off_by_a_last_bit_of_each_state(
    host_compiler, tmp_path, bits, inputs, order, varies
):
    random = np.random.default_rng(10 * inputs + order)
    law = law_of(random, inputs, order, varies=varies)
    names = [signal.name for signal in law.measured]
    ranges = dict.fromkeys(names, 3.0)
    memory = Memory(order, TIME, TIME)
    made = in_words(law, BOUNDS if varies else (), bits, names, ranges, (), memory)
    word = ctypes.c_int16 if bits == 16 else ctypes.c_int32
    wide = ctypes.c_int32 if bits == 16 else ctypes.c_int64
    code, scales = Started(made, tmp_path, (), word, wide), made.scales
    # what a last bit of each state is worth, in those of u
    K = np.abs(made.gains).sum(axis=0) if varies else np.abs(made.K)
    sizes = K[:inputs, code.n :] @ 2.0 ** -np.array(scales.signals[code.n :])
    sizes = sizes * 2.0 ** np.array(scales.answers[:inputs])
    top, tried = largest(bits), 0
    for _ in range(60):
        p = [int(random.uniform(*ends) * 2.0**s) for ends, s in
             zip(((1, 2), (4, 20)), scales.given or (0, 0), strict=True)]  # fmt: skip
        y = [int(v) for v in random.uniform(-0.3, 0.3, code.n) * top]
        # one that states in half of their ranges give
        states = [int(v) for v in random.uniform(-0.5, 0.5, order) * top]
        reads = [t - s for s, t in zip(scales.signals[code.n :], scales.answers[inputs:],
                                       strict=True)]  # fmt: skip
        code.memory[:] = [v << r for v, r in zip(states, reads, strict=True)]
        wanted, flags = code.update(p, y)
        if flags:
            continue
        code.memory[:] = [0] * order
        assert code.start(p, y, [int(v) for v in wanted]) == OK
        first, flags = code.update(p, y)
        assert flags == OK
        assert np.all(np.abs(first.astype(float) - wanted) <= sizes + 2.5)
        tried += 1
    assert tried > 20


def test_integers_go_to_their_ends_where_no_states_answer_it(host_compiler, tmp_path):
    law = law_of(np.random.default_rng(4), 1, 2, varies=False)
    names = [signal.name for signal in law.measured]
    ranges = {"y1": 3.0, "y2": 3.0, "y3": 0.01, "y4": 0.01}
    made = in_words(law, (), 16, names, ranges, (), Memory(2, TIME, TIME))
    code = Started(made, tmp_path, (), ctypes.c_int16, ctypes.c_int32)
    signs = np.sign(made.K[0, 2:])
    assert code.start([], [0, 0], [32767]) == BUMP
    tops = [32767 << (t - s) for s, t in zip(made.scales.signals[2:], made.scales.answers[1:],
                                             strict=True)]  # fmt: skip
    assert list(code.memory) == list((signs * tops).astype(int))
    code.memory[:] = [2**31 - 1, -(2**31)]
    assert code.start([], [-32768, 32767], [-32768]) & SATURATED  # nothing wraps


def test_what_depends_on_the_first_input_is_said_to_be_off(host_compiler, tmp_path):
    law = law_of(np.random.default_rng(7), 2, 2, varies=False)
    K = np.array(law.gains[0])
    K[1, 2:] = 2 * K[0, 2:]
    law = PolynomialGain(law.powers, K[None], law.measured, BOUNDS)
    code = Started(with_memory(program_of(law, BOUNDS, number(64)), 2, TIME), tmp_path)
    assert code.start([], [0.0, 0.0], [1.0, 2.0]) == OK  # both can be had
    assert code.start([], [0.0, 0.0], [1.0, 5.0]) == BUMP
    first, _ = code.update([], [0.0, 0.0])
    np.testing.assert_allclose(first, [1.0, 2.0], rtol=1e-12)


def started(code, y, u):
    given = (ctypes.c_double * 2)(*CORNER.values())
    y, u = (ctypes.c_double * 1)(y), (ctypes.c_double * 1)(u)
    return code.library.law_start(code.memory, given, y, u)


def test_what_is_no_number_leaves_the_states(host_compiler, tmp_path):
    code = Code(exported("affine", 64), tmp_path)
    for y, u in ((np.nan, 1.0), (np.inf, 1.0), (-np.inf, 1.0), (0.1, np.nan), (1e308, 1.0)):
        code.states = [0.25]
        assert started(code, y, u) == NO_CONTROL
        assert code.states == [0.25]
    code.states = [np.nan]  # such states begin at 0
    assert started(code, 0.1, 2.0) == OK
    assert code.update(CORNER.values(), [0.1])[0][0] == pytest.approx(2.0, rel=1e-14)


@pytest.mark.parametrize("u", [1e4, np.inf])
def test_an_input_beyond_its_limit_is_asked_for_at_the_limit(host_compiler, tmp_path, u):
    code = Code(exported("affine", 64), tmp_path)
    assert started(code, 0.1, -u) == LIMITED
    assert code.update(CORNER.values(), [0.1])[0][0] == pytest.approx(-800, rel=1e-14)


@pytest.mark.parametrize("kind", ["affine", "pid"])
def test_a_law_takes_over_without_a_bump_and_what_is_left_dies_out(host_compiler, tmp_path, kind):
    """The spring held by a hand at 0.3 m; then the law is on."""
    code, (A, B), steps = Code(exported(kind, 64, late=False), tmp_path), spring(**CORNER), 1500
    x, held = np.array([0.3, 0.0]), CORNER["k"] * 0.3
    code.reset()
    assert started(code, 0.3, held) == OK
    inputs, grown = [], np.eye(2) + TIME * np.array(A)
    for _ in range(steps):
        u, _ = code.update(CORNER.values(), [x[0]])
        inputs.append(u[0])
        x = grown @ x + TIME * np.array(B)[:, 0] * u[0]
    assert inputs[0] == pytest.approx(held, rel=1e-13)
    assert abs(x[0]) < 0.02 * 0.3
    code.reset()  # without: the law's own answer, which is another
    assert abs(code.update(CORNER.values(), [0.3])[0][0] - held) > 1


def test_a_start_that_goes_astray_says_so(host_compiler, tmp_path):
    made = exported("affine", 64)
    made.save(tmp_path)
    text = (tmp_path / "law.c").read_text()
    for whole, less in (
        ("+= (left[i] / square[i]) *", "+= 0.5 * (left[i] / square[i]) *"),
        ("asked[i] - row_of(w, i, signals);", "asked[i] - signals[0];"),
    ):
        assert text.count(whole) == 1
        wrong = tmp_path / str(len(less))
        code = Code(made, wrong)
        (wrong / "law.c").write_text(text.replace(whole, less))
        run("cc", "-std=c99", "-shared", "-fPIC", "-o", "wrong.so", "law.c", cwd=wrong)
        code.library = ctypes.CDLL(str(wrong / "wrong.so"))
        assert started(code, 0.1, 200.0) == BUMP


@pytest.mark.parametrize("flags", [[*STRICT, "-fanalyzer"], SANITIZED])
def test_compilers_have_nothing_to_say(host_compiler, tmp_path, flags):
    made = exported("pid", 32)
    made.save(tmp_path)
    run("gcc", *flags, "-c", "law.c", "-o", "law.o", cwd=tmp_path)
