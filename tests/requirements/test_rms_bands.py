"""The rms in a band: against SciPy's filters, integrals over frequency, and direct searches."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import quad

import polefence as pf
from polefence import InputError, SpecError, optimise
from polefence.certify.bounds import best_bound, bounds_file, sampled
from polefence.certify.given import analyse
from polefence.cli.main import main
from polefence.examples import family
from polefence.law.laws import FixedGain
from polefence.law.structure import Structure
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms, filtered_by
from polefence.requirements.text import parse_specification
from polefence.requirements.weights import named
from polefence.response.samples import at_sample_time
from polefence.response.weighting import WK, BandFilter

DENSITY = 1e-3
SKYHOOK = FixedGain([[0, 0, -1500.0, 0]])
BANDS = [(4.0, 8.0), (0.5, 80.0), (4.0, 4.2), (0.0, 3.0), (0.001, 1000.0)]

MASS = """
states = ["x [m]", "v [m/s]"]
inputs = ["f [m/s2]"]
disturbances = ["w [m/s2]"]

[parameter.k]
range = [300, 500]

[matrices]
A = [[0, 1], ["-k", -2]]
B = [[0], [1]]
E = [[0], [1]]

[outputs]
"a [m/s2]" = {C = ["-k", -2], D = [1], F = [1]}
"""


@pytest.fixture(scope="module")
def car():
    return family("quarter-car-ride")


@pytest.fixture(scope="module")
def mass():
    return loads(MASS)


def butterworth(band):
    """Return the numerator and denominator that SciPy has."""
    low, high = (2 * np.pi * f for f in band)
    if low:
        return signal.butter(3, [low, high], "bandpass", analog=True)
    return signal.butter(4, high, analog=True)


@pytest.mark.parametrize("band", BANDS)
def test_the_filter_is_scipys(band):
    own = BandFilter(*band)
    f = np.geomspace(max(band[0], 0.1) / 10, 10 * band[1], 300)
    _, gain = signal.freqs(*butterworth(band), 2 * np.pi * f)
    assert np.allclose(own.gain(f), gain, atol=1e-10)
    A, B, C, D = own.state_space()
    away = 2j * np.pi * f[:, None, None] * np.eye(len(A)) - A
    assert np.allclose((C @ np.linalg.solve(away, B[None]) + D)[:, 0, 0], gain, atol=1e-10)
    assert not D.any()
    assert abs(own.gain(band[1])) ** 2 == pytest.approx(0.5)


def test_a_filter_of_white_noise_has_nearly_the_power_of_an_ideal_one():
    for band, more in (((4.0, 8.0), 1.0472), ((0.0, 3.0), 1.0262)):
        own = BandFilter(*band)
        power, _ = quad(lambda f, own=own: abs(own.gain(f)) ** 2, 0, 400, limit=800)
        assert power / (band[1] - band[0]) == pytest.approx(more, rel=1e-3)


def test_a_name_is_of_one_filter():
    for band in BANDS:
        own = BandFilter(*band)
        assert named(own.name) == own
        assert named(f"Wk, {own.name}").filters == (WK, own)
    for name in ("4 to 8.0 Hz", "4 to nine Hz", "Wx", "", "Wk, Wx"):
        assert named(name) is None


@pytest.mark.parametrize("weight", [None, "Wk"])
@pytest.mark.parametrize("band", BANDS[:4])
def test_values_are_integrals_over_frequency(car, band, weight):
    own = Rms("sprung-mass acceleration", density=DENSITY, weight=weight, band=band)
    found = sampled(car, SKYHOOK, own, np.eye(4)).values
    top = car.signal("sprung-mass acceleration")
    for j in range(4):
        vertex = car.vertices[j]
        C, D, _ = (rows[j] for rows in top.arrays(car))
        A, row, E = vertex.A + vertex.B @ SKYHOOK.K, C + D @ SKYHOOK.K, vertex.E

        def power(log, A=A, row=row, E=E):
            f = np.exp(log)
            H = (row @ np.linalg.solve(2j * np.pi * f * np.eye(4) - A, E)).item()
            _, by = signal.freqs(*butterworth(band), [2 * np.pi * f])
            return f * abs(H * by[0] * (WK.gain(f) if weight else 1)) ** 2

        parts = [1e-4, *(f for f in band if f), 1e3]
        logs = np.log(parts)
        square = sum(
            quad(power, low, high, limit=400, epsrel=1e-9)[0] for low, high in pairwise(logs)
        )
        assert found[j] == pytest.approx(np.sqrt(DENSITY * square), rel=1e-5)


@pytest.mark.parametrize("k", range(12))
def test_bounds_of_random_plants_are_tight(k):
    rng = np.random.default_rng([54, k])
    soft, damping = rng.uniform(50, 900), rng.uniform(1, 9)
    text = MASS.replace("[300, 500]", f"[{soft}, {soft * rng.uniform(1.1, 2)}]")
    plant = loads(text.replace("-2]", f"{-damping}]"))
    middle = np.sqrt(soft) / 2 / np.pi * rng.uniform(0.5, 2)
    own = Rms("v", density=2.0, band=(middle / 1.4, middle * 1.4))
    law = FixedGain([[rng.normal() * 10, -abs(rng.normal()) * 3]])
    bound = best_bound(plant, law, own)
    worst = sampled(plant, law, own, seeded(plant, 1000)).worst
    assert worst * (1 - 1e-9) <= bound.level < 1.002 * worst
    assert prove(bound.claim).proved
    assert not prove(replace(bound.claim, level=Fraction(0.9999 * worst))).proved


def test_a_ratio_is_of_the_band(mass):
    law, band = FixedGain([[0.0, -6.0]]), (2.0, 4.0)
    bound = best_bound(mass, law, RelativeRms("v", band=band))
    each = (
        sampled(mass, own, Rms("v", band=band), seeded(mass, 300)).values for own in (law, None)
    )
    worst = np.divide(*each).max()
    assert worst * (1 - 1e-9) <= bound.level < 1.002 * worst


def test_a_search_lowers_the_band_rather_than_all(mass):
    own, limit = Rms("a", band=(2.0, 4.0)), Rms("f", 1.0)
    done = optimise(mass, own, [limit], structure=Structure(schedule=()))
    worst = sampled(done.plant, done.law, own).worst
    assert worst * (1 - 1e-9) <= done.bounds[0].level < 1.01 * worst
    # no gain of a fine grid within the limit has less; it is worst between the vertices
    least, some = np.inf, np.array([[1 - t, t] for t in np.linspace(0, 1, 9)])
    for k in np.linspace(-60, 60, 25):
        for d in np.linspace(-1.9, 8, 34):
            law = FixedGain([[k, -d]])
            if sampled(mass, law, limit, some).worst <= 1:
                least = min(least, sampled(mass, law, own, some).worst)
    assert worst <= 1.001 * least


def test_samples_have_a_band_below_half_their_rate(mass):
    law, own = FixedGain([[0.0, -1.0]]), Rms("v", density=2.0, band=(2.0, 4.0))
    fine = sampled(mass, law, own).worst
    late = at_sample_time(mass, 0.005, 0)
    bound = best_bound(late, law, own)
    assert bound.level == pytest.approx(fine, rel=0.03)
    with pytest.raises(InputError, match="no frequency above 100 Hz, half the sample rate"):
        best_bound(late, law, replace(own, band=(2.0, 100.5)))


def test_a_line_has_weight_and_band():
    own = Rms("a", 2.0, density=DENSITY, weight="Wk", band=(4.0, 8.5))
    assert own.title == "rms of a with weight Wk with band [4, 8.5]"
    assert parse_specification(f"{own.title} <= 2 with density 0.001") == own
    assert own.unweighted() == Rms("a", 2.0, density=DENSITY)


@pytest.mark.parametrize("band", ["4", "[8, 4]", "[4]", "[4, 4.0000001]", '["a", 8]', "[-1, 3]"])
def test_a_band_that_is_none_is_refused(band, tmp_path):
    path = tmp_path / "mass.toml"
    row = '[[specification]]\nkind = "rms"\nsignal = "v"\nminimise = true\ndensity = 1\n'
    path.write_text(f"{MASS}\n{row}band = {band}\n")
    with pytest.raises(SpecError, match=r"band = .*write band = \[4, 8\]"):
        pf.load_specifications(path)


def test_a_file_says_which_band_and_check_compares_it(car, tmp_path, capsys):
    spec = tmp_path / "car.toml"
    assert main(["example", "quarter-car-ride"]) == 0
    spec.write_text(capsys.readouterr().out)
    own = Rms("sprung-mass acceleration", density=DENSITY, band=(4.0, 8.0))
    claim = best_bound(car, SKYHOOK, own).claim
    certificate = analyse(car, SKYHOOK, pf.HalfPlane(0)).certificate
    path = tmp_path / "design.json"
    path.write_text(bounds_file(certificate, [claim]).dumps())
    assert main(["check", str(path), "--spec", str(spec)]) == 0
    assert "behind the filter '4 to 8 Hz'" in capsys.readouterr().out
    (own,) = claim.filters
    other = replace(claim, filters=(replace(own, name="4 to 9 Hz"),))
    path.write_text(bounds_file(certificate, [other]).dumps())
    assert main(["check", str(path), "--spec", str(spec)]) == 1
    assert "'4 to 9 Hz' is not what its name says" in capsys.readouterr().out


@pytest.mark.parametrize("weight", [None, "Wk", ("Wk", "none")])
@pytest.mark.parametrize("band", [None, (4.0, 8.0)])
def test_names_of_filters_say_weight_and_band(weight, band):
    own = Rms(["a", "b"], weight=weight, band=band)
    again = Rms(["a", "b"], **filtered_by([one and one.name for one in own.filters]))
    assert again.filters == own.filters
    with pytest.raises(InputError, match="are not of one band"):
        filtered_by(["4 to 8 Hz", "4 to 9 Hz"])
    with pytest.raises(InputError, match="no filter 'band 4'"):
        filtered_by(["band 4"])
