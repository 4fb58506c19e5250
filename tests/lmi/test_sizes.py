"""The work of a search, counted before it is begun: against the pencils themselves."""

import tracemalloc
from itertools import pairwise

import pytest

from polefence import (
    Disk,
    InputError,
    Parameter,
    Rms,
    Scheduled,
    Slack,
    UncertainPlant,
    limits,
    optimise,
    place,
    tightest,
    tradeoff,
)
from polefence.certify import checks
from polefence.certify.checks import is_checkable, is_optimisable
from polefence.cli.main import main
from polefence.lmi.conditions.methods import (
    LONG_STEP,
    blocks,
    build,
    fitting,
    method_label,
    step_work,
)
from support.commands import ran, refused

METHODS = [
    "quadratic",
    "slack",
    "scheduled",
    Scheduled(1, 0),
    Scheduled(2, 1),
    Scheduled(1, 0, "box"),
    Scheduled(1, 1, "box"),
    Scheduled(2, 1, "box"),
    Slack(1, 1, "box"),
]


def springs(count, masses=2):
    """Masses in a row, the second one pushed; every spring of the first one is a parameter."""
    k = [Parameter(f"k{i}", 1, 1.2) for i in range(count)]
    n = 2 * masses
    A = [["0"] * n for _ in range(n)]
    for i in range(masses):
        A[2 * i][2 * i + 1], A[2 * i + 1][2 * i + 1] = "1", "-1"
        A[2 * i + 1][2 * i] = "-" + "-".join(f"k{j}" for j in range(count))
        if i:
            A[2 * i + 1][2 * i - 2] = A[2 * i - 1][2 * i] = "k0"
    B = [["0"]] * (n - 1) + [["k0"]]
    E = [[str(int(i == 1))] for i in range(n)]
    return UncertainPlant.from_expressions(k, A, B, E)


def test_six_to_eight_parameters_are_what_they_are_called():
    assert [len(springs(p).vertices) for p in (6, 8)] == [64, 256]


@pytest.mark.parametrize("method", METHODS, ids=method_label)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_inequalities_are_counted_as_they_are_built(method, count):
    plant = springs(count)
    pencil = build(method, plant.A, plant.B, 5.0)
    assert len(pencil.blocks) == blocks(plant, method)


@pytest.mark.parametrize("method", METHODS, ids=method_label)
def test_work_grows_with_parameters_and_states(method):
    by_parameters = [step_work(springs(p), method) for p in (1, 2, 3, 4)]
    by_states = [step_work(springs(2, masses), method) for masses in (2, 3, 4)]
    for found in (by_parameters, by_states):
        assert all(a < b for a, b in pairwise(found))


def test_a_plain_scheduled_is_asked_for_on_the_box_where_the_simplex_is_too_large():
    assert fitting(springs(4), "scheduled") == "scheduled"
    assert fitting(springs(5), "scheduled") == Scheduled(1, 1, "box")
    assert fitting(springs(5), Scheduled()) == Scheduled()
    assert fitting(springs(6, masses=4), "scheduled") == Scheduled(1, 0, "box")
    chosen = fitting(springs(6), "scheduled")
    assert chosen.on == "box"
    assert step_work(springs(6), chosen) <= LONG_STEP
    # what was asked for in full stays
    asked = Scheduled(1, 0, "simplex")
    assert fitting(springs(6), asked) == asked


def test_too_large_is_refused_before_it_is_begun():
    plant = springs(8)
    tracemalloc.start()
    try:
        for ask in (
            lambda: place(plant, Disk(-5, 4.9), Scheduled(1, 1, "box")),
            lambda: tightest(plant, -5, Scheduled(1, 1, "box")),
            lambda: limits(plant, -5, Scheduled(1, 1, "box")),
        ):
            with pytest.raises(InputError, match=r"65536 inequalities .* elevation 0.*quadratic"):
                ask()
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


