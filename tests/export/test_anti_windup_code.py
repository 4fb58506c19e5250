"""Code of laws with anti-windup: it cuts, its states follow; nothing moves where nothing is cut."""

import ctypes
from dataclasses import replace
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
from polefence.export.vectors import LIMITED, vectors
from polefence.plant.larger import with_states
from polefence.plant.parameters import Parameter
from polefence.response.discrete import Sampling
from support import memories
from support.commands import ran
from support.cortex import run
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
    cut = vectors(made.program, made.design.law, (LIMIT,)).flags
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


def test_code_without_limits_or_in_integers_is_refused():
    sampling = Sampling(T, False)
    with pytest.raises(InputError, match="its code must know where the inputs end; give --limit"):
        export_c99(design(), sampling=sampling)
    with pytest.raises(InputError, match="--fixed 32: code in integers has no anti-windup"):
        export_c99(design(), sampling=sampling, fixed=32, limits=LIMIT, ranges={"x": 1.0})


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
