"""Laws that are evaluated together: as each alone, whatever is asked and whichever cannot be."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from polefence.base.effort import bounded
from polefence.base.team import Team
from polefence.law.structure import Structure
from polefence.plant.spec import loads
from polefence.requirements.text import KINDS, parse_specification
from polefence.search.tune import measures, tuner
from polefence.search.tune.measures import LEVEL, LIMITS, REGION, SMALL, WORST, Ask
from polefence.search.tune.tuner import _Search, _task, together
from support.specs import TWO_MASSES

# Of which one point says nothing of the others; several loops, and sectors, are weighed.
ALONE = {
    "rms": "rms of [x1, u, h] <= 2 with density 1",
    "gain": "gain of [x1, u] <= 4",
    "energy peak": "energy peak of x1 <= 2 with norm 1",
    "initial peak": "initial peak of u <= 3 with impulse 1",
    "relative rms": "relative rms of x1 <= 0.9",
    "gain norm": "gain norm of the law <= 9",
    "disk margin": "disk margin of u >= 0.5",
    "unmodelled dynamics": "unmodelled dynamics of u >= 0.5 with weight (s+1)/(s+9)",
    "gain margin": "gain margin of u >= 1.5",
    "phase margin": "phase margin of u >= 20",
    "delay margin": "delay margin of u >= 0.05",
    "step": "step of x1 <= 5 with measure peak",
    "initial": "initial of x1 from [x2 * 0.3] <= 5 with measure peak",
    "impulse": "impulse of x1 <= 5 with measure peak",
    "bump": "bump of x1 <= 5 with height 1 with length 2 with speed 1 with acts rate",
    "peak to peak": "peak to peak of x1 <= 5",
}
COUPLED = (
    "disk margin of [u, h] >= 0.5",
    "worst-case gain of x1 <= 9 with inputs [u] with weight 0.1*(s+1)/(s+9)",
    "sector of x1 with disturbance [w] with sector [-0.2, 0.1] >= 1",
)


def searched(line, structure=None):
    """A search for the least of a requirement within a limit on it, with random laws."""
    plant, limit = loads(TWO_MASSES), parse_specification(line)
    if limit.kind in ("gain margin", "phase margin"):  # tuned by the disks that imply them
        limit = next(iter(limit.tuned(1.0)))
    least = replace(limit, at_most=None) if limit.of_signal else parse_specification(ALONE["rms"])
    task = _task(plant, structure or Structure(), replace(least, at_most=None), (limit,), None)
    random = np.random.default_rng(3)
    laws = [0.02 * random.normal(size=task.unknowns.size) for _ in range(6)]
    laws[1][:] = 1e200  # overflows
    laws[3] *= 1e4  # unstable
    return _Search(task), laws


def same(one, other):
    if one is None or other is None:
        return one is other
    if isinstance(one, np.ndarray):
        return np.allclose(one, other, rtol=1e-9, atol=1e-12)
    columns = ("values", "slopes", "groups", "objective")
    return all(
        np.shape(getattr(one, key)) == np.shape(getattr(other, key))
        and np.allclose(getattr(one, key), getattr(other, key), rtol=1e-7, atol=1e-9)
        for key in columns
    )


def test_every_kind_is_tried():
    tuned = set(KINDS) - {"saturation"}  # it has no slopes
    assert set(ALONE) | {parse_specification(line).kind for line in COUPLED} == tuned


@pytest.mark.parametrize("line", [*ALONE.values(), *COUPLED])
@pytest.mark.parametrize("phase", [REGION, LIMITS, LEVEL, SMALL, WORST])
def test_laws_together_are_as_each_alone(line, phase):
    search, laws = searched(line)
    asks = [
        Ask(theta, phase, unit=1.0 + k, most=2.0 + k, kappa=10.0 if phase == REGION else None)
        for k, theta in enumerate(laws)
    ]
    whole = search.first.answers(asks)
    each = [search.first.answers([ask])[0] for ask in asks]
    assert all(map(same, whole, each))
    if phase != WORST:
        assert whole[1] is None
        assert (whole[3] is None) == (phase != REGION)
        assert whole[0] is not None
    else:
        assert np.isinf(whole[1]).all()


@pytest.mark.parametrize("line", COUPLED)
def test_what_weighs_all_points_is_not_taken_together(line):
    """Else a law would be weighed with others: its rows would be those of another question."""
    search, _ = searched(line)
    assert search.task.coupled


def test_asks_of_several_phases_are_answered_in_their_order():
    search, laws = searched(ALONE["rms"])
    phases = [REGION, LEVEL, REGION, LIMITS, WORST, LEVEL]
    asks = [Ask(theta, phase) for theta, phase in zip(laws, phases, strict=True)]
    whole = search.first.answers(asks)
    assert all(map(same, whole, [search.first.answers([ask])[0] for ask in asks]))


def test_work_is_counted_law_by_law():
    search, laws = searched(ALONE["rms"])
    with bounded(1e12) as one:
        search.first.answers([Ask(laws[0], LIMITS)])
    with bounded(1e12) as several:
        search.first.answers([Ask(theta, LIMITS) for theta in (laws[0], laws[2], laws[4])])
    assert (several.spent, several.evaluations) == (3 * one.spent, 3)


@pytest.mark.parametrize("structure", [Structure(), Structure(schedule=())])
def test_searches_together_end_where_each_does_alone(structure):
    search, laws = searched(ALONE["rms"], structure)
    starts = [laws[0], laws[2], laws[4]]
    whole = search._improved(starts, search.first)
    each = [search._improved([theta], search.first)[0] for theta in starts]
    assert [end.level for end in whole] == pytest.approx([end.level for end in each], rel=1e-6)
    assert together([], search.first) == []


def test_threads_change_nothing(monkeypatch):
    search, laws = searched(ALONE["rms"])
    starts = [laws[0], laws[2], laws[4]]
    monkeypatch.setattr(tuner, "SHARED", 0)
    monkeypatch.setattr(measures, "SHARED", 1.0)
    ends = []
    for count in (1, 3):
        monkeypatch.setattr(tuner, "Team", partial(Team, count))
        ends.append([end.theta for end in search._improved(starts, search.first)])
    assert all(map(np.array_equal, *ends))


def test_a_team_answers_in_order_and_hands_on_what_is_raised():
    items = list(range(40))
    with Team(4) as team:
        assert team.each(lambda item: item * item, items) == [item * item for item in items]
        with pytest.raises(ZeroDivisionError):
            team.each(lambda item: 1 / item, items)
    assert team.each(str, [1, 2]) == ["1", "2"]  # alone, once the threads are gone
