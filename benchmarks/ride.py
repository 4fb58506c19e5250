"""A car's ride under limits: one LMI in CVXPY with Clarabel against the search and its proof.

python benchmarks/ride.py
python benchmarks/ride.py --rounds 5 --skip-optimise

The quarter car "quarter-car-ride" on a class C road at 20 m/s: the least worst rms of the sprung
mass's acceleration, with limits on the rms of tyre deflection, suspension deflection and actuator
force, and with a region for the poles or without. One Lyapunov matrix W(alpha) proves everything.

The peer is that LMI written by hand in CVXPY over Clarabel, with its own settings; it is scaled
as polefence scales (states, input, time; each signal in units of its limit), and proves nothing.
Ours are the search of `polefence.lmi.solve.performance.least`, from the plant on, and the exact
proof with the law's own W: of the bound, and of the bound, the limits and the region. For
information `optimise` as a whole, which answers more: a law, each bound with a Lyapunov polynomial
of its own; and so of a half car: eight states, two forces, mass and inertia uncertain, limits on
two of tyre deflections, spring deflections and forces. All run in one process on one thread, turn
by turn; times are medians of wall-clock times, data from the plant to arrays not counted; of
`optimise` the processor's time. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"
os.environ["RAYON_NUM_THREADS"] = "1"

import argparse
import gc
import platform
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from importlib.metadata import version
from itertools import product
from statistics import median
from typing import Any

import cvxpy as cp
import numpy as np

import polefence
from polefence import FixedGain, HalfPlane, Scheduled, ScheduledGain, Sector
from polefence.certify.certificate import Certificate
from polefence.examples import family
from polefence.law.laws import Law, right_divide
from polefence.lmi.conditions.methods import Method
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.performance import Problem, least
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.spec import loads
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.laws import Evidence
from polefence.region.regions import Region
from polefence.requirements.rms import Rms
from polefence.requirements.specification import Specification, claim_of, disturbance
from polefence.response.stationary import velocity_psd
from polefence.search.optimise import optimise

DENSITY = velocity_psd(256e-6, 20.0)  # class C, 20 m/s
COMFORT = Rms("sprung-mass acceleration", None, DENSITY)
LIMITS = (
    Rms("tyre deflection", 4.72e-3, DENSITY),
    Rms("suspension deflection", 27e-3, DENSITY),
    Rms("actuator force", 700.0, DENSITY),
)
REGIONS: dict[str, Region | None] = {
    "none": None,
    "decay >= 1": HalfPlane(1),
    "decay >= 1, damping >= 0.15": HalfPlane(1) & Sector(0.15),
}
LAWS: dict[str, tuple[Method, int]] = {
    "scheduled": (Scheduled(1, 0, "box"), 1),
    "one gain": ("quadratic", 0),
}
# how far above what was found the exact proof is attempted, as in polefence.certify.bounds
STEPS = (1e-7, 1e-6, 1e-5, 1e-4)
INSIDE = 0.95  # as in polefence.search.optimise


@dataclass(frozen=True)
class Case:
    """A row: plant, region and method."""

    plant: UncertainPlant
    name: str
    region: Region | None
    law: str

    @property
    def method(self) -> Method:
        return LAWS[self.law][0]

    @property
    def degree(self) -> int:
        return LAWS[self.law][1]


@dataclass
class Times:
    """Seconds of every round."""

    peer: list[float] = field(default_factory=list)
    solver: list[float] = field(default_factory=list)
    search: list[float] = field(default_factory=list)
    bound: list[float] = field(default_factory=list)
    everything: list[float] = field(default_factory=list)


HALF_CAR = """
name = "half car"
states = [
    "front deflection [m]", "rear deflection [m]", "heave velocity [m/s]", "pitch rate [rad/s]",
    "front wheel velocity [m/s]", "rear wheel velocity [m/s]",
    "front tyre deflection [m]", "rear tyre deflection [m]",
]
inputs = ["front force [N]", "rear force [N]"]
disturbances = ["front road velocity [m/s]", "rear road velocity [m/s]"]

[constants]
a = 1.2         # m, from the centre of mass to the axles
b = 1.5
kf = 18000      # N/m
kr = 22000
cf = 1000       # N s/m
cr = 1000
mf = 40         # kg, wheels
mr = 40
kt = 200000     # N/m, tyres

[parameter.m]
range = [550, 700]
unit = "kg"
through = "1/m"

[parameter.J]
range = [900, 1200]
unit = "kg m^2"
through = "1/J"

