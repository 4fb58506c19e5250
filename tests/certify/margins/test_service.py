"""Margins in service: against numbers known in closed form, samples, simulation, and each other."""

import json
import math
import re
from itertools import product

import numpy as np
import pytest

from polefence import (
    InputError,
    Parameter,
    Scheduled,
    UncertainPlant,
    load,
    optimise,
    place,
    tightest,
)
from polefence.base.errors import DesignFileError
from polefence.certify.design import check
from polefence.certify.given import analyse
from polefence.certify.margins import estimation_error, gain_error, in_service, parameter_rate
from polefence.certify.margins.claims import climb
from polefence.certify.margins.estimate import EstimateQuestion
from polefence.certify.margins.service import _Task
from polefence.cli.main import main
from polefence.examples import spec_path
from polefence.proof.claims.base import prove
from polefence.region.regions import Disk, HalfPlane, Sector
from polefence.requirements.text import load_specifications
from support.commands import ran
from support.files import rewritten

BOX, BOX0 = Scheduled(1, 1, "box"), Scheduled(1, 0, "box")


def oscillator(m="1/m", k="k") -> UncertainPlant:
    parameters = [Parameter("m", 1, 2, "kg", m), Parameter("k", 1, 9, "N/m", k)]
    return UncertainPlant.from_expressions(
        parameters, [["0", "1"], ["-k/m", "-1/m"]], [["0"], ["1/m"]]
    )


def two_inputs() -> UncertainPlant:
    """Stiffness through 1/c, c negative; two inputs of unlike strength."""
    parameters = [Parameter("c", -2, -1, "m/N", "1/c"), Parameter("d", 0, 1)]
    return UncertainPlant.from_expressions(
        parameters, [["0", "1"], ["1/c", "-d"]], [["0.1", "0"], ["0", "1 + d/2"]]
    )


def scattered(seed: int, n: int, m: int, spread: float) -> UncertainPlant:
    """Three vertices without parameters."""
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    As = [A + spread * random.normal(size=(n, n)) for _ in range(3)]
    return UncertainPlant.from_vertices(As, [B + spread * random.normal(size=(n, m)) for _ in As])


DESIGNS = {
    "box": (oscillator, Disk(-3, 2.2), BOX),
    "simplex": (oscillator, Disk(-3, 2.2), "scheduled"),
    "degree 2": (oscillator, Disk(-3, 2.0), Scheduled(2, 0, "box")),
    "two inputs": (two_inputs, HalfPlane(1) & Sector(0.4) & Disk(-6, 5.5), BOX),
    "one gain": (two_inputs, Disk(-4, 3.5), "quadratic"),
    "vertices": (lambda: scattered(6, 3, 1, 0.1), Disk(-4, 3.6), "scheduled"),
    "vertices, degree 2": (lambda: scattered(6, 3, 1, 0.1), Disk(-4, 3.5), Scheduled(2, 0)),
    "slack": (two_inputs, Disk(-4, 3.5), "slack"),
}
# the same laws, proved again with Lyapunov polynomials
GIVEN = ("box", "two inputs", "one gain", "vertices")
ALL = (*DESIGNS, *(f"{name}, given" for name in GIVEN))
# one gain needs no estimate
SCHEDULED = [name for name in ALL if not name.startswith(("one gain", "slack"))]


@pytest.fixture(scope="module")
def services():
    designs = {name: place(plant(), *asked) for name, (plant, *asked) in DESIGNS.items()}
    for name in GIVEN:
        own = designs[name]
        designs[f"{name}, given"] = analyse(own.plant, own.law, own.region).design
    assert tuple(designs) == ALL
    return {name: in_service(design, 0.05) for name, design in designs.items()}


def test_everything_is_proved(services):
    for name, service in services.items():
        assert service.proved, name
        for margin in service:
            assert margin.value > 0, (name, margin)
            assert margin.upper is None or margin.upper > margin.value
    names = [margin.name for margin in services["box"]]
    assert names == ["estimate-m", "estimate-k", "estimate", "gain", "rate-m", "rate-k", "rate"]
    assert [m.name for m in services["vertices"]] == ["estimate", "gain", "rate"]
    assert [m.name for m in services["one gain"]] == ["gain", "rate"]
    assert math.isinf(services["one gain"]["rate"].value)
    assert [m.unit for m in services["box"]][:2] == ["kg", "N/m"]
    # known apart, each is at least as large as its share when all are wrong at once
    for name, span in (("m", 1.0), ("k", 8.0)):
        assert services["box"][f"estimate-{name}"].value >= services["box"]["estimate"].value * span
        assert services["box"][f"rate-{name}"].value >= services["box"]["rate"].value * span


