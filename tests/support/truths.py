"""What files of claims say, held against samples in floats: nothing here is of the checker.

`false` looks for a plain contradiction of any claim of a file, at many alphas. Where it finds none,
the claim may be false all the same; where it finds one, by more than rounding, it is.
"""

import copy
from itertools import product
from math import comb, factorial, prod

import numpy as np
from scipy.linalg import (
    block_diag,
    expm,
    solve_continuous_are,
    solve_continuous_lyapunov,
    solve_discrete_lyapunov,
)

from support import motions
from support.motions import number

SLACK = 1e-6  # relative, of what counts as more than rounding


def array(value):
    if isinstance(value, list):
        return np.array([array(each) for each in value], dtype=float)
    return number(value)


class Plant:
    """Vertices and parameters; of samples between nodes what they are samples of, a claim."""

    def __init__(self, table, seed=0, claims=()):
        self.A, self.B = (np.stack([array(v[k]) for v in table["vertices"]]) for k in "AB")
        given = "E" in table["vertices"][0]
        self.E = np.stack([array(v["E"]) for v in table["vertices"]]) if given else None
        self.ranges = [
            (*map(number, p["range"]), p.get("through", p["name"]) != p["name"])
            for p in table.get("parameters", [])
        ]
        self.rates = [
            rate if isinstance(rate := p.get("rate"), str | None) else tuple(map(number, rate))
            for p in table.get("parameters", [])
        ]
        self.random = np.random.default_rng(seed)
        self.T = number(table.get("sample_time", 0))
        self.R = array(table["remainder"]) if "remainder" in table else None
        self.curve = table.get("curve")
        bends = table.get("bends")
        self.bends = {key: array(bends[key]) for key in bends} if bends else None
        self.nodes = table.get("nodes", ())
        self.samples = next((own for own in claims if own["kind"] == "samples"), None)
        spans = len(self.A) == 2 ** len(self.ranges) > 1
        self.sizes = (2,) * len(self.ranges) if spans else (len(self.A),)

    def at(self, alpha):
        """A, B and E there."""
        n, m = self.A.shape[1], self.B.shape[2]
        E = np.zeros((n, 0)) if self.E is None else mix(alpha, self.E)
        A, B = mix(alpha, self.A), mix(alpha, self.B)
        if self.curve:
            weights = basis(coordinates(alpha, self.sizes), self.sizes, self.curve["degree"])
            off = np.tensordot(weights, array(self.curve["coefficients"]), 1)
            A, B, E = A + off[:, :n], B + off[:, n : n + m], E + off[:, n + m :]
        return placed(self, self.samples, alpha, A, B, E) if self.bends else (A, B, E)

    def near(self, alpha):
        """A, B and E there, and at random signs of all that they may be off by."""
        n, m = self.A.shape[1], self.B.shape[2]
        own = self.at(alpha)
        yield own
        for _ in range(4 if self.R is not None and not self.bends else 0):
            R = self.R * self.random.choice([-1.0, 1.0], size=self.R.shape)
            parts = R[:, :n], R[:, n : n + m], R[:, n + m :]
            yield tuple(M + off for M, off in zip(own, parts, strict=True))

    def alpha(self, values):
        pairs = []
        for (low, high, inverted), v in zip(self.ranges, values, strict=True):
            s0, s1, s = (1 / x if inverted else x for x in (low, high, v))
            pairs.append((1 - (s - s0) / (s1 - s0), (s - s0) / (s1 - s0)))
        return np.array([prod(choice) for choice in product(*pairs)])

    def values(self, count=12):
        """Parameter values: the corners, and some between."""
        if not self.ranges:
            return []
        corners = list(product(*((low, high) for low, high, _ in self.ranges)))
        lows, highs = (np.array([r[k] for r in self.ranges]) for k in (0, 1))
        inner = lows + (highs - lows) * self.random.random((count, len(lows)))
        return [*map(np.array, corners), *inner]

    def alphas(self, on, count=12):
        """Points of the domain."""
        N = len(self.A)
        if N == 1:
            return [np.ones(1)]
        if on == "box" and self.ranges:
            return [self.alpha(v) for v in self.values(count)]
        return [*np.eye(N), *self.random.dirichlet(np.ones(N), count)]


def order(size, degree):
    """Exponents on a simplex, in the file's order."""
    found = [e for e in product(range(degree + 1), repeat=size) if sum(e) == degree]

    def rank(e):
        support = sorted((j for j in range(size) if e[j]), key=lambda j: (-e[j], j))
        return len(support), [-e[j] for j in support], support

    return sorted(found, key=rank)


def basis(coordinates, sizes, degree):
    """Bernstein polynomials of a product of simplices, at coordinates one simplex after another."""
    values, start = [1.0], 0
    for size in sizes:
        x = coordinates[start : start + size]
        start += size
        own = [
            factorial(degree) / prod(map(factorial, e)) * float(np.prod(np.power(x, e)))
            for e in order(size, degree)
        ]
        values = [a * b for a in values for b in own]
    return np.array(values)


def coordinates(alpha, sizes):
    if len(sizes) == 1:
        return alpha
    found = []
    for f in range(len(sizes)):
        bit = len(sizes) - 1 - f
        high = sum(a for j, a in enumerate(alpha) if j >> bit & 1)
        found += [1 - high, high]
    return np.array(found)


def measured(plant, names, count, key="C"):
    """Rows C or F of states and outputs of these names, at every vertex; None for all states."""
    found, width = [], len(plant["vertices"][0]["A" if key == "C" else "E"][0])
    for name in names:
        states = [label.partition("[")[0].strip() for label in plant.get("states", [])]
        if name in states:
            rows = np.eye(width)[[states.index(name)] * count] if key == "C" else [[0.0] * width]
        else:
            own = next(output for output in plant["outputs"] if output["name"] == name)
            rows = array(own[key]) if key in own else [[0.0] * width]
        found.append(np.broadcast_to(rows, (count, width)))
    return np.stack(found, axis=1) if found else None


class Law:
    """K(alpha)."""

    def __init__(self, table, count, plant=None):
        self.fixed = table["kind"] == "fixed"
        self.on = table.get("on", "simplex")
        self.polynomial, self.more = table["kind"] == "polynomial", None
        if self.fixed:
            self.K = array(table["K"])
            return
        self.degree = table.get("degree", 1)
        if self.polynomial:
            self.more = array(table["anti_windup"]) if "anti_windup" in table else None
            self.terms = [(np.array(t["powers"]), array(t["K"])) for t in table["terms"]]
            names, self.F = table.get("measured", []), None
            self.C = None if plant is None else measured(plant, names, count)
            if self.C is not None and "E" in plant["vertices"][0]:
                self.F = measured(plant, names, count, "F")
        box = self.on == "box" and count > 1
        self.sizes = (2,) * (count.bit_length() - 1) if box else (count,)
        if not self.polynomial:
            self.W, self.Z = array(table["W"]), array(table["Z"])

    def gain(self, alpha):
        if self.fixed:
            return self.K
        if self.polynomial:
            K = self.own(alpha)
            return K if self.C is None else K @ np.tensordot(alpha, self.C, 1)
        weights = basis(coordinates(alpha, self.sizes), self.sizes, self.degree)
        W, Z = (np.tensordot(weights, M, 1) for M in (self.W, self.Z))
        return np.linalg.solve(W.T, Z.T).T

    def own(self, alpha):
        c = coordinates(alpha, self.sizes)
        if len(self.terms[0][0]) < len(c):
            c = c[1::2] - c[::2]
        return sum(np.prod(c**e) * K for e, K in self.terms)

    def passing(self, alpha):
        """What passes from disturbances straight to inputs; zero where nothing does."""
        if not self.polynomial or self.F is None:
            return np.zeros((len(self.gain(alpha)), 1))
        return self.own(alpha) @ np.tensordot(alpha, self.F, 1)