[matrices]
A = [
    [0, 0, 1, "-a", -1, 0, 0, 0],
    [0, 0, 1, "b", 0, -1, 0, 0],
    ["-kf/m", "-kr/m", "-(cf+cr)/m", "(a*cf-b*cr)/m", "cf/m", "cr/m", 0, 0],
    ["a*kf/J", "-b*kr/J", "(a*cf-b*cr)/J", "-(a**2*cf+b**2*cr)/J", "-a*cf/J", "b*cr/J", 0, 0],
    ["kf/mf", 0, "cf/mf", "-a*cf/mf", "-cf/mf", 0, "-kt/mf", 0],
    [0, "kr/mr", "cr/mr", "b*cr/mr", 0, "-cr/mr", 0, "-kt/mr"],
    [0, 0, 0, 0, 1, 0, 0, 0],
    [0, 0, 0, 0, 0, 1, 0, 0],
]
B = [[0, 0], [0, 0], ["1/m", "1/m"], ["-a/J", "b/J"], ["-1/mf", 0], [0, "-1/mr"], [0, 0], [0, 0]]
E = [[0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [-1, 0], [0, -1]]

[outputs."heave acceleration [m/s2]"]
C = ["-kf/m", "-kr/m", "-(cf+cr)/m", "(a*cf-b*cr)/m", "cf/m", "cr/m", 0, 0]
D = ["1/m", "1/m"]
"""
TYRES = {"front tyre deflection": 4.7e-3, "rear tyre deflection": 4.7e-3}
FORCES = {"front force": 500.0, "rear force": 500.0}
SPRINGS = {"front deflection": 25e-3, "rear deflection": 25e-3}
HALF_LIMITS = {
    "tyres and forces": TYRES | FORCES,
    "springs and forces": SPRINGS | FORCES,
    "tyres and springs": TYRES | SPRINGS,
}
HALF_REGION = HalfPlane(1) & Sector(0.1)


# --- the peer ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Data:
    """What the LMI is made of, scaled: [A B; C D] at the vertices, the noise, the limits."""

    rows: Array
    EE: Array
    limits: tuple[float | None, ...]
    pairs: tuple[tuple[Array, Array], ...]
    states: int


def scaled(case: Case) -> Data:
    """Return the data in our coordinates: states, input and time; signals over their limits."""
    plant = case.plant
    scaling = _scaling(plant)
    A, B = scaling.apply(plant.A, plant.B)
    E = np.linalg.solve(scaling.T, disturbance(plant)[0])
    levels, C, D = [], [], []
    for own in (COMFORT, *LIMITS):
        output = own.condition(plant, _domain(plant), own.at_most or 1.0)[1]
        C.append(output.C @ scaling.T / output.level)
        D.append(output.D @ scaling.S / output.level)
        levels.append(1.0 if own.at_most else None)
    top = np.concatenate([A, B], axis=2)
    below = np.concatenate([np.concatenate(C, axis=1), np.concatenate(D, axis=1)], axis=2)
    pairs = () if case.region is None else case.region.pairs(scaling.rate)
    EE = DENSITY / 2 * E @ E.T / scaling.rate
    return Data(np.concatenate([top, below], axis=1), EE, tuple(levels), tuple(pairs), A.shape[1])


def by_hand(data: Data, degree: int) -> tuple[float, float]:
    """Write the LMI on the box of two parameters and solve it; return the rms, and Clarabel's time.

    W(alpha) and Z(alpha) are constant or of degree 1 in each parameter; products have degree 2,
    and each of their nine Bernstein coefficients (four where W is constant) is an inequality.
    """
    n, m = data.states, data.rows.shape[2] - data.states
    corners = list(product((0, 1), repeat=2))
    W = [cp.Variable((n, n), symmetric=True) for _ in (corners if degree else [0])]
    Z = [cp.Variable((m, n)) for _ in W]
    WZ = [cp.vstack(both) for both in zip(W, Z, strict=True)]
    square = cp.Variable()
    coefficients: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for (j, a), (k, b) in product(enumerate(corners), enumerate(corners)):
        if degree:
            coefficients.setdefault((a[0] + b[0], a[1] + b[1]), []).append((j, k))
        elif k == 0:
            coefficients[a] = [(j, 0)]
    constraints = []
    for terms in coefficients.values():
        weight = len(terms)
        X = sum(W[k] for _, k in terms)
        P = sum(data.rows[j] @ WZ[k] for j, k in terms)
        N = P[:n]
        constraints.append(-(N + N.T + weight * data.EE) >> 0)
        for i, limit in enumerate(data.limits):
            Y = P[n + i : n + i + 1]
            corner = (
                np.array([[weight * limit**2]])
                if limit
                else cp.reshape(weight * square, (1, 1), "F")
            )
            constraints.append(cp.bmat([[corner, Y], [Y.T, X]]) >> 0)
        for L, M in data.pairs:
            part = cp.kron(L, X) + cp.kron(M, N) + cp.kron(M.T, N.T)
            constraints.append(-part >> 0)
    problem = cp.Problem(cp.Minimize(square), constraints)
    problem.solve(solver=cp.CLARABEL)
    if problem.status != cp.OPTIMAL:
        raise SystemExit(f"Clarabel: {problem.status}")
    return float(np.sqrt(square.value)), problem.solver_stats.solve_time


# --- ours ----------------------------------------------------------------------------------------


def _scaling(plant: UncertainPlant) -> Scaling:
    return balanced(plant.A, plant.B, typical_rate(plant.A))


def _domain(plant: UncertainPlant) -> Domain:
    return Domain.of("box", len(plant.vertices))


@dataclass(frozen=True)
class Ours:
    """What the search found: the rms, the law, and W over t."""

    rms: float
    law: Law
    W: Array


def searched(case: Case, question: Problem) -> Ours:
    """Search from the plant on: a law within the region, the limits, and the least rms."""
    plant, inside = case.plant, case.region or HalfPlane(0)
    values = smallest(plant.A, plant.B, Around(inside), case.method, enough=INSIDE).values
    if not case.degree:
        values = {"W1": values["W"], "Z1": values["Z"]}
    start = {k: v for k, v in values.items() if k[0] in "WZ"}
    found = least(question, start, _scaling(plant))
    count = _domain(plant).count(case.degree)
    (t,) = found.t.values()
    W, Z = (np.stack([found.values[f"{x}{k + 1}"] for k in range(count)]) / t for x in "WZ")
    law: Law = FixedGain(right_divide(Z, W)[0])
    if case.degree:
        law = ScheduledGain(W, Z, plant.parameters, case.degree, _domain(plant).sizes)
    return Ours(float(np.sqrt(found.r)), law, W)


def asked(case: Case) -> Problem:
    """Return the LMI as polefence has it."""
    plant, domain = case.plant, _domain(case.plant)
    outputs = [s.condition(plant, domain) for s in LIMITS]
    outputs.append(COMFORT.condition(plant, domain, 1.0))
    return Problem(
        plant.A,
        plant.B,
        (outputs[0][0],),
        tuple(output for _, output in outputs),
        case.region,
        domain,
        case.degree,
        0,
    )


def evidence(ours: Ours) -> Evidence:
    """Return the law's own W: none where the law has it."""
    if isinstance(ours.law, ScheduledGain):
        return Evidence([])
    return Evidence([[list(map(Fraction, row)) for row in W] for W in ours.W.tolist()])


def _is_proved(case: Case, ours: Ours, own: Specification, level: float) -> bool:
    law, X = ours.law.exact, evidence(ours)
    claim = claim_of(case.plant, law, "box", own, X, Fraction(level))
    return prove(claim).proved


def bound_proved(case: Case, ours: Ours) -> float:
    """Return the least rms of the acceleration that is proved with the law's own W."""
    for step in STEPS:
        if _is_proved(case, ours, COMFORT, ours.rms * (1 + step)):
            return ours.rms * (1 + step)
    raise SystemExit(f"{case.name}, {case.law}: the bound is not proved")


def rest_proved(case: Case, ours: Ours) -> None:
    """Prove the limits and the region with the same W."""
    if not all(_is_proved(case, ours, own, own.at_most or 0.0) for own in LIMITS):
        raise SystemExit(f"{case.name}, {case.law}: a limit is not proved")
    if case.region is None:
        return  # stable, as the bound says
    parts = tuple({"X": ours.W, "degree": 0, "elevation": 0} for _ in case.region.parts)
    fixed = Certificate(
        case.plant, case.region, "lyapunov", ours.law, {"on": "box", "parts": parts}
    )
    own = Certificate(case.plant, case.region, "scheduled", ours.law, {"tau": 0.0, "elevation": 0})
    if not (own if case.degree else fixed).prove().proved:
        raise SystemExit(f"{case.name}, {case.law}: the region is not proved")


# --- tables --------------------------------------------------------------------------------------


def timed(action: Callable[[], Any], into: list[float]) -> Any:
    gc.collect()
    gc.disable()
    begin = time.perf_counter()
    try:
        return action()
    finally:
        into.append(time.perf_counter() - begin)
        gc.enable()


def run(case: Case, rounds: int) -> tuple[Times, float, Ours, float]:
    """Run both turn by turn; the first round, which loads libraries, does not count."""
    times, data, question = Times(), scaled(case), asked(case)
    for number in range(rounds + 1):
        if number == 1:
            times = Times()
        theirs, solver = timed(lambda: by_hand(data, case.degree), times.peer)
        times.solver.append(solver)
        ours = timed(lambda: searched(case, question), times.search)
        proved = timed(lambda own=ours: bound_proved(case, own), times.bound)
        timed(lambda own=ours: rest_proved(case, own), times.everything)
    return times, theirs, ours, proved


def table(head: list[str], rows: list[list[str]]) -> None:
    print("\n| " + " | ".join(head) + " |")
    print("| " + " | ".join("---" for _ in head) + " |")
    for row in rows:
        print("| " + " | ".join(row) + " |")


def ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g}"


