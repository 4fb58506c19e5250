"""Gains in a band of frequencies: against frequency responses on grids, and in every command."""

import json
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound
from polefence.certify.refutation import least_of_any, refute_limits
from polefence.certify.robust.attained import attained
from polefence.cli.main import main
from polefence.plant.larger import with_states
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import from_plain
from polefence.proof.work import FormatError
from polefence.requirements.gain import Gain
from polefence.requirements.specification import limit_text
from polefence.requirements.text import parse_specification
from polefence.response.modes import Modes
from polefence.response.peaks import largest, peaks, response
from support.specs import MASS_ON_SPRING

K = np.array([[-20.0, -4.0]])
LAW = "[[-20, -4]]"


def random_plant(seed, period=None):
    """Two vertices with two outputs and two disturbances, a light resonance near 0.5 Hz in each."""
    random = np.random.default_rng(seed)
    n, As = 4, []
    T = np.eye(n) + 0.3 * random.normal(size=(n, n))
    for w in (3.0, 3.6):
        A = np.diag([-0.2, -0.2, -2.0, -6.0])
        A[0, 1], A[1, 0] = w, -w
        As.append(T @ A @ np.linalg.inv(T))
    if period:
        As = [np.eye(n) + period * A + (period * A) @ (period * A) / 2 for A in As]
    B, E = random.normal(size=(n, 1)), random.normal(size=(n, 2))
    outputs = [
        Output(f"y{k}", C=random.normal(size=n), D=[0.1], F=0.3 * random.normal(size=2))
        for k in range(2)
    ]
    more = {} if period is None else {"sample_time": period}
    plant = pf.UncertainPlant.from_vertices(As, [B, B], [E, E], **more)
    return plant, outputs, 0.02 * random.normal(size=(1, n))


def in_band(plant, outputs, gain, band, points=80, grid=1500):
    """The largest singular value over a grid of vertices' shares and frequencies of the band."""
    f, T, worst = np.linspace(*band, grid), float(plant.period), 0.0
    z = np.exp(2j * np.pi * f * T) if T else 2j * np.pi * f
    for share in np.linspace(0, 1, points):
        alpha = np.array([[1 - share, share]])
        (A,), (B,) = (M for M in plant.at(alpha))
        (E,) = plant.driven(alpha)
        C, D, F = (
            np.concatenate([np.tensordot(alpha[0], y.arrays(plant)[k], 1)[None] for y in outputs])
            for k in range(3)
        )
        G = response(*(M[None] for M in (A + B @ gain, E, C + D @ gain, F)), z[None])
        worst = max(worst, float(largest(G).max()))
    return worst


@pytest.mark.parametrize(
    ("seed", "period", "band"),
    [(0, None, (0.8, 2)), (1, None, (0, 0.3)), (2, Fraction(1, 10), (0.9, 5))],
)
def test_a_bound_is_bracketed_in_the_band_and_more_is_outside(seed, period, band):
    plant, outputs, gain = random_plant(seed, period)
    true, law = in_band(plant, outputs, gain, band), pf.FixedGain(gain)
    own = Gain(outputs, band=band)
    found = best_bound(plant, law, own)
    assert true * (1 - 1e-9) <= found.level <= true * 1.001
    assert kept_bound(plant, law, Gain(outputs, 1.001 * true, band=band)) is not None
    assert kept_bound(plant, law, Gain(outputs, 0.999 * true, band=band)) is None
    highest = 1 / (2 * float(period)) if period else 10
    assert in_band(plant, outputs, gain, (0, highest)) > 1.2 * true
    assert kept_bound(plant, law, Gain(outputs, 1.001 * true)) is None


def test_what_is_attained_is_attained_in_the_band():
    plant, outputs, gain = random_plant(3)
    whole = attained(plant, pf.FixedGain(gain), Gain(outputs), [Fraction(1), Fraction(0)])
    for band in ((0.8, 2), (0.1, 0.2), (0.5, 0.5001)):
        own = Gain(outputs, band=band)
        square = attained(plant, pf.FixedGain(gain), own, [Fraction(1), Fraction(0)])
        true = in_band(plant, outputs, gain, band, points=1)
        assert float(square) ** 0.5 == pytest.approx(true, rel=1e-4)
        assert square < whole


