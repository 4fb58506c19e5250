"""Linearised plants: Jacobians by hand, how far the polytope misses them, what cannot be done."""

import math

import numpy as np
import pytest

from polefence import MultiAffinityError, Parameter, PlantError, UncertainPlant, linearise

G = 9.81
MASS, LENGTH = Parameter("m", "0.1", "0.3", "kg"), Parameter("l", "0.3", "0.7", "m", "1/l")
NAMES = {"name": "cart and pole", "inputs": ("force [N]",)}


def cart(x, u, m, l, M=1.0):  # noqa: E741
    _, v, angle, rate = x
    s, c = np.sin(angle), np.cos(angle)
    total = M + m * s**2
    a = (u[0] + m * s * (l * rate**2 - G * c)) / total
    return [v, a, rate, (-u[0] * c - m * l * rate**2 * c * s + (M + m) * G * s) / (l * total)]


def test_the_vertices_are_the_jacobians_at_the_corners():
    found = linearise(cart, np.zeros(4), [0], [MASS, LENGTH], declared=True, **NAMES)
    plant = found.plant
    assert plant.name == "cart and pole"
    assert [p.name for p in plant.parameters] == ["m", "l"]
    for m in (0.1, 0.22, 0.3):
        for l in (0.3, 0.41, 0.7):  # noqa: E741
            A, B = plant.at(plant.alpha(m=m, l=l, clamp=True))
            own = np.zeros((4, 4))
            own[0, 1] = own[2, 3] = 1
            own[1, 2], own[3, 2] = -m * G, (1 + m) * G / l
            np.testing.assert_allclose(A, own, rtol=1e-13, atol=1e-13)
            np.testing.assert_allclose(B[:, 0], [0, 1, 0, -1 / l], rtol=1e-13)
    assert found.error < 1e-14
    assert "declared multi-affine" in str(found)


def test_what_is_not_declared_is_said_to_be_unproved():
    plain = Parameter("l", "0.3", "0.7", "m")
    found = linearise(cart, np.zeros(4), [0], [MASS, plain], **NAMES)
    assert found.plant.name == "cart and pole, linearised"
    # 1 / l against its chord: the largest share of 1 / 0.3 is (1 - sqrt(0.3 / 0.7))^2
    chord = (1 - np.sqrt(0.3 / 0.7)) ** 2
    assert 0.97 * chord < found.error < chord * (1 + 1e-12)
    assert found.place == "B[4][1]"
    assert found.values["l"] == pytest.approx(np.sqrt(0.21), abs=0.02)
    assert str(found).startswith(
        "unproved: what is proved of 'cart and pole, linearised' holds for"
    )
    with pytest.raises(MultiAffinityError, match=r"B\[4\]\[1\] is not multi-affine in m, l"):
        linearise(cart, np.zeros(4), [0], [MASS, plain], declared=True, **NAMES)


def test_an_equilibrium_may_depend_on_parameters():
    def magnet(x, u, m):
        gap, v = x
        return [v, G - (u[0] / gap) ** 2 / m]

    mass = Parameter("m", 1, 2)
    found = linearise(magnet, [0.01, 0], lambda m: [0.01 * np.sqrt(m * G)], [mass])
    for m, A, B in zip((1, 2), found.plant.A, found.plant.B, strict=True):
        assert A[1, 0] == pytest.approx(2 * G / 0.01)
        assert B[1, 0] == pytest.approx(-2 * np.sqrt(G / m) / 0.01)
    with pytest.raises(PlantError, match=r"not an equilibrium at m = 1: component 2 of f is 9.8"):
        linearise(magnet, [0.01, 0], [0.0], [mass])


def test_disturbances_outputs_and_discrete_time():
    def step(x, u, w, a):
        return np.array([a * np.sin(x[0]) + u[0] + 3 * w[0]])

    def speed(x, u, w, a):
        return a * x[0] + 2 * u[0] - w[0]

    a = Parameter("a", "0.2", "0.6")
    words = {
        "sample_time": "0.01",
        "outputs": {"speed [m/s]": speed},
        "disturbances": ("gust [N]",),
    }
    found = linearise(step, [0], [0], [a], w0=[0], declared=True, **words)
    plant = found.plant
    np.testing.assert_allclose(plant.A[:, 0, 0], [0.2, 0.6])
    assert [float(v.exact_E[0][0]) for v in plant.vertices] == [3, 3]
    own = plant.signal("speed")
    C, D, F = own.arrays(plant)
    np.testing.assert_allclose(C[:, 0], [0.2, 0.6])
    assert (D[0, 0], F[0, 0], own.unit) == (2, -1, "m/s")
    assert float(plant.sample_time) == 0.01
    with pytest.raises(PlantError, match=r"component 1 of f - x0 is -0.8"):
        linearise(step, [1], [0], [a], w0=[0], **words)


def of(rates):
    return lambda: linearise(rates, [0, 0], [0], [Parameter("k", 1, 2)])


BAD = {
    "abs": (of(lambda x, u, k: [x[1], -k * x[0] + u[0] - abs(x[1] + 1) + 1]), "cannot be diff"),
    "real": (of(lambda x, u, k: [x[1], u[0] - k * np.real(x[0])]), "component 2"),
    "float": (of(lambda x, u, k: [x[1], -k * float(x[0]) + u[0]]), "component 2"),
    "math": (of(lambda x, u, k: [x[1], -k * math.sin(x[0]) + u[0]]), "component 2"),
    "index": (of(lambda x, u, k: [x[1], -k * x[2] + u[0]]), "f fails at k = 1"),
    "kink": (of(lambda x, u, k: [x[1], u[0] - k * (x[0] if x[0] > 0 else 0)]), "cannot be diff"),
    "length": (of(lambda x, u, k: [x[1]]), "f must return 2 finite numbers"),
    "infinite": (of(lambda x, u, k: [x[1], u[0] + np.inf]), "f must return 2 finite numbers"),
    "name": (of(lambda x, u: [x[1], u[0]]), "unexpected keyword argument 'k'"),
    "text": (lambda: linearise(cart, "nothing", [0], [MASS]), "x0 must be a list of numbers"),
    "none": (lambda: linearise(cart, [0] * 4, [0], []), "needs a parameter"),
    "no input": (of(lambda x, u, k: [x[1], -k * x[0]]), "B is zero"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_linearised_is_one_line(name):
    call, said = BAD[name]
    with pytest.raises(PlantError, match=said) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_random_rational_plants_are_those_of_expressions():
    """The same plant, by f and by expressions: vertices agree to rounding."""
    random = np.random.default_rng(3)
    for _ in range(5):
        a, b, c = random.uniform(0.5, 2, 3).tolist()

        def f(x, u, k, m, a=a, b=b, c=c):
            return [x[1] + a * x[0] * x[1], (-k * np.sin(x[0]) - b * x[1] + c * u[0]) / m]

        box = [Parameter("k", 1, 3), Parameter("m", 2, 5, through="1/m")]
        found = linearise(f, [0, 0], [0], box, declared=True)
        rows = [["0", "1"], ["-k/m", f"{-b!r}/m"]]
        known = UncertainPlant.from_expressions(box, rows, [["0"], [f"{c!r}/m"]])
        np.testing.assert_allclose(found.plant.A, known.A, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(found.plant.B, known.B, rtol=1e-13, atol=1e-13)
