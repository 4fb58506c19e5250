"""Worst-case gain: from disturbances to a signal, whatever dynamics that no model has are added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.base.explained import explained_fields
from polefence.law.laws import Law, law_or_table
from polefence.lmi.conditions import performance as conditions
from polefence.plant.delta import delta_form
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.plant.weights import shape_of
from polefence.proof import claims as proof
from polefence.proof.claims.disk_margin import Loops, through
from polefence.proof.claims.worst_gain import SKEW, alone, demands, is_sent
from polefence.requirements.disk_margin import (
    ENOUGH,
    FARTHEST,
    FEW,
    HASTY,
    MOST_STEPS,
    ROUNDS,
    LoopGain,
    Posed,
    Unmodelled,
    named_disturbances,
    open_loops,
    opened_subject,
    place_of,
    reading_beside,
    rounded,
    shaped,
)
from polefence.requirements.gain import Gain, Highest
from polefence.requirements.slopes import Channel, Slopes, Turned
from polefence.requirements.slopes import Loops as ClosedLoops
from polefence.requirements.specification import Row, Specification
from polefence.requirements.weights import Shape, behind
from polefence.response.closed import close
from polefence.response.modes import Modes
from polefence.response.peaks import largest, peaks, response
from polefence.response.stationary import growth

BITS = 24  # of the weight of a loop
ALIKE = 1e-3  # of the highest value, those that are alike where weights are best
LEAST_SHARE = 0.02  # of a peak that is of z: slopes of the others are taken as of this one
SOME, AT_ONCE = 40, 16  # loops and responses of them that weights are first found for
NEAR = 0.8  # of the highest peak: those that weights are found for
FREQUENCIES = 3  # of a point, at which dynamics are sought; and points that are looked at closely
CLOSELY, ZOOMS, WITHIN = 20, 6, 9
TURNS, NEARER = 12, 4  # of a circle, and how often the best is looked at more closely
ROUNDS_OF_TURNS = 3  # of several loops
CHUNK = 250  # points at once


@dataclass(frozen=True)
class WorstCaseGain(Gain):
    """The largest L2 gain from the disturbances to a signal that unmodelled dynamics can make.

    At inputs u becomes (1 + delta W) u, delta any stable system of L2 gain up to one, one that
    varies in time among them; of several inputs each has its own. It is the gain of robust
    performance: mu is below one where it is at most one.

    Attributes
    ----------
    inputs : str or sequence of str
        Inputs, by their names.
    weight : str or mapping
        W, the share by which an input may be off at each frequency, as `with_weight` takes one.
    """

    inputs: Any = field(default=(), kw_only=True)
    weight: Any = field(default="", kw_only=True)
    kind = "worst-case gain"
    keys = ("disturbances", "inputs", "weight")

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        named = (self.inputs,) if isinstance(self.inputs, str) else self.inputs
        good = isinstance(named, Sequence) and named and all(isinstance(x, str) for x in named)
        if not good or len(set(named)) < len(named):
            written = "an empty list" if named in ([], ()) else shown(self.inputs)
            raise InputError(
                f'inputs = {written} must name inputs, each once; write inputs = ["NAME"]'
            )
        self._settle("inputs", tuple(named))
        if isinstance(self.weight, str):
            self._settle("weight", "".join(self.weight.split()))
        _ = self.shapes

    @classmethod
    def read(cls, row: Row) -> WorstCaseGain:
        """Return what a row says."""
        table = row.table
        for key, written in (("inputs", '["NAME"]'), ("weight", '"(3*s + 18.5)/(s + 46.3)"')):
            if key not in table:
                raise InputError(f"{key} is missing; write {key} = {written}")
        own = {key: table[key] for key in ("inputs", "weight")}
        return cls(table["signal"], **row.given(), **own)

    @property
    def title(self) -> str:
        """Kind, signal, chosen disturbances, inputs and weight, as a line has them."""
        inputs = ", ".join(self.inputs)
        return f"{super().title} with inputs [{inputs}] with weight {self.shapes[0].name}"

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The weight at each input."""
        return (Shape(shape_of(self.weight, self.kind)),) * len(self.inputs)

    def unweighted(self) -> Gain:
        """Return the gain without dynamics."""
        return Gain(self.signal, self.at_most, disturbances=self.disturbances)

    @property
    def presumed(self) -> tuple[Specification, ...]:
        """That the loop stays stable: else there is no such gain."""
        return (Unmodelled(self.inputs, 1.0, weight=self.weight),)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a sampled plant, and what is no input."""
        super().require_fit(plant)
        self.presumed[0].require_fit(plant)

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,  # noqa: ARG002
        unit: float | None = None,  # noqa: ARG002
        law: Law | None = None,  # noqa: ARG002
    ) -> tuple[conditions.Source, conditions.Output]:
        """Refuse it."""
        raise InputError(self.beyond_lmi(plant))

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has its weight."""
        return f"{self.title}: no LMI has its weight; leave out the method, so that a law is tuned"

    # --- what it is in the loop that is opened ---------------------------------------------------

    def posed(self, plant: UncertainPlant, law: Any) -> Posed:
        """Return the plant with its loops opened, the law beside it, and the gain to be bounded."""
        level, weights = self._weighed(plant, law)
        if not np.isfinite(level):
            raise InputError(f"{self.title}: dynamics within the weight make the loop unstable")
        return self._opened(plant, law, level, weights)

    def nearest(self, plant: UncertainPlant, law: Any) -> float:
        """Return about the least level that can be proved of it; infinite where there is none."""
        return self._weighed(plant, law)[0]

    def _weighed(self, plant: UncertainPlant, law: Any) -> tuple[float, tuple[Fraction, ...]]:
        """Return the level, and a weight for each loop, that are about best at a few points."""
        alpha = seeded(plant, len(plant.vertices) + FEW)
        loops = self._closed(plant, law, alpha)
        if not np.all(growth(loops.modes.poles, loops.modes.step) < 0):
            return np.inf, ()
        x, level, _ = scaled(loops, len(self.entries), self.at_most)
        level = self.at_most or level
        if not np.isfinite(level):
            return np.inf, ()
        return level, tuple(rounded(d, BITS) for d in (level * np.exp(x)).tolist())

    def _closed(self, plant: UncertainPlant, law: Any, alpha: Array) -> ClosedLoops:
        """Return the loops from [w; w_k] to [z; v_k], none weighed."""
        opened, beside, gain = self._opened(plant, law, 1.0, (Fraction(1),) * len(self.inputs))
        wide = behind(opened, beside, gain)
        closed = close(wide.plant, wide.law, alpha)
        channel = Gain.channel(wide.specification, delta_form(wide.plant), alpha)  # type: ignore[arg-type]
        return channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)

    def _opened(
        self, plant: UncertainPlant, law: Any, level: float, weights: tuple[Fraction, ...]
    ) -> Posed:
        """Return the opened loops at a level, for weights of the loops."""
        loops = replace(self._loops(plant, law), weights=weights)
        beside = reading_beside(plant, law, loops)
        opened = open_loops(plant, loops, beside)
        chosen = self.scales(plant)
        names = named_disturbances(loops)
        own = chosen or (1.0,) * loops.own
        at_loops = (float(Fraction(level) / weight) for weight in weights)
        acting = dict(zip(names, (*own, *at_loops), strict=True))
        gain = OpenedGain(
            (*(_beside(y, plant, loops) for y in self.outputs(plant)), *_sent(opened, loops)),
            level,
            disturbances={name: scale for name, scale in acting.items() if scale},
            loops=loops,
            margin=self.title,
            shapes=(*(None for _ in self.entries), *self.shapes),  # type: ignore[arg-type]
            chosen=tuple(map(Fraction, chosen)),
        )
        return opened, beside, gain

    def _loops(self, plant: UncertainPlant, law: Any) -> Loops:
        inputs = tuple(place_of(plant, name, None)[1] for name in self.inputs)
        weights, known = (Fraction(1),) * len(inputs), file_plant(plant)
        straight = through(known, _measured(law))
        return Loops(inputs, (), SKEW, weights, straight, plant.disturbance_count, demands(known))

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about loops that weigh alike."""
        loops = self._loops(plant, subject.law)
        opened = opened_subject(subject, plant, loops)
        filters = tuple(shape.filter for shape in self.shapes)
        chosen = tuple(map(Fraction, self.scales(plant)))
        signals = self.exact_outputs(plant)
        return proof.WorstCaseGain.of(opened, signals, loops, level, filters, chosen)

    # --- what samples show, and slopes -----------------------------------------------------------

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the gain with the worst dynamics that were found, at points alpha.

        These are a complex number of size one at each input, at one frequency: some stable delta
        is that number there.
        """
        law = law_or_table(plant, law.as_law() if hasattr(law, "as_law") else law)
        p, values, known = len(self.entries), list[Array](), None
        for first in range(0, len(alpha), CHUNK):
            loops = self._closed(plant, law, alpha[first : first + CHUNK])
            if not np.all(growth(loops.modes.poles, loops.modes.step) < 0):
                raise InputError(f"{self.title}: a loop is not stable")
            known = known or _weights_of(loops, p)
            values.append(_on_grid(loops, p, *known))
        found = np.concatenate(values)
        worst = np.argsort(-found)[:CLOSELY]
        found[worst] = np.maximum(found[worst], _closely(self._closed(plant, law, alpha[worst]), p))
        return found

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the signal, and the loops behind their weights, as a channel at points alpha."""
        channel = super().channel(plant, alpha)
        places = [place_of(plant, name, None)[1] for name in self.inputs]
        p, q, size = channel.C.shape[1], channel.E.shape[2], len(places)
        n, m = channel.B.shape[1:]
        loops = self._loops(plant, None)
        added = channel.B[:, :, places]
        added[:, list(loops.demands)] = 0.0
        E = np.concatenate([channel.E, added], axis=2)
        C = np.concatenate([channel.C, np.zeros((len(alpha), size, n))], axis=1)
        sent = np.broadcast_to(np.eye(m)[places], (len(alpha), size, m))
        D = np.concatenate([channel.D, sent], axis=1)
        F = np.zeros((len(alpha), p + size, q + size))
        F[:, :p, :q] = channel.F
        for j, y in enumerate(self.outputs(plant)):
            if not _is_sent(y, plant, loops):
                F[:, j, q:] = channel.D[:, j, places]
        S = np.zeros((q + size, q + size))
        S[:q, :q] = np.eye(q) if channel.S is None else channel.S
        S[q:, q:] = np.eye(size)
        reads = (*(None for _ in range(q)), *places)
        channel = replace(channel, E=E, C=C, D=D, F=F, S=S, reads=reads)
        for k, shape in enumerate(self.shapes):
            channel = shaped(channel, p + k, shape.filter)
        return channel

    def slopes(self, loops: ClosedLoops) -> Slopes:
        """Return what is bounded at peaks with its slopes, loops weighed anew.

        Under a limit it is the gain for weights at that level: it exists where the loop does not
        stay stable too.
        """
        p = len(self.entries)
        x, level, known = scaled(loops, p, self.at_most, HASTY)
        if not np.isfinite(level):
            return _nothing(loops)
        out, into = sides(loops, p, x, self.at_most or level)
        found = Highest.of(weighed(loops, out, into), known)
        values, each = found.values, np.ones(len(found.values))
        share = each
        if self.at_most is None:  # the level for which a peak is as high: it turns weights too
            share = np.maximum((np.abs(found.u[:, :p]) ** 2).sum(axis=1), LEAST_SHARE)
            values = level * (found.values / level) ** (1 / share)
            each = values / found.values / share

        q = loops.E.shape[-1] - len(x)
        along = np.abs(found.u[:, p:]) ** 2 - np.abs(found.v[:, q:]) ** 2
        mixed = following(values, values[:, None] * along / share[:, None])

        def turned() -> list[Turned]:
            own, times = found.turned(), each[:, None, None]
            E, F = own.E, own.F
            return [
                Turned(
                    own.A * times,
                    own.C * out[:, None] * times,
                    None if E is None else E * into * times,
                    None if F is None else out[:, None] * F * into * times,
                )
            ]

        return Slopes(values, found.points, turned, mixed)


def following(values: Array, along: Array) -> Array:
    """Return what slopes of values are of those for weights that stay, (rows, rows).

    Where weights are best several of the highest values are alike, and stay so while weights follow
    the law: without that a search ends where no law lowers all of them for weights that stay.

    Parameters
    ----------
    along : (rows, loops) array
        Slopes with respect to logarithms of the weights.
    """
    from scipy.optimize import nnls  # deferred: slow to import

    top = float(values.max())
    high = np.flatnonzero(values >= top * (1 - ALIKE))
    size = max(float(np.abs(along[high]).max()), 1e-300)
    sides = np.vstack([along[high].T / size, np.ones(len(high))])
    kept = high[nnls(sides, np.append(np.zeros(along.shape[1]), 1.0))[0] > 1e-6]
    mixed = np.eye(len(values))
    if len(kept) > 1:
        solved = np.linalg.pinv(np.hstack([along[kept], -np.ones((len(kept), 1))]))
        mixed[:, kept] -= along @ solved[:-1]
    return mixed


def _nothing(loops: ClosedLoops) -> Slopes:
    """Return that there is no level at any point."""
    count, (n, p) = len(loops.E), (loops.A.shape[-1], loops.C.shape[1])

    def turned() -> list[Turned]:
        return [Turned(np.zeros((count, n, n)), np.zeros((count, p, n)), 0 * loops.E, 0 * loops.F)]

    return Slopes(np.full(count, np.inf), np.arange(count), turned)


@dataclass(frozen=True)
class OpenedGain(LoopGain):
    """The gain of opened loops and of what they are opened for, for given weights of the loops."""

    chosen: tuple[Fraction, ...] = ()

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about the worst-case gain."""
        signals = [alone(y, self.loops.own) for y in self.exact_outputs(plant)[: -self.loops.count]]
        filters = tuple(shape.filter for shape in self.shapes if shape is not None)
        return proof.WorstCaseGain.of(subject, signals, self.loops, level, filters, self.chosen)