@pytest.mark.parametrize("seed", range(4))
def test_peaks_in_a_band_are_those_of_a_grid(seed):
    random = np.random.default_rng(seed)
    n, count = 5, 3
    A = random.normal(size=(count, n, n))
    A -= (np.linalg.eigvals(A).real.max(axis=1)[:, None, None] + 0.05) * np.eye(n)
    E, C = random.normal(size=(count, n, 2)), random.normal(size=(count, 2, n))
    F = random.normal(size=(count, 2, 2))
    for low, high in ((0.0, 0.4), (0.9, 1.1), (2.0, 30.0), (50.0, 1e5)):
        loops, w, height = peaks(Modes(A), E, C, F, (low, high))
        assert np.all((w >= low) & (w <= high))
        grid = np.linspace(low, high, 4000) if high < 40 else np.geomspace(low, high, 4000)
        for k in range(count):
            some = [M[k : k + 1] for M in (A, E, C, F)]
            most = largest(response(*some, 1j * grid[None])).max()
            assert most * (1 - 1e-9) <= height[loops == k].max() <= most * (1 + 1e-3)


# --- as it is asked, and refused ------------------------------------------------------------------


def test_a_line_and_a_table_say_the_band():
    own = parse_specification("gain of x from [w] <= 3 with band [4, 8]")
    assert own == Gain("x", 3.0, disturbances=["w"], band=(4, 8))
    assert parse_specification(limit_text(own)) == own
    assert own.title == "gain of x from [w] with band [4, 8]"
    both = parse_specification("gain of x <= 3 with at samples with band [0, 0.5]")
    assert (both.at, both.band) == ("samples", (0.0, 0.5))
    assert parse_specification(limit_text(both)) == both


@pytest.mark.parametrize(
    "band", ["4", "[4]", "[8, 4]", "[4, 4]", "[-1, 4]", "[4, inf]", "[1, 2, 3]", "[2, 2.000001]"]
)
def test_what_is_no_band_is_refused(band):
    with pytest.raises(SpecError, match=r"must be two numbers in Hz.*write band = \[4, 8\]"):
        parse_specification(f"gain of x <= 3 with band {band}")


@pytest.mark.parametrize(
    ("spec", "why"),
    [
        (
            MASS_ON_SPRING.replace("range = [80, 120]", "range = [80, 120]\nrate = [-3, 3]"),
            "moves, and",
        ),
        (MASS_ON_SPRING.replace('"-k"', '"-90*cos(k/100)"'), "have a remainder"),
        (MASS_ON_SPRING + "[dead_time.force]\ntime = 0.02\n", "dead time"),
    ],
)
def test_plants_of_which_none_is_proved_are_refused(spec, why):
    with pytest.raises(InputError, match=why):
        Gain("position", 3.0, band=(1, 2)).require_fit(loads(spec))


def test_plants_at_a_sample_time_are_refused_unless_they_are_given_in_discrete_time():
    plant = pf.at_sample_time(loads(MASS_ON_SPRING), 0.01)
    with pytest.raises(InputError, match="between samples there is no frequency response"):
        Gain("position", 3.0, band=(1, 2)).require_fit(plant)
    with pytest.raises(InputError, match="samples, and functions of parameters, have a remainder"):
        Gain("position", 3.0, at="samples", band=(1, 2)).require_fit(plant)
    own, outputs, _ = random_plant(0, Fraction(1, 10))
    Gain(outputs, 3.0, band=(1, 5)).require_fit(own)
    with pytest.raises(InputError, match="no frequency above 5 Hz"):
        Gain(outputs, 3.0, band=(1, 5.01)).require_fit(own)


