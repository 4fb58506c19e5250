"""Drives of exported code beside its plant: what they measure, against the loop's covariance."""

import math
import re
from functools import cache
from importlib import import_module

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov

from polefence import HalfPlane, Structure, UncertainPlant, at_sample_time, place
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound
from polefence.cli.main import main
from polefence.export import Sampling, check_guarantee, export_c99, with_board
from polefence.export.documents import names, of_signals
from polefence.plant.parameters import Parameter
from polefence.requirements.rms import Rms
from polefence.search.optimise import save
from support.cortex import run

T, DECAY, DENSITY = 0.02, 0.3, 0.02
SAMPLES = 100_000  # an rms scatters by less than 1 % of itself
ROW = re.compile(r"(.*\]) +([0-9.e+-]+) +([0-9.e+-]+) +([0-9.e+-]+)  (.*)")


def spring(m, k):
    row = [-k / m, -0.5 / m]
    outputs = {"acceleration [m/s2]": {"C": row, "D": [1 / m]}}
    return [[0, 1], row], [[0], [1 / m]], [[0], [1 / m]], outputs


@cache
def plant():
    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m")]
    known = {"states": ["position [m]", "speed [m/s]"], "inputs": ["force [N]"]}
    return UncertainPlant.from_function(spring, bounds, disturbances=["gust [N]"], **known)


@cache
def exported(kind, delay, bits=64, size=None):
    """Return code with its board, of a law that was designed before its sample time or at it."""
    if kind in ("quadratic", "scheduled"):
        design = place(plant(), HalfPlane(DECAY), kind)
        code = export_c99(design, sampling=Sampling(T, delay), **numbers(design, bits, size))
    else:
        sampled = at_sample_time(plant(), T, delay)
        late = [own for own in sampled.states if "late" in own]
        structure = Structure(measured=["position", *late], order=1, schedule=[])
        # to its end: where a search that is cut short ends hangs on the last bits of floats, and so
        # does what rounding its law bears
        design = place(sampled, HalfPlane(DECAY), structure=structure)
        code = export_c99(design, **numbers(design, bits, size))
    return with_board(code, claims(design))


def numbers(design, bits, size):
    """Return what the code computes with: integers where the signals' size is given."""
    if size is None:
        return {"bits": bits}
    known = [label.partition(" [")[0] for label in names(of_signals(design))[0]]
    return {"fixed": bits, "ranges": dict.fromkeys(known, 20 * size) | {known[0]: size}}


def claims(design, **more):
    """Return proved bounds on acceleration and on the law's own demand."""
    limits = [Rms(name, density=DENSITY, **more) for name in ("acceleration", "force")]
    return [best_bound(design.plant, design.law, limit).claim for limit in limits]


def driven(made, folder, samples=SAMPLES):
    """Drive on this machine; return name, bound, rms over all roads, and place of each signal."""
    made.save(folder)
    return rows(run("make", "-s", "drive", f"SAMPLES={samples}", cwd=folder))


def rows(said):
    found = [ROW.fullmatch(line) for line in said.splitlines()]
    return [(row[1].split(" [")[0], float(row[2]), float(row[3]), row[5]) for row in found if row]


def long_run(design, at, delay):
    """Return the rms over time of acceleration and force: noise and plant in 200 short steps."""
    alpha = plant().alpha(**at)
    (A, B), E, count = plant().at(alpha), plant().driven(alpha), 200
    K, h = design.law.gain(alpha), T / count
    own = K.shape[0] - 1
    first = math.ceil(delay)
    late = first if design.plant.sample_time is not None else 0
    # (x, the law's own state, the last three demands, the newest first, u that acts)
    columns = [0, 1, *range(2 + own, 2 + own + late), *range(2, 2 + own)]
    wide = np.zeros((1 + own, 6 + own))
    wide[:, columns] = K
    update = np.eye(6 + own)
    update[2 : 2 + own, :] += T * wide[1:]
    update[2 + own : 5 + own] = [wide[0], *np.eye(6 + own)[2 + own : 4 + own]]
    update[-1] = update[2 + own + first]
    change = np.eye(6 + own)
    change[-1] = np.eye(6 + own)[1 + own + first]
    changed = round((1 - first + delay) * count)  # after so many steps the next one acts
    M = expm(np.block([[A, B], [np.zeros((1, 3))]]) * h)[:2]
    step = np.eye(6 + own)
    step[:2, :2], step[:2, -1] = M[:, :2], M[:, 2]
    noise = np.zeros((6 + own, 6 + own))
    noise[:2, :2] = E @ E.T * DENSITY / 2 * h
    whole, added = np.eye(6 + own), np.zeros_like(noise)
    for k in range(count):
        if k == changed:
            whole, added = change @ whole, change @ added @ change.T
        whole, added = step @ whole, step @ added @ step.T + noise
    X, sums = solve_discrete_lyapunov(whole @ update, added), np.zeros(2)
    X = update @ X @ update.T
    signals = np.zeros((2, 6 + own))
    signals[0, :2], signals[0, -1], signals[1, 2 + own] = A[1], B[1, 0], 1
    for k in range(count):
        X = change @ X @ change.T if k == changed else X
        sums += np.diag(signals @ X @ signals.T) / count
        X = step @ X @ step.T + noise
    return np.sqrt(sums)