def _measured(law: Any) -> list[str]:
    """Return the names of what a law measures."""
    law = law.as_law() if hasattr(law, "as_law") else law
    return [y if isinstance(y, str) else y.name for y in getattr(law, "measured", ())]


def _is_sent(output: Output, plant: UncertainPlant, loops: Loops) -> bool:
    """Whether an output is of demands alone."""
    return is_sent([[list(row)] for row in output.exact(plant)[0]], output.near, loops)


def _beside(output: Output, plant: UncertainPlant, loops: Loops) -> Output:
    """Return an output of a plant with the disturbances at loops too."""
    sent, n = _is_sent(output, plant, loops), plant.shape[0]

    def wider(M: Any) -> Any:
        return tuple(
            (*row, *(Fraction(0) if sent else row[n + i] for i in loops.inputs)) for row in M
        )

    _, D, own = output.exact(plant)
    F = [
        [*f, *(Fraction(0) if sent else d[i] for i in loops.inputs)]
        for f, d in zip(own, D, strict=True)
    ]
    return replace(output, F=F, near=output.near and output.near.mapped(wider))


def _sent(opened: UncertainPlant, loops: Loops) -> list[Output]:
    """Return what is sent to the inputs of loops, times the weights."""
    m = opened.shape[1]
    pairs = zip(loops.inputs, loops.weights, strict=True)
    return [
        Output(f"loop {k + 1}", "", D=[weight * (i == j) for j in range(m)])
        for k, (i, weight) in enumerate(pairs)
    ]