def test_no_limit_of_every_law_is_said_of_a_band():
    plant = loads(MASS_ON_SPRING)
    tight = [Gain("force", 1e-6)]  # which leaves the plant as it is
    assert least_of_any(plant, Gain("position"), tight, 0.1) is not None
    assert least_of_any(plant, Gain("position", band=(1, 2)), tight, 0.1) is None
    assert refute_limits(plant, [Gain("position", 1e-3), *tight]) is not None
    assert refute_limits(plant, [Gain("position", 1e-3, band=(1, 2)), *tight]) is None


# --- commands, and files --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bands")
    (path / "mass.toml").write_text(MASS_ON_SPRING)
    words = [
        "--gain",
        LAW,
        "--region",
        "half_plane(0.3)",
        "--limit",
        "gain of position with band [2, 3]",
    ]
    assert main(["verify", str(path / "mass.toml"), *words, "-o", str(path / "made")]) == 0
    return path


def test_check_prints_the_band_and_refuses_a_wider_one(folder):
    document = json.loads((folder / "made" / "design.json").read_text())
    claim = document["claims"][-1]
    assert claim["band"] == [2, 3]
    read = from_plain(document)
    assert prove(read.claims[-1]).proved
    assert "at every frequency from 2 to 3 Hz" in read.claims[-1].said(read.plant)
    for band, answer in (([1.9, 3], False), ([0, 3], False), ([2.1, 2.9], True)):
        claim["band"] = band
        assert prove(from_plain(document).claims[-1]).proved is answer
    del claim["band"]
    assert not prove(from_plain(document).claims[-1]).proved
    claim["band"] = [2, 3]
    claim["level"] *= 0.999
    assert not prove(from_plain(document).claims[-1]).proved


@pytest.mark.parametrize("band", [[3, 2], [2], "2, 3", [2, 2], [-1, 2], [2, 1e10], [2, None]])
def test_a_file_with_another_band_is_refused(folder, band):
    document = json.loads((folder / "made" / "design.json").read_text())
    document["claims"][-1]["band"] = band
    with pytest.raises(FormatError, match="band"):
        from_plain(document)


def test_a_band_is_printed_within_itself(folder):
    document = json.loads((folder / "made" / "design.json").read_text())
    for ends, text in (
        (["2000001/1000000", 3], "from 2.00001 to 3 Hz"),
        ([2, "2999999/1000000"], "from 2 to 2.99999 Hz"),
    ):
        document["claims"][-1]["band"] = ends
        read = from_plain(document)
        assert text in read.claims[-1].said(read.plant)
    for ends in ([2, "2000001/1000000"], ["20000001/10000000", "20000003/10000000"]):
        document["claims"][-1]["band"] = ends
        with pytest.raises(FormatError, match="band: its ends must differ in six digits"):
            from_plain(document)


def test_a_law_is_found_for_a_limit_and_as_an_objective(folder):
    plant = loads(MASS_ON_SPRING)
    wide, band = Gain("position"), Gain("position", band=(2, 3))
    limits = [Gain("force", 0.5)]
    (least,) = pf.optimise(plant, band, limits).bounds[:1]
    done = pf.optimise(plant, wide, limits)
    assert least.level < 0.99 * best_bound(plant, done.law, band).level
    with pytest.raises(InputError, match="no LMI has its band"):
        pf.optimise(plant, band, limits, method="quadratic")


@pytest.mark.parametrize("band", [None, (0.5, 3)])
def test_states_of_a_law_do_not_count_where_there_is_no_law(band):
    """They are integrators then, on which no signal depends; nor does a force that is zero."""
    plant = loads(MASS_ON_SPRING)
    larger, alpha = with_states(plant, 2), np.eye(2)
    for signal in ("position", "force"):
        own = Gain(signal, band=band)
        values = own.values(larger, None, alpha)
        assert values == pytest.approx(own.values(plant, None, alpha), rel=1e-12)
        assert np.all(values > 0) == (signal == "position")