def outside(region, poles):
    """How far the worst pole is out of a region, relative to what it is measured by."""
    parts = region["parts"] if region["kind"] == "intersection" else [region]
    worst = -np.inf
    for part in parts:
        v = {key: number(x) for key, x in part.items() if key != "kind"}
        x, y = poles.real, np.abs(poles.imag)
        scale = max(1.0, float(np.abs(poles).max()))
        if part["kind"] == "disk":
            d, scale = np.abs(poles - v["centre"]) - v["radius"], max(scale, v["radius"])
        elif part["kind"] == "half_plane":
            d = x + v["decay"]
        elif part["kind"] == "sector":
            d = v["slope"] * x + y
        elif part["kind"] == "wedge":
            d = v["slope"] * (x - v["apex"]) + y
        elif part["kind"] == "vertical_strip":
            d = np.maximum(x - v["high"], v["low"] - x)
        elif part["kind"] == "horizontal_strip":
            d = y - v["height"]
        else:
            d = np.hypot((x - v["centre"]) / v["real"], y / v["imaginary"]) - 1
        worst = max(worst, float(np.max(d)) / scale)
    return worst


def mix(alpha, matrices):
    return np.tensordot(alpha, matrices, 1)


def domain_of(claim, law):
    table = claim["evidence"]
    return table.get("on", "simplex") if law.fixed else law.on


def false_poles(plant, law, claim):
    for alpha in plant.alphas(domain_of(claim, law)):
        for A, B, _ in plant.near(alpha):
            if outside(claim["region"], np.linalg.eigvals(A + B @ law.gain(alpha))) > SLACK:
                return True
    return False


def false_region(plant, law, claim):
    """At constant parameters, and as fast as the region says along motions."""
    if false_poles(plant, law, claim):
        return True
    region = claim["region"]
    parts = region["parts"] if region["kind"] == "intersection" else [region]
    if not any(plant.rates):
        return False
    if plant.T:
        zero = [number(p["radius"]) for p in parts if p["kind"] == "disk" and not p["centre"]]
        return bool(zero) and motions.false_decay(plant, law, factor=min(zero))
    decays = [number(p["decay"]) for p in parts if p["kind"] == "half_plane"]
    return bool(decays) and motions.false_decay(plant, law, decay=max(decays))


def false_observer(plant, _, claim):
    C = array(claim["C"])
    C = np.broadcast_to(C, (len(plant.A), *C.shape[1:]))
    law = Law(claim["law"], len(plant.A))
    for alpha in plant.alphas(domain_of(claim, law)):
        for A, _, _ in plant.near(alpha):
            loop = A.T + mix(alpha, C).T @ law.gain(alpha)
            if outside(claim["region"], np.linalg.eigvals(loop)) > SLACK:
                return True
    return False


def rows(value, count, width):
    return np.broadcast_to(array(value)[:, None, :], (count, 1, width))


def false_signal(plant, law, claim):
    outputs = claim["outputs"] if "outputs" in claim else [claim["output"]]
    C, D, F = (
        np.concatenate([stacked(plant, output, key) for output in outputs], axis=1) for key in "CDF"
    )
    scales = array(claim["disturbances"]) if "disturbances" in claim else 1.0
    level = number(claim["level"]) * (1 + SLACK) + 1e-12

    def rows_at(alpha):
        through = mix(alpha, F) + mix(alpha, D) @ law.passing(alpha)
        return mix(alpha, C) + mix(alpha, D) @ law.gain(alpha), through

    filters = [own for own in claim.get("filters", []) if own]
    if any(plant.rates) and not filters and motions.false_signal(plant, law, claim, rows_at):
        return True
    for alpha in plant.alphas(domain_of(claim, law)):
        K = law.gain(alpha)
        y, kind, P = mix(alpha, C) + mix(alpha, D) @ K, claim["kind"], law.passing(alpha)
        through = (mix(alpha, F) + mix(alpha, D) @ P) * scales
        if kind not in DIRECT and np.any(through) and not filters:
            return True
        if "held" in claim:
            rows = mix(alpha, C), mix(alpha, D)
            most = {"gain": gain_between, "energy peak": peak_between}.get(kind, between)
            most = started_between if kind == "initial peak" else most
            more = (through,) if kind == "gain" else ()
            own = most(plant, claim, alpha, K, rows, *more, scales)
            if own > level:
                return True
            continue
        for A, B, E in plant.near(alpha):
            poles = np.linalg.eigvals(A + B @ K)
            if (np.abs(poles).max() - 1 if plant.T else poles.real.max()) > SLACK:
                return True
            loop = behind(claim, (A + B @ K, (E + B @ P) * scales, y, through), plant.T)
            own = array(claim["baseline"]["K"]) if "K" in claim.get("baseline", {}) else 0 * K
            shown, direct = mix(alpha, C) + mix(alpha, D) @ own, mix(alpha, F) * scales
            passive = A + B @ own, E * scales, shown, direct
            if _reached(kind, claim, loop, behind(claim, passive, plant.T), plant.T) > level:
                return True
    return False


def between(plant, claim, alpha, K, rows, scales):
    """The largest rms at all times, for periods all alike, or in a few orders; inf if unstable."""
    held, (C, D) = claim["held"], rows
    A, B, E = Plant({"vertices": held["vertices"], "parameters": []}).at(alpha)
    size, worst = number(claim.get("intensity", 1)), 0.0
    one, other, _ = plant.at(alpha)
    for order in orders_of(plant, held):
        known = [
            period(A, B, E * scales * size**0.5, phases_of(held, B.shape, C, D, K, end), plant.T)
            for end in order
        ]
        steps = [over(moved, one + other @ K) for moved, *_ in known]
        through = np.eye(len(one))
        for whole in steps:
            through = whole @ through
        if np.abs(np.linalg.eigvals(through)).max() > 1 - 1e-9:
            return np.inf
        noise = np.zeros_like(one)
        for whole, (_, added, *_) in zip(steps, known, strict=True):
            noise = whole @ noise @ whole.T
            noise[: len(A), : len(A)] += added
        P, total = solve_discrete_lyapunov(through, noise, "bilinear"), 0.0
        for whole, (_, added, energy, more) in zip(steps, known, strict=True):
            total += np.trace(energy @ P) + more
            P = whole @ P @ whole.T
            P[: len(A), : len(A)] += added
        worst = max(worst, float(np.sqrt(total / (plant.T * sum(order)))))
    return worst


def orders_of(plant, held):
    """Lengths of periods that repeat."""
    clock = held.get("clock")
    if not clock:
        return [[1.0]]
    spans = [(number(span["least"]), number(span["most"])) for span in clock["spans"]]
    ends, random = sorted({end for span in spans for end in span}), plant.random
    between = [random.uniform(*spans[k]) for k in random.integers(len(spans), size=5)]
    return [[end] for end in ends] + [ends, list(random.choice(ends, 5)), between]


def over(moved, whole):
    """What a period makes of all states at a sample."""
    whole[: len(moved)] = moved
    return whole


def false_clocked(plant, law, claim):
    """Whether periods in some order leave more of the states than a decay rate says."""
    held, level = claim["held"], number(claim["level"])
    for alpha in plant.alphas(domain_of(claim, law)):
        A, B, E = Plant({"vertices": held["vertices"], "parameters": []}).at(alpha)
        (one, other, _), K = plant.at(alpha), law.gain(alpha)
        none = np.zeros((1, len(one))), np.zeros((1, other.shape[1]))
        for order in orders_of(plant, held):
            through = np.eye(len(one))
            for end in order:
                phases = phases_of(held, B.shape, *none, K, end)
                moved = period(A, B, E, phases, plant.T)[0]
                through = over(moved, one + other @ K) @ through
            rate = -np.log(np.abs(np.linalg.eigvals(through)).max()) / (plant.T * sum(order))
            if rate < level * (1 - SLACK):
                return True
    return False


