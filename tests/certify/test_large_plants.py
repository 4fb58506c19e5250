"""One loop of many states: poles, rms and gain by its modes, against Gramians and a Hamiltonian."""

import json

import numpy as np
import pytest
import scipy.linalg

import polefence as pf
from polefence.base.errors import InputError, PlantError
from polefence.law.laws import given_law
from polefence.lmi.solve.loops import loop_of
from polefence.lmi.solve.one_loop import modal, stabilising
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.proof.document import check, loads


def structure(modes: int, seed: int = 1, sample_time: float | None = None) -> UncertainPlant:
    """Return lightly damped modes in physical coordinates, positions above velocities."""
    random = np.random.default_rng(seed)
    w, damping = 10 ** random.uniform(0, 2, modes), 10 ** random.uniform(-3, -2, modes)
    turned = np.linalg.qr(random.normal(size=(modes, modes)))[0]
    stiffness, viscous = (turned @ np.diag(x) @ turned.T for x in (w**2, 2 * damping * w))
    none, eye = np.zeros((modes, modes)), np.eye(modes)
    A = np.block([[none, eye], [-stiffness, -viscous]])
    E = np.vstack([np.zeros((modes, 1)), random.normal(size=(modes, 1))])
    if sample_time is not None:
        moved = scipy.linalg.expm(np.block([[A, E], [np.zeros((1, 2 * modes + 1))]]) * sample_time)
        A, E = moved[:-1, :-1], moved[:-1, -1:]
    C = np.concatenate([random.normal(size=modes), np.zeros(modes)])
    y = Output("y", "m", C=[C.tolist()])
    return UncertainPlant.from_vertices(
        [A], [E], [E], name="structure", outputs=(y,), sample_time=sample_time
    )