# --- weights of loops, and the level ------------------------------------------------------------


def sides(loops: ClosedLoops, p: int, x: Array, level: float) -> tuple[Array, Array]:
    """Return what outputs and disturbances are multiplied by, for logarithms x of weights.

    The gain is then at most the level where the worst-case gain is.
    """
    d, q = np.exp(x), loops.E.shape[-1] - len(x)
    return np.concatenate([np.ones(p), level * d]), np.concatenate([np.ones(q), 1 / d])


def weighed(loops: ClosedLoops, out: Array, into: Array) -> ClosedLoops:
    """Return loops whose outputs and disturbances are multiplied."""
    column = out[:, None]
    return replace(loops, E=loops.E * into, C=loops.C * column, F=column * loops.F * into)


class Weighed(NamedTuple):
    """What weights of the loops lead to.

    Attributes
    ----------
    x : (loops,) array
        Their logarithms.
    level : float
        What is least with them: infinite where there is none.
    peaks : tuple of arrays, optional
        Numbers of loops and frequencies of the peaks of loops that are weighed so, if known.
    """

    x: Array
    level: float
    peaks: tuple[Array, Array] | None = None


def scaled(loops: ClosedLoops, p: int, limit: float | None, rounds: int = ROUNDS) -> Weighed:
    """Return weights of the loops, and what is least with them.

    Without a limit that is the level that the gain of loops weighed for it does not exceed, else
    the gain of those weighed for the limit. Both are convex in logarithms of the weights. Peaks
    over the frequency are found anew for what is best for those found before, until none is higher.

    Parameters
    ----------
    p : int
        How many outputs are not at loops.
    """
    known = _at_some(loops, p, limit)
    search = Search(known, p, limit)
    x, level = search.least(search.even)
    best = Weighed(x, np.inf)
    for _ in range(rounds):
        if not np.isfinite(level):
            return Weighed(x, np.inf)
        points, w, height = peaks_of(weighed(loops, *sides(loops, p, x, limit or level)))
        if not np.all(np.isfinite(height)):
            return Weighed(x, np.inf)
        top = float(height.max())
        if limit is None or top < best.level:
            best = Weighed(x, max(top, level) if limit is None else top, (points, w))
        if top <= level * (1 + ENOUGH):
            return best
        near = height >= NEAR * top
        s = 1j * w[near]
        A, E, C, F = (M[points[near]] for M in (loops.A, loops.E, loops.C, loops.F))
        found = response(A, E, C, F, s[:, None])[:, 0]
        search = search._replace(M=np.concatenate([search.M, found]))
        x, level = search.least(x)
    return best