def gain_between(plant, claim, alpha, K, rows, through, scales, parts=8):
    """The largest gain from w that is held in each of so many parts of a phase; inf if unstable."""
    held, (C, D) = claim["held"], rows
    A, B, E = Plant({"vertices": held["vertices"], "parameters": []}).at(alpha)
    (n, m), q = B.shape, E.shape[1]
    one, other, _ = plant.at(alpha)
    phases, width = phases_of(held, B.shape, C, D, K, 1.0), len(one)
    x = np.eye(n, width + q * parts * len(phases))
    shown, begun = [], width
    for length, C, stays, acting in phases:
        step = length * plant.T / parts
        half = expm(np.block([[A, B, E * scales], [np.zeros((m + q, n + m + q))]]) * step / 2)[:n]
        for _ in range(parts):
            w, known = np.zeros((q, x.shape[1])), np.zeros((width, x.shape[1]))
            w[:, begun : begun + q], known[:, :width] = np.eye(q) / step**0.5, np.eye(width)
            begun += q
            for k, weight in enumerate((1, 4, 1)):  # Simpson's rule
                shown.append((weight * step / 6) ** 0.5 * (C @ x + stays @ known + through @ w))
                x = half @ np.vstack([x, acting @ known, w]) if k < 2 else x
    whole, moved = one + other @ K, np.zeros((width, x.shape[1]))
    whole[:n], moved[:n], z = x[:, :width], x, np.vstack(shown)
    if np.abs(np.linalg.eigvals(whole)).max() > 1 - 1e-9:
        return np.inf
    circle = np.exp(1j * np.linspace(0, np.pi, 60))
    return _largest(whole, moved[:, width:], z[:, :width], z[:, width:], circle)


def peak_between(plant, claim, alpha, K, rows, scales, parts=24):
    """The largest value in a period under disturbances of the norm; inf if the loop is unstable."""
    held, (C, D) = claim["held"], rows
    A, B, E = Plant({"vertices": held["vertices"], "parameters": []}).at(alpha)
    E, (one, other, _) = E * scales * number(claim.get("norm", 1)), plant.at(alpha)
    phases, n = phases_of(held, B.shape, C, D, K, 1.0), len(A)
    moved, added, *_ = period(A, B, E, phases, plant.T)
    whole, noise = one + other @ K, np.zeros_like(one)
    whole[:n], noise[:n, :n] = moved, added
    if np.abs(np.linalg.eigvals(whole)).max() > 1 - 1e-9:
        return np.inf
    P, worst = solve_discrete_lyapunov(whole, noise, "bilinear"), 0.0
    for k, (length, own, stays, _) in enumerate(phases):
        for share in np.arange(parts + 1) / parts * length:
            # the phases so far, the last of them cut short
            done = [*phases[:k], (share, *phases[k][1:])]
            moved, added, *_ = period(A, B, E, done, plant.T, 1)
            row = own @ moved + stays
            worst = max(worst, float((row @ P @ row.T + own @ added @ own.T)[0, 0]))
    return worst**0.5


def started_between(plant, claim, alpha, K, rows, _, parts=24):
    """The largest value in periods that follow on the points, and on X0; inf if not stable."""
    held, (C, D) = claim["held"], rows
    A, B, E = Plant({"vertices": held["vertices"], "parameters": []}).at(alpha)
    one, other, _ = plant.at(alpha)
    phases, whole, seen = phases_of(held, B.shape, C, D, K, 1.0), one + other @ K, []
    for k, (length, own, stays, _) in enumerate(phases):
        for share in np.arange(parts + 1) / parts * length:
            moved = period(A, B, E, [*phases[:k], (share, *phases[k][1:])], plant.T, 1)[0]
            seen.append((own @ moved + stays)[0])
    whole[: len(A)] = period(A, B, E, phases, plant.T, 1)[0]
    if np.abs(np.linalg.eigvals(whole)).max() > 1 - 1e-9:
        return np.inf
    x = np.array([list(map(number, p)) for p in claim.get("points", [])]).reshape(-1, len(whole)).T
    X0, worst = array(claim["ellipsoid"]) if "ellipsoid" in claim else 0 * whole, 0.0
    for _ in range(400):
        worst = max(worst, float(np.abs(seen @ x).max(initial=0.0)))
        worst = max(worst, float(np.einsum("ij,jk,ik->i", seen, X0, seen).max()) ** 0.5)
        x, X0 = whole @ x, whole @ X0 @ whole.T
    return worst


def phases_of(held, shape, C, D, K, length):
    """Phases of a period of so many T: how long each is, z by x, what stays of it, u that acts.

    Inputs change a fixed time after a sample, whatever the period.
    """
    (n, m), whole = shape, K.shape[1]
    delay, early = held["delay"], number(held.get("early", 0))
    late = [K[:m], *np.eye(whole)[n : n + delay * m].reshape(delay, m, whole)]
    stays, first = C + D @ K, n + (delay - 1) * m
    stays[:, :n] -= C[:, :n]
    found = [(1 - early if early else length, C[:, :n], stays, late[delay])]
    if early:  # what shows the inputs that acted shows those that do now
        now = stays + C[:, first : first + m] @ (late[delay - 1] - late[delay])
        found.append((length - 1 + early, C[:, :n], now, late[delay - 1]))
    return found


def period(A, B, E, phases, time, parts=24):
    """What a period makes of the states, the noise it adds, and the integral of z'z in parts."""
    (n, m), width = B.shape, phases[0][2].shape[1]
    moved, added = np.eye(n, width), np.zeros((n, n))
    energy, more = np.zeros((width, width)), 0.0
    for length, C, stays, acting in phases:
        step = length * time / parts
        F = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * step)
        both = expm(np.block([[-A, E @ E.T], [np.zeros((n, n)), A.T]]) * step)
        W = both[n:, n:].T @ both[:n, n:]
        for k in range(parts + 1):
            row, weight = C @ moved + stays, step / 3 * (1 if k in (0, parts) else 2 + 2 * (k % 2))
            energy += weight * row.T @ row
            more += weight * np.trace(C @ added @ C.T)
            if k < parts:
                moved = F[:n, :n] @ moved + F[:n, n:] @ acting
                added = F[:n, :n] @ added @ F[:n, :n].T + W
    return moved, added, energy, more


def behind(claim, loop, T):
    """The loop with the filters of a claim behind its outputs."""
    A, E, C, F = loop
    if not any(claim.get("filters", [])):
        return loop
    outputs = []
    for row, through, own in zip(C, F, claim["filters"], strict=True):
        n = len(A)
        if not own:
            outputs.append((row, through))
            continue
        a, b, c = (array(own[key]) for key in "abc")
        size, stays = (T, np.eye(len(a))) if T else (1.0, 0.0)  # a and b are of the delta form
        own_row = np.concatenate([row, np.zeros(n - len(row))])
        A = np.block([[A, np.zeros((n, len(a)))], [size * b * own_row, stays + size * a]])
        E = np.vstack([E, size * b * through])
        outputs.append((np.concatenate([np.zeros(n), c[0]]), 0 * through))
    C = np.stack([np.concatenate([row, np.zeros(len(A) - len(row))]) for row, _ in outputs])
    return A, E, C, np.stack([through for _, through in outputs])


def stacked(plant, output, key):
    """One row of C, D or F at every vertex."""
    width = {"C": plant.A, "D": plant.B, "F": plant.E}[key].shape[2]
    return rows(output[key] if key in output else [[0] * width], len(plant.A), width)


def _reached(kind, claim, loop, passive, T):
    A, E, C, F = loop
    if T:
        return _reached_at_samples(kind, claim, loop, passive, T)
    if kind in ("rms", "relative rms"):
        own = _rms(A, E, C, number(claim.get("intensity", 1)))
        if kind == "rms":
            return own
        other, driven, y, _ = passive
        return own / _rms(other, driven, y, number(claim.get("intensity", 1)))
    if kind == "energy peak":
        return number(claim.get("norm", 1)) * _rms(A, E, C, 1.0)
    if kind == "gain" and "band" in claim:
        return _largest(A, E, C, F, 1j * in_band(claim))
    if kind == "gain":
        w = np.array([0.0, *np.geomspace(1e-3, 1e3, 60)])
        return max(float(np.linalg.norm(F, 2)), _largest(A, E, C, F, 1j * w))
    if kind in FOLLOWED:
        return _followed(kind, claim, A, E, C, F)
    if kind == "peak to peak":
        return _bounded(A, E, C) + float(np.abs(F).sum())
    starts = [np.array(list(map(number, p))) for p in claim.get("points", [])]
    sizes = map(number, claim.get("impulses", []))
    starts += [s * E[:, k] for k, s in enumerate(sizes)]
    step = expm(A * 0.02)
    worst, peak = 0.0, np.array(starts).T
    for _ in range(200):
        worst = max(worst, float(np.abs(C @ peak).max()))
        peak = step @ peak
    return worst


