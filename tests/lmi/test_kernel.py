"""The compiled interior point: the reference's twin, and no way to misuse it."""

import runpy
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy

import numpy as np
import pytest

import polefence
from polefence import Scheduled
from polefence.base.kernel import kernel as built
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.engine import run
from polefence.lmi.solve.interior_point import least_radius
from polefence.lmi.solve.smallest import smallest
from polefence.lmi.solve.stacked import stack
from support.paths import FAMILIES
from support.pencils import start

RIGHT = Scheduled(right_hand_sides=True)
METHODS = ["quadratic", "slack", "scheduled", RIGHT]
kernel = built()
compiled = pytest.mark.skipif(kernel is None, reason="installed without a compiler: no kernel")


def problem(plant, sigma, method):
    """A pencil in nominal coordinates, and a point inside it."""
    pencil, x, _ = start(plant, sigma, method)
    stacked = stack(pencil)
    return stacked, x, 1.3 * least_radius(*stacked.parts(x))


NAMES = ("D", "M", "R", "rows", "weights")


def arguments(stacked, x, r):
    """What `_kernel.run` takes; a term is a dict here, for tests to spoil."""
    families = [[{k: getattr(t, k) for k in NAMES} for t in f.terms] for f in stacked.families]
    given = {"unknowns": stacked.unknowns, "entries": stacked.entries, "families": families}
    given |= {"x": x, "r": r, "tolerance": 1e-8, "enough": 0.0, "order": 4, "max_iterations": 100}
    return given


def call(given, **changes):
    families = [[tuple(t[k] for k in NAMES) for t in f] for f in given["families"]]
    return kernel.run(**(given | {"families": families} | changes))


@pytest.fixture(scope="module")
def small(make_random):
    return problem(make_random(1, 2, 1, 2), 3.0, "slack")


# --- against the reference -----------------------------------------------------------------------

# Seed, n, m, N. Paths that are hard to follow magnify rounding; these are not.
SIZES = [(5, 2, 2, 5), (7, 3, 1, 2), (9, 3, 2, 4), (10, 3, 3, 5), (12, 4, 3, 2), (13, 5, 1, 4)]
CASES = [(*size, method) for size in SIZES for method in METHODS]
CASES += [(1, 1, 1, 2, "quadratic"), (1, 1, 1, 2, "slack"), (14, 5, 2, 3, "scheduled")]
CASES += [(17, 6, 2, 3, "quadratic"), (17, 6, 2, 3, "slack"), (16, 6, 1, 2, RIGHT)]
CASES += [(19, 7, 2, 2, "quadratic"), (19, 7, 2, 2, "scheduled"), (22, 9, 2, 2, "quadratic")]


@compiled
@pytest.mark.parametrize(("seed", "n", "m", "N", "method"), CASES, ids=str)
def test_it_agrees_with_the_reference(seed, n, m, N, method, make_random):
    stacked, x, r = problem(make_random(seed, n, m, N), 3.0, method)
    theirs = run(stacked, x, r, engine="numpy")
    ours = run(stacked, x, r, engine="compiled")
    assert ours.converged is theirs.converged is True
    assert abs(ours.iterations - theirs.iterations) <= 1 < 4 <= ours.iterations
    assert np.isclose(ours.r, theirs.r, rtol=1e-9)
    started, _, r, _, _, iterations, converged, trail = call(arguments(stacked, x, r), plain=True)
    assert trail.shape == (iterations + 1, 1 + stacked.unknowns)
    assert trail[-1, 0] == r
    assert started is converged is True
    assert abs(iterations - theirs.iterations) <= 1
    assert np.isclose(r, theirs.r, rtol=1e-9)
    # x may be free in some directions, to the square root of the gap
    assert np.allclose(ours.x, theirs.x, rtol=0, atol=1e-3 * np.abs(theirs.x).max())
    for mine, other in zip(ours.Y, theirs.Y, strict=True):
        assert mine.shape == other.shape
        assert np.allclose(mine, other, rtol=0, atol=1e-5 * np.abs(other).max())


@compiled
@pytest.mark.parametrize("seed", [19, 38, 45, 57])
def test_folds_are_passed_alike(seed):
    plant, centre = runpy.run_path(str(FAMILIES))["polytope"](seed)
    A, B, engines = plant.A, plant.B, ("compiled", "numpy")
    ours, theirs = (smallest(A, B, Disks(centre), "quadratic", engine=e) for e in engines)
    assert ours.converged
    assert ours.iterations <= 1.3 * theirs.iterations
    assert np.isclose(ours.r, theirs.r, rtol=1e-8)


