"""C of a law of controllable dampers: its own coefficients, within their bounds whatever x."""

import ctypes
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import InputError, NotProvedError, semi_active
from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.export import damper_words
from polefence.export.damper import damper_sources
from polefence.proof.dampers import Curve, SemiActive
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
    for option in (["--lang", "fmu"], ["--board"], ["--sample-time", "0.001"], ["--limit", "3"]):
        said = refused(capsys, "export", saved, *option, "-o", tmp_path / "no")
        assert "a law of controllable dampers is exported without it" in said
    assert not (tmp_path / "no").exists()


# --- in fixed point ------------------------------------------------------------------------------

RANGES = {
    "suspension deflection": 0.15,
    "tyre deflection": 0.05,
    "sprung-mass velocity": 2.0,
    "unsprung-mass velocity": 5.0,
}
CURVES = (
    Curve(tuple((Fraction(v), Fraction(F)) for v, F in points))
    for points in (
        [(-1, -350), ("-0.1", -50), (0, 0), ("0.1", 80), (1, 600)],
        [(-1, -1800), ("-0.1", -600), (0, 0), ("0.1", 900), (1, 3000)],
    )
)
BENT = SemiActive(0, [[[Fraction(x) for x in (0, 0, -1, 1)]]], *CURVES)


def of_words(folder, bits, dampers):
    """The update of a folder's code in integers, with traps for what C leaves undefined."""
    traps = ["-ftrapv", "-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"]
    gcc, so = need("gcc"), folder / "law.so"
    made = run(gcc, *STRICT, *traps, "-shared", "-fPIC", folder / "law.c", "-o", so)
    assert not made.stderr
    update, word = ctypes.CDLL(str(so)).law_update, f"i{bits // 8}"

    def call(x):
        given, c = np.array(x, dtype=word), np.zeros(dampers, dtype=word)
        assert update(*(own.ctypes.data_as(ctypes.c_void_p) for own in (given, c))) == 0
        return [int(v) for v in c]

    return call


def force_of(damper, row, x, c=None):
    """The exact force c v of a state; of the law itself without c."""
    v = sum(r * y for r, y in zip(damper.rate[0][0], x, strict=True))
    if c is not None:
        return c * v
    u = sum(k * y for k, y in zip(row, x, strict=True))
    ends = sorted((damper.low.at(v), damper.high.at(v)))
    f = max(ends[0], min(ends[1], u))
    bounds = sorted(end * v for end in damper.ends)
    return max(bounds[0], min(bounds[1], f))


def worst_force(damper, row, words, signals, update, bits, seed=0, count=3000):
    """The largest error of the force, as a share of what is stated; c in its bounds throughout."""
    random, most, top = np.random.default_rng(seed), Fraction(0), 2 ** (bits - 1) - 1
    for k in range(count):
        size = 2.0 ** -random.integers(0, 14) if k % 3 else 1.0
        x = [int(v) for v in np.round(random.uniform(-1, 1, 4) * top * size)]
        if k % 5 == 0:
            x = [int(s) * top for s in random.choice([-1, 1], 4)]
        elif k % 5 == 1:  # a rate next to nothing, or next to a bend
            v = [0, 0.1, -0.1][k % 3] + random.normal() * 1e-3
            x[3] = min(top, max(-top, int((v + x[2] * 2.0 ** -signals[2]) * 2.0 ** signals[3])))
        c = Fraction(update(x)[0]) / 2**words.of_c
        assert damper.ends[0] <= c <= damper.ends[1]
        y = [Fraction(v) / Fraction(2) ** s for v, s in zip(x, signals, strict=True)]
        off = abs(force_of(damper, row, y, c) - force_of(damper, row, y))
        most = max(most, off / words.error)
    return float(most)


@pytest.fixture(scope="module")
def row(saved):
    return loads(saved.read_text()).claims[0].K[0][:4]


@pytest.mark.parametrize("bits", [16, 32])
def test_the_force_is_off_by_no_more_than_is_stated(saved, row, bits, tmp_path, capsys):
    both = [x for name, v in RANGES.items() for x in ("--range", f"{name} = {v}")]
    said = ran(capsys, "export", saved, "--fixed", bits, *both, "-o", tmp_path / "c")
    assert f"integers of {bits} bits" in said
    assert "clipped to 300 to 3000" in ran(capsys, "check", tmp_path / "c" / "guarantee.json")
    text = (tmp_path / "c" / "law.h").read_text() + (tmp_path / "c" / "law.c").read_text()
    assert not any(word in text for word in ("double", "<float.h>", "_real"))
    assert "changes the force of a damper by at most" in " ".join(text.split())
    damper = loads(saved.read_text()).claims[0].dampers[0]
    signals = damper_words.scales_of(list(RANGES), RANGES, bits)
    words = damper_words.in_words(row, damper, signals, bits)
    update = of_words(tmp_path / "c", bits, 1)
    assert 0.05 < worst_force(damper, row, words, signals, update, bits) <= 1


@pytest.mark.parametrize("bits", [16, 32])
def test_curves_in_integers(saved, row, bits, tmp_path, monkeypatch):
    document = loads(saved.read_text())
    bent = replace(document.claims[0], dampers=[BENT])
    monkeypatch.setattr("polefence.export.damper.prove", lambda claim: Proved())
    made = replace(document, claims=(bent,))
    for name, text in damper_sources(made, fixed=bits, ranges=RANGES).items():
        (tmp_path / name).write_bytes(text)
    signals = damper_words.scales_of(list(RANGES), RANGES, bits)
    words = damper_words.in_words(row, BENT, signals, bits)
    update = of_words(tmp_path, bits, 1)
    assert worst_force(BENT, row, words, signals, update, bits) <= 1
    # any integers at all
    for x in np.random.default_rng(1).choice([-(2 ** (bits - 1)), 2 ** (bits - 1) - 1], (40, 4)):
        assert words.least <= update(x)[0] <= words.most


class Proved:
    """A verdict: the test is about code, not about this law."""

    proved = True


def test_a_statement_without_one_of_its_terms_is_exceeded(saved, row, tmp_path):
    damper, signals = loads(saved.read_text()).claims[0].dampers[0], (17, 19, 13, 12)
    words = damper_words.in_words(row, damper, signals, 16)
    for name, text in damper_sources(loads(saved.read_text()), fixed=16, ranges=RANGES).items():
        (tmp_path / name).write_bytes(text)
    update = of_words(tmp_path, 16, 1)
    less = replace(words, error=words.error / 16)
    assert worst_force(damper, row, less, signals, update, 16, count=6000) > 1


def test_integers_without_ranges_or_room_are_refused(saved, capsys, tmp_path):
    base = ["export", saved, "--fixed", "16", "-o", tmp_path / "no"]
    assert "--fixed needs the range of suspension deflection" in refused(capsys, *base)
    both = [x for name, v in RANGES.items() for x in ("--range", f"{name} = {v}")]
    said = refused(capsys, *base, *both, "--range", "force = 3")
    assert "is of no signal of the law; these are: suspension deflection" in said
    assert "must be a positive number" in refused(capsys, *base, *both[:-1], "tyre deflection = -1")
    said = refused(capsys, "export", saved, *both, "-o", tmp_path / "no")
    assert "give --fixed too" in said
    narrow = SemiActive(
        0, BENT.rate, Curve.line(Fraction(1000, 3)), Curve.line(Fraction(100001, 300))
    )
    with pytest.raises(InputError, match="no integer lies between the bounds"):
        damper_words.in_words([Fraction(1)] * 4, narrow, (9, 9, 9, 9), 16)