def in_band(claim):
    """Frequencies of a claim's band [rad/s]."""
    return 2 * np.pi * np.linspace(*map(number, claim["band"]), 60)


def _bounded(A, E, C, apart=0.01, count=2000):
    """No more than the integrals of |C exp(A t) E|: those of it over short times, without signs."""
    n = len(A)
    whole = expm(np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]]) * apart)
    step, over, total = whole[:n, :n], C @ whole[:n, n:], 0.0
    for _ in range(count):
        total += float(np.abs(over @ E).sum())
        E = step @ E
    return total


def _followed(kind, claim, A, E, C, F, apart=0.01, count=2000):
    """The measure of a response, of its values at times."""
    n = len(A)
    if kind == "bump":
        y, t, final, size = *_crossed(claim, A, E, C, F, apart, count), 0.0, 1.0
        return _measured(claim, y, t, final, size)
    x, b, F = np.zeros(n), E.sum(axis=1), F.sum(axis=1)
    if kind != "step":
        x, b, F = array(claim["start"]) if kind == "initial" else b, x, 0 * F
    whole = np.block([[A, b[:, None]], [np.zeros((1, n + 1))]])
    step, x, y = expm(whole * apart), np.append(x, 1.0), []
    for _ in range(count):
        y.append(float((C @ x[:n] + F)[0]))
        x = step @ x
    final = float((F - C @ np.linalg.solve(A, b))[0])
    y, t = np.array(y), apart * np.arange(count)
    size = (abs(final) or np.nan) if kind == "step" else 1.0
    return _measured(claim, y, t, final, size)


def _measured(claim, y, t, final, size):
    """The measure of y at times t, beside a size."""
    measure, band, s = claim["measure"], number(claim.get("band", 0)), np.sign(final)
    match measure:
        case "envelope":
            times, low, high = array(claim["envelope"]).T
            half = (np.interp(t, times, high) - np.interp(t, times, low)) / 2
            off = np.abs(y - np.interp(t, times, low) - half) / half
            return float(off[t >= times[0]].max(initial=0))
        case "peak":
            return max(float(np.abs(y).max()), abs(final))
        case "final":
            return abs(final)
        case "overshoot":
            return float((s * y).max() / size - 1)
        case "undershoot":
            return float(-(s * y).min() / size)
        case "settling":
            out = np.flatnonzero(np.abs(y - final) > (band + SLACK) * size)
            return float(t[out[-1]]) if len(out) else 0.0
    reached = np.flatnonzero(s * y >= (1 - band - SLACK) * size)
    return float(t[max(reached[0] - 1, 0)]) if len(reached) else np.inf


def _crossed(claim, A, E, C, F, apart, count):
    """y over a bump, by Simpson's rule on each step, and the times."""
    n, t = len(A), apart * np.arange(count)
    height, length, speed = (number(claim[key]) for key in ("height", "length", "speed"))
    halves = np.arange(2 * count) * apart / 2
    u = (halves - array(claim["late"])[:, None]) * speed / length
    on, angle = (u >= 0) & (u <= 1), 2 * np.pi * u
    each = {
        "rate": np.pi * height * speed / length * np.sin(angle),
        "height": height / 2 * (1 - np.cos(angle)),
    }
    w = np.array([(each[word] * on)[k] for k, word in enumerate(claim["acts"])])
    half, step, x, y = expm(A * apart / 2), expm(A * apart), np.zeros(n), []
    for k in range(count):
        y.append(float((C @ x + F @ w[:, 2 * k])[0]))
        if 2 * k + 2 < 2 * count:
            a, b, c = (E @ w[:, 2 * k + j] for j in range(3))
            x = step @ x + apart / 6 * (step @ a + 4 * half @ b + c)
    return np.array(y), t


def _largest(A, E, C, F, points):
    """The largest gain at points of the plane."""
    found = np.linalg.solve(points[:, None, None] * np.eye(len(A)) - A, E + 0j)
    return float(np.linalg.norm(C @ found + F, 2, (1, 2)).max())


def _reached_at_samples(kind, claim, loop, passive, T):
    A, E, C, F = loop
    if kind in ("rms", "relative rms", "energy peak"):
        noise = "rms" in kind
        size = number(claim.get("intensity", 1)) if noise else number(claim.get("norm", 1)) ** 2

        def own(A, E, C, _):
            P = solve_discrete_lyapunov(A, size / T * E @ E.T)
            return float(np.sqrt(max(np.trace(C @ P @ C.T), 0.0)))

        return own(*loop) / (own(*passive) if kind == "relative rms" else 1.0)
    if kind == "gain":
        turns = T * in_band(claim) if "band" in claim else np.linspace(0, np.pi, 60)
        return _largest(A, E, C, F, np.exp(1j * turns))
    starts = [np.array(list(map(number, p))) for p in claim.get("points", [])]
    sizes = map(number, claim.get("impulses", []))
    starts += [s * E[:, k] / T for k, s in enumerate(sizes)]
    worst, peak = 0.0, np.array(starts).T
    for _ in range(200):
        worst, peak = max(worst, float(np.abs(C @ peak).max())), A @ peak
    return worst


def exponential(claim, alpha, time):
    """F, G and H of the plant that a claim of samples is of, over a time."""
    A, B, E = Plant({"vertices": claim["vertices"], "parameters": []}).at(alpha)
    n, m, q = len(A), B.shape[1], E.shape[1]
    whole = expm(np.block([[A, B, E], [np.zeros((m + q, n + m + q))]]) * time)[:n]
    return whole[:, :n], whole[:, n : n + m], whole[:, n + m :]


def placed(plant, claim, alpha, A, B, E):
    """A, B and E with the samples in their places, and the inputs on their way behind them."""
    F, G, H = exponential(claim, alpha, plant.T)
    (n, m), delay = G.shape, claim.get("delay", 0)
    late = delay * m
    A, B, E = A.copy(), B.copy(), E.copy()
    A[: n + late], B[: n + late], E[: n + late] = 0, 0, 0
    A[:n, :n], E[:n] = F, H
    soon = exponential(claim, alpha, number(claim.get("early", 0)) * plant.T)[1]
    for after, acting in ((delay, G - soon), (delay - 1, soon)):
        if after > 0:
            A[:n, n + (after - 1) * m : n + after * m] += acting
        else:
            B[:n, :m] += acting
    if late:
        B[n : n + m, :m] = np.eye(m)
        A[n + m : n + late, n : n + late - m] = np.eye(late - m)
    return A, B, E


def false_samples(plant, _, claim):
    """Whether the matrix exponential is farther off than the remainder somewhere."""
    on = "box" if plant.ranges else "simplex"
    if plant.bends:
        return false_nodes(plant, claim)
    for alpha in plant.alphas(on):
        found = next(plant.near(alpha))
        apart = np.abs(np.hstack(found) - np.hstack(placed(plant, claim, alpha, *found)))
        if np.any(apart > plant.R * (1 + SLACK) + 1e-12):
            return True
    return False


def false_nodes(plant, claim):
    """Whether vertices and nodes are no samples, or these bend more on a part of the box."""
    count, rounding, along = len(plant.ranges), plant.bends["rounding"], plant.bends["along"]

    def weights(t):
        return np.array([prod(own) for own in product(*((1 - x, x) for x in t))])

    def exact(t):
        combined = [mix(weights(t), M) for M in (plant.A, plant.B, plant.E)]
        return np.hstack(placed(plant, claim, weights(t), *combined))

    corners = list(product((0, 1), repeat=count))
    known = [
        *zip(corners, map(np.hstack, zip(plant.A, plant.B, plant.E, strict=True)), strict=True)
    ]
    known += [(array(x["at"]), np.hstack([array(x[key]) for key in "ABE"])) for x in plant.nodes]
    if any(np.any(np.abs(M - exact(t)) > rounding * (1 + SLACK) + 1e-12) for t, M in known):
        return True
    for _ in range(10):
        low, t = plant.random.random((2, count))
        side = (1 - low) * plant.random.random(count)
        ends = np.array([exact(low + side * np.array(corner)) for corner in corners])
        apart = np.abs(exact(low + side * t) - mix(weights(t), ends))
        if np.any(apart > (rounding + mix(side**2, along) / 8) * (1 + SLACK) + 1e-12):
            return True
        if "third" in plant.bends and apart_between_middles(exact, low, side, t, plant.bends):
            return True
    return False


