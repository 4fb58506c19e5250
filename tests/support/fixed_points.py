"""Laws in fixed point, their code called from Python, and what exact arithmetic makes of them."""

import ctypes
import math
from fractions import Fraction
from functools import cache
from itertools import product

import numpy as np

from polefence import Disk, FixedGain, HalfPlane, Scheduled, UncertainPlant, analyse, place
from polefence.export import export_c99
from polefence.export.program import memory_of
from polefence.law.laws import PolynomialGain
from polefence.plant.outputs import states
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import binomial
from polefence.proof.claims.rounding import answer_errors, gain_errors
from polefence.proof.claims.words import largest, two
from polefence.proof.matrices import right_divide
from polefence.response.discrete import Sampling
from support.cortex import run
from support.memories import REGION, TIME, design, spring

# Of the last three the gain is found by elimination.
SOLVED = ("scheduled", "scheduled, of weights", "degree 2")
KINDS = ("one gain", "square", "alpha", "below zero", "own state", "pid", *SOLVED)
RANGES = {"position": 0.3, "speed": 1.0}
# The law's own states too: of a PID the integral has no range of its own.
MORE = {
    "own state": {"position": 0.3},
    "pid": {"position": 0.3, "pid integral of position": 0.5, "pid filter of position": 0.4},
}
UNDEFINED = ["-ftrapv", "-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"]


@cache
def law_design(kind):
    if kind in ("own state", "pid"):
        return design("affine" if kind == "own state" else "pid")
    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m")]
    if kind == "below zero":
        bounds[0] = Parameter("m", -2, -1, "kg", "1/m")
    names = {"states": ["position [m]", "speed [m/s]"], "inputs": ["force [N]"]}
    make = spring if kind != "below zero" else lambda m, k: spring(-m, k)
    plant = UncertainPlant.from_function(make, bounds, **names)
    if kind in SOLVED:
        if kind == "scheduled, of weights":
            A = [[[0.0, 1.0], [-k, -0.5]] for k in (2.0, 5.0, 9.0)]
            B = [[[0.0], [b]] for b in (1.0, 0.7, 1.3)]
            plant = UncertainPlant.from_vertices(A, B, **names)
        how = Scheduled(degree=2, on="box") if kind == "degree 2" else "scheduled"
        return place(plant, Disk(-4, 3.5), how)
    if kind == "one gain":
        return analyse(plant, FixedGain([[-6.1, -3.3]]), REGION).design
    if kind == "alpha":
        A = [[[0.0, 1.0], [-k, -0.5]] for k in (2.0, 5.0, 9.0)]
        plant = UncertainPlant.from_vertices(A, [[[0.0], [1.0]]] * 3, **names)
        powers, region = ((1, 0, 0), (0, 1, 0), (0, 0, 1)), HalfPlane(0.2)
        gains = [[[-5.3, -2.1]], [[-3.7, -2.9]], [[-1.1, -3.3]]]
        return analyse(plant, PolynomialGain(powers, gains, states(plant), ()), region).design
    powers = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0))
    gains = [[[-6.1, -3.3]], [[0.7, -0.31]], [[-0.21, 0.2]], [[0.13, 0.11]], [[0.05, -0.07]]]
    law = PolynomialGain(powers, gains, states(plant), bounds)
    return analyse(plant, law, REGION).design


@cache
def exported(kind, bits, limit=None):
    own = kind in MORE
    return export_c99(
        law_design(kind),
        fixed=bits,
        ranges=MORE.get(kind, RANGES),
        sampling=Sampling(TIME, delay=1) if own else None,
        limits=() if limit is None else limit,
        allow_unproved=True,
    )


class WordCode:
    """The code, compiled with traps for what C leaves undefined."""

    def __init__(self, made, folder):
        made.save(folder / "code")
        flags = ["-std=c99", "-shared", "-fPIC", "-O1", *UNDEFINED]
        run("gcc", *flags, "-o", "law.so", "code/law.c", cwd=folder)
        self.update_ = ctypes.CDLL(str(folder / "law.so")).law_update
        bits = made.program.number.bits
        self.word, self.wide = (
            (ctypes.c_int16, ctypes.c_int32) if bits == 16 else (ctypes.c_int32, ctypes.c_int64)
        )
        self.inputs = len(made.texts.inputs)

    def update(self, given, x, own):
        u, memory = (self.word * self.inputs)(), (self.wide * len(own))(*own)
        arrays = [(self.word * len(values))(*values) for values in (given, x) if len(values)]
        flags = self.update_(*([memory] if own else []), *arrays, u)
        return [*u, *memory], flags


