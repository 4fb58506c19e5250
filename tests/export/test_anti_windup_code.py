"""Code of laws with anti-windup: it cuts, its states follow; nothing moves where nothing is cut."""

import ctypes
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from polefence import (
    Disk,
    HalfPlane,
    PolynomialGain,
    Structure,
    UncertainPlant,
    analyse,
    at_sample_time,
)
from polefence.base.errors import InputError
from polefence.export import check_guarantee, export_c99, with_fmus
from polefence.export.vectors import LIMITED, Ends, vectors
from polefence.plant.larger import with_states
from polefence.plant.parameters import Parameter
from polefence.proof.claims import words
from polefence.proof.claims.rounding import answer_errors, gain_errors, recovery_errors
from polefence.proof.claims.words import largest, two
from polefence.proof.work import FormatError
from polefence.response.discrete import Sampling
from support import memories
from support.commands import ran
from support.cortex import run
from support.files import rewritten
from support.fixed_points import WordCode
from support.shapes_of_laws import SANITIZED, STRICT

T, LIMIT, GAINS = 0.01, 1.4, (-4.0, -3.0)


@cache
def design(G=-0.375):
    """An unstable lag, x' = a x + b u, with proportional and integral action."""
    parameters = [Parameter("a", 0.8, 1.2), Parameter("b", 0.9, 1.1)]
    plant = UncertainPlant.from_function(
        lambda a, b: ([[a]], [[b]], [[b]]),
        parameters,
        states=("x [m]",),
        inputs=("u [N]",),
        disturbances=("w",),
        name="lag",
    )
    plant = with_states(plant, 1)
    law = PolynomialGain(((0, 0),), [[GAINS, (1.0, 0.0)]], (), plant.parameters)
    if G is not None:
        law = law.with_anti_windup(np.array([[0.0, 0.0], [G, 0.0]]))
    return analyse(plant, law, HalfPlane(0.1)).design


@cache
def exported(bits=64, G=-0.375, limit=LIMIT):
    return export_c99(design(G), bits, sampling=Sampling(T, False), limits=limit)


class Code:
    """The compiled code, given x, around a lag of a and b that is stepped exactly."""

    def __init__(self, made, folder, bits=64):
        made.save(folder)
        run("cc", "-std=c99", "-shared", "-fPIC", "-O1", "-o", "law.so", "law.c", cwd=folder)
        self.law = ctypes.CDLL(str(folder / "law.so"))
        self.real = ctypes.c_double if bits == 64 else ctypes.c_float
        self.memory = (self.real * 1)(0.0)

    def tick(self, x):
        u = (self.real * 1)()
        flags = self.law.law_update(self.memory, (self.real * 1)(x), u)
        return flags, u[0], self.memory[0]


def ends(code, a=1.2, b=0.9, steps=1500):
    """The state of the plant at last, the code's u held between its samples."""
    x, grown = 1.0, np.exp(a * T)
    for _ in range(steps):
        _, u, _ = code.tick(x)
        x = grown * x + (grown - 1) / a * b * u
        if abs(x) > 1e3:
            break
    return abs(x)


def test_it_steps_its_states_as_the_equations_say(host_compiler, tmp_path):
    code, z, seen = Code(exported(), tmp_path), 0.0, set()
    for x in np.random.default_rng(3).uniform(-0.6, 0.6, 400):
        asked = GAINS[0] * x + GAINS[1] * z
        u = min(max(asked, -LIMIT), LIMIT)
        z = z + T * (x - 0.375 * (u - asked))
        flags, acting, own = code.tick(x)
        assert acting == pytest.approx(u, abs=1e-12)
        assert own == pytest.approx(z, abs=1e-12)
        assert flags == (LIMITED if abs(asked) > LIMIT else 0)
        seen.add(flags)
    assert seen == {0, LIMITED}


def test_where_nothing_is_cut_every_bit_is_that_of_the_law_without_it(host_compiler, tmp_path):
    folders = [tmp_path / name for name in ("with", "without")]
    codes = [
        Code(exported(32, G, 1e6), at, 32) for G, at in zip((-0.375, None), folders, strict=True)
    ]
    for x in np.random.default_rng(4).uniform(-5, 5, 500):
        assert codes[0].tick(x) == codes[1].tick(x)


def test_the_loop_recovers_with_it_and_is_lost_without(host_compiler, tmp_path):
    found = {
        G: ends(Code(exported(64, G), tmp_path / f"{k}")) for k, G in enumerate((-0.375, None))
    }
    assert found[-0.375] < 1e-3
    assert found[None] > 1e2