def apart_between_middles(exact, low, side, t, bounds):
    """Whether a parabola along each side, one after the other, is farther off than a file says."""
    values = np.array(
        [exact(low + side * np.array(own)) for own in product((0, 0.5, 1), repeat=len(t))]
    )
    allowed = (5 / 4) ** len(t) * bounds["rounding"]
    for k, x in enumerate(t):
        parabolas = np.array([(2 * x - 1) * (x - 1), 4 * x * (1 - x), x * (2 * x - 1)])
        values = np.tensordot(parabolas, values.reshape(3, -1, *values.shape[1:]), 1)
        allowed = allowed + (5 / 4) ** k * side[k] ** 3 / 124 * bounds["third"][k]
    return np.any(np.abs(exact(low + side * t) - values[0]) > allowed * (1 + SLACK) + 1e-12)


def false_saturation(plant, law, claim):
    """Whether a loop that is cut off runs away, at rest or from pushes."""
    level = number(claim["level"])
    outputs = claim["outputs"] if "outputs" in claim else [claim["output"]]
    C, D = (
        np.concatenate([stacked(plant, output, key) for output in outputs], axis=1)[0]
        for key in "CD"
    )
    moving = [int(np.flatnonzero(row)[0]) for row in D]
    alphas = plant.alphas(domain_of(claim, law), 2)
    A, B, E = map(np.stack, zip(*(next(plant.near(alpha)) for alpha in alphas), strict=True))
    K = np.stack([law.gain(alpha) for alpha in alphas])
    poles = np.linalg.eigvals(A + B @ K)
    if (np.abs(poles).max() - 1 if plant.T else poles.real.max()) > SLACK:
        return True
    norms = array(claim["norms"]) if "norms" in claim else np.zeros(E.shape[2])
    starts = [np.array(list(map(number, p))) for p in claim.get("points", [])]
    x = np.tile(np.array(starts) if starts else np.zeros((4, A.shape[1])), (len(A), 1, 1))
    dt = 0.02 / np.maximum(1.0, np.abs(poles).max(axis=1))[:, None, None]
    dt = np.full_like(dt, plant.T) if plant.T else dt
    lengths = np.array([0.1, 0.5, 1.0, 3.0])[:, None]
    more = law.more.T if law.more is not None else np.zeros(B.shape[:0:-1])
    drive, (A, B, K) = (E @ norms)[:, None, :], (np.swapaxes(M, 1, 2) for M in (A, B, K))
    for k in range(min(int(30 / dt.min()), 6000)):
        asked = x @ K
        u = asked.copy()
        for c, d, j in zip(C, D, moving, strict=True):
            middle, half = -(x @ c) / d[j], level / abs(d[j])
            u[..., j] = np.clip(u[..., j], middle - half, middle + half)
        push = 0.0 if starts else np.where(k * dt < lengths, lengths**-0.5, 0.0) * drive
        moved, back = x @ A + u @ B + push, (u - asked) @ more
        x = moved + plant.T * back if plant.T else x + dt * (moved + back)
    return not np.abs(x).max() < 1e3


def _rms(A, E, C, intensity):
    P = solve_continuous_lyapunov(A, -intensity * E @ E.T)
    return float(np.sqrt(max(np.trace(C @ P @ C.T), 0.0)))


def false_norm(plant, law, claim):
    rows_, columns = (array(claim[key]) for key in ("rows", "columns"))
    level = number(claim["level"]) * (1 + SLACK)
    scaled = (
        law.gain(alpha) / rows_[:, None] * columns for alpha in plant.alphas(domain_of(claim, law))
    )
    return any(np.linalg.norm(K, 2) > level for K in scaled)


def false_estimate(plant, law, claim):
    errors, lows = array(claim["errors"]), np.array([r[0] for r in plant.ranges])
    highs = np.array([r[1] for r in plant.ranges])
    for q in plant.values():
        for signs in product((-1, 1), repeat=len(errors)):
            p = np.clip(q + np.array(signs) * errors, lows, highs)
            alpha = plant.alpha(p)
            K = law.gain(plant.alpha(q))
            A, B, _ = plant.at(alpha)
            if outside(claim["region"], np.linalg.eigvals(A + B @ K)) > SLACK:
                return True
    return False


def columns_of(claim):
    columns = array(claim["columns"])
    return np.diag(columns) if columns.ndim == 1 else columns


def false_gain(plant, law, claim, gain=None):
    scales, T, error = array(claim["rows"]), columns_of(claim), number(claim["error"])
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        (A, B, _), K = plant.at(alpha), (gain or law.gain)(alpha)
        for _ in range(4):
            D = plant.random.normal(size=(len(scales), len(T)))
            D /= np.linalg.norm(D, 2)
            off = K + error * scales[:, None] * (D @ T)
            if outside(claim["region"], np.linalg.eigvals(A + B @ off)) > SLACK:
                return True
    return False


def false_disk_margin(plant, law, claim):
    """Whether complex factors of the disks, on its edge, make a loop unstable."""
    inputs, read = claim.get("inputs", []), claim.get("measured", [])
    skew, margin = number(claim.get("skew", 0)), 1 / number(claim["level"])
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        for A, B, _ in plant.near(alpha):
            own = law.own(alpha) if law.polynomial else law.gain(alpha)
            C = getattr(law, "C", None)
            C = np.eye(len(A)) if C is None else np.tensordot(alpha, C, 1)
            for _ in range(40):
                turned = np.exp(2j * np.pi * plant.random.random(len(inputs) + len(read)))
                d = margin * turned
                f = (1 + (1 - skew) / 2 * d) / (1 - (1 + skew) / 2 * d)
                at_u, at_y = np.ones(B.shape[1], complex), np.ones(len(C), complex)
                at_u[[k - 1 for k in inputs]] = f[: len(inputs)]
                at_y[[k - 1 for k in read]] = f[len(inputs) :]
                poles = np.linalg.eigvals(A + B * at_u @ own * at_y @ C)
                size = max(1.0, np.abs(poles).max())
                if (np.abs(poles).max() - 1 if plant.T else poles.real.max() / size) > SLACK:
                    return True
    return False


def with_dynamics(plant, law, claim, alpha, deltas, outputs=()):
    """The loop with complex numbers in the place of dynamics: A, E, C, F from w to outputs.

    The unknowns beside its states are u, what arrives of it, and what acts: w with what paths add.
    """
    (A, B, E), K = plant.at(alpha), law.gain(alpha)
    (n, m), q = B.shape, E.shape[1]
    P = law.passing(alpha) * np.ones((m, q))
    inputs, paths = claim.get("inputs", []), claim.get("paths", {"outputs": [], "disturbances": []})

    def seen(output):
        rows = (mix(alpha, stacked(plant, output, key)) for key in "CDF")
        C, D, F = (row.reshape(1, -1) for row in rows)
        sent = not np.any(C)  # of inputs alone it is what is sent
        return C, np.hstack([D, 0 * D, F] if sent else [0 * D, D, F])

    # v_k = C_k x + D_k U of each loop, and where it is added in U
    loops = [(np.zeros((1, n)), np.eye(1, 2 * m + q, k - 1), m + k - 1) for k in inputs]
    for output, j in zip(paths["outputs"], paths["disturbances"], strict=True):
        loops.append((*seen(output), 2 * m + j - 1))
    shapes = claim["filters"]
    sizes = [len(shape.get("a", [])) for shape in shapes]
    M, N = np.eye(2 * m + q, dtype=complex), np.zeros((2 * m + q, n + sum(sizes)), complex)
    M[:m, 2 * m :], N[:m, :n], M[m : 2 * m, :m] = -P, K, -np.eye(m)
    A_z, rows, at = np.zeros((sum(sizes),) * 2), [], n
    for (C, D, to), shape, delta, size in zip(loops, shapes, deltas, sizes, strict=True):
        own, d = slice(at, at + size), number(shape.get("d", 0))
        M[to] -= delta * d * D[0]
        N[to, :n] += delta * d * C[0]
        if size:
            a, b, c = (array(shape[key]) for key in "abc")
            N[to, own], A_z[at - n : at - n + size, at - n : at - n + size] = delta * c[0], a
            rows.append((b @ C, b @ D))
        at += size
    scales = array(claim["disturbances"]) if "disturbances" in claim else np.ones(q)
    into = np.vstack([np.zeros((2 * m, q)), np.diag(scales * np.ones(q))])
    U, of_w = np.linalg.solve(M, N), np.linalg.solve(M, into)
    moved = np.hstack([np.zeros((n, m)), B, E])
    moved = np.vstack([moved, *(D for _, D in rows)])
    fed = np.vstack(
        [
            np.hstack([A, np.zeros((n, sum(sizes)))]),
            *(np.hstack([C, np.zeros((len(C), sum(sizes)))]) for C, _ in rows),
        ]
    )
    fed[n:, n:] += A_z
    z = [seen(y) for y in outputs]
    C = np.vstack([np.hstack([C, np.zeros((1, sum(sizes)))]) + D @ U for C, D in z]) if z else None
    F = np.vstack([D @ of_w for _, D in z]) if z else None
    return fed + moved @ U, moved @ of_w, C, F