@pytest.mark.parametrize("name", SCHEDULED)
def test_poles_stay_where_the_estimate_is_wrong(services, name):
    """Errors up to what is proved, of all sizes and signs, against numpy's eigenvalues."""
    service, random = services[name], np.random.default_rng(1)
    design = service.design
    plant = design.plant
    for margin in service:
        if margin.kind != "estimate":
            continue
        if plant.parameters:
            low, high = (np.array([float(getattr(p, b)) for p in plant.parameters]) for b in ENDS)
            values = low + (high - low) * random.uniform(-0.1, 1.1, (300, len(low)))
            values = np.clip(values, low, high)
            share = np.array(
                [margin.value if p.name == margin.parameter else 0.0 for p in plant.parameters]
            )
            share = share if margin.parameter else margin.value * (high - low)
            moves = random.choice([-1, 1, 0.5], values.shape) * share
            own = np.clip(values + moves, low, high)
            pair = [alphas(plant, each) for each in (own, values)]
        else:
            N, eta = len(plant.vertices), margin.value
            kept = (1 - eta) * random.dirichlet(np.full(N, 0.4), 300)
            pair = [kept + eta * random.dirichlet(np.full(N, 0.2), 300) for _ in range(2)]
        A, B = plant.at(pair[0])
        poles = np.linalg.eigvals(A + B @ design.law.gain(pair[1]))
        assert design.region.contains(poles)


ENDS = ("low", "high")


def alphas(plant, values):
    names = [p.name for p in plant.parameters]
    return np.array([plant.alpha(**dict(zip(names, row, strict=True))) for row in values])


@pytest.mark.parametrize("name", ALL)
def test_poles_stay_where_the_gain_is_wrong(services, name):
    design, margin = services[name].design, services[name]["gain"]
    random = np.random.default_rng(2)
    N, (n, m) = len(design.plant.vertices), design.plant.shape
    sizes = np.array(margin.claim.sizes, dtype=float)
    if design.plant.parameters:
        shares = random.uniform(0, 1, (500, 2))
        alpha = np.array([np.kron([1 - s, s], [1 - t, t]) for s, t in shares])
    else:
        alpha = random.dirichlet(np.full(N, 0.5), 500)
    D = random.choice([-1.0, 1.0], size=(500, m, n))
    D[::5] *= random.uniform(size=(100, m, n))
    K = design.law.gain(alpha)
    A, B = design.plant.at(alpha)
    off = margin.value * D * sizes
    assert design.region.contains(np.linalg.eigvals(A + B @ (K + off)))
    # each gain is measured by its own size: that of no corner is larger
    corners = np.abs(design.law.gain(np.eye(N)))
    assert np.allclose(corners.max(axis=0), sizes, rtol=1e-15)
    # and not much more breaks: errors that move would, where what is proved holds for them too
    assert margin.upper is None or margin.upper <= 4.5 * margin.value


@pytest.mark.parametrize("name", ALL)
def test_what_is_said_to_break_does(services, name):
    """The errors are those of the example, and a pole is out."""
    broken = [margin for margin in services[name] if margin.upper is not None]
    assert broken
    for margin in broken:
        distance = by_the_gain if margin.kind == "gain" else by_the_estimate
        assert distance(services[name].design, margin) > -1e-3, margin.name


def region_distance(design, loops):
    return design.region.distance(np.linalg.eigvals(loops)).max()


