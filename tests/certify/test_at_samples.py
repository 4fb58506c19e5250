"""Laws of continuous time in the loop that a computer closes: as SciPy's exponentials have it."""

import json
import math

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    Disk,
    HalfPlane,
    InputError,
    PolynomialGain,
    Scheduled,
    Structure,
    UncertainPlant,
    analyse,
    at_sample_time,
    optimise,
    place,
)
from polefence.certify.at_samples import at_samples
from polefence.certify.design import Design
from polefence.examples import family
from polefence.export.guarantee import guarantee
from polefence.export.program import number, program
from polefence.plant.larger import own_states, with_actuator
from polefence.plant.spec import loads
from polefence.proof.document import check as check_document
from polefence.proof.document import loads as read
from support.specs import TWO_STATES, rms

T = 0.05
KINDS = {
    "one gain": lambda plant: place(plant, HalfPlane(0.05), "quadratic"),
    "Z W^-1": lambda plant: place(plant, HalfPlane(0.05), Scheduled(1, 0, "box")),
    "Z W^-1 on the simplex": lambda plant: place(plant, HalfPlane(0.05), "scheduled"),
    "degree 2": lambda plant: place(plant, HalfPlane(0.05), Scheduled(2, 0, "box")),
    "order 1": lambda plant: place(
        plant, HalfPlane(0.03), structure=Structure(("x",), (), order=1, largest_gain=2.0)
    ),
    "affine": lambda plant: (
        optimise(plant, rms("x"), [rms("force", 1.0)], structure=Structure()).design
    ),
}


@pytest.fixture(scope="module")
def plant():
    return loads(TWO_STATES)


@pytest.fixture(scope="module", params=KINDS)
def design(plant, request):
    return KINDS[request.param](plant)


def by_hand(plant, design, alpha, delay):
    """The matrix from one sample to the next: the plant by its exponential, the law's numbers."""
    A, B = (own[:2, :size] for own, size in zip(design.plant.at(alpha), (2, 1), strict=True))
    whole = expm(np.block([[A, B], [np.zeros((1, 3))]]) * T)
    F, G, K = whole[:2, :2], whole[:2, 2:], design.law.gain(alpha[None])[0]
    kept = own_states(design.plant)
    of_x, of_z = K[:, :2], K[:, 2:]
    own = np.hstack([T * of_x[1:], np.eye(kept) + T * of_z[1:]])
    u = np.hstack([of_x[:1], of_z[:1]])
    acting = np.hstack([F, np.zeros((2, kept))])
    if not delay:
        return np.vstack([acting + G @ u, own])
    rows = [np.hstack([acting, G]), np.hstack([own, np.zeros((kept, 1))])]
    return np.vstack([*rows, np.append(u, [[0.0]], axis=1)])


def points(plant):
    """Six values alpha of the family."""
    for point in np.random.default_rng(2).random((6, len(plant.parameters))):
        pairs = zip(plant.parameters, point, strict=True)
        yield plant.alpha(
            **{p.name: float(p.low) + s * (float(p.high) - float(p.low)) for p, s in pairs}
        )


@pytest.mark.parametrize("delay", [0, 1])
def test_the_loop_is_the_one_that_a_computer_closes(plant, design, delay):
    seen, law = at_samples(design.plant, design.law, T, delay)
    assert own_states(seen) == own_states(design.plant)
    assert seen.shape[0] == design.plant.shape[0] + delay
    entries = max(float(x) for row in seen.remainder.entries for x in row)
    for alpha in points(plant):
        A, B = seen.at(alpha[None])
        mine = np.poly(np.linalg.eigvals((A + B @ law.gain(alpha[None]))[0]))
        other = np.poly(np.linalg.eigvals(by_hand(plant, design, alpha, delay)))
        assert np.allclose(mine, other, atol=1e-10 + 50 * entries)


@pytest.mark.parametrize("delay", [0, 1])
def test_its_decay_is_proved_and_its_file_checks(plant, design, delay):
    seen, law = at_samples(design.plant, design.law, T, delay)
    slowest = max(
        float(np.abs(np.linalg.eigvals(by_hand(plant, design, alpha, delay))).max())
        for alpha in points(plant)
    )
    found = analyse(seen, law, Disk(0, 1 - 0.5 * (1 - slowest)))
    assert found.proved
    text = found.certificate.file().dumps()
    assert check_document(read(text)).proved
    kinds = {table["kind"] for table in json.loads(text)["claims"]}
    assert kinds == {"region", "samples"}
    assert not analyse(seen, law, Disk(0, slowest - 1e-3)).proved


@pytest.mark.parametrize(("method", "region"), [("quadratic", (-40, 35)), ("scheduled", (-40, 31))])
def test_the_rounding_of_its_code_is_proved_beside_it(method, region):
    """The car's force is on its way in N: a gain of it that is zero costs no room."""
    car = family("quarter-car-physical")
    seen, law = at_samples(car, place(car, Disk(*region), method).law, 0.001, 1)
    found = analyse(seen, law, Disk(0, math.exp(-0.005)))
    made = guarantee(Design(found.certificate), program(law, car.parameters, number(32)))
    assert made.proved
    assert made.share < 0.1


@pytest.mark.parametrize(("delay", "limit"), [(0, 2.0), (1, 1.0)])
def test_the_proof_reaches_the_limit_of_an_integrator(delay, limit):
    # z = 1 - k T, and z^2 - z + k T = 0
    plant = UncertainPlant.from_vertices([[[0]]], [[[1]]])
    law = place(plant, Disk(-4, 1), "quadratic").law
    k = -float(law.K[0, 0])
    for share, proved in ((0.99, True), (1.01, False)):
        seen, own = at_samples(plant, law, share * limit / k, delay)
        assert analyse(seen, own, Disk(0, 1)).proved is proved
    assert math.isclose(float(own.K[0, 0]), -k)


def test_samples_are_not_sampled_again(plant):
    seen = at_sample_time(plant, T)
    with pytest.raises(InputError, match="in discrete time already"):
        at_samples(seen, [[-1.0, -1.0]], T)


def test_a_law_may_measure_an_output():
    """The output keeps its name at the samples: the file is read with it."""
    car = with_actuator(family("quarter-car-ride"), "actuator force", 40)
    measured = (car.signal("sprung-mass acceleration"), car.signal("suspension deflection"))
    law = PolynomialGain([(0, 0)], [[[-60.0, 400.0]]], measured, car.parameters)
    seen, late = at_samples(car, law, 0.001, 1)
    assert [own.name for own in late.measured] == [own.name for own in measured]
    found = analyse(seen, late, Disk(0, 1))
    assert found.proved
    assert check_document(read(found.certificate.file().dumps())).proved