def test_without_the_kernel_the_reference_runs(monkeypatch, make_random):
    plant = make_random(9, 3, 2, 4)
    usual = smallest(plant.A, plant.B, Disks(-3.0), "scheduled")
    monkeypatch.setattr("polefence.base.kernel._kernel", None)
    assert polefence.engine() == "numpy"
    for engine in (None, "numpy", "compiled"):
        found = smallest(plant.A, plant.B, Disks(-3.0), "scheduled", engine=engine)
        assert found.converged
        assert np.isclose(found.r, usual.r, rtol=1e-6)


# --- misuse --------------------------------------------------------------------------------------

# an axis of one of a term's arrays, without its last index (-1) or without any (0)
CUTS = [("D", 0), ("D", 1), ("D", 2), ("M", 0), ("M", 1), ("M", 2), ("R", 0), ("R", 1)]
CUTS = [(*cut, -1) for cut in [*CUTS, ("rows", 0), ("rows", 2), ("weights", 0), ("weights", 1)]]
CUTS += [("D", 2, 0), ("R", 2, 0), ("rows", 1, 0), ("weights", 1, 0)]


@compiled
@pytest.mark.parametrize("where", [0, 1])
@pytest.mark.parametrize(("name", "axis", "until"), CUTS)
def test_terms_that_do_not_fit_are_refused(name, axis, until, where, small):
    given = arguments(*small)
    assert call(given)[0]
    term = given["families"][0][where]
    term[name] = term[name].take(range(term[name].shape[axis])[:until], axis)
    with pytest.raises(ValueError, match="term|fit|row|block"):
        call(given)


@compiled
def test_arguments_that_do_not_fit_are_refused(small):
    given = arguments(*small)
    x, entries = given["x"], given["entries"]
    bad = [{"x": x[:-1]}, {"x": np.append(x, 0.0)}, {"x": x[:0], "unknowns": 0}]
    bad += [{"unknowns": -1}, {"unknowns": len(x) + 1}]
    bad += [{"entries": entries + 1}, {"entries": entries - 1}, {"entries": entries[:-1]}]
    bad += [{"order": order} for order in (-1, 0, 9, 2**40)]
    for changes in bad:
        with pytest.raises(ValueError, match="fit|entr|order"):
            call(given, **changes)
    for where in (0, 1):
        for beyond in (-1000, 1000):
            spoilt = arguments(*small)
            term = spoilt["families"][0][where]
            term["rows"] = term["rows"] + beyond
            with pytest.raises(ValueError, match="row"):
                call(spoilt)
    for families in ([], [[]], [given["families"][0], []]):
        with pytest.raises(ValueError, match="no (blocks|terms)"):
            call(given | {"families": families})


@compiled
def test_other_types_are_refused(small):
    given = arguments(*small)
    x = given["x"]
    bad = [{"x": x.astype(complex)}, {"x": x.astype(object)}, {"x": list(x)}, {"x": x[None]}]
    bad += [{"entries": given["entries"].astype(complex)}, {"entries": None}, {"r": "1"}]
    bad += [{"families": None}, {"families": [[()]]}, {"order": 4.5}, {"unknowns": None}]
    for changes in bad:
        with pytest.raises(TypeError):
            kernel.run(**(given | {"families": []} | changes))
    for name in NAMES:
        for change in (lambda a: a.astype(complex), lambda a: a[..., None], np.ndarray.tolist):
            spoilt = arguments(*small)
            spoilt["families"][0][0][name] = change(spoilt["families"][0][0][name])
            with pytest.raises(TypeError):
                call(spoilt)


@compiled
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-300, 5e-324])
@pytest.mark.parametrize("plain", [False, True])
def test_wild_numbers_end_the_run(value, plain, small):
    """One entry at a time: it ends, and says nothing about what is not finite."""
    ends = []
    for name in (*NAMES, "x", "r"):
        for place in range(4):
            given = arguments(*small)
            holder = given["families"][0][place % 2] if name in NAMES else given
            if name == "rows" or not np.any(holder[name]):
                continue
            spoilt = np.array(holder[name])
            nonzero = np.flatnonzero(spoilt)
            spoilt.flat[nonzero[place % len(nonzero)]] = value
            holder[name] = spoilt if spoilt.ndim else float(spoilt)
            started, x, r, Y, gap, iterations, converged, _ = call(given, plain=plain)
            assert 0 <= iterations <= 100
            assert not converged or (started and np.isfinite([r, gap, *x, *Y]).all())
            ends.append(converged)
    assert len(ends) > 15
    assert np.isfinite(value) or not any(ends)