def value_of(place_text):
    return {name: float(v) for name, v in re.findall(r"(\w) = ([0-9.]+)", place_text)}


CASES = [("quadratic", 0), ("quadratic", 1), ("scheduled", 1)]
CASES += [("order 1", delay) for delay in (0, 1, 0.5, 1.3)]


@pytest.mark.parametrize("delay", [0, 1, 0.5, 1.3])
def test_its_steps_give_the_rms_of_the_loop(monkeypatch, delay):
    """Covariances of the board's own steps and looks, which no drive scatters about."""
    of_board, boards = import_module("polefence.export.board"), []
    known = of_board._board
    monkeypatch.setattr(of_board, "_board", lambda *made: boards.append(known(*made)) or boards[-1])
    made, first = exported("order 1", delay), math.ceil(delay)
    for one in boards[0].places:
        at = value_of(one.text)
        # (x, the law's own state, the demands, the newest first)
        K, N, H = made.design.law.gain(plant().alpha(**at)), 4 + first, 1 + first
        wide, update, whole, added = np.zeros((2, N)), np.eye(N), np.eye(N), np.zeros((N, N))
        late = first if made.design.plant.sample_time is not None else 0
        wide[:, [0, 1, *range(3, 3 + late), 2]] = K
        update[2] += T * wide[1]
        update[3:] = [wide[0], *np.eye(N)[3 : 2 + H]]
        moved = []
        for M in one.steps:
            step, noise = np.eye(N), np.zeros((N, N))
            step[:2, :2], step[:2, 3:] = M[:, :2], M[:, 2 : 2 + H]
            noise[:2, :2] = M[:, 2 + H :] @ M[:, 2 + H :].T
            moved.append((step, noise))
        phases = list(zip(boards[0].phases, moved, one.seen, strict=True))
        for phase, (step, noise), _ in phases:
            for _ in range(phase.steps):
                whole, added = step @ whole, step @ added @ step.T + noise
        X, sums = update @ solve_discrete_lyapunov(whole @ update, added) @ update.T, np.zeros(2)
        for phase, (step, noise), seen in phases:
            rows = np.zeros((2, N))
            rows[:, :2], rows[:, 3:] = seen[:, :2], seen[:, 2 : 2 + H]
            for k in range(phase.steps + 1):
                weight = 1 if k in (0, phase.steps) else 4 if k % 2 else 2  # Simpson's rule
                sums += weight * phase.share / (3 * phase.steps) * np.diag(rows @ X @ rows.T)
                X = step @ X @ step.T + noise if k < phase.steps else X
        assert np.sqrt(sums) == pytest.approx(long_run(made.design, at, delay), rel=2e-4)


@pytest.mark.parametrize(("kind", "delay"), CASES)
def test_what_is_measured_is_the_rms_of_the_loop(host_compiler, tmp_path, kind, delay):
    made = exported(kind, delay)
    # the law's own state is slow: one drive scatters by more
    found = driven(made, tmp_path, SAMPLES * (32 if kind == "order 1" else 1))
    assert [name for name, *_ in found] == ["acceleration", "force"]
    for k, (_, proved, measured, where) in enumerate(found):
        at = value_of(where)
        assert measured == pytest.approx(long_run(made.design, at, delay)[k], rel=0.02)
        # none of the corners is much worse, and the bound is the one that was given
        corners = [{"m": m, "k": k} for m in (1.0, 2.0) for k in (4.0, 20.0)]
        worst = max(long_run(made.design, corner, delay)[k] for corner in corners)
        assert measured > 0.97 * worst
        assert proved == pytest.approx(float(claims(made.design)[k].level), rel=1e-4)
    # a loop without the delay, or with one more, is another
    if made.design.plant.sample_time is None:
        other = long_run(made.design, value_of(found[0][3]), 1 - delay)[0]
        own = long_run(made.design, value_of(found[0][3]), delay)[0]
        assert abs(found[0][2] - own) < abs(found[0][2] - other) / 2


def test_an_rms_behind_a_filter_is_that_of_the_weighted_signal(host_compiler, tmp_path):
    design = place(plant(), HalfPlane(DECAY), "quadratic")
    code = export_c99(design, 64, sampling=Sampling(0.002))
    (_, _, measured, where), _ = driven(
        with_board(code, claims(design, weight="Wk")), tmp_path, 500_000
    )
    limit = Rms("acceleration", density=DENSITY, weight="Wk")
    exact = limit.values(plant(), design.law, plant().alpha(**value_of(where))[None])
    plain = Rms("acceleration", density=DENSITY).values(
        plant(), design.law, plant().alpha(**value_of(where))[None]
    )
    assert measured == pytest.approx(exact[0], rel=0.03)
    assert abs(plain[0] / exact[0] - 1) > 0.1