def spec(path, plant):
    rows = {p.name: (p.low, p.high) for p in plant.parameters}
    text = "".join(f"[parameter.{k}]\nrange = [{a}, {float(b)}]\n" for k, (a, b) in rows.items())
    A = [["0", "1"], ["-" + "-".join(rows), "-1"]]
    path.write_text(
        f'name = "springs"\n{text}[matrices]\nA = {A}\nB = [["0"], ["k0"]]\nE = [["0"], ["1"]]\n'
    )
    return str(path)


def test_limits_leaves_out_what_is_too_large_unless_it_was_chosen(tmp_path, capsys):
    path = spec(tmp_path / "p.toml", springs(7))
    words = ["limits", path, "--centre", "-5", "--degree", "2", "--on", "simplex"]
    assert "too many to search and prove" in refused(capsys, *words, "--method", "scheduled")


def test_a_plant_too_large_for_every_method_is_refused(tmp_path, capsys, monkeypatch):
    from polefence.cli import limits as command

    monkeypatch.setattr(command, "is_checkable", lambda plant, method: False)
    path = spec(tmp_path / "p.toml", springs(1))
    assert main(["limits", path, "--centre", "-5"]) == 2
    said = capsys.readouterr()
    assert said.out.count("note: without") == 3
    assert "too large for every method" in said.err


def test_rows_are_printed_in_order_and_each_as_soon_as_those_before_it_are_there(
    tmp_path, capsys, monkeypatch
):
    from polefence.cli import limits as command

    seen = []
    add = command._Table.add

    def watched(self, row):
        add(self, row)
        seen.append((row["centre"], capsys.readouterr().out.count("proved")))

    monkeypatch.setattr(command._Table, "add", watched)
    path = spec(tmp_path / "p.toml", springs(1))
    centres = [word for c in (-5, -3, -1) for word in ("--centre", str(c))]
    assert main(["limits", path, *centres, "--method", "quadratic"]) == 0
    # the chain goes upwards, as the rows do: one line a row, at once
    assert seen == [(-5, 1), (-3, 1), (-1, 1)]


def test_what_is_accepted_is_searched_and_proved():
    plant = springs(5)
    method = Scheduled(1, 0, "box")
    assert is_checkable(plant, method)
    assert tightest(plant, -5, method).proved


ASKED = Rms("x1", density=1), (Rms("u1", density=1, at_most=1),)


def test_specifications_are_refused_before_they_are_begun():
    plant = springs(8)
    tracemalloc.start()
    try:
        said = r"19683 inequalities .* quadratic.* a tuned law needs none"
        with pytest.raises(InputError, match=said):
            optimise(plant, *ASKED, method="scheduled")
        with pytest.raises(InputError, match="19683 inequalities"):
            tradeoff(plant, ASKED[0], Rms("u1", density=1), [1.0], methods=["scheduled"])
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


def test_where_inequalities_are_too_many_a_law_is_tuned(monkeypatch):
    plant = springs(1, masses=1)
    method = Scheduled(1, 0, "box")
    work = 3 * step_work(plant, method)  # of the region, and of each specification
    monkeypatch.setattr(checks, "MOST_OPTIMISED_STEP", work)
    assert is_optimisable(plant, method, 2)
    monkeypatch.setattr(checks, "MOST_OPTIMISED_STEP", work - 1)
    assert optimise(plant, *ASKED).structure is not None
    with pytest.raises(InputError, match="9 inequalities"):
        optimise(plant, *ASKED, method=method)


def test_a_tradeoff_leaves_out_what_is_too_large_unless_it_was_chosen(
    tmp_path, capsys, monkeypatch
):
    path = spec(tmp_path / "p.toml", springs(1))
    words = ["tradeoff", path, "--over", "rms of u1 with density 1", "--value", "1"]
    words += ["--minimise", "rms of x1 with density 1"]
    least = 3 * step_work(springs(1, masses=1), "quadratic")
    monkeypatch.setattr(checks, "MOST_OPTIMISED_STEP", least)
    told = ran(capsys, *words)
    assert "note: without scheduled(1, 0, box): too large" in told
    assert "  quadratic " in told
    assert "too many to optimise" in refused(capsys, *words, "--method", "scheduled")
