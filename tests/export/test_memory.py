"""Code of laws with states of their own: it keeps them, as the proof says, whatever is given."""

import json
import math
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import HalfPlane, InputError, NotProvedError, observe
from polefence.export import check_guarantee, export_c99
from polefence.export.memory import kept, with_rates
from polefence.export.sampled import sampled_poles
from polefence.export.vectors import special, vectors
from polefence.plant.larger import own_states
from polefence.proof.claims.rounding import gain_errors
from polefence.response.discrete import Sampling
from support.commands import ran, refused
from support.cortex import Export, _bounds, run
from support.files import rewritten
from support.memories import CORNER, TIME, Code, design, exactly, exported
from support.once import proved_once  # noqa: F401
from support.shapes_of_laws import SANITIZED, STRICT

ORDERS = {"affine": 1, "one gain": 1, "pid": 2}


def given(kind):
    return None if kind == "one gain" else list(CORNER.values())


@pytest.fixture
def code(host_compiler, tmp_path):
    return lambda made: Code(made, tmp_path)


@pytest.mark.parametrize(("kind", "bits"), [("affine", 32), ("one gain", 64), ("pid", 64)])
def test_the_folder_is_proved_and_its_test_passes(host_compiler, kind, bits, tmp_path, capsys):
    made = exported(kind, bits)
    assert made.proved
    made.save(tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror", cwd=tmp_path).splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2
    if kind != "one gain":
        said = ran(capsys, "check", tmp_path)
        assert "code computes it" in said
        assert "samples every 10 ms of x' = A x + B u" in said
        assert "u 1 sample late" in said


def test_the_code_has_no_warning_and_no_undefined_behaviour(host_compiler, tmp_path):
    exported("affine", 32).save(tmp_path)
    for flags in ([*STRICT, "-fanalyzer"], SANITIZED):
        run("gcc", *flags, "law.c", "law_test.c", "-o", "test", cwd=tmp_path)
        run("./test", cwd=tmp_path)


@pytest.mark.parametrize("kind", ORDERS)
def test_the_caller_gives_what_is_measured_and_gets_inputs_of_the_plant(kind):
    made = exported(kind, 32 if kind == "affine" else 64)
    header, page = (made.files[name].decode() for name in ("law.h", "README.md"))
    assert "#define LAW_INPUTS 1U\n" in header
    assert f"#define LAW_ORDER {ORDERS[kind]}U" in header
    assert "#define LAW_MEASURED 1U\n" in header
    assert "u[0]  force [N]" in header
    for word in ("law state", "pid", "rate of"):
        assert word not in header + page
    assert "law_reset(&memory)" in page
    assert made.program.memory.states == ORDERS[kind]
    assert len(made.texts.inputs) == 1


@pytest.mark.parametrize(("kind", "bits"), [("affine", 32), ("one gain", 64), ("pid", 64)])
def test_a_thousand_updates_are_the_exact_recursion_within_the_proved_bound(code, kind, bits):
    """At a corner the coordinates are whole numbers: the law's own gain is exact there."""
    made = exported(kind, bits)
    own, claim = code(made), made.guarantee.claim
    law, q, random = made.design.law, ORDERS[kind], np.random.default_rng(1)
    c = law.domain.coordinates(np.array(made.design.plant.alpha(**CORNER), dtype=float))
    c = (c[1::2] - c[::2]).astype(int)
    assert set(map(abs, c)) == {1}
    terms = [int(np.prod(c ** np.array(e))) for e in law.powers]
    K = sum(many * exactly(gain) for many, gain in zip(terms, law.gains, strict=True))
    E, T = exactly(np.zeros((len(K), K.shape[1]))), Fraction(TIME)
    for i, row in enumerate(gain_errors(claim)):
        E[i] = row
    own.reset()
    y, worst = np.zeros(K.shape[1] - q), 0.0
    real = np.float32 if bits == 32 else float
    for _ in range(1000):
        y = (0.95 * y + 0.01 * random.normal(size=len(y))).astype(real)
        s = exactly([*y, *own.states])
        u, flags = own.update(given(kind), y)
        assert flags == 0
        exact, off = K @ s, E @ np.abs(s)
        found = [*exactly(u), *((exactly(own.states) - s[-q:]) / T)]
        wrong = [abs(a - b) for a, b in zip(found, exact, strict=True)]
        assert all(a <= b for a, b in zip(wrong, off, strict=True))
        worst = max(worst, *(float(a / b) for a, b in zip(wrong, off, strict=True) if b))
    assert worst > 0.01  # of the bound: it is none of another size
    assert np.abs(own.states).max() > 0


def closed(own, made, late):
    """The sampled loop at a corner, the law by the code: from (x, z, u before) to the next."""
    plant, q = made.design.plant, made.program.memory.states
    A, B = plant.at(plant.alpha(**CORNER))
    n, m = plant.shape[0] - q, plant.shape[1] - q
    block = expm(np.block([[A[:n, :n], B[:n, :m]], [np.zeros((m, n + m))]]) * TIME)[:n]
    C = made.design.law.C[0][: len(made.texts.states), :n]
    values = given("one gain" if made.design.law.fixed else "affine")

    def tick(z):
        x, own.states, before = z[:n], z[n : n + q], z[n + q :]
        u, flags = own.update(values, C @ x)
        assert flags == 0
        return np.concatenate([block @ [*x, *(before if late else u)], own.states, u])

    return np.array([tick(unit) for unit in np.eye(n + q + m)]).T


@pytest.mark.parametrize(
    ("kind", "late"), [("affine", False), ("affine", True), ("one gain", True), ("pid", True)]
)
def test_the_loop_that_the_code_closes_is_the_one_that_is_judged(code, kind, late):
    made = exported(kind, 64, late)
    whole = closed(code(made), made, late)
    found = np.linalg.eigvals(whole)
    wanted = sampled_poles(made.design, made.design.plant.alpha(**CORNER), TIME, int(late)).z
    found = found[np.argsort(-np.abs(found))][: len(wanted)]
    assert np.allclose(np.poly(found), np.poly(wanted), atol=1e-9)
    assert np.abs(found).max() < math.exp(-made.timing.proof.decay * TIME)
    assert 0.8 * made.timing.proof.sampled < made.timing.proof.decay


def test_a_pid_keeps_the_loop_and_steps_integral_and_filter(code):
    own = design("pid")
    rated = with_rates(own)
    assert (kept(own), kept(rated)) == (0, 2)
    assert rated.plant.shape == (4, 3)
    alpha = own.plant.alpha(**CORNER)
    A, B = own.plant.at(alpha)
    larger, more = rated.plant.at(alpha)
    assert np.allclose(A + B @ own.law.gain(alpha), larger + more @ rated.law.gain(alpha))
    stepped = code(exported("pid", 64))
    stepped.update(given("pid"), [0.5])
    w = 2 * math.pi * 2
    assert stepped.states == pytest.approx([0.5 * TIME, 0.5 * w * TIME])
    stepped.update(given("pid"), [0.5])
    assert stepped.states == pytest.approx([TIME, 0.5 * w * TIME * (2 - w * TIME)])


@pytest.mark.parametrize("kind", ["affine", "pid"])
def test_a_design_without_own_states_is_left_as_it_is(kind):
    rated = with_rates(design(kind))
    assert with_rates(rated) is rated


def test_names_alone_make_no_state_the_laws_own():
    plant = design("affine").plant
    assert own_states(plant) == 1
    for key, i, j in (("exact_A", 1, 2), ("exact_A", 2, 0), ("exact_B", 2, 0), ("exact_B", 0, 1)):
        changed = [[list(row) for row in getattr(v, key)] for v in plant.vertices]
        changed[1][i][j] = Fraction(1)
        pairs = zip(plant.vertices, changed, strict=True)
        vertices = tuple(replace(v, **{key: tuple(map(tuple, M))}) for v, M in pairs)
        assert own_states(replace(plant, vertices=vertices)) == 0
    assert own_states(replace(plant, inputs=("force", "force 2"))) == 0


def test_what_is_not_finite_leaves_the_states_and_what_overflows_begins_them_again(code):
    own = code(exported("affine", 32))
    for bad in (math.nan, math.inf, -math.inf):
        own.states = [0.25]
        assert own.update(given("affine"), [bad]) == ([0.0], 4)
        assert own.states == [0.25]
    for states, y in ((math.nan, 0), (math.inf, 0), (3e38, 0), (0.25, 3e38)):
        own.states = [states]
        assert own.update(given("affine"), [y]) == ([0.0], 4 | 16)
        assert own.states == [0.0]
    own.states = [1e6]
    assert own.update(given("affine"), [0.0]) == ([800.0], 8)
    assert 0.8e6 < own.states[0] < 0.95e6  # the rate, -1e7, is not cut
    own.reset()
    assert own.states == [0.0]


def test_limits_are_of_inputs_of_the_plant():
    assert exported("affine", 32).texts.limits == (800.0,)
    with pytest.raises(InputError, match="2 numbers for 1 inputs"):
        export_c99(design("affine"), 32, sampling=Sampling(TIME), limits=(1.0, 2.0))


def test_without_a_sample_time_there_is_no_code(tmp_path, capsys):
    design("affine").save(tmp_path / "own")
    capsys.readouterr()
    (line,) = refused(capsys, "export", tmp_path / "own", "-o", tmp_path / "code").splitlines()
    assert "1 state of its own" in line
    assert "--sample-time 0.001" in line
    assert not (tmp_path / "code").exists()


def test_an_observer_beside_a_law_with_states_is_refused():
    own = design("one gain")
    seen = observe(own.plant, ["position", "law state 1"], HalfPlane(1))
    with pytest.raises(InputError, match="states of its own"):
        export_c99(own, 32, observer=seen, sampling=Sampling(TIME))


def test_short_samples_in_float32_are_refused_with_the_remedy():
    """u / T is 60 1/s: more than the loop tolerates."""
    with pytest.raises(NotProvedError, match="--float 64, or with a longer --sample-time") as found:
        export_c99(design("affine"), 32, sampling=Sampling(1e-9))
    assert "rounding in float32" in str(found.value)


CHANGED = {
    "law.c": lambda text: text.replace("LAW_SAMPLE_TIME * sum", "LAW_SAMPLE_TIME * 2 * sum"),
    "law.h": lambda text: text.replace("SAMPLE_TIME 0.0", "SAMPLE_TIME 0.1"),
    "README.md": lambda text: text.replace("law_reset", "law_begin"),
}


def claims(change):
    def changed(text):
        table = json.loads(text)
        change(*table["claims"])
        return json.dumps(table)

    return changed


OF_CLAIMS = {
    "no memory": lambda rounded: rounded["code"].pop("memory"),
    "another step": lambda rounded: rounded["code"]["memory"].update(step=0.0078125),
    "another time": lambda rounded: rounded["code"]["memory"].update(sample_time=0.0099),
    "two states": lambda rounded: rounded["code"]["memory"].update(states=2),
}


@pytest.mark.parametrize("change", [*CHANGED, *OF_CLAIMS])
def test_changed_files_are_not_what_is_proved(change, tmp_path):
    exported("affine", 32).save(tmp_path)
    assert check_guarantee(tmp_path).proved
    path = tmp_path / (change if change in CHANGED else "guarantee.json")
    text = path.read_text()
    new = (CHANGED.get(change) or claims(OF_CLAIMS[change]))(text)
    assert new != text
    path.write_text(new)
    with suppress(InputError):  # no file of claims at all
        assert not check_guarantee(path.parent).proved


def test_a_memory_needs_a_claim_about_the_sampled_loop(tmp_path):
    exported("affine", 32).save(tmp_path)
    path = tmp_path / "guarantee.json"
    with rewritten(path) as table:
        del table["export"]["text"]["sampled"]
    with pytest.raises(InputError, match="needs a claim about its sampled loop"):
        check_guarantee(path)


@pytest.mark.parametrize("kind", ["affine", "one gain"])
def test_expected_states_are_those_of_the_recursion(kind):
    made = exported(kind, 64)
    law, q = made.design.law, 1
    for table in (vectors(made.program, law, count=16), special(made.program, law)):
        for row in range(len(table.x)):
            y, z, after = table.x[row, :-q], table.x[row, -q:], table.u[row, -q:]
            if not np.isfinite(y).all():
                assert np.array_equal(after, z)
                assert table.flags[row] & 20 == 4
            elif not np.isfinite(z).all():
                assert np.all(after == 0)
                assert table.flags[row] & 20 == 20
            elif table.flags[row] == 0:
                values = dict(zip(CORNER, table.given[row], strict=False))
                own = made.design.plant.alpha(clamp=True, **(values or CORNER))
                rates = law.own_gain(own, clamp=True)[-q:] @ table.x[row]
                assert np.allclose(after, z + TIME * rates, rtol=1e-12, atol=1e-12)


def test_many_updates_are_the_same_bits_on_host_and_target(emulator, tmp_path):
    made = exported("affine", 32)
    made.save(tmp_path)
    (tmp_path / "inputs.h").write_text(_bounds(made.program))
    own = Export(tmp_path, made.program, made.design.law)
    answers = [
        own.answers(build("ticks.c", "-DCOUNT=1000U"), 1000, where)
        for build, where in ((own.host, "host"), (own.target, "target"))
    ]
    assert answers[0].shape == (1000, 2)
    assert answers[0].tobytes() == answers[1].tobytes()
    assert np.all(np.ptp(answers[0], axis=0) > 0)