def by_the_estimate(design, margin):
    """How far outside the farthest pole is, the parameters taken for the example's."""
    if not design.plant.parameters:
        own, estimate = (
            np.array(part.split(", "), dtype=float)
            for part in re.findall(r"\(([^)]*)\)", margin.example)
        )
        assert np.abs(own - estimate).sum() / 2 <= margin.upper * (1 + 1e-3)
        pair = [point[None] / point.sum() for point in (own, estimate)]
    else:
        words = [part.split(" = ")[1].split(" taken for ") for part in margin.example.split(", ")]
        own, estimate = np.array(words, dtype=float).T
        moved = dict(zip([p.name for p in design.plant.parameters], own - estimate, strict=True))
        if margin.parameter:
            assert abs(moved[margin.parameter]) <= margin.upper * (1 + 1e-4)
            assert sum(abs(v) > 0 for v in moved.values()) == 1
        pair = [alphas(design.plant, each[None]) for each in (own, estimate)]
    A, B = design.plant.at(pair[0])
    return design.region.distance(np.linalg.eigvals(A + B @ design.law.gain(pair[1]))).max()


def by_the_gain(design, margin):
    """How far outside an error of the size said moves a pole at the example's alpha, at most."""
    alpha = np.array(re.search(r"\(([^)]*)\)", margin.example)[1].split(", "), dtype=float)
    A, B = design.plant.at(alpha / alpha.sum())
    K = design.law.gain(alpha / alpha.sum())
    sizes = np.abs(design.law.gain(np.eye(len(design.plant.vertices)))).max(axis=0)
    signs = np.array(list(product((-1, 1), repeat=K.size))).reshape(-1, *K.shape)
    off = A + B @ (K + margin.upper * signs * sizes)
    return region_distance(design, off)


# --- one state: poles, and what is proved, in closed form ----------------------------------------


@pytest.fixture(scope="module")
def single():
    """x' = p x + u, the pole p + K(q)."""
    plant = UncertainPlant.from_expressions([Parameter("p", 1, 3, "1/s")], [["p"]], [["1"]])
    return place(plant, Disk(-2, 0.5), BOX)


def test_one_state_estimates(single):
    margin = in_service(single)["estimate-p"]
    q = np.linspace(1, 3, 4001)
    K = single.law.gain(alphas(single.plant, q[:, None]))[:, 0, 0]
    room = np.min(np.where(q < 3, 0.5 - (q + K + 2), np.inf)), np.min(0.5 + (q + K + 2))
    # p - q is limited by the interval too: the pole has to leave inside it
    reach = np.linspace(0, 2, 4001)
    breaks = [
        e
        for e in reach
        if (np.clip(q + e, 1, 3) + K + 2 > 0.5).any() or (np.clip(q - e, 1, 3) + K + 2 < -0.5).any()
    ]
    assert min(room) > 0
    assert margin.value == pytest.approx(breaks[0], rel=0.01)
    assert margin.value <= breaks[0] <= margin.upper * (1 + 1e-3)
    assert margin.upper == pytest.approx(margin.value, rel=0.03)


def test_one_state_gains(single):
    margin = gain_error(single)
    q = np.linspace(1, 3, 2001)
    K = single.law.gain(alphas(single.plant, q[:, None]))[:, 0, 0]
    room = (0.5 - np.abs(q + K + 2)).min()
    ((scale,),) = margin.claim.sizes
    assert margin.value * float(scale) == pytest.approx(room, rel=0.01)
    assert margin.value * float(scale) <= room <= margin.upper * float(scale) * (1 + 1e-3)


def test_one_state_rates(single):
    """V = x^2 / W: what is proved is 2 (p + K) - (dW/dp) rate / W + 2 a < 0, no more, no less."""
    for decay in (0.0, 1.0):
        (margin,) = parameter_rate(single, decay)
        q, (W0, W1) = np.linspace(1, 3, 2001), single.law.W[:, 0, 0]
        K = single.law.gain(alphas(single.plant, q[:, None]))[:, 0, 0]
        W, slope = W0 + (W1 - W0) * (q - 1) / 2, (W1 - W0) / 2
        limit = (-2 * (q + K + decay) * W / abs(slope)).min()
        assert margin.value == pytest.approx(limit, rel=0.03)
        assert margin.value <= limit
    assert not parameter_rate(single, 4.0)[0].proved  # faster than the poles are