def compare(cases: list[Case], rounds: int) -> None:
    """Print times and optima."""
    speed, values = [], []
    for case in cases:
        times, theirs, ours, proved = run(case, rounds)
        bound = [a + b for a, b in zip(times.search, times.bound, strict=True)]
        everything = [a + b for a, b in zip(bound, times.everything, strict=True)]
        peer, solver, search, short, long = (
            median(each) for each in (times.peer, times.solver, times.search, bound, everything)
        )
        numbers = [ms(peer), ms(solver), ms(search), ms(short), f"{peer / short:.1f}"]
        numbers += [ms(long), f"{peer / long:.1f}", f"{solver / short:.2f}"]
        speed.append([case.name, case.law, *numbers])
        off = ours.rms / theirs - 1
        values.append(
            [
                case.name,
                case.law,
                f"{theirs:.6f}",
                f"{ours.rms:.6f}",
                f"{proved:.6f}",
                f"{off:+.1e}",
            ]
        )
    table(
        [
            "region",
            "law",
            "CVXPY + Clarabel [ms]",
            "of which Clarabel [ms]",
            "search [ms]",
            "search, bound proved [ms]",
            "x",
            "search, bound, limits and region proved [ms]",
            "x",
            "Clarabel alone over bound proved",
        ],
        speed,
    )
    print("\nWorst rms of the sprung mass's acceleration [m/s2], with one W(alpha) for everything")
    names = ["region", "law", "CVXPY + Clarabel", "found", "proved", "found / CVXPY - 1"]
    table(names, values)