def parts(plant: UncertainPlant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, E and C in floats."""
    vertex = plant.vertices[0]
    return vertex.A, vertex.E, np.array(plant.outputs[0].C, dtype=float)


def gain_of(A: np.ndarray, E: np.ndarray, C: np.ndarray) -> float:
    """Return the H-infinity norm by bisection with a Hamiltonian, in coordinates of the modes."""
    poles, V = np.linalg.eig(A)
    e, c = np.linalg.solve(V, E), C @ V
    at = np.abs(poles.imag)
    low = max(np.linalg.norm(c @ (e / (1j * w - poles)[:, None])) for w in at)
    high = 2 * low
    while high - low > 1e-7 * low:
        level = (low + high) / 2
        up, down = e @ e.conj().T / level, c.conj().T @ c / level
        H = np.block([[np.diag(poles), up], [-down, -np.diag(poles).conj()]])
        if np.abs(np.linalg.eigvals(H).real).min() < 1e-9 * np.abs(poles).max():
            low = level
        else:
            high = level
    return high


@pytest.mark.parametrize("modes", [12, 32])
def test_poles_rms_and_gain_are_proved_near_the_truth(modes, tmp_path):
    plant = structure(modes)
    A, E, C = parts(plant)
    decay = -np.linalg.eigvals(A).real.max()
    X = scipy.linalg.solve_continuous_lyapunov(A, -E @ E.T)
    truths = float(np.sqrt(C @ X @ C.T).item()), gain_of(A, E, C)
    limits = [pf.Rms("y", density=2.0), pf.Gain("y")]
    zero = np.zeros((1, 2 * modes))

    analysis = pf.analyse(plant, zero, pf.HalfPlane(0.99 * decay), limits=limits)

    assert analysis.proved, analysis.reason
    for truth, verified in zip(truths, analysis.bounds, strict=True):
        assert truth * (1 - 1e-7) < verified.bound.level < truth * (1 + 1e-4)
    path = analysis.save(tmp_path)
    assert pf.check(path).proved
    if modes > 12:  # what is not proved takes more digits, and longer
        return
    document = json.loads(path.read_text())
    levels = [claim for claim in document["claims"] if "level" in claim]
    for claim, truth in zip(levels, truths, strict=True):  # below the truth nothing is proved
        kept, claim["level"] = claim["level"], truth * (1 - 1e-6)
        assert not check(loads(json.dumps(document))).proved
        claim["level"] = kept
    X = document["claims"][0]["evidence"]["parts"][0]["X"][0]
    X[3][3] *= 0.5
    assert not check(loads(json.dumps(document))).proved


@pytest.mark.parametrize(
    ("region", "slowest"),
    [(pf.HalfPlane, "decay"), (pf.Sector, "damping"), (lambda r: pf.Disk(-40, 1 / r), "reach")],
    ids=["half_plane", "sector", "disk"],
)
def test_a_region_is_proved_up_to_the_worst_pole_and_refuted_beyond_it(region, slowest):
    plant, none = structure(35), np.zeros((1, 70))
    poles = np.linalg.eigvals(parts(plant)[0])
    truth = {
        "decay": -poles.real.max(),
        "damping": (-poles.real / np.abs(poles)).min(),
        "reach": 1 / np.abs(poles + 40).max(),
    }[slowest]
    assert pf.analyse(plant, none, region(truth * (1 - 1e-5))).kept == "proved"
    beyond = pf.analyse(plant, none, region(truth * (1 + 1e-5)))
    assert beyond.kept == "refuted"
    assert np.abs(poles - beyond.pole).min() < 1e-6
    assert not region(truth * (1 + 1e-5)).distance(np.array([beyond.pole])) < 0


@pytest.mark.parametrize(
    ("of", "centre"), [("half_plane", None), ("sector", None), ("disk", -40.0)], ids=str
)
def test_the_reach_of_many_states_is_proved_near_the_truth(of, centre):
    plant = structure(35)
    poles = np.linalg.eigvals(parts(plant)[0])
    reach = pf.worst_case(plant, np.zeros((1, 70)), of, centre)
    assert reach.region is not None
    assert reach.certificate.holds()
    proved, truth, sign = {
        "half_plane": (getattr(reach.region, "decay", 0), -poles.real.max(), -1),
        "sector": (getattr(reach.region, "damping", 0), (-poles.real / np.abs(poles)).min(), -1),
        "disk": (getattr(reach.region, "radius", 0), np.abs(poles + 40).max(), 1),
    }[of]
    assert 0 <= sign * (proved / truth - 1) < 1e-4


def test_samples_of_many_states_are_proved_too():
    plant = structure(35, sample_time=0.01)
    A, E, C = parts(plant)
    X = scipy.linalg.solve_discrete_lyapunov(A, E @ E.T / 0.01)  # of one-sided density 2
    limits = [pf.Rms("y", density=2.0)]
    analysis = pf.analyse(plant, np.zeros((1, 70)), pf.Disk(0, 1), limits=limits)
    assert analysis.proved, analysis.reason
    truth = float(np.sqrt(C @ X @ C.T).item())
    assert truth * (1 - 1e-7) < analysis.bounds[0].bound.level < truth * (1 + 1e-4)


REGIONS = [
    pf.HalfPlane(0.1),
    pf.Disk(-20, 19.95),
    pf.Sector(0.01),
    pf.HalfPlane(0.1) & pf.Sector(0.01),
]


@pytest.mark.parametrize("region", REGIONS, ids=str)
def test_modes_meet_the_inequality_of_any_region(region):
    random = np.random.default_rng(3)
    A = random.normal(size=(7, 7))
    A = A - (np.linalg.eigvals(A).real.max() + 1) * np.eye(7)
    plant = UncertainPlant.from_vertices([A], [np.eye(7)[:, :1]], name="random")
    loop = loop_of(plant, given_law(plant, np.zeros((1, 7))))
    (found,) = modal(loop, region)
    X = found.Q[0]
    assert np.linalg.eigvalsh(X).min() > 0
    for L, M in region.pairs():
        F = np.kron(L, X) + np.kron(M, A @ X) + np.kron(M.T, X @ A.T)
        assert np.linalg.eigvalsh(F).max() < 0
    assert not list(modal(loop, pf.HalfPlane(1.001)))  # whose slowest pole is at -1


def test_the_riccati_equation_is_solved_and_has_no_solution_below_the_gain():
    A, E, C = parts(structure(10))
    level = gain_of(A, E, C)
    S, Q = E @ E.T, C.T @ C
    X = stabilising(A, S / (1.01 * level), Q / (1.01 * level))
    rest = A.T @ X + X @ A + X @ S @ X / (1.01 * level) + Q / (1.01 * level)
    assert np.abs(rest).max() < 1e-6 * np.abs(A.T @ X).max()
    assert np.linalg.eigvals(A + S @ X / (1.01 * level)).real.max() < 0
    below = stabilising(A, S / (0.99 * level), Q / (0.99 * level))
    if below is not None:  # two roots of the axis, by rounding one on each side: it is no solution
        rest = A.T @ below + below @ A + below @ S @ below / (0.99 * level) + Q / (0.99 * level)
        assert np.abs(rest).max() > 1e-3 * np.abs(Q / level).max()


def test_larger_plants_and_searches_for_laws_are_refused():
    with pytest.raises(PlantError, match="302 states; at most 300"):
        structure(151)
    with pytest.raises(InputError, match="62 states; laws are sought for at most 60"):
        pf.place(structure(31), pf.HalfPlane(1e-4))
    with pytest.raises(InputError, match="62 states; laws are sought for at most 60"):
        pf.optimise(structure(31), pf.Rms("y"))