def false_unmodelled(plant, law, claim):
    """Whether complex numbers in the place of unmodelled dynamics make a loop unstable."""
    size = 1 / number(claim["level"])
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        for _ in range(40):
            deltas = size * np.exp(2j * np.pi * plant.random.random(len(claim["filters"])))
            poles = np.linalg.eigvals(with_dynamics(plant, law, claim, alpha, deltas)[0])
            if poles.real.max() / max(1.0, np.abs(poles).max()) > SLACK:
                return True
    return False


def errors_of(claim, T):
    """What each loop is multiplied by with its error, as a filter (a, b, c, d)."""
    loops = claim["loops"]
    skew, shapes = number(loops.get("skew", 0)), loops.get("filters")
    p, q = (1 - skew) / 2, (1 + skew) / 2
    for k, error in enumerate(loops["errors"]):
        g, a = number(error["gain"]), number(error.get("pole", 0))
        # delta = (t1 s + t0) / (s + b0), or g; s is z in discrete time
        t1, t0, b0 = (-g * a, g, -a) if T else (g, -g * a, a)
        if "pole" not in error:
            t1, t0, b0 = g, g, 1.0
        if not shapes:  # f = (1 + p delta) / (1 - q delta)
            n1, n0, d1, d0 = 1 + p * t1, b0 + p * t0, 1 - q * t1, b0 - q * t0
            own = [[-d0 / d1]], [[1.0]], [[n0 / d1 - n1 * d0 / d1**2]], n1 / d1
            yield tuple(np.array(M) for M in own)
            continue
        A, B, C = (array(shapes[k][key]) for key in "abc")  # f = 1 + delta W
        D, n = number(shapes[k].get("d", 0)), len(A)
        a = np.block([[A, np.zeros((n, 1))], [C, -b0 * np.ones((1, 1))]])
        b = np.vstack([B, [[D]]])
        yield a, b, np.hstack([t1 * C, [[t0 - t1 * b0]]]), np.array(1 + t1 * D)


def beside(errors, places, count):
    """Filters of some of so many signals as one."""
    a, b, c, d = [], [], [], np.eye(count)
    for (A, B, C, D), k in zip(errors, places, strict=True):
        row = np.zeros((1, count))
        row[0, k - 1], d[k - 1, k - 1] = 1, D
        a.append(A)
        b.append(B @ row)
        c.append(row.T @ C)
    if not a:
        return np.zeros((0, 0)), np.zeros((0, count)), np.zeros((count, 0)), d
    return block_diag(*a), np.vstack(b), np.hstack(c), d


def false_failure(plant, law, claim):
    """Whether all poles are in the region at the point."""
    shares = [number(x) for x in claim["at"]]
    pairs = [(1 - t, t) for t in shares]
    alpha = np.array([prod(w) for w in product(*pairs)]) if plant.ranges else np.array(shares)
    A, B, _ = plant.at(alpha)
    if "elements" in claim:
        numbers = [number(k) for k in claim["elements"]["numbers"]]
        loops = closed_by(plant, law, claim["elements"], alpha, numbers)
        return any(outside(claim["region"], np.linalg.eigvals(M)) < -SLACK for M in loops)
    if "loops" not in claim:
        poles = np.linalg.eigvals(A + B @ law.gain(alpha))
        return outside(claim["region"], poles) < -SLACK
    own = law.own(alpha) if law.polynomial else law.gain(alpha)
    C = getattr(law, "C", None)
    C = np.eye(len(A)) if C is None else np.tensordot(alpha, C, 1)
    inputs, read = (claim["loops"].get(key, []) for key in ("inputs", "measured"))
    errors = list(errors_of(claim, plant.T))
    au, bu, cu, du = beside(errors[: len(inputs)], inputs, B.shape[1])
    ay, by, cy, dy = beside(errors[len(inputs) :], read, len(C))
    loop = [
        [A + B @ du @ own @ dy @ C, B @ du @ own @ cy, B @ cu],
        [by @ C, ay, np.zeros((len(ay), len(au)))],
        [bu @ own @ dy @ C, bu @ own @ cy, au],
    ]
    return outside(claim["region"], np.linalg.eigvals(np.block(loop))) < -SLACK


def false_factor_margin(plant, law, claim):
    """Whether a factor of the set, at its ends and between, makes a loop unstable."""
    margin = 1 / number(claim["level"])
    factors = margin ** np.linspace(-1, 1, 15)
    if claim["kind"] == "phase margin":
        factors = np.exp(1j * np.radians(np.linspace(-margin, margin, 15)))
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        for A, B, _ in plant.near(alpha):
            own = law.own(alpha) if law.polynomial else law.gain(alpha)
            C = getattr(law, "C", None)
            C = np.eye(len(A)) if C is None else np.tensordot(alpha, C, 1)
            for f in factors:
                at_u, at_y = np.ones(B.shape[1], complex), np.ones(len(C), complex)
                at = at_u if "input" in claim else at_y
                at[claim.get("input", claim.get("measured")) - 1] = f
                poles = np.linalg.eigvals(A + B * at_u @ own * at_y @ C)
                size = max(1.0, np.abs(poles).max())
                if (np.abs(poles).max() - 1 if plant.T else poles.real.max() / size) > SLACK:
                    return True
    return False


def false_worst_case(plant, law, claim):
    """Whether complex numbers in the place of dynamics make the gain exceed its level."""
    level, outputs = number(claim["level"]) * (1 + SLACK), claim["outputs"]
    w = np.array([0.0, *np.geomspace(1e-2, 1e3, 40)])
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        for _ in range(20):
            deltas = np.exp(2j * np.pi * plant.random.random(len(claim["filters"])))
            loop = with_dynamics(plant, law, claim, alpha, deltas, outputs)
            poles = np.linalg.eigvals(loop[0])
            if poles.real.max() / max(1.0, np.abs(loop[0]).max()) > SLACK:
                return True
            if _largest(*loop, 1j * w) > level:
                return True
    return False


def closed_by(plant, law, claim, alpha, numbers):
    """The closed loops at a point whose elements are numbers: w = k y."""
    C, D = (
        np.concatenate([stacked(plant, y, key) for y in claim["outputs"]], axis=1) for key in "CD"
    )
    places = [k - 1 for k in claim["disturbances"]]
    for A, B, E in plant.near(alpha):
        K, P = law.gain(alpha), law.passing(alpha) * np.ones((B.shape[1], E.shape[1]))
        # [u; w] = L [x; u; w]
        m, q = B.shape[1], len(places)
        rows = np.zeros((m + q, len(A) + m + q))
        rows[:m, : len(A)], rows[:m, len(A) + m :] = K, P[:, places]
        k = np.array(numbers)[:, None]
        rows[m:, : len(A)], rows[m:, len(A) : len(A) + m] = k * mix(alpha, C), k * mix(alpha, D)
        sent = np.linalg.solve(np.eye(m + q) - rows[:, len(A) :], rows[:, : len(A)])
        yield A + np.hstack([B, E[:, places]]) @ sent


