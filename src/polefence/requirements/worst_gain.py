"""Worst-case gain: from disturbances to a signal, whatever dynamics that no model has are added."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.base.explained import explained_fields
from polefence.law.laws import law_or_table
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.disk_margin import Loops, beside_loops, is_sent, through
from polefence.proof.claims.worst_gain import SKEW, alone, demands
from polefence.requirements import scales
from polefence.requirements.disk_margin import (
    FEW,
    TO,
    LoopGain,
    Posed,
    Unmodelled,
    all_paths,
    closed_loops,
    flag_words,
    may_part,
    named_disturbances,
    open_loops,
    opened_subject,
    paths_of,
    place_of,
    reading_beside,
    require_flag,
    seen_paths,
    shape_for,
    shaped,
    with_paths,
    written_weight,
)
from polefence.requirements.gain import Gain, sampled_frequency
from polefence.requirements.slopes import Acting, Channel, Slopes
from polefence.requirements.slopes import Loops as ClosedLoops
from polefence.requirements.specification import BestScale, Row, Specification
from polefence.requirements.weights import Shape
from polefence.response.peaks import largest, response
from polefence.response.stationary import growth

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
    time_invariant : bool
        Of dynamics delta that do not vary in time alone: no more is proved, and sooner.
    """

    inputs: Any = field(default=(), kw_only=True)
    weight: Any = field(default="", kw_only=True)
    time_invariant: bool = field(default=False, kw_only=True)
    kind = "worst-case gain"
    keys = ("disturbances", "inputs", "weight", "time_invariant")

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
        require_flag(self.time_invariant, self.kind)
        self._settle("weight", written_weight(self.weight))
        _ = self.shapes

    @classmethod
    def read(cls, row: Row) -> WorstCaseGain:
        """Return what a row says."""
        table = row.table
        for key, written in (("inputs", '["NAME"]'), ("weight", '"(3*s + 18.5)/(s + 46.3)"')):
            if key not in table:
                raise InputError(f"{key} is missing; write {key} = {written}")
        own = {key: table[key] for key in ("inputs", "weight", "time_invariant") if key in table}
        return cls(table["signal"], **row.given(), **own)

    @property
    def title(self) -> str:
        """Kind, signal, chosen disturbances, inputs and weight, as a line has them."""
        inputs = ", ".join(self.inputs)
        whole = f"{super().title} with inputs [{inputs}] with weight {self.shapes[0].name}"
        return whole + flag_words(self.time_invariant)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The weight at each input."""
        shape = shape_for(self.weight, self.kind, constant=all_paths(self.inputs))
        return (shape,) * len(self.inputs)

    def shapes_at(self, plant: UncertainPlant) -> tuple[Shape, ...]:
        """Return the weights as claims about a plant have them."""
        return tuple(Shape(shape.at(plant.period)) for shape in self.shapes)

    def unweighted(self) -> Gain:
        """Return the gain without dynamics."""
        return Gain(self.signal, self.at_most, disturbances=self.disturbances)

    @property
    def presumed(self) -> tuple[Specification, ...]:
        """That the loop stays stable: else there is no such gain."""
        same = {"weight": self.weight, "time_invariant": self.time_invariant}
        return (Unmodelled(self.inputs, 1.0, **same),)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a sampled plant, and what is no input."""
        super().require_fit(plant)
        self.presumed[0].require_fit(plant)

    def held(self, plant: UncertainPlant) -> None:
        """Return None: at a sample time it is of samples, and of disturbances that are held."""

    def require_samples(self, plant: UncertainPlant, F: Array | None) -> None:
        """Nothing: it is of samples."""

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has its weight."""
        return f"{self.title}: no LMI has its weight; leave out the method, so that a law is tuned"

    # --- what it is in the loop that is opened ---------------------------------------------------

    def posed(self, plant: UncertainPlant, law: Any) -> Posed:
        """Return the plant with its loops opened, the law beside it, and the gain to be bounded."""
        level, found = self._scaled(plant, law)
        if not np.isfinite(level):
            raise InputError(f"{self.title}: dynamics within the weight make the loop unstable")
        return self._opened(plant, law, level, *found.times(level).exact)

    def nearest(self, plant: UncertainPlant, law: Any) -> float:
        """Return about the least level that can be proved of it; infinite where there is none."""
        return self._scaled(plant, law)[0]

    def ways(
        self, plant: UncertainPlant, law: Any
    ) -> tuple[tuple[float | None, Specification], ...]:
        """Return it with that level."""
        return ((self.nearest(plant, law), self),)

    @property
    def coupled(self) -> bool:
        """Loops are weighed, alike for all points."""
        return True

    def scales_apart(self, plant: UncertainPlant, law: Any) -> bool:
        """Whether parameters do not move."""
        return may_part(plant, law)

    def best_scales(self, plant: UncertainPlant, law: Any, alpha: Array) -> Iterator[BestScale]:
        """Return the best scale of the loops at each point, and the least level with it."""
        loops = self._closed(plant, law, alpha)
        return scales.of_each(loops, len(self.entries), None, leads=self.time_invariant)

    def _scaled(self, plant: UncertainPlant, law: Any) -> tuple[float, scales.Scale]:
        """Return the level, and a scale of the loops, that are about best at a few points."""
        alpha = seeded(plant, len(plant.vertices) + FEW)
        loops = self._closed(plant, law, alpha)
        none = scales.Scale(np.zeros((len(self.inputs), 1)))
        if not np.all(growth(loops.modes.poles, loops.modes.step) < 0):
            return np.inf, none
        leads = self.time_invariant and plant.dead_time is None  # a proof with one has none
        found = scales.scaled(loops, len(self.entries), self.at_most, leads=leads)
        level = self.at_most or found.level
        return (level, found.scale) if np.isfinite(level) else (np.inf, none)

    def _closed(self, plant: UncertainPlant, law: Any, alpha: Array) -> ClosedLoops:
        """Return the loops from [w; w_k] to [z; v_k], none scaled."""
        alike = (Fraction(1),) * len(self.inputs)
        return closed_loops(*self._opened(plant, law, 1.0, alike), alpha)

    def _opened(
        self,
        plant: UncertainPlant,
        law: Any,
        level: float,
        weights: tuple[Fraction, ...],
        leads: tuple[tuple[Fraction, Fraction], ...] = (),
    ) -> Posed:
        """Return the opened loops at a level, for weights and leads of the loops."""
        loops = replace(self._loops(plant, law), weights=weights, leads=leads)
        beside = reading_beside(plant, law, loops)
        opened = open_loops(plant, loops, beside)
        chosen = self.scales(plant)
        names = named_disturbances(loops)
        own = chosen or (1.0,) * loops.own
        at_loops = (float(Fraction(level) / weight) for weight in weights)
        acting = dict(zip(names, (*own, *at_loops), strict=True))
        gain = OpenedGain(
            (
                *(_beside(y, plant, loops) for y in self.outputs(plant)),
                *_sent(opened, loops),
                *seen_paths(loops),
            ),
            level,
            disturbances={name: scale for name, scale in acting.items() if scale},
            loops=loops,
            invariant=self.time_invariant,
            margin=self.title,
            shapes=(*(None for _ in self.entries), *self.shapes_at(plant)),  # type: ignore[arg-type]
            chosen=tuple(map(Fraction, chosen)),
        )
        return opened, beside, gain

    def _loops(self, plant: UncertainPlant, law: Any) -> Loops:
        weights, known = (Fraction(1),) * len(self.inputs), file_plant(plant)
        straight, q = through(known, _measured(law)), plant.disturbance_count
        paths, own = paths_of(plant, self.inputs), demands(known)
        inputs = tuple(place_of(plant, x, None)[1] for x in self.inputs if TO not in x)
        return Loops(inputs, (), SKEW, weights, straight, q, own, paths=paths)

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about loops that weigh alike."""
        loops = self._loops(plant, subject.law)
        opened = opened_subject(subject, plant, loops)
        filters = tuple(shape.filter for shape in self.shapes_at(plant))
        chosen = tuple(map(Fraction, self.scales(plant)))
        signals = self.exact_outputs(plant)
        known = {"invariant": self.time_invariant}
        return proof.WorstCaseGain.of(opened, signals, loops, level, filters, chosen, **known)

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
            known = known or _scale_of(loops, p)
            values.append(_on_grid(loops, p, *known))
        found = np.concatenate(values)
        worst = np.argsort(-found)[:CLOSELY]
        closely = _closely(self._closed(plant, law, alpha[worst]), p)[0]
        found[worst] = np.maximum(found[worst], closely)
        return found

    def worst_frequency(self, plant: UncertainPlant, law: Any, alpha: Array) -> float | None:
        """Return where dynamics are worst at a point (N,) [rad/s]."""
        law = law_or_table(plant, law.as_law() if hasattr(law, "as_law") else law)
        loops = self._closed(plant, law, alpha[None])
        return sampled_frequency(float(_closely(loops, len(self.entries))[1][0]), loops.modes.step)

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the signal, and the loops behind their weights, as a channel at points alpha."""
        channel = super().channel(plant, alpha)
        loops = self._loops(plant, None)
        places = list(loops.inputs)
        p, q, size = channel.C.shape[1], channel.E.shape[2], loops.count
        (n, m), last = channel.B.shape[1:], q + len(places)
        added = np.zeros((len(alpha), n, size))
        added[:, :, : len(places)] = channel.B[:, :, places]
        added[:, list(loops.demands)] = 0.0
        E = np.concatenate([channel.E, added], axis=2)
        C = np.concatenate([channel.C, np.zeros((len(alpha), size, n))], axis=1)
        sent = np.zeros((len(alpha), size, m))
        sent[:, range(len(places)), places] = 1.0
        D = np.concatenate([channel.D, sent], axis=1)
        F = np.zeros((len(alpha), p + size, q + size))
        F[:, :p, :q] = channel.F
        for j, y in enumerate(self.outputs(plant)):
            if not _is_sent(y, plant, loops):
                F[:, j, q:last] = channel.D[:, j, places]
            passing = np.tensordot(alpha, y.arrays(plant)[2], 1)
            F[:, j, last:] = passing[:, [path.disturbance for path in loops.paths]]
        S = np.zeros((q + size, q + size))
        S[:q, :q] = np.eye(q) if channel.S is None else channel.S
        S[q:, q:] = np.eye(size)
        own: list[str | int | Acting] = [Acting(j) for j in range(q)]
        reads = (*own, *places, *(Acting(path.disturbance) for path in loops.paths))
        channel = replace(channel, E=E, C=C, D=D, F=F, S=S, reads=reads)
        channel = with_paths(channel, plant, alpha, loops, self.scales(plant))
        for k, shape in enumerate(self.shapes_at(plant)):
            channel = shaped(channel, p + k, shape.filter)
        return channel

    def slopes(self, loops: ClosedLoops) -> Slopes:
        """Return what is bounded at peaks with its slopes, loops scaled anew."""
        return scales.slopes(loops, len(self.entries), self.at_most, leads=self.time_invariant)


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
        known = {"invariant": self.invariant}
        loops, chosen = self.loops, self.chosen
        return proof.WorstCaseGain.of(subject, signals, loops, level, filters, chosen, **known)


def _measured(law: Any) -> list[str]:
    """Return the names of what a law measures."""
    law = law.as_law() if hasattr(law, "as_law") else law
    return [y if isinstance(y, str) else y.name for y in getattr(law, "measured", ())]


def _is_sent(output: Output, plant: UncertainPlant, loops: Loops) -> bool:
    """Whether an output is of demands alone."""
    return is_sent([[list(row)] for row in output.exact(plant)[0]], output.near, loops)


def _beside(output: Output, plant: UncertainPlant, loops: Loops) -> Output:
    """Return an output of a plant with the disturbances at loops too."""
    (exact,) = Gain(output).exact_outputs(plant)
    wide = beside_loops(exact, loops)
    return replace(output, F=[row for (row,) in wide.F], near=wide.near)


def _sent(opened: UncertainPlant, loops: Loops) -> list[Output]:
    """Return what is sent to the inputs of loops, times the weights."""
    m = opened.shape[1]
    pairs = zip(loops.inputs, loops.weights, strict=False)
    return [
        Output(f"loop {k + 1}", "", D=[weight * (i == j) for j in range(m)])
        for k, (i, weight) in enumerate(pairs)
    ]


# --- the worst dynamics at a frequency ----------------------------------------------------------


def _scale_of(loops: ClosedLoops, p: int) -> tuple[scales.Scale, float]:
    """Return a scale and a level for which peaks tell where dynamics are worst."""
    found = scales.scaled(loops, p, None, scales.HASTY)
    if np.isfinite(found.level):
        return found.scale, found.level
    still = response(loops.A, loops.E, loops.C, loops.F, np.zeros((len(loops.A), 1)))
    q = loops.E.shape[-1] - len(found.scale.theta)
    level = float(largest(still[..., :p, :q]).max()) or 1.0
    return scales.scaled(loops, p, level, scales.HASTY).scale, level


def _on_grid(loops: ClosedLoops, p: int, scale: scales.Scale, level: float) -> Array:
    """Return the worst gain at each point, at those frequencies of a grid where it may be."""
    w = scales.frequencies(loops.modes.poles)
    q = loops.E.shape[-1] - len(scale.theta)
    s = scales.points(w, loops.modes.step)
    out, into = scales.sides(scale, p, q, level, s[0])
    G = response(loops.A, loops.E, loops.C, loops.F, s)
    some = np.argsort(-largest(out[:, :, None] * G * into[:, None]), axis=1)[:, :FREQUENCIES]
    worst = worst_of_dynamics(np.take_along_axis(G, some[:, :, None, None], axis=1), p)
    return np.asarray(worst.max(axis=1))


def _closely(loops: ClosedLoops, p: int) -> tuple[Array, Array]:
    """Return the worst gain at each point, and the frequency where it is worst."""
    sizes = np.abs(loops.modes.poles)
    fast, slow = sizes.max(axis=1), np.maximum(sizes.min(axis=1), 1e-6 * sizes.max(axis=1))
    w = slow[:, None] / 10 * ((100 * fast / slow)[:, None]) ** np.linspace(0, 1, 150)
    values = _worst_at(loops, w, p)
    rows, best = np.arange(len(w)), values.max(axis=1)
    for _ in range(ZOOMS):
        j = values.argmax(axis=1)
        ends = w[rows, np.maximum(j - 1, 0)], w[rows, np.minimum(j + 1, w.shape[1] - 1)]
        low, high = (end[:, None] for end in ends)
        w = low + (high - low) * np.linspace(0, 1, WITHIN)
        values = _worst_at(loops, w, p)
        best = np.maximum(best, values.max(axis=1))
    return np.asarray(best), w[rows, values.argmax(axis=1)]


def _worst_at(loops: ClosedLoops, w: Array, p: int) -> Array:
    s = scales.points(w, loops.modes.step)
    return worst_of_dynamics(response(loops.A, loops.E, loops.C, loops.F, s), p)


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