class Exact:
    """What the law makes of integers, by rationals, and the errors that are stated."""

    def __init__(self, made):
        self.made, program, memory = made, made.program, memory_of(made.program)
        self.scales, self.law = program.scales, made.design.law
        self.q = memory.states if memory else 0
        self.m, self.n = len(self.scales.rows) - self.q, len(self.scales.signals) - self.q
        self.time = Fraction(memory.sample_time if memory else 1)
        self.top = largest(program.number.bits)
        claim = made.guarantee.claim
        assert claim is not None, made.guarantee.reason
        self.E, self.off = gain_errors(claim), answer_errors(claim.code)
        kept = zip(self.scales.signals[self.n :], self.scales.answers[self.m :], strict=True)
        self.ranges = [self.top << (t - s) for s, t in kept]
        self.shares = getattr(program, "shares", ())

    def gain(self, given):
        """Return K, of integers that are inside."""
        law = self.law
        if law.W is not None:
            return self.solved(given)
        if law.K is not None:
            return [[Fraction(x) for x in row] for row in law.K.tolist()]
        terms = [[[Fraction(x) for x in row] for row in K] for K in law.gains.tolist()]
        if not self.shares:
            total = sum(max(v, 0) for v in given)
            c = [Fraction(max(v, 0), total) for v in given] if given else [Fraction(1)]
        else:
            known = zip(self.shares, self.scales.given, given, strict=True)
            c = [2 * self.place(*pair) - 1 for pair in known]
        assert len(terms) == 1 or len(c) == len(law.powers[0])
        weights = []
        for e in law.powers:
            weight = Fraction(1)
            for value, power in zip(c, e, strict=False):
                weight *= value**power
            weights.append(weight)
        shape = range(len(terms[0])), range(len(terms[0][0]))
        return [
            [sum(w * K[i][j] for w, K in zip(weights, terms, strict=True)) for j in shape[1]]
            for i in shape[0]
        ]

    def solved(self, given):
        """Return Z W^-1 of parameters' weights, or of alpha: of the numbers of the design."""
        domain = self.law.domain
        if self.shares:
            ends = [
                self.place(*pair)
                for pair in zip(self.shares, self.scales.given, given, strict=True)
            ]
            c = [w for at in ends for w in (1 - at, at)]
            if domain.sizes == (domain.corners,):
                c = [math.prod(pair) for pair in product(*zip(c[::2], c[1::2], strict=True))]
        else:
            c = [Fraction(max(v, 0), sum(max(w, 0) for w in given)) for v in given]
        total = 0
        for e, M in zip(domain.monomials(self.law.degree), self.law.form, strict=True):
            weight = math.prod(map(pow, c, e)) * binomial(domain.sizes, e)
            total = total + weight * np.vectorize(Fraction, otypes=[object])(M)
        n = self.law.shape[1]
        return right_divide(total[n:].tolist(), total[:n].tolist())

    @staticmethod
    def place(share, s, v):
        """Return a parameter's place in its interval."""
        p, own = share.parameter, Fraction(v) * two(-s)
        p_ = min(max(own, p.low), p.high)
        return (p_ - p.low) / (p.high - p.low) * (p.high / p_ if p.inverted else 1)

    def answers(self, given, x, own):
        """Return the exact answers in their units, not cut, and the errors stated of them."""
        K = self.gain(given)
        values = [Fraction(v) * two(-s) for v, s in zip(x, self.scales.signals, strict=False)]
        states = [
            Fraction(v) * two(-t) for v, t in zip(own, self.scales.answers[self.m :], strict=True)
        ]
        values += states
        found = []
        for i, t in enumerate(self.scales.answers):
            exact = sum((k * v for k, v in zip(K[i], values, strict=True)), Fraction(0))
            error = sum((e * abs(v) for e, v in zip(self.E[i], values, strict=True)), Fraction(0))
            if i >= self.m:
                exact, error = states[i - self.m] + self.time * exact, self.time * error
            found.append((exact * two(t), (error + self.off[i]) * two(t)))
        return found

    def random(self, random, k):
        """Return integers: inside, at ends, small or large."""
        size = 2.0 ** -random.integers(0, 10) if k % 4 else 1.0
        x = [int(v) for v in np.round(random.uniform(-1, 1, self.n) * self.top * size)]
        own = [
            int(v * r * size)
            for v, r in zip(random.uniform(-1, 1, self.q), self.ranges, strict=True)
        ]
        if k % 8 == 0:
            x = [int(s) * self.top for s in random.choice([-1, 1], self.n)]
            own = [
                int(s) * r for s, r in zip(random.choice([-1, 1], self.q), self.ranges, strict=True)
            ]
        given = []
        for share, s in zip(self.shares, self.scales.given, strict=True):
            ends = [int(Fraction(end) * two(s)) for end in (share.low, share.high)]
            given.append(int(random.integers(ends[0], ends[1] + 1)))
        if not self.shares and (self.law.W is not None or len(self.law.powers) > 1):
            whole = (self.top + 1) >> 1
            first, second = sorted(int(v) for v in random.integers(0, whole + 1, 2))
            given = [first, second - first, whole - second]
        return given, x, own