def false_sector(plant, law, claim):
    """Whether numbers in the sectors make a loop unstable."""
    ends, level = array(claim["sectors"]), number(claim["level"])
    middle, half = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2 / level
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        shares = plant.random.uniform(-1, 1, (20, len(ends)))
        for share in [*product((-1, 0, 1), repeat=len(ends)), *shares]:
            for loop in closed_by(plant, law, claim, alpha, middle + half * np.array(share)):
                poles = np.linalg.eigvals(loop)
                size = max(1.0, np.abs(poles).max())
                if (np.abs(poles).max() - 1 if plant.T else poles.real.max() / size) > SLACK:
                    return True
    return False


def false_delay_margin(plant, law, claim):
    """Whether the loop is on the edge of stability with a shorter delay."""
    i, margin = claim["inputs"][0] - 1, 1 / number(claim["level"])
    if plant.T:
        return late_by_samples(plant, law, i, int(margin / plant.T))
    w = np.geomspace(1e-3, 1e3, 2000)
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        (A, B, _), K = plant.at(alpha), law.gain(alpha)
        rest = A + B @ K - B[:, i : i + 1] @ K[i : i + 1]
        s = 1j * w[:, None, None] * np.eye(len(A))
        L = (K[i : i + 1] @ np.linalg.solve(s - rest, B[:, i : i + 1].astype(complex)))[:, 0, 0]
        size = np.abs(L) - 1
        for k in np.flatnonzero(size[:-1] * size[1:] < 0):  # 1 = L exp(-j w t)
            if (np.angle(L[k]) % (2 * np.pi)) / w[k] < margin * (1 - 1e-2):
                return True
    return False


def late_by_samples(plant, law, i, most):
    """Whether the loop is unstable with an input late by some number of samples up to this."""
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        (A, B, _), K = plant.at(alpha), law.gain(alpha)
        n, rest = len(A), A + B @ K - B[:, i : i + 1] @ K[i : i + 1]
        for late in range(1, min(most, 60) + 1):
            Z = np.zeros((n + late, n + late))
            Z[:n, :n], Z[:n, n], Z[-1, :n] = rest, B[:, i], K[i]
            Z[n:-1, n + 1 :] = np.eye(late - 1)
            if np.abs(np.linalg.eigvals(Z)).max() > 1 + SLACK:
                return True
    return False


def false_each_gain(plant, law, claim):
    sizes, error = array(claim["sizes"]), number(claim["error"])
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        (A, B, _), K = plant.at(alpha), law.gain(alpha)
        C = getattr(law, "C", None)
        for _ in range(6):
            off = error * sizes * plant.random.choice([-1.0, 1.0], size=sizes.shape)
            off = off if C is None else off @ np.tensordot(alpha, C, 1)
            if outside(claim["region"], np.linalg.eigvals(A + B @ (K + off))) > SLACK:
                return True
    return False


def false_rate(plant, law, claim):
    """At constant parameters, which move at no rate; and along motions at their rates."""
    decay = number(claim["decay"])
    slow = any(
        np.linalg.eigvals(A + B @ law.gain(a)).real.max() > -decay + SLACK * max(1.0, decay)
        for a in plant.alphas("box" if plant.ranges else "simplex")
        for A, B, _ in [plant.at(a)]
    )
    if slow or not plant.ranges:
        return slow
    moving, rates = copy.copy(plant), claim["rates"]
    each = [rates] * len(plant.ranges) if rates == "any" else map(number, rates)
    moving.rates = [rate if rate == "any" else (-rate, rate) for rate in each]
    return motions.false_decay(moving, law, decay=decay)


def false_sampled(plant, law, claim):
    time, decay = number(claim["sample_time"]), number(claim["decay"])
    n, m = plant.A.shape[1], plant.B.shape[2]
    limit = np.exp(-decay * time) * (1 + SLACK)
    for alpha in plant.alphas("box" if plant.ranges else "simplex", 6):
        A, B, K = mix(alpha, plant.A), mix(alpha, plant.B), law.gain(alpha)
        whole = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)[:n]
        for _ in range(3):
            off, D = claim.get("off"), 0.0
            if off:
                D = plant.random.normal(size=(m, n))
                D = D / np.linalg.norm(D, 2) * number(off["error"])
                D = array(off["rows"])[:, None] * (D @ array(off["columns"]))
            own = K + D
            late = m - int(claim.get("prompt", 0)) if claim.get("delay", 1) else 0
            F, G = whole[:, :n], whole[:, n:]
            loop = np.block(
                [[F + G[:, late:] @ own[late:], G[:, :late]], [own[:late], np.zeros((late, late))]]
            )
            if np.abs(np.linalg.eigvals(loop)).max() > limit:
                return True
    return False


def false_rounding(plant, law, claim):
    """The code's constants as a law of their own, without its rounding."""
    code, apart = claim["code"], 0.0
    if false_gain(plant, law, claim["gain"]):
        return True
    if "K" in code or "terms" in code:
        own, gains = copy.copy(law), [array(K) for K in code.get("terms", [code.get("K")])]
        if law.polynomial:
            own.terms = [(e, K) for (e, _), K in zip(law.terms, gains, strict=True)]
        else:
            own.fixed, own.K = True, gains[0]
        T = np.eye(plant.A.shape[1])
    else:
        T, table = array(code["T"]), {"kind": "scheduled", "W": code["W"], "Z": code["Z"]}
        apart = array(code["L"]) if "L" in code else 0.0
        own = Law(table | {"degree": law.degree, "on": law.on}, len(plant.A))
    for alpha, told in told_by(plant, code.get("shares", [])):
        A, B, _ = plant.at(alpha)
        loop = A + B @ (own.gain(told) + apart) @ T
        if outside(claim["gain"]["region"], np.linalg.eigvals(loop)) > 1e-4:
            return True
    return False


def told_by(plant, shares):
    """Yield alpha, and the alpha that the code computes of the same parameters."""
    if not shares:
        yield from ((a, a) for a in plant.alphas("box" if plant.ranges else "simplex"))
        return
    for values in plant.values():
        pairs = []
        for p, (_, _, inverted), share in zip(values, plant.ranges, shares, strict=True):
            low, high, scale = (number(share[key]) for key in ("low", "high", "scale"))
            p = np.clip(p, low, high)
            weight = scale * (p - low) / (p if inverted else 1)
            pairs.append((1 - weight, weight))
        yield plant.alpha(values), np.array([prod(choice) for choice in product(*pairs)])


def false_cells(plant, table, claim):
    """At points of the cells that are called proved, and of those called refuted."""
    grid = [array(knots) for knots in table["grid"]]
    shape = [len(knots) for knots in grid]
    gains = array(table["gains"])
    gains = gains.reshape(*shape, *gains.shape[1:])

    def gain(p):
        K = gains
        for knots, v in zip(grid, p, strict=True):
            i = min(max(int(np.searchsorted(knots, v)) - 1, 0), len(knots) - 2)
            t = (v - knots[i]) / (knots[i + 1] - knots[i])
            K = (1 - t) * K[i] + t * K[i + 1]
        return K

    def out(p):
        alpha = plant.alpha(p)
        loop = mix(alpha, plant.A) + mix(alpha, plant.B) @ gain(p)
        return outside(claim["region"], np.linalg.eigvals(loop))

    for cell in claim["cells"]:
        low, high = (array(cell[key]) for key in ("low", "high"))
        if cell["answer"] == "proved":
            points = [*product(*zip(low, high, strict=True))]
            points += list(low + (high - low) * plant.random.random((6, len(low))))
            if any(out(np.array(p)) > SLACK for p in points):
                return True
        elif cell["answer"] == "refuted" and out(array(cell["at"])) < -SLACK:
            return True
    return False


def rows_of(claim, count, shape):
    """The rows C, D and, of three widths, F of a limit's outputs at every vertex, as one matrix."""
    found = []
    for key, width in zip("CDF"[: len(shape)], shape, strict=True):
        each = [array(own.get(key, [[0] * width])) for own in claim["outputs"]]
        full = [np.repeat(own, count, axis=0) if len(own) == 1 else own for own in each]
        found.append(np.stack(full, axis=1))
    return found