@pytest.mark.parametrize(("kind", "bits"), [("scheduled", 32), ("order 1", 64)])
def test_emulated_processors_drive_the_same_bits(emulator, tmp_path, kind, bits):
    made = exported(kind, 1, bits)
    here = driven(made, tmp_path, 300)
    said = run("make", "-s", "board", "SAMPLES=300", cwd=tmp_path)
    assert re.findall(r"law on (\S+):", said) == ["Cortex-M4F", "Cortex-M3"]
    assert rows(said) == here * 2
    counts = [int(n) for n in re.findall(r"(\d+) instructions an update", said)]
    # what the one does with its unit the other does in software, both so in doubles
    if bits == 32:
        assert 5 * counts[0] < counts[1] < 100 * counts[0]
    else:
        assert 0.5 < counts[0] / counts[1] < 2


@pytest.mark.parametrize("kind", ["quadratic", "scheduled", "order 1"])
def test_integers_drive_as_floats_do(host_compiler, tmp_path, kind):
    floats, words = (
        driven(exported(kind, 1, *how), tmp_path / str(len(how)), 20_000)
        for how in ((32,), (32, 2.0))
    )
    for (*_, one, where), (*_, other, there) in zip(floats, words, strict=True):
        assert other == pytest.approx(one, rel=1e-4)
        assert where == there


def test_a_drive_beyond_the_range_of_words_says_so(host_compiler, tmp_path):
    exported("quadratic", 1, 16, 1e-4).save(tmp_path)
    said = run("make", "-s", "drive", "SAMPLES=1000", cwd=tmp_path)
    assert re.search(r"^\d+ measured values were beyond their range$", said, re.MULTILINE)
    assert check_guarantee(tmp_path).proved


def test_a_processor_without_floats_runs_integers_as_fast_as_one_with(emulator, tmp_path):
    exported("scheduled", 1, 32, 2.0).save(tmp_path)
    said = run("make", "-s", "board", "SAMPLES=20", cwd=tmp_path)
    counts = [int(n) for n in re.findall(r"(\d+) instructions an update", said)]
    assert len(counts) == 2
    assert 0.8 < counts[0] / counts[1] < 1.25


def test_a_law_that_refuses_ends_the_drive_with_a_failure(host_compiler, tmp_path):
    exported("quadratic", 1).save(tmp_path)
    text = (tmp_path / "law_board.c").read_text()
    (tmp_path / "law_board.c").write_text(text.replace("now[k] = 0.0;", "now[k] = INFINITY;"))
    said = run("make", "-k", "drive", "SAMPLES=10", cwd=tmp_path, status=2)
    places = int(re.search(r"PLACES (\d)U", text)[1])
    assert f"flags were raised at {33 * places} samples" in said  # of 11, on three roads


def test_the_board_is_in_the_guarantee(tmp_path):
    made = exported("order 1", 1)
    made.save(tmp_path)
    assert check_guarantee(tmp_path).proved
    assert "make board" in (tmp_path / "README.md").read_text()
    board = tmp_path / "law_board.c"
    board.write_text(board.read_text().replace("0.5", "0.4", 1))
    answer = check_guarantee(tmp_path)
    assert not answer.proved
    assert "law_board.c is not what" in answer.reason


def test_what_no_board_can_drive_is_said(tmp_path, capsys):
    design = place(plant(), HalfPlane(DECAY), "quadratic")
    code = export_c99(design, 64, sampling=Sampling(T))
    with pytest.raises(InputError, match="the design bounds none"):
        with_board(code, [])
    with pytest.raises(InputError, match="give --sample-time"):
        with_board(export_c99(design, 64), claims(design))
    with pytest.raises(InputError, match="without white noise in them"):
        with_board(code, [of_noise(design)])
    save(design.certificate, claims(design), tmp_path / "made")
    words = ["export", str(tmp_path / "made"), "-o", str(tmp_path / "code"), "--board"]
    assert main(words) == 2
    assert "give --sample-time" in capsys.readouterr().err
    assert main([*words, "--sample-time", str(T)]) == 0
    assert (tmp_path / "code" / "law_board.c").exists()
    assert main(words[:-1]) == 0  # an export without it removes it
    assert not (tmp_path / "code" / "law_board.c").exists()


def of_noise(design):
    """Return a claim about a signal with white noise in it, as a file may have one."""
    from dataclasses import replace
    from fractions import Fraction

    claim = claims(design)[0]
    direct = replace(claim.outputs[0], F=([[Fraction(1)]],) * 4)
    return replace(claim, outputs=(direct,))