@pytest.mark.parametrize("bits", [32, 64])
def test_its_own_test_covers_what_is_cut(host_compiler, tmp_path, bits):
    made = exported(bits)
    assert made.proved
    made.save(tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror", cwd=tmp_path).splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2
    cut = vectors(made.program, made.design.law, Ends((LIMIT,))).flags
    assert np.any(cut == LIMITED)
    assert np.any(cut == 0)
    for flags in ([*STRICT, "-fanalyzer"], SANITIZED):
        run("gcc", *flags, "law.c", "law_test.c", "-o", "test", cwd=tmp_path)
        run("./test", cwd=tmp_path)
    # a gain that is a little off fails
    text = made.files["law.c"].decode()
    assert "{ -0.375" in text
    (tmp_path / "law.c").write_text(text.replace("{ -0.375", "{ -0.3751"))
    run("gcc", "law.c", "law_test.c", "-o", "test", cwd=tmp_path)
    with pytest.raises(Exception, match="FAILED"):
        run("./test", cwd=tmp_path)


@pytest.mark.parametrize("kind", ["affine", "pid"])
def test_a_law_in_the_parameters_and_a_pid_have_it_in_code(host_compiler, tmp_path, kind):
    made = memories.design(kind)
    gain = np.zeros(made.law.shape[::-1])
    gain[2:, 0] = [0.7, -0.3][: len(gain) - 2]
    law = made.law.with_anti_windup(gain)
    found = analyse(made.plant, law, memories.REGION).design
    code = export_c99(found, 32, sampling=Sampling(T), limits=5.0)
    assert np.array_equal(code.program.memory.anti_windup, np.float32(gain[2:, :1]))
    code.save(tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror", cwd=tmp_path).splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2
    assert check_guarantee(tmp_path).proved


def test_its_words_say_what_happens_beyond_the_limit_and_the_folder_is_checked(tmp_path, capsys):
    exported().save(tmp_path)
    header = " ".join((tmp_path / "law.h").read_text().replace("*", " ").split())
    assert "adds G (sat(u) - u) to the rates of the law's own states" in header
    assert "exactly zero while nothing is cut" in header
    ran(capsys, "check", tmp_path)
    text = (tmp_path / "law.c").read_text()
    (tmp_path / "law.c").write_text(text.replace("{ -0.375", "{ -0.376"))
    assert "law.c is not what this version writes" in str(check_guarantee(tmp_path))


def test_code_without_limits_is_refused():
    with pytest.raises(InputError, match="its code must know where the inputs end; give --limit"):
        export_c99(design(), sampling=Sampling(T, False))


# --- in integers ---------------------------------------------------------------------------------

RANGES = {"x": 3.0, "law state 1": 2.0}


@cache
def in_words(bits, G=-0.375, limit=LIMIT):
    return export_c99(
        design(G), fixed=bits, sampling=Sampling(T, False), limits=limit, ranges=RANGES
    )


def share_of_what_is_stated(made, folder, count=600):
    """Return the largest error of a step of the state, as a share of what is stated of it."""
    code, claim = WordCode(made, folder), made.guarantee.claim
    scales, random, most = made.program.scales, np.random.default_rng(5), Fraction(0)
    E, off = gain_errors(claim), answer_errors(claim.code)
    (more,), (own_G,) = recovery_errors(claim), claim.code.G[0]
    s, t, (of_u, of_state) = scales.signals[0], scales.answers[0], scales.answers
    limit = Fraction(int(Fraction(LIMIT) * two(t))) * two(-t)
    time, G = Fraction(T), Fraction(-0.375)
    seen = set()
    for _ in range(count):
        x, z = (
            int(v)
            for v in random.uniform(-1, 1, 2) * (largest(made.program.number.bits), two(of_state))
        )
        (u, after), flags = code.update([], [x], [z])
        y = Fraction(x) * two(-s), Fraction(z) * two(-of_state)
        asked = sum(Fraction(g) * v for g, v in zip(GAINS, y, strict=True))
        cut = max(-limit, min(limit, asked))
        exact = y[1] + time * y[0] + time * G * (cut - asked)
        of_gain = [sum(e * abs(v) for e, v in zip(row, y, strict=True)) for row in E]
        error = time * of_gain[1] + off[1]
        near = abs(asked) + of_gain[0] + off[0] >= limit
        error += (more + abs(own_G) * of_gain[0]) if near else 0
        assert abs(Fraction(u) * two(-of_u) - cut) <= of_gain[0] + off[0]
        most = max(most, abs(Fraction(after) * two(-of_state) - exact) / error)
        seen.add(flags)
    assert seen == {0, LIMITED}
    return float(most)


@pytest.mark.parametrize("bits", [16, 32])
def test_steps_in_integers_are_within_what_is_stated(host_compiler, tmp_path, bits):
    made = in_words(bits)
    assert made.proved
    assert 0.3 < share_of_what_is_stated(made, tmp_path) <= 1


@pytest.mark.parametrize("left_out", ["what is cut off", "all of it"])
def test_without_a_term_of_what_is_stated_it_is_exceeded(
    host_compiler, tmp_path, monkeypatch, left_out
):
    made, plain = in_words(16), words.step_errors

    def less(bits, code, recovering, exact, scales):
        if left_out == "all of it":
            return [Fraction(0)]
        wide = replace(scales, beyond=scales.answers[:1])
        return plain(bits, code, recovering, exact, wide)

    monkeypatch.setattr(words, "step_errors", less)
    assert share_of_what_is_stated(made, tmp_path) > 1


@pytest.mark.parametrize("bits", [16, 32])
def test_integers_that_are_cut_are_proved_tested_and_recover(host_compiler, tmp_path, bits, capsys):
    made = in_words(bits)
    made.save(tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror -ftrapv", cwd=tmp_path).splitlines()
    assert lines[-1].endswith("passed (0 failed)")
    run("gcc", *STRICT, "-c", "law.c", "-o", "law.o", cwd=tmp_path)
    ran(capsys, "check", tmp_path)
    header = " ".join(made.files["law.h"].decode().replace("*", " ").split())
    assert "more then, and by G times the error of u" in header
    code, scales, x, z = WordCode(made, tmp_path), made.program.scales, 1.0, 0
    grown = np.exp(1.2 * T)
    for _ in range(1500):
        (u, z), _ = code.update([], [int(max(-3.0, min(3.0, x)) * 2 ** scales.signals[0])], [z])
        x = grown * x + (grown - 1) / 1.2 * 0.9 * u * 2.0 ** -scales.answers[0]
    assert abs(x) < 0.02


def test_integers_far_beyond_what_is_asked_do_not_wrap(host_compiler, tmp_path):
    for bits in (16, 32):
        made = in_words(bits)
        code, top = WordCode(made, tmp_path / str(bits)), largest(bits)
        edge = top << (made.program.scales.answers[1] - made.program.scales.signals[1])
        for x in (-top - 1, top):
            for z in (-(2 ** (2 * bits - 1)), -edge, 0, edge, 2 ** (2 * bits - 1) - 1):
                (u, after), flags = code.update([], [x], [z])
                assert abs(u) <= LIMIT * 2 ** made.program.scales.answers[0]
                assert abs(after) <= edge
                assert flags & LIMITED


def test_where_nothing_is_cut_integers_are_those_of_the_law_without_it(host_compiler, tmp_path):
    # the state of a law without it may have more bits: here both have the most that there are
    pair = [in_words(32, G, 1e6) for G in (-0.375, None)]
    assert pair[0].program.scales.answers == pair[1].program.scales.answers
    codes = [WordCode(made, tmp_path / f"{k}") for k, made in enumerate(pair)]
    for x, z in np.random.default_rng(6).integers(-(2**29), 2**29, (300, 2)):
        given = [], [int(x)], [int(z) << 30]
        assert codes[0].update(*given) == codes[1].update(*given)


def test_a_file_with_other_anti_windup_in_integers_is_refused(tmp_path):
    for change in (
        lambda code: code.pop("G"),
        lambda code: code["G"][0].__setitem__(0, "-1/3"),
        lambda code: code["scales"]["beyond"].__setitem__(0, 99),
        lambda code: code["scales"]["beyond"].__setitem__(
            0, in_words(16).program.scales.answers[0]
        ),
        lambda code: code["scales"]["recovering"].__setitem__(0, 60),
        lambda code: code["scales"].pop("recovering"),
    ):
        in_words(16).save(tmp_path)
        with rewritten(tmp_path / "guarantee.json") as whole:
            change(whole["claims"][0]["code"])
        try:
            proved = check_guarantee(tmp_path).proved
        except (FormatError, InputError, ValueError):
            proved = False
        assert not proved


def test_a_unit_of_fmi_has_it(host_compiler):
    whole = with_fmus(exported(), ("2.0",))
    assert any(name.endswith(".fmu") for name in whole.files)
    assert replace(whole, files={}).program.memory.anti_windup[0, 0] == -0.375


def test_a_pid_that_was_designed_at_samples_one_late_is_exported(tmp_path):
    """The inputs that its code's states have besides are none of the plant's remainder."""
    plant = design(None).plant
    bare = UncertainPlant.from_function(
        lambda a, b: ([[a]], [[b]]), plant.parameters, states=("x",), inputs=("u",), name="lag"
    )
    structure = Structure(measured=("x",), schedule=(), kind="pid", derivative_bandwidth=5.0)
    larger, gain = structure.extended(at_sample_time(bare, 0.02, 1))
    law = gain.law(larger, np.array([[[-6.0, -4.0, 0.0]]]))
    law = law.with_anti_windup(np.array([[0.0], [0.0], [-0.2], [0.0]]))
    found = analyse(larger, law, Disk(0, 0.99)).design
    assert found.plant.remainder is not None
    made = export_c99(found, 32, limits=LIMIT)
    assert made.proved
    made.save(tmp_path)
    assert check_guarantee(tmp_path).proved
    assert "proved at the samples" in " ".join(made.texts.statement)