def noise_of(plant, claim, intensity):
    scales = array(claim["disturbances"]) if "disturbances" in claim else 1.0
    return plant.E * scales * np.sqrt(number(intensity))


def dampers_of(claim, count):
    """For each damper its input, its rate by the state, and its bounds."""
    found = []
    for own in claim.get("dampers", ()):
        rate = array(own["rate"])
        rate = np.repeat(rate, count, axis=0) if len(rate) == 1 else rate
        found.append((own["input"] - 1, rate, number(own["low"]), number(own["high"])))
    return found


def false_clipped(plant, law, claim):
    """Drives over roads that are drawn, and dampers stuck at their bounds."""
    N, limit, K = len(plant.A), claim["limit"], array(claim["K"])
    C, D = rows_of(limit, N, (plant.A.shape[1], plant.B.shape[2]))
    E, dampers = noise_of(plant, claim, limit.get("intensity", 1)), dampers_of(claim, N)
    for alpha in plant.alphas("simplex", 2):
        A, B, E0, C0, D0 = (mix(alpha, M) for M in (plant.A, plant.B, E, C, D))
        V = np.stack([mix(alpha, rate) for _, rate, _, _ in dampers])
        low, high = (np.array([own[k] for own in dampers]) for k in (2, 3))
        for c in product(*zip(low, high, strict=True)):
            if np.linalg.eigvals(A + B @ (np.array(c)[:, None] * V)).real.max() > SLACK:
                return True
        reached = _driven(A, B, E0, C0, D0, V, K, low, high, plant.random)
        if reached > 1.05 * number(limit["level"]):
            return True
    return False


def _driven(A, B, E, C, D, V, K, low, high, random):
    loops = [A + B @ (c[:, None] * V) for c in (low, high)]
    rates = np.abs(np.concatenate([np.linalg.eigvals(own) for own in loops]))
    step, steps = 0.05 / rates.max(), 4000

    def forces(x):
        v, u = x @ V.T, x @ K.T
        return np.clip(u, np.minimum(low * v, high * v), np.maximum(low * v, high * v))

    def moved(x):
        return x @ A.T + forces(x) @ B.T

    x, total = np.zeros((200, len(A))), 0.0
    for k in range(steps):
        for half in range(2):
            x = x + random.standard_normal((len(x), E.shape[1])) @ E.T * np.sqrt(step / 2)
            x = x + step * moved(x + step / 2 * moved(x)) if not half else x
        if k >= steps // 2:
            total += np.mean(np.sum((x @ C.T + forces(x) @ D.T) ** 2, axis=1)) / (steps // 2)
    return np.sqrt(total)


def false_conflict(plant, law, claim):
    """Dampers that stay keep all of the limits times the factor."""
    j, N = claim["vertex"] - 1, len(plant.A)
    n, m = plant.A.shape[1], plant.B.shape[2]
    dampers = dampers_of(claim, N)
    for share in np.linspace(0, 1, 9):
        K = np.zeros((m, n))
        for k, rate, low, high in dampers:
            K[k] += (low + share * (high - low)) * rate[j]
        loop = plant.A[j] + plant.B[j] @ K
        if np.linalg.eigvals(loop).real.max() >= 0:
            continue
        kept = []
        for limit in claim["limits"]:
            E = noise_of(plant, claim, limit.get("intensity", 1))[j]
            X = solve_continuous_lyapunov(loop, -E @ E.T)
            C, D = (rows[j] for rows in rows_of(limit, N, (n, m)))
            Y = C + D @ K
            level = number(limit["level"]) * number(claim["factor"])
            kept.append(np.trace(Y @ X @ Y.T) < level**2 * (1 - SLACK))
        if all(kept):
            return True
    return False


def has_less(A, E, C, F, level):
    """Whether a stable loop has a gain below a level: no eigenvalue on the imaginary axis."""
    R = level**2 * np.eye(E.shape[1]) - F.T @ F
    if np.linalg.eigvals(A).real.max() >= 0 or np.linalg.eigvalsh(R).min() <= 0:
        return False
    S = np.linalg.inv(R)
    M = A + E @ S @ F.T @ C
    both = np.block([[M, E @ S @ E.T], [-C.T @ (np.eye(len(C)) + F @ S @ F.T) @ C, -M.T]])
    values = np.linalg.eigvals(both)
    return bool(np.abs(values.real).min() > 1e-7 * np.abs(values).max())


def false_gain_conflict(plant, law, claim):
    """Gains of all states keep all of the limits: of games over the outputs, and of regulators."""
    j, N = claim["vertex"] - 1, len(plant.A)
    A, B = plant.A[j], plant.B[j]
    E = noise_of(plant, claim, 1)[j]
    (n, m), q = B.shape, E.shape[1]
    own = array(claim["disturbances"]) if "disturbances" in claim else np.ones(q)
    rows = [
        (
            *(M[j] for M in rows_of(limit, N, (n, m, q))),
            number(limit["level"]) * number(claim["factor"]),
        )
        for limit in claim["limits"]
    ]
    kept = [level for *_, level in rows]
    if min(kept) <= 0:
        return False
    laws = [np.zeros((m, n))]
    for share in (1.0, 0.8, 0.5, 0.2):
        for times in (0.5, 0.9, 0.99, 0.999, 1.0, 1e3):
            weights = [share, *[(1.0 - share) / (len(rows) - 1) + 1e-9 for _ in rows[1:]]]
            scaled = [w**0.5 / level for w, level in zip(weights, kept, strict=True)]
            C = np.vstack([s * r[0] for s, r in zip(scaled, rows, strict=True)])
            D = np.vstack([s * r[1] for s, r in zip(scaled, rows, strict=True)])
            R = block_diag(D.T @ D + 1e-9 * np.eye(m), -(times**2) * np.eye(q))
            S = np.hstack([C.T @ D, np.zeros((n, q))])
            try:
                P = solve_continuous_are(A, np.hstack([B, E]), C.T @ C, R, s=S)
            except (np.linalg.LinAlgError, ValueError):
                continue
            laws.append(-np.linalg.solve(R[:m, :m], B.T @ P + D.T @ C))
        if len(rows) == 1:
            break
    return any(
        all(has_less(A + B @ K, E, C + D @ K, F * own, g * (1 - SLACK)) for C, D, F, g in rows)
        for K in laws
    )


FOLLOWED = ("step", "initial", "impulse", "bump")
# Of which a disturbance may pass straight into the signal.
DIRECT = ("gain", "step", "initial", "bump", "peak to peak")
FALSE = {
    "clipped": false_clipped,
    "conflict": false_conflict,
    "gain conflict": false_gain_conflict,
    "region": false_region,
    "observer": false_observer,
    **dict.fromkeys(("rms", "relative rms", "energy peak", "initial peak", "gain"), false_signal),
    "saturation": false_saturation,
    "gain norm": false_norm,
    "estimate": false_estimate,
    "gain error": false_gain,
    "error of each gain": false_each_gain,
    "disk margin": false_disk_margin,
    "failure": false_failure,
    "unmodelled dynamics": false_unmodelled,
    **dict.fromkeys(("gain margin", "phase margin"), false_factor_margin),
    "delay margin": false_delay_margin,
    "worst-case gain": false_worst_case,
    "sector": false_sector,
    **dict.fromkeys((*FOLLOWED, "peak to peak"), false_signal),
    "rate": false_rate,
    "decay": false_clocked,
    "sampled": false_sampled,
    "samples": false_samples,
    "rounding": false_rounding,
    "cells": false_cells,
}


def false(document, seed=0):
    """Whether samples contradict a claim of a file, plain data of JSON."""
    plant = Plant(document["plant"], seed, document["claims"])
    table = document.get("law")
    law = (
        table
        if table is None or table["kind"] == "table"
        else (Law(table, len(plant.A), document["plant"]))
    )
    with np.errstate(all="ignore"):
        return any(FALSE[claim["kind"]](plant, law, claim) for claim in document["claims"])


def count(sizes, degree):
    """Number of monomials, for tests of the order here."""
    return prod(comb(size - 1 + degree, degree) for size in sizes)