# --- motion --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["box", "degree 2", "vertices", "box, given", "two inputs, given", "vertices, given"]
)
def test_v_decays_along_every_motion(services, name):
    """A parameter moves to and fro as fast as is proved; V exp(2 a t) must fall at each step."""
    service, random = services[name], np.random.default_rng(3)
    design, rate = service.design, service["rate"].value
    plant, law = design.plant, design.law
    boxed = bool(plant.parameters)
    if boxed:
        low, high = (np.array([float(getattr(p, b)) for p in plant.parameters]) for b in ENDS)
        place_, speed = (low + high) / 2, rate * (high - low)
    else:
        place_ = np.full(len(plant.vertices), 1 / len(plant.vertices))
    x, h = random.normal(size=plant.shape[0]), 1e-4
    # the motion of p is slow against h: a step of x with the middle's A + B K is enough
    values = []
    for step in range(300):
        if step % 50 == 0:
            turn = random.choice([-1.0, 1.0], len(place_))
            to, off = random.choice(len(place_), 2, replace=False)
        if boxed:
            there = np.clip(place_ + turn * speed * h, low, high)
        else:
            move = min(rate * h, place_[off])
            there = place_ + move * (np.eye(len(place_))[to] - np.eye(len(place_))[off])
        before, middle, after = (
            plant.alpha(**dict(zip([p.name for p in plant.parameters], v, strict=True)))
            if boxed
            else v / v.sum()
            for v in (place_, (place_ + there) / 2, there)
        )
        A, B = plant.at(middle)
        F = A + B @ law.gain(middle)
        moved = x + h * F @ (x + h / 2 * F @ (x + h / 3 * F @ x))
        margin = service["rate"]
        values.append(energy(margin, law, after, moved) / energy(margin, law, before, x))
        x, place_ = moved / np.linalg.norm(moved), there
    assert max(values) * math.exp(2 * service.decay * h) < 1
    # it does come near: the rate is no triviality
    assert max(values) > 1 - 20 * h


def energy(margin, law, alpha, x):
    """x' X(alpha)^-1 x, X the Lyapunov polynomial of the claim."""
    X = W = np.tensordot(law.domain.basis(alpha, law.degree), law.W, 1)
    if margin.design.method == "lyapunov":
        own = margin.design.certificate.evidence["parts"][margin.claim.part]
        basis = law.domain.basis(alpha, own["degree"])
        V = basis @ own["multiple"] * np.eye(len(W)) + np.tensordot(basis, own["X"], 1) @ W
        X = W @ V
    return x @ np.linalg.solve(X, x)


# --- answers, files, command ---------------------------------------------------------------------


def test_another_region_is_kept(services):
    own = services["box"]
    design = own.design
    stable = estimation_error(design, region=HalfPlane(0))[0]
    assert stable.value > own["estimate-m"].value
    assert gain_error(design, region=HalfPlane(0)).value > own["gain"].value
    refused = gain_error(design, region=Disk(-3, 0.5))
    assert (refused.answer, refused.value, refused.text) == ("undecided", 0.0, "-")
    with pytest.raises(InputError, match="is not a region"):
        in_service(design, region="half_plane(0)")


def test_another_region_is_proved_anew_of_a_law_that_was_given(services):
    """Each part of the region has its own evidence; another region has others."""
    for name in ("two inputs, given", "slack", "one gain, given"):
        own = services[name]
        stable = in_service(own.design, 0.05, region=HalfPlane(0))
        assert stable.proved
        assert stable["gain"].value > own["gain"].value
        assert stable["gain"].design.method == "lyapunov"
        assert stable["gain"].design.region == HalfPlane(0)
        assert stable["rate"].value == own["rate"].value
        (claim,) = json.loads(stable.file(stable["gain"]).dumps())["claims"]
        assert claim["region"]["kind"] == "half_plane"
        assert claim["method"] == "lyapunov"
        refused = in_service(own.design, 0.05, region=Disk(-3, 0.05))
        assert refused["gain"].answer == "undecided"
        assert refused["gain"].upper is not None


def test_margins_of_a_given_law_lie_on_both_sides(services):
    """Proved below what breaks, and not absurdly far below."""
    for name in (f"{n}, given" for n in GIVEN):
        for margin in services[name]:
            if margin.upper is not None:
                assert margin.upper / 20 < margin.value < margin.upper, (name, margin)
    assert math.isinf(services["one gain, given"]["rate"].value)
    assert services["box, given"]["rate-m"].claim.part == 0