def _at_some(loops: ClosedLoops, p: int, limit: float | None) -> Any:
    """Return responses (count, ., .) at those frequencies of a grid that may bound the gain."""
    some = np.linspace(0, len(loops.A) - 1, min(len(loops.A), SOME)).astype(int)
    A, E, C, F = (M[np.unique(some)] for M in (loops.A, loops.E, loops.C, loops.F))
    poles = loops.modes.poles[np.unique(some)]
    G = response(A, E, C, F, 1j * _frequencies(poles))
    M = G.reshape(-1, *G.shape[2:])
    search = Search(M, p, limit)
    q = M.shape[2] - search.size
    alone = largest(M[:, :p, :q])
    height = search.heights(search.even, limit or float(alone.max()) or 1.0)[0]
    return M[np.unique([*np.argsort(-height)[:AT_ONCE], *np.argsort(-alone)[: AT_ONCE // 4]])]


def _frequencies(poles: Any) -> Array:
    """Return frequencies (count, f): those of the poles, and some between and beyond."""
    sizes = np.abs(poles)
    fast = np.maximum(sizes.max(axis=1, keepdims=True), 1e-300)
    slow = np.maximum(sizes.min(axis=1, keepdims=True), 1e-6 * fast)
    even = slow / 5 * (25 * fast / slow) ** np.linspace(0, 1, 32)
    return np.concatenate([0 * slow, sizes, np.abs(poles.imag), even], axis=1)


def peaks_of(loops: ClosedLoops) -> tuple[Array, Array, Array]:
    """Return the peaks of loops: their numbers, frequencies and heights."""
    return peaks(loops.modes, loops.E, loops.C, loops.F)


class Search(NamedTuple):
    """Weights of loops for responses M (count, p + loops, q + loops) that are known."""

    M: Any
    p: int
    limit: float | None

    @property
    def size(self) -> int:
        """How many loops there are."""
        return int(self.M.shape[1]) - self.p

    @property
    def even(self) -> Array:
        """Logarithms of weights that even out what comes from loops, and what goes to them."""
        p, q = self.p, self.M.shape[2] - self.size
        M, x = np.abs(self.M).max(axis=0), np.zeros(self.size)
        M[:p] /= self.limit or float(M[:p, :q].max()) or 1.0
        for _ in range(MOST_STEPS):
            for i in range(self.size):
                d = np.exp(x)
                row = M[p + i] * np.concatenate([np.ones(q), 1 / d])
                column = M[:, q + i] * np.concatenate([np.ones(p), d])
                row[q + i] = column[p + i] = 0.0
                if row.sum() > 0 and column.sum() > 0:
                    x[i] = np.log(column.sum() / row.sum()) / 2
        return np.asarray(np.clip(x, -FARTHEST, FARTHEST))

    def heights(self, x: Array, level: float) -> tuple[Array, Array, Array]:
        """Return logarithms of singular values, of z over the level, and slopes.

        With respect to x, and to the logarithm of the level.
        """
        p, d = self.p, np.exp(x)
        q = self.M.shape[2] - self.size
        out = np.concatenate([np.full(p, 1 / level), d])
        into = np.concatenate([np.ones(q), 1 / d])
        u, values, vt = np.linalg.svd(out[:, None] * self.M * into, full_matrices=False)
        one, other = np.abs(u[:, :, 0]) ** 2, np.abs(vt[:, 0]) ** 2
        slopes = one[:, p:] - other[:, q:]
        return np.log(np.maximum(values[:, 0], 1e-300)), slopes, -one[:, :p].sum(axis=1)

    def level(self, x: Array) -> float:
        """Return the least level for weights, infinite where there is none.

        Its square is the largest eigenvalue of W^-1 Z'Z, Z the rows of z, W = diag(1, d^2) - Y'Y.
        """
        d = np.exp(x)
        q = self.M.shape[2] - self.size
        into = np.concatenate([np.ones(q), 1 / d])
        Z, Y = self.M[:, : self.p] * into, d[:, None] * self.M[:, self.p :] * into
        W = np.eye(self.M.shape[2]) - np.swapaxes(Y.conj(), 1, 2) @ Y
        try:
            L = np.linalg.cholesky(W)
        except np.linalg.LinAlgError:
            return np.inf
        return float(largest(np.linalg.solve(L, np.swapaxes(Z.conj(), 1, 2))).max())

    def least(self, x: Array) -> tuple[Array, float]:
        """Return the best weights, and the level or the gain that is least with them."""
        if self.limit is not None:
            x, t = self._searched(x, float(np.log(self.limit)))
            return x, self.limit * float(np.exp(t))
        level = self.level(x)
        if not np.isfinite(level):  # first those for which loops stay stable
            top = float(np.abs(self.M).max())
            x = self._searched(x, float(np.log(top) + FARTHEST / 2))[0]
            level = self.level(x)
        if np.isfinite(level):
            x = self._searched(x, None, float(np.log(level)))[0]
            level = self.level(x)
        return x, level

    def _searched(self, x: Array, g: float | None, start: float = 0.0) -> tuple[Array, float]:
        """Return weights with the least height at the level e^g; without one the least level."""
        from scipy.optimize import minimize  # deferred: slow to import

        def heights(z: Array) -> tuple[Array, Array]:
            top, slopes, of_level = self.heights(z[:-1], float(np.exp(z[-1] if g is None else g)))
            last = -of_level if g is None else np.ones(len(top))
            margin = -top if g is None else z[-1] - top
            return margin, np.hstack([-slopes, last[:, None]])

        z = np.append(x, start if g is None else self.heights(x, float(np.exp(g)))[0].max())
        settings: dict[str, Any] = {
            "jac": lambda z: np.append(np.zeros(len(z) - 1), 1.0),
            "method": "SLSQP",
            "bounds": [(a - FARTHEST, a + FARTHEST) for a in x] + [(None, None)],
            "constraints": {
                "type": "ineq",
                "fun": lambda z: heights(z)[0],
                "jac": lambda z: heights(z)[1],
            },
            "options": {"maxiter": MOST_STEPS, "ftol": 1e-10},
        }
        found = minimize(_last, z, **settings).x[:-1]
        if g is None:
            return (found, 0.0) if self.level(found) <= self.level(x) else (x, 0.0)
        top = float(self.heights(found, float(np.exp(g)))[0].max())
        return (found, top) if top <= z[-1] else (x, float(z[-1]))


def _last(z: Array) -> float:
    return float(z[-1])


# --- the worst dynamics at a frequency ----------------------------------------------------------


def _weights_of(loops: ClosedLoops, p: int) -> tuple[Array, float]:
    """Return logarithms of weights and a level for which peaks tell where dynamics are worst."""
    found = scaled(loops, p, None, HASTY)
    if np.isfinite(found.level):
        return found.x, found.level
    still = response(loops.A, loops.E, loops.C, loops.F, np.zeros((len(loops.A), 1)))
    level = float(largest(still[..., :p, : loops.E.shape[-1] - len(found.x)]).max()) or 1.0
    return scaled(loops, p, level, HASTY).x, level


def _on_grid(loops: ClosedLoops, p: int, x: Array, level: float) -> Array:
    """Return the worst gain at each point, at those frequencies of a grid where it may be."""
    w = _frequencies(loops.modes.poles)
    out, into = sides(loops, p, x, level)
    G = response(loops.A, loops.E, loops.C, loops.F, 1j * w)
    some = np.argsort(-largest(out[:, None] * G * into), axis=1)[:, :FREQUENCIES]
    worst = worst_of_dynamics(np.take_along_axis(G, some[:, :, None, None], axis=1), p)
    return np.asarray(worst.max(axis=1))


def _closely(loops: ClosedLoops, p: int) -> Array:
    """Return the worst gain at each point, at the frequency where it is worst."""
    sizes = np.abs(loops.modes.poles)
    fast, slow = sizes.max(axis=1), np.maximum(sizes.min(axis=1), 1e-6 * sizes.max(axis=1))
    w = slow[:, None] / 10 * ((100 * fast / slow)[:, None]) ** np.linspace(0, 1, 150)
    values = worst_of_dynamics(response(loops.A, loops.E, loops.C, loops.F, 1j * w), p)
    rows, best = np.arange(len(w)), values.max(axis=1)
    for _ in range(ZOOMS):
        j = values.argmax(axis=1)
        ends = w[rows, np.maximum(j - 1, 0)], w[rows, np.minimum(j + 1, w.shape[1] - 1)]
        low, high = (end[:, None] for end in ends)
        w = low + (high - low) * np.linspace(0, 1, WITHIN)
        values = worst_of_dynamics(response(loops.A, loops.E, loops.C, loops.F, 1j * w), p)
        best = np.maximum(best, values.max(axis=1))
    return np.asarray(best)


def worst_of_dynamics(G: Any, p: int) -> Array:
    """Return the largest gain from w to z that numbers of size one in the loops make.

    With the other loops closed, a loop of G = [M, b; c, m] closed by delta is M + b t c with
    t = delta / (1 - m delta) on a circle: of one loop its worst turn is found, of several that of
    one after the other. It is infinite where numbers within size one make the loops unstable.

    Parameters
    ----------
    G : (..., p + loops, q + loops) complex array
    """
    size = G.shape[-2] - p
    q = G.shape[-1] - size
    found, delta = largest(G[..., :p, :q]), np.zeros((*G.shape[:-2], size), dtype=complex)
    for _ in range(ROUNDS_OF_TURNS if size > 1 else 1):
        for k in range(size):
            one = _others_closed(G, p, q, k, delta)
            m, steps = one[..., p, q], one[..., :p, q, None] * one[..., p, None, :q]
            room = 1 / np.maximum(1 - np.abs(m) ** 2, 1e-9)
            start = one[..., :p, :q] + (room * m.conj())[..., None, None] * steps
            psi, value = _worst_turn(start, room[..., None, None] * steps)
            found = np.where(np.abs(m) >= 1, np.inf, np.maximum(found, value))
            t = room * (m.conj() + np.exp(1j * psi))
            delta[..., k] = np.where(np.abs(m) < 1, t / (1 + m * t), 0)
    return found


def _worst_turn(M: Any, N: Any) -> tuple[Any, Any]:
    """Return psi for which M + e^(j psi) N is largest, and that value: of a grid, then nearer."""
    psi, value = np.zeros(M.shape[:-2]), np.zeros(M.shape[:-2])
    width, steps = np.pi, np.linspace(-1, 1, TURNS + 1)[1:]
    for _ in range(NEARER):
        middle = psi
        for step in steps:
            turned = middle + width * step
            more = largest(M + np.exp(1j * turned)[..., None, None] * N)
            psi, value = np.where(more > value, turned, psi), np.maximum(more, value)
        width, steps = 2 * width / TURNS, np.linspace(-1, 1, 7)
    return psi, value


def _others_closed(G: Any, p: int, q: int, k: int, delta: Any) -> Any:
    """Return responses of one loop alone, the others closed."""
    others = [j for j in range(G.shape[-2] - p) if j != k]
    rows, columns = [*range(p), p + k], [*range(q), q + k]
    own = G[..., rows, :][..., columns]
    if not others:
        return own
    into, out = [p + j for j in others], [q + j for j in others]
    closed = delta[..., others]
    back = np.eye(len(others)) - G[..., into, :][..., out] * closed[..., None, :]
    right = np.linalg.solve(back, G[..., into, :][..., columns])
    return own + (G[..., rows, :][..., out] * closed[..., None, :]) @ right