def whole(cases: list[Case]) -> None:
    """Print what `optimise` takes and proves."""
    rows = []
    asked = [(case.name, case.region, case.law, case.method) for case in cases]
    for name, region, law, method in asked:
        begin = time.process_time()
        found = optimise(cases[0].plant, COMFORT, LIMITS, region, method)
        seconds = time.process_time() - begin
        level = f"{found.bounds[0].level:.5f}"
        rows.append([name, law, f"{seconds:.1f}", f"{found.shared:.5f}", level])
    print("\n`optimise` as a whole, once")
    table(["region", "law", "processor time [s]", "one W(alpha) [m/s2]", "own proofs [m/s2]"], rows)


def half_car() -> None:
    """Print what `optimise` takes for the half car."""
    plant = loads(HALF_CAR, "half car")
    comfort = Rms("heave acceleration", None, DENSITY)
    rows = []
    for (name, levels), (law, (method, _)) in product(HALF_LIMITS.items(), LAWS.items()):
        limits = [Rms(signal, level, DENSITY) for signal, level in levels.items()]
        begin = time.process_time()
        found = optimise(plant, comfort, limits, HALF_REGION, method)
        seconds = time.process_time() - begin
        reached = [f"{found.shared:.5f}", f"{found.bounds[0].level:.5f}"]
        rows.append([name, law, f"{seconds:.1f}", *reached])
    print(f"\n`optimise` of the half car within {HALF_REGION}, once")
    table(["limits", "law", "processor time [s]", "one W(alpha) [m/s2]", "own proofs [m/s2]"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--skip-optimise", action="store_true")
    options = parser.parse_args()
    warnings.filterwarnings("ignore", module="cvxpy")
    plant = family("quarter-car-ride")
    cases = [Case(plant, name, REGIONS[name], law) for law in LAWS for name in REGIONS]
    print(
        f"{os.cpu_count()} CPUs, one thread used; Python {platform.python_version()}, numpy "
        f"{np.__version__}, cvxpy {cp.__version__}, clarabel {version('clarabel')}; polefence "
        f"{polefence.__version__}, engine {polefence.engine()}. Medians of {options.rounds}."
    )
    compare(cases, options.rounds)
    if not options.skip_optimise:
        whole(cases)
        half_car()


if __name__ == "__main__":
    main()
