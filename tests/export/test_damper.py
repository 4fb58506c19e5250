"""C of a law of controllable dampers: its own coefficients, within their bounds whatever x."""

import ctypes
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import InputError, NotProvedError, semi_active
from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.export.damper import damper_sources
from polefence.proof.document import loads
from polefence.requirements.rms import Rms
from polefence.vehicle import Damper
from support.commands import ran, refused
from support.needed import need
from support.shapes_of_laws import STRICT, run

HALF = ("front", "rear")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """The example's law, saved by the command."""
    folder = tmp_path_factory.mktemp("damper")
    (folder / "damper.toml").write_text(spec_text("semi-active"))
    words = ["semi-active", str(folder / "damper.toml"), "--degree", "2", "-o", str(folder)]
    assert main(words) == 0
    return folder / "law.json"


def library(folder):
    """The update of a folder's code, compiled: x to what it returns and c."""
    gcc = need("gcc")
    made = run(gcc, *STRICT, "-shared", "-fPIC", folder / "law.c", "-o", folder / "law.so")
    assert not made.stderr
    update = ctypes.CDLL(str(folder / "law.so")).law_update
    update.restype = ctypes.c_uint32

    def call(x, kind, dampers):
        given, c = np.array(x, dtype=kind), np.full(dampers, np.nan, dtype=kind)
        pointers = (own.ctypes.data_as(ctypes.c_void_p) for own in (given, c))
        return update(*pointers), c

    return call


def expected(K, rates, low, high, x):
    found = []
    for row, rate in zip(K, rates, strict=True):
        v, u = rate @ x, row @ x
        found.append(np.clip(u / v, low, high) if v else low)
    return found


@pytest.mark.parametrize(("bits", "kind", "close"), [(32, "f4", 2e-3), (64, "f8", 1e-9)])
def test_the_code_sets_the_coefficients_of_the_law(saved, bits, kind, close, tmp_path, capsys):
    folder = tmp_path / "code"
    assert main(["export", str(saved), "--float", str(bits), "-o", str(folder)]) == 0
    assert "clipped to 300 to 3000" in ran(capsys, "check", folder / "guarantee.json")
    update, claim = library(folder), loads(saved.read_text()).claims[0]
    K = np.array([[float(x) for x in row] for row in claim.K])
    rates = np.array([[0.0, 0, -1, 1]])
    source, kinds = np.random.default_rng(2), set()
    for _ in range(2000):
        x = source.standard_normal(4) * [0.02, 0.005, 0.2, 0.5]
        x = x.astype(kind).astype(float)
        status, c = update(x, kind, 1)
        wanted = expected(K, rates, 300, 3000, x)
        assert status == 0
        assert 300 <= c[0] <= 3000
        if abs(rates[0] @ x) > 1e-3:
            assert c == pytest.approx(wanted, rel=close)
        kinds.add("low" if c[0] == 300 else "high" if c[0] == 3000 else "between")
    assert kinds == {"low", "high", "between"}


def test_whatever_is_given_the_bounds_are_kept(saved, tmp_path):
    for name, text in damper_sources(loads(saved.read_text()), 32).items():
        (tmp_path / name).write_bytes(text)
    update, largest = library(tmp_path), np.finfo("f4").max
    for x in ([np.nan, 0, 0, 0], [0, np.inf, 0, 0], [0, 0, -np.inf, 1], [largest] * 4):
        status, c = update(x, "f4", 1)
        assert (status, c[0]) == (1, 300)
    for x in ([0, 0, 0, 0], [1, 1, 0.5, 0.5], [1, 0, 0, 1e-45], [1, 0, 0, -1e-45]):
        status, c = update(x, "f4", 1)
        assert status == 0
        assert 300 <= c[0] <= 3000
    assert update([0, 0, 0, 0], "f4", 1)[1][0] == 300


def test_two_dampers_of_a_half_car(tmp_path):
    plant = family("half-car")
    dampers = [Damper(f"{k} force", f"{k} suspension deflection", 300, 2000) for k in HALF]
    named = ["driver acceleration", "front tyre deflection", "rear tyre deflection"]
    law = semi_active(plant, Rms(named, density=2e-3), dampers)
    for name, text in damper_sources(law.file(), 32).items():
        (tmp_path / name).write_bytes(text)
    update = library(tmp_path)
    rates = np.array([[float(x) for x in own.rate[0][0]] for own in law.claim.dampers])
    source = np.random.default_rng(3)
    for _ in range(200):
        x = source.standard_normal(8).astype("f4").astype(float)
        status, c = update(x, "f4", 2)
        assert status == 0
        assert c == pytest.approx(expected(law.K, rates, 300, 2000, x), rel=0.05)


def test_what_cannot_be_exported_is_refused(saved, tmp_path, capsys):
    document = loads(saved.read_text())
    claim = document.claims[0]
    with pytest.raises(InputError, match="no claim about a law of controllable dampers"):
        damper_sources(replace(document, claims=()))
    louder = replace(claim, limit=replace(claim.limit, level=claim.limit.level / 2))
    with pytest.raises(NotProvedError, match="not proved"):
        damper_sources(replace(document, claims=(louder,)))
    finer = [[x * (1 + Fraction(1, 10**10)) for x in row] for row in claim.K]
    with pytest.raises(InputError, match="not a number of 32 bits"):
        damper_sources(replace(document, claims=(replace(claim, K=finer),)), 32)
    for option in (["--lang", "fmu"], ["--sample-time", "0.001"], ["--limit", "3"]):
        said = refused(capsys, "export", saved, *option, "-o", tmp_path / "no")
        assert "a law of controllable dampers is exported without it" in said
    assert not (tmp_path / "no").exists()