@compiled
def test_data_are_only_read(small):
    given = deepcopy(arguments(*small))
    arrays = [given["x"], given["entries"]]
    arrays += [t[name] for f in given["families"] for t in f for name in NAMES]
    before = deepcopy(arrays)
    writable = call(given)
    for array, old in zip(arrays, before, strict=True):
        assert np.array_equal(array, old)
        array.setflags(write=False)
    locked = call(given)
    assert writable[6] is locked[6] is True
    assert np.array_equal(writable[1], locked[1])
    assert not np.shares_memory(locked[1], given["x"])


# --- threads -------------------------------------------------------------------------------------


@compiled
def test_threads_do_not_disturb_one_another(make_random):
    plants = [make_random(seed, 4, 2, 3) for seed in (1, 2)]
    problems = [arguments(*problem(p, 3.0, method)) for p in plants for method in METHODS]
    alone = [call(given) for given in problems]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(call, problems * 6))
    for k, result in enumerate(together):
        expected = alone[k % len(alone)]
        assert result[0]
        assert all(np.array_equal(a, b) for a, b in zip(result, expected, strict=True))


@compiled
def test_other_threads_run_meanwhile(make_random):
    """With the GIL held, no other thread would see the middle of a run."""
    given = arguments(*problem(make_random(15, 5, 3, 5), 3.0, RIGHT))
    span, ticks = [], []

    def work():
        span.extend([time.perf_counter(), call(given) and time.perf_counter()])

    thread = threading.Thread(target=work)
    thread.start()
    while thread.is_alive():
        ticks.append(time.perf_counter())
        time.sleep(1e-4)
    begin, end = span
    assert any(0.25 < (tick - begin) / (end - begin) < 0.75 for tick in ticks)


# --- while it runs -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long(make_random):
    """A run of about a second, that Python is asked in several times."""
    return problem(make_random(3, 8, 2, 8), 3.0, "scheduled")


@compiled
@pytest.mark.parametrize("plain", [False, True])
def test_a_listener_hears_of_iterations_and_may_end_the_run(plain, long):
    heard = []

    def listen(iterations):
        heard.append(iterations)
        if iterations > 1:
            raise TimeoutError

    with pytest.raises(TimeoutError):
        call(arguments(*long), plain=plain, told=listen)
    assert 1 < heard[-1] < 10
    assert all(earlier <= 1 for earlier in heard[:-1])


@compiled
def test_hearing_changes_nothing(long):
    given = arguments(*long) | {"max_iterations": 2}
    silent, told = call(given), call(given, told=lambda iterations: None)
    assert silent[2] == told[2]
    assert np.array_equal(silent[1], told[1])


@pytest.fixture(scope="module")
def large(make_random):
    """A system large enough to be worked out in several threads."""
    return problem(make_random(2, 8, 1, 16), 3.0, Scheduled(1, 0))


@compiled
@pytest.mark.parametrize("plain", [False, True])
def test_the_number_of_threads_changes_no_bit(plain, large):
    given = arguments(*large) | {"max_iterations": 2, "plain": plain}
    assert given["unknowns"] >= 600
    alone, *others = (call(given, threads=count) for count in (1, 2, 5))
    assert alone[5] == 2
    for own in others:
        assert own[2] == alone[2]
        assert all(np.array_equal(own[k], alone[k]) for k in (1, 3, 7))


@compiled
def test_the_number_of_threads_is_bounded(small):
    for count in (0, -1, 257):
        with pytest.raises(ValueError, match="1 to 256 threads"):
            call(arguments(*small), threads=count)


@compiled
def test_a_run_in_several_threads_is_ended_like_any_other(large):
    def listen(iterations):
        raise TimeoutError

    with pytest.raises(TimeoutError):
        call(arguments(*large), threads=3, told=listen)


@compiled
def test_a_run_ends_at_ctrl_c(long):
    given = arguments(*long)

    def interrupt(iterations):
        signal.raise_signal(signal.SIGINT)  # Python handles it after this call, or in the next

    with pytest.raises(KeyboardInterrupt):
        call(given, told=interrupt)