def test_a_law_that_proves_no_polynomial_is_undecided():
    """Of a slack design at its very limit nothing may be proved: said, no traceback."""
    design = tightest(oscillator(), -3, "slack")
    service = in_service(design, region=Disk(-3, design.region.radius * 0.9))
    assert service["gain"].answer == "undecided"
    assert service["gain"].claim is None
    assert service["gain"].design is None


def test_what_has_no_margins(services):
    with pytest.raises(InputError, match="must be a Design"):
        in_service(oscillator())
    for decay in (-1, math.nan, "1"):
        with pytest.raises(InputError, match="decay"):
            parameter_rate(services["box"].design, decay)


def test_files_are_proved_afresh(services, tmp_path):
    for name in ("box", "one gain", "vertices", "two inputs, given", "slack"):
        service = services[name]
        paths = service.save(tmp_path / name)
        assert [path.stem for path in paths] == [margin.name for margin in service]
        for path in paths:
            assert check(path).proved
            assert "nothing" not in str(check(path))
    path = tmp_path / "box" / "estimate-m.json"
    with rewritten(path) as document:
        document["claims"][0]["errors"][0] *= 1.05
    assert check(path).answer == "undecided"
    path.write_text("{")
    with pytest.raises(DesignFileError, match="cut short"):
        check(path)


def test_the_command(services, tmp_path, capsys):
    design = services["box"].design.save(tmp_path)
    out, summary = tmp_path / "out", tmp_path / "summary.json"
    words = ["service", str(design), "--decay", "0.05", "-o", str(out), "--json", str(summary)]
    printed = ran(capsys, *words)
    rows = json.loads(summary.read_text())["margins"]
    for row, margin in zip(rows, services["box"], strict=True):
        assert row["value"] == margin.value
        assert f"{margin.subject}" in printed
        assert margin.text in printed
    spec = tmp_path / "spec.toml"
    spec.write_text(SPEC)
    for path in sorted(out.iterdir()):
        assert "proved: " in ran(capsys, "check", path, "--spec", spec)
    spec.write_text(SPEC.replace("9]", "8]"))
    assert main(["check", str(path), "--spec", str(spec)]) == 1
    with rewritten(path) as document:
        document["claims"][0]["rates"] = [1000, 1000]
    assert main(["check", str(path)]) == 1
    assert main(["service", str(design), "--decay", "50", "--region", "half_plane(0)"]) == 1
    assert main(["service", str(design), "--decay", "-1"]) == 2
    assert main(["service", str(path)]) == 2
    document["claims"][0]["surprise"] = 1
    path.write_text(json.dumps(document))
    assert main(["check", str(path)]) == 2


SPEC = """
name = "plant"
[parameter.m]
range = [1, 2]
unit = "kg"
through = "1/m"
[parameter.k]
range = [1, 9]
unit = "N/m"
[matrices]
A = [[0, 1], ["-k/m", "-1/m"]]
B = [[0], ["1/m"]]
"""


def test_the_car(physical):
    """The numbers of docs/service.md."""
    service = in_service(place(physical, Disk(-40, 31), BOX0))
    assert service["estimate-m1"].value == pytest.approx(3.27, abs=0.01)
    assert service["estimate-m1"].upper == pytest.approx(10.98, abs=0.05)
    assert [m.answer for m in service] == ["proved"] * 7


def test_values_print(services):
    assert str(services["one gain"]["rate"]) == "rate of change, all at once: any"
    text = str(services["box"])
    assert text.startswith("error of the estimate, m: ")
    assert " kg, breaks at " in text
    assert "7 margins" in repr(services["box"])
    assert all(isinstance(m.upper, float | None) for s in services.values() for m in s)


def test_a_law_for_signals_has_margins_of_a_smaller_region():
    """Its own matrices, of the region of all stable loops, leave next to none."""
    path = spec_path("quarter-car-ride")
    least, limits = load_specifications(path)
    car = optimise(load(path), least, limits, HalfPlane(0), method="scheduled").design
    own = _Task(car, car.region, car)
    spans = [span for _, _, span in own.spans()]
    bare = EstimateQuestion(own.loops, own.parameters, spans[-1])
    margins = {one.name: one for one in in_service(car).margins}
    assert next(climb(bare)).value < 1e-3
    for name in ("estimate", "rate"):
        assert margins[name].value > 0.01
        assert margins[name].design.region == car.region
        assert all(prove(claim).proved for claim in margins[name].file(car).claims)
