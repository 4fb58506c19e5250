"""Tuned laws of random plants: proved, refuted or undecided, and whether samples contradict.

python benchmarks/random_laws.py --plants 60

Plants of 2 to 8 states, 1 to 3 inputs and 1 to 3 parameters, every second one with measured
signals only, fewer than its states. With each a gain is drawn that keeps it stable. Asked is the
least rms of a state, with half that gain's decay rate, and the rms of every input at most 1.3 times
that gain's; of every third plant half of that gain's, which may be refuted. "Over known" is the
proved bound over the drawn gain's worst sample. The proved bounds are held against 10,000 samples,
the region against the poles of 1,000. Prints Markdown; exits with 1 where a sample contradicts.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import statistics
import sys
import time
from dataclasses import dataclass, field
from itertools import product

import numpy as np

import polefence as pf
from polefence import FixedGain, HalfPlane, Rms, Structure, UncertainPlant
from polefence.certify.bounds import sampled
from polefence.plant.points import seeded

BOUNDS, POLES, ROUNDING = 10_000, 1_000, 1e-6
SPREAD = 0.1  # of a parameter's matrix beside the nominal one


@dataclass(frozen=True, eq=False)
class Case:
    """A plant, what is asked of it, and a law that keeps its region."""

    plant: UncertainPlant
    known: FixedGain
    structure: Structure
    least: Rms
    limits: tuple[Rms, ...]
    region: HalfPlane


def signs_of(count: int) -> list[tuple[int, ...]]:
    """Return the corners of a cube."""
    return list(product((-1, 1), repeat=count))


def drawn(seed: int) -> Case:
    """Return the case of a seed."""
    random = np.random.default_rng([15, seed])
    n, m, count = (int(random.integers(*b)) for b in ((2, 9), (1, 4), (1, 4)))
    A, B, E = (random.standard_normal((n, k)) for k in (n, m, 2))
    measured = int(random.integers(1, n)) if seed % 2 else n
    C = random.standard_normal((measured, n)) if seed % 2 else np.eye(n)
    K = 0.5 * random.standard_normal((m, measured)) @ C
    names = [f"p{k + 1}" for k in range(count)]
    more = [SPREAD * random.standard_normal((n, n)) for _ in names]
    corners = [A + B @ K + np.tensordot(signs, more, 1) for signs in signs_of(count)]
    A -= np.eye(n) * (np.linalg.eigvals(np.array(corners)).real.max() + random.uniform(0.3, 1.5))
    terms = list(zip(["1", *names], [A, *more], strict=True))
    rows = [
        [" + ".join(f"({M[i, j]:.4f})*{p}" for p, M in terms) for j in range(n)] for i in range(n)
    ]
    outputs = {f"y{k + 1}": {"C": row} for k, row in enumerate(np.round(C, 4).tolist())}
    plant = UncertainPlant.from_expressions(
        [pf.Parameter(p, -1, 1) for p in names],
        rows,
        np.round(B, 4).astype(str).tolist(),
        np.round(E, 4).astype(str).tolist(),
        states=tuple(f"x{k + 1}" for k in range(n)),
        inputs=tuple(f"u{k + 1}" for k in range(m)),
        outputs=outputs,
        name=f"random {seed}",
    )
    known, alpha = FixedGain(K), seeded(plant, 200)
    P, Q = plant.at(alpha)
    decay = -np.linalg.eigvals(P + Q @ K).real.max()
    region = HalfPlane(round(0.5 * decay, 4) if decay > 0 else 0.0)
    signals = tuple(Rms(f"u{k + 1}", density=2.0) for k in range(m))
    share = 1.3 if seed % 3 else 0.5
    limits = tuple(
        Rms(
            own.signal, float(f"{share * sampled(plant, known, own, alpha).worst:.4g}"), density=2.0
        )
        for own in signals
    )
    measures = tuple(outputs) if seed % 2 else None
    structure = Structure(measured=measures, degree=1 + seed % 2)
    return Case(plant, known, structure, Rms("x1", density=2.0), limits, region)


@dataclass
class Tally:
    """What came of the cases."""

    answers: dict[str, int] = field(default_factory=dict)
    over: list[float] = field(default_factory=list)
    apart: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    contradicted: list[str] = field(default_factory=list)

    def add(self, case: Case) -> str:
        """Ask, and hold the answer against samples."""
        start = time.perf_counter()
        answer, said = "proved", ""
        try:
            done = pf.optimise(
                case.plant, case.least, case.limits, case.region, structure=case.structure
            )
            said = self.held(case, done)
        except pf.NotProvedError as error:
            answer = "refuted" if error.refutation is not None else "undecided"
            if answer == "refuted" and self.keeps(case):
                self.contradicted.append(f"{case.plant.name}: refuted, but kept by a known law")
        self.seconds.append(time.perf_counter() - start)
        self.answers[answer] = self.answers.get(answer, 0) + 1
        return f"{answer} {said}"

    def held(self, case: Case, done: pf.Optimised) -> str:
        """Compare every bound and the region with samples."""
        plant, alpha = done.plant, seeded(done.plant, BOUNDS)
        for own in done.bounds:
            worst = sampled(plant, done.law, own.specification, alpha).worst
            if worst > own.level * (1 + ROUNDING):
                self.contradicted.append(f"{plant.name}: {own} but {worst:.9g} at a sample")
        A, B = plant.at(alpha[:POLES])
        out = case.region.distance(np.linalg.eigvals(A + B @ done.law.gain(alpha[:POLES]))).max()
        if out > 0:
            self.contradicted.append(f"{plant.name}: a pole outside {case.region} by {out:.3g}")
        least = done.bounds[0]
        worst = sampled(plant, done.law, least.specification, alpha).worst
        known = sampled(case.plant, case.known, case.least, alpha).worst
        self.apart.append(least.level / worst - 1)
        self.over.append(least.level / known)
        return f"{least.level:.5g}, {least.level / known:.3f} of the known law's"

    def keeps(self, case: Case) -> bool:
        """Whether the known law keeps everything, at samples."""
        alpha = seeded(case.plant, BOUNDS)
        A, B = case.plant.at(alpha)
        inside = case.region.distance(np.linalg.eigvals(A + B @ case.known.K)).max() < 0
        return inside and all(
            sampled(case.plant, case.known, own, alpha).worst <= (own.at_most or 0)
            for own in case.limits
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--rows", action="store_true", help="say what came of each, on stderr")
    options = parser.parse_args()
    tally = Tally()
    for seed in range(options.first, options.first + options.plants):
        said = tally.add(drawn(seed))
        if options.rows:
            print(seed, said, f"{tally.seconds[-1]:.1f} s", file=sys.stderr, flush=True)
    answers = ", ".join(f"{count} {answer}" for answer, count in sorted(tally.answers.items()))
    print("| plants | answers | proved over sampled, median | most | over known, median | most |")
    print("|--:|---|--:|--:|--:|--:|")
    median, most = statistics.median, max
    apart = [f"{100 * each(tally.apart):.2g} %" for each in (median, most)]
    over = [f"{each(tally.over):.3f}" for each in (median, most)]
    print(f"| {options.plants} | {answers} | {' | '.join([*apart, *over])} |")
    print(f"\nSeconds: median {median(tally.seconds):.1f}, most {max(tally.seconds):.1f}.")
    print(f"Contradicted by a sample: {len(tally.contradicted)}.")
    print("\n".join(tally.contradicted))
    return 1 if tally.contradicted else 0


if __name__ == "__main__":
    sys.exit(main())
