"""Compensators beside a plant: their loops, against python-control's, and what they refuse."""

from dataclasses import replace
from time import process_time

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete

from polefence import (
    Compensator,
    FixedGain,
    GainTable,
    HalfPlane,
    InputError,
    Parameter,
    ScheduledGain,
    TableAnalysis,
    UncertainPlant,
    analyse,
    at_sample_time,
    check,
    worst_case,
)
from polefence.law.compensator import beside
from polefence.plant.outputs import Output


def random_plant(rng, n=3, m=2, r=2, vertices=2):
    A = rng.normal(size=(vertices, n, n)) - 2 * np.eye(n)
    B, C = rng.normal(size=(n, m)), rng.normal(size=(r, n))
    outputs = [Output(f"y{i + 1}", C=[C[i]]) for i in range(r)]
    plant = UncertainPlant.from_vertices(list(A), [B] * vertices)
    return UncertainPlant(plant.vertices, outputs=tuple(outputs), name="p"), A, B, C


def random_law(rng, k=2, m=2, r=2):
    return [rng.normal(size=shape) for shape in ((k, k), (k, r), (m, k), (m, r))]


def close(one, other):
    """Whether two sets of poles are the same to rounding."""
    return np.allclose(np.poly(one), np.poly(other), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_loops_are_those_of_python_control(seed):
    rng = np.random.default_rng(seed)
    plant, A, B, C = random_plant(rng)
    a, b, c, d = random_law(rng)
    larger, law = Compensator(a, b, c, d).beside(plant)
    assert larger.shape == (5, 4)
    for j, vertex in enumerate(larger.vertices):
        ours = np.linalg.eigvals(vertex.A + vertex.B @ law.gain(np.eye(2)[j]))
        open_loop = control.ss(A[j], B, C, np.zeros((2, 2)))
        assert close(ours, control.feedback(open_loop, control.ss(a, b, c, d), sign=1).poles())
        minus = Compensator(a, b, c, d).negated().beside(plant)[1]
        theirs = control.feedback(open_loop, control.ss(a, b, c, d)).poles()
        assert close(np.linalg.eigvals(vertex.A + vertex.B @ minus.gain(np.eye(2)[j])), theirs)


@pytest.mark.parametrize("seed", range(4))
def test_loops_in_discrete_time(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(3, 3)) / 4, rng.normal(size=(3, 2))
    C = rng.normal(size=(2, 3))
    a, b, c, d = random_law(rng)
    plant = UncertainPlant.from_vertices([A], [B], sample_time="0.02")
    larger, law = Compensator(a, b @ C, c, d @ C, sample_time=0.02).beside(plant)
    ours = np.linalg.eigvals(larger.A[0] + larger.B[0] @ law.gain([1.0]))
    loop = control.feedback(control.ss(A, B, C, 0, 0.02), control.ss(a, b, c, d, 0.02), sign=1)
    assert close(ours, loop.poles())


def test_a_law_in_steps_of_a_sampled_plant():
    """The plant is held by SciPy, the loop closed by python-control, one sample late."""
    A, B = np.array([[0.0, 1.0], [2.0, -1.0]]), np.array([[0.0], [1.0]])
    plant = UncertainPlant.from_vertices([A], [B], states=["x", "v"])
    seen = at_sample_time(plant, "0.01", 1)
    law = control.tf([-40, 39], [1, -0.7], 0.01, inputs=["x"], outputs=["u"])
    larger, gain = beside(seen, law)
    ours = np.linalg.eigvals(larger.A[0] + larger.B[0] @ gain.gain([1.0]))
    a, b, *_ = cont2discrete((A, B, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 0.01)
    late = control.tf([1], [1, 0], 0.01)
    held = control.tf(control.ss(a, b, [[1, 0]], 0, 0.01))
    assert close(
        ours, control.feedback(held * late, control.tf([-40, 39], [1, -0.7], 0.01), 1).poles()
    )


TRANSFERS = [
    ("(s + 50)/(s + 500)", [1, 50], [1, 500]),
    ("-3*(s**2 + 2*s + 5)/((s + 1)*(s + 20))", [-3, -6, -15], [1, 21, 20]),
    ("7", [7], [1]),
    ("1e4/(s*(s/300 + 1)**2)", [1e4], [1 / 90000, 2 / 300, 1, 0]),
]


@pytest.mark.parametrize(("text", "top", "bottom"), TRANSFERS)
def test_a_text_a_list_and_python_control_are_one_law(text, top, bottom):
    laws = [
        Compensator.from_text(text),
        Compensator.from_fields({"numerator": top, "denominator": bottom}),
        Compensator.from_fields({"num": [top], "den": [bottom]}),
        Compensator.from_control(control.tf(top, bottom)),
    ]
    zpk = {"zeros": np.roots(top), "poles": np.roots(bottom), "gain": top[0] / bottom[0]}
    if not np.iscomplexobj(zpk["zeros"]) or text.startswith("-3"):
        laws.append(Compensator.from_fields(zpk))
    at = 1j * np.logspace(-2, 4, 25)
    truth = np.polyval(top, at) / np.polyval(bottom, at)
    for law in laws:
        assert law.order == len(bottom) - 1
        assert np.allclose(answer(law, at)[:, 0, 0], truth, rtol=1e-9)


def answer(law, at):
    """C (s - A)^-1 B + D at points s."""
    k, D = law.order, np.array(law.D, dtype=float)
    if not k:
        return np.broadcast_to(D, (len(at), *D.shape))
    A, B, C = (np.array(M, dtype=float) for M in (law.A, law.B, law.C))
    return np.array([C @ np.linalg.solve(s * np.eye(k) - A, B) + D for s in at])


def test_matrices_have_no_states_that_are_not_seen():
    """An integrator that all entries share is one state; two are two, where they are two."""
    shared = [["1/s", "2/s"], ["3/s", "6/s"]]
    law = Compensator.from_text(shared)
    assert law.order == 1
    assert Compensator.from_text([["1/s", "2/s"], ["3/s", "7/s"]]).order == 2
    assert Compensator.from_text([["1/s", "1/s**2"], ["1/(s + 1)", "1/(s + 1)"]]).order == 3
    assert Compensator.from_text("(s + 1)*(s - 3)/((s - 3)*(s + 2))").order == 1
    at = np.array([0.3j, 2j, 1 + 40j])
    for rows in (shared, [["1/s", "1/s**2"], ["1/(s + 1)", "(s + 2)/(s + 1)"]]):
        truth = [[eval(e, {"s": at}) for e in row] for row in rows]
        ours = answer(Compensator.from_text(rows), at)
        assert np.allclose(ours, np.moveaxis(truth, 2, 0), rtol=1e-12)


def test_matrices_of_python_control():
    num = [[[1.0], [2.0, 1.0]], [[3.0], [4.0]]]
    den = [[[1.0, 2.0], [1.0, 3.0]], [[1.0, 2.0], [1.0, 2.0, 5.0]]]
    law = Compensator.from_control(control.tf(num, den))
    at = np.array([0.1j, 1j, 7j])
    for i in range(2):
        for j in range(2):
            truth = np.polyval(num[i][j], at) / np.polyval(den[i][j], at)
            assert np.allclose(answer(law, at)[:, i, j], truth)
    same = Compensator.from_fields({"numerator": num, "denominator": den})
    assert np.allclose(answer(same, at), answer(law, at))


LEVER = Parameter("L", "0.1", "0.4", "m")
GRAVITY = [[0, 1, 0], ["30 - 40*L", "-1", "5*L"], [0, 0, -20]]
ACTS = [[0], [0], [20]]


def lever():
    names = {"states": ["angle [rad]", "rate [rad/s]", "torque [N m]"], "name": "lever"}
    return UncertainPlant.from_expressions([LEVER], GRAVITY, ACTS, **names)


# of a pendulum behind a lag: stiffer where the lever is short
CUBIC = ["-190 + 1080*L - 2350*L**2 + 1800*L**3", "-35 + 190*L - 390*L**2 + 280*L**3", "-L/5"]


def test_gains_that_are_cubic_polynomials_of_a_length():
    plant = lever()
    found = analyse(plant, [CUBIC], HalfPlane(0.5))
    assert found.proved
    assert found.law.powers == ((0,), (1,), (2,), (3,))
    for L in np.linspace(0.1, 0.4, 31):
        truth = [eval(text, {"L": L}) for text in CUBIC]
        assert np.allclose(found.law.gain_at(L=L), [truth], rtol=1e-12, atol=1e-12)
        A = np.array([[0, 1, 0], [30 - 40 * L, -1, 5 * L], [0, 0, -20]])
        A[2] += 20 * np.array(truth)
        assert np.linalg.eigvals(A).real.max() < -0.5


def test_a_cubic_gain_that_destabilises_between_its_ends_is_refuted():
    """It is right at both ends of the interval and in its middle, and not between."""
    bump = "+ 200000*(L - 1/10)*(L - 4/10)*(L - 1/4)"
    gain = [f"{CUBIC[0]} {bump}", *CUBIC[1:]]
    found = analyse(lever(), [gain], HalfPlane(0))
    assert found.answer == "refuted"
    L = float(found.values["L"])
    A = np.array([[0, 1, 0], [30 - 40 * L, -1, 5 * L], [0, 0, -20]])
    A[2] += 20 * np.array([eval(text, {"L": L}) for text in gain])
    assert np.linalg.eigvals(A).real.max() > 0
    for end in (0.1, 0.25, 0.4):
        assert eval(bump, {"L": end}) == pytest.approx(0, abs=1e-9)


def test_gains_through_the_reciprocal_of_a_mass():
    mass = Parameter("m", 1, 4, "kg", through="1/m")
    plant = UncertainPlant.from_expressions([mass], [[0, 1], [0, "-1/m"]], [[0], ["1/m"]])
    found = analyse(plant, [["-3/m - 1", "-2"]], HalfPlane(0))
    assert found.proved
    assert np.allclose(found.law.gain_at(m=3), [[-2, -2]])
    found = analyse(plant, [["-3*m", "-2"]], HalfPlane(0))  # a quotient of polynomials in 1/m
    assert found.proved
    assert np.allclose(found.law.gain_at(m=3), [[-9, -2]])


RATIONAL = ["-(30 + 40/(0.1 + L))/(2*L)", "-6/L", "-1/(1 + L)"]


def test_gains_with_a_denominator_are_proved_exactly(tmp_path):
    plant = lever()
    found = analyse(plant, [RATIONAL], HalfPlane(4.38))
    assert found.proved
    assert isinstance(found.law, ScheduledGain)
    worst = np.inf
    for L in np.linspace(0.1, 0.4, 301):
        truth = np.array([eval(text, {"L": L}) for text in RATIONAL])
        assert np.allclose(found.law.gain_at(L=L), [truth], rtol=1e-12)
        A = np.array([[0, 1, 0], [30 - 40 * L, -1, 5 * L], [0, 0, -20]])
        A[2] += 20 * truth
        worst = min(worst, -np.linalg.eigvals(A).real.max())
    assert worst_case(plant, [RATIONAL]).region.numbers["decay"] == pytest.approx(worst, rel=1e-4)
    found.save(tmp_path)
    assert check(tmp_path).proved
    assert analyse(plant, [RATIONAL], HalfPlane(4.4)).answer == "refuted"
    measured = Compensator(D=[RATIONAL[:2]], measured=["angle", "rate"])
    assert np.allclose(measured.beside(plant)[1].gain_at(L=0.3)[0, 2], 0)
    assert analyse(plant, measured, HalfPlane(0)).proved


def test_a_compensator_with_entries_in_the_parameters():
    plant = lever()
    law = Compensator(
        [["-30 - 100*L"]], [["200 - 300*L"]], [["-1 - L"]], [["-120 + 60*L"]], ["angle"]
    )
    larger, gain = law.beside(plant)
    for L in (0.1, 0.23, 0.4):
        alpha = plant.alpha(L=L)
        A, B = larger.at(alpha)
        a, b, c, d = -30 - 100 * L, 200 - 300 * L, -1 - L, -120 + 60 * L
        own = np.array([[0, 1, 0], [30 - 40 * L, -1, 5 * L], [0, 0, -20]])
        loop = control.feedback(
            control.ss(own, ACTS, [[1, 0, 0]], 0), control.ss(a, b, c, d), sign=1
        )
        assert close(np.linalg.eigvals(A + B @ gain.gain(alpha)), loop.poles())


@pytest.mark.parametrize("measured", [None, ["angle", "rate"]])
def test_a_table_of_compensators(measured):
    plant = lever()
    knots, rng = [0.1, 0.2, 0.4], np.random.default_rng(5)
    r = 3 if measured is None else 2
    blocks = [rng.normal(size=(3, *shape)) for shape in ((2, 2), (2, r), (1, 2), (1, r))]
    law = Compensator(*blocks, measured=measured, grid={"L": knots})
    larger, table = law.beside(plant)
    assert isinstance(table, GainTable)
    C = np.eye(3)[:r]
    for L in (0.1, 0.15, 0.2, 0.37):
        a, b, c, d = (
            np.array([[np.interp(L, knots, M[:, i, j]) for j in range(M.shape[2])]
                      for i in range(M.shape[1])])
            for M in blocks
        )  # fmt: skip
        own = np.array([[0, 1, 0], [30 - 40 * L, -1, 5 * L], [0, 0, -20]])
        loop = control.feedback(
            control.ss(own, ACTS, C, np.zeros((r, 1))), control.ss(a, b, c, d), 1
        )
        A, B = larger.at(plant.alpha(L=L))
        assert close(np.linalg.eigvals(A + B @ table.gain_at(L=L)), loop.poles())


@pytest.mark.parametrize("dt", [None, "0.05"])
@pytest.mark.parametrize("seed", range(3))
def test_a_compensator_a_vertex(seed, dt):
    """As hinfgs has them: A, B, C and D are the means of those at the vertices."""
    rng = np.random.default_rng(seed)
    A, B, C = rng.normal(size=(3, 3, 3)) / 4, rng.normal(size=(3, 2)), rng.normal(size=(2, 3))
    blocks = [rng.normal(size=(3, *shape)) / 2 for shape in ((2, 2), (2, 2), (2, 2), (2, 2))]
    plant = UncertainPlant.from_vertices(list(A), [B] * 3, sample_time=dt)
    plant = replace(plant, outputs=tuple(Output(f"y{i}", C=[C[i]]) for i in range(2)))
    law = Compensator(*blocks, sample_time=dt)
    for own in (law, law.negated()):
        larger, gain = own.beside(plant)
        sign = 1 if own is law else -1
        for alpha in ([1, 0, 0], [0.2, 0.5, 0.3], [0, 0.4, 0.6]):
            step = 0 if dt is None else float(dt)
            a, b, c, d = (np.tensordot(alpha, M, 1) for M in blocks)
            P = control.ss(np.tensordot(alpha, A, 1), B, C, 0, step)
            loop = control.feedback(P, control.ss(a, b, c, d, step), sign)
            ours, acts = larger.at(alpha)
            assert close(np.linalg.eigvals(ours + acts @ gain.gain(alpha)), loop.poles())
    two = Compensator(*(M[:2] for M in blocks), sample_time=dt)
    with pytest.raises(InputError, match="the law has 2 vertices; plant has 3: give one at each"):
        two.beside(plant)
    with pytest.raises(InputError, match="different numbers of knots or vertices: 2 and 3"):
        Compensator(blocks[0][:2], *blocks[1:])


def test_a_table_is_proved_cell_by_cell_and_refuted(tmp_path):
    plant = lever()
    D = [[[-120.0, -20.0]], [[-110.0, -18.0]], [[-100.0, -15.0]]]
    blocks = {"A": [[[-50.0]]] * 3, "B": [[[0.0, 50.0]]] * 3, "C": [[[-1.0]]] * 3}
    law = Compensator(**blocks, D=D, measured=["angle", "rate"], grid={"L": [0.1, 0.2, 0.4]})
    found = analyse(plant, law, HalfPlane(0))
    assert found.answer == "proved"
    again = TableAnalysis.load(found.save(tmp_path))
    assert again.proved
    assert again.plant.shape == (4, 2)
    assert analyse(plant, law.negated(), HalfPlane(0)).answer == "refuted"


def test_a_law_of_more_states_than_are_sought(tmp_path):
    """As D-K iterations leave them: 22 states."""
    rng = np.random.default_rng(0)
    fast = rng.normal(size=(21, 21)) - 12 * np.eye(21)
    slow = Compensator.from_text("-1800*(s + 5)/(s + 100)")
    A = np.zeros((22, 22))
    A[0, 0], A[1:, 1:] = slow.A[0][0], fast
    B, C = np.ones((22, 1)), np.full((1, 22), 0.5)
    B[0], C[0, 0] = float(slow.B[0][0]), float(slow.C[0][0])
    law = Compensator(A, B, C, slow.D, ["angle"])
    found = analyse(lever(), law, HalfPlane(0))
    assert found.proved
    found.save(tmp_path)
    assert check(tmp_path).proved


def test_what_proves_also_bounds_and_saves(tmp_path):
    plant = lever()
    law = Compensator.from_text("-1800*(s + 5)/(s + 100)", measured=["angle"])
    found = analyse(plant, law, HalfPlane(0))
    assert found.proved
    found.save(tmp_path)
    assert check(tmp_path).proved
    reach = worst_case(plant, law)
    assert 3.4 < reach.region.numbers["decay"] <= reach.bound < 3.43  # of a grid of 13 lengths
    assert analyse(plant, law, HalfPlane(3.43)).answer == "refuted"


def test_a_gain_of_all_states_stays_a_fixed_gain():
    plant = lever()
    _, law = beside(plant, [["-150", "-1/3", 0]])
    assert isinstance(law, FixedGain)
    assert np.array_equal(law.K, [[-150, -1 / 3, 0]])


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("1/(s", "cannot read the expression '1/(s'"),
        ("s + 1", "numerator has degree 1, the denominator 0; divide by a fast pole"),
        ("__import__('os')", "unknown name '__import__' in the law"),
        (
            [["sin(L)", 0, 0]],
            "sin in the law: gains are polynomials in the parameters, or quotients",
        ),
        ("(s + q)/(s + 1)", "unknown name 'q' in the law; known are the parameters"),
        ([["1/s", "1/z"]], "in s beside one in z"),
        ("1/(z - 0.5)", "in z, and no sample time; sample the plant by polefence.at_sample_time"),
        ("1/(s + 1)", "measures 1 signal; lever has 3 states and 0 outputs: neither has as many"),
        ([["L**9", 0, 0]], "has degree 9 in the parameters; at most 8"),
        ([["1/(L - 0.2)", 0, 0]], "denominator of the gains is not seen to keep its sign for all"),
        ([["1/L**5", "1/(1 + L)**4", 0]], "over one denominator have degree 9 in a parameter"),
        ([["1/L**9", 0, 0]], "has degree 9 in the parameters; at most 8"),
        (
            Compensator([["-1/L"]], [[1]], [[1]], measured=["angle"]),
            "A[1][1]: '-1/L' is no polynomial in L, as entries of laws with states must be",
        ),
        ([["1", "2"]], "the law measures 2 signals"),
        ([["1", "2", "3"], ["1", "2", "3"]], "the law gives 2 inputs u; lever has 1 input"),
        ("1/((s + 1)**21*(s + 2)**20)", "41 states or more; at most 40 are supported"),
        ("1/((s + 1)**32*(s + 2)**32)", "64 states or more; at most 40 are supported"),
        ([["1/s"] * 401], "more than 400 entries"),
        ("(s**999)/(s + 1)", "in '(s**999)/(s + 1)' is beyond 32"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(law, message):
    with pytest.raises(InputError) as refused:
        analyse(lever(), law, HalfPlane(0))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_work_on_transfer_functions_is_bounded():
    """Forty states of digits that are all different are realised in seconds."""
    rng = np.random.default_rng(0)
    num, den = ([[[1.0, *rng.normal(size=n)] for _ in range(2)] for _ in range(2)] for n in (9, 10))
    began = process_time()
    assert Compensator.from_fields({"numerator": num, "denominator": den}).order == 40
    assert process_time() - began < 60


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"A": [[1]], "B": [[1]], "D": [[2]]}, "C is missing; give A, B, C and D"),
        ({"A": [[1]], "B": [[1]]}, "give A, B, C and D, or numerator and denominator"),
        ({"A": [[1, 2]], "B": [[1]], "C": [[1]]}, "A is 1 x 2"),
        (
            {"A": [[1]], "B": [[1], [2]], "C": [[1]]},
            "B is 2 x 1; beside the others it must be 1 x 1",
        ),
        ({"A": [[1]], "B": [[1]], "C": [[1]], "D": [[1, 2]]}, "D is 1 x 2"),
        ({"A": [[1, 2], [3]], "B": [[1]], "C": [[1]]}, "A is ragged"),
        ({"A": [[float("nan")]], "B": [[1]], "C": [[1]]}, "A[1][1] = nan must be a finite number"),
        ({"numerator": [1], "denominator": [0]}, "the denominator is zero"),
        (
            {"A": [[1]], "B": [[1]], "C": [[1]], "mesured": ["x"]},
            "'mesured'; did you mean 'measured'",
        ),
        ({"num": [1], "den": [1, 1], "grid": {}}, "a table is of A, B, C and D; realise each"),
        ({"numerator": "s + 1", "denominator": [1, 2]}, "= 's + 1' is not a number; write 0.5"),
        ({"numerator": [[[1], [2]]], "denominator": [[[1, 2]], [[1, 3]]]}, "matrices of one shape"),
        ({"zeros": [], "poles": ["-1+2j"], "gain": 1}, "-1+2j has no conjugate; give both"),
        ({"zeros": [], "poles": ["x"], "gain": 1}, "'x' is no number"),
        ({"A": [[1]], "B": [[1]], "C": [[1]], "sample_time": -1}, "its sample time is not said"),
        ({"A": [[1]], "B": [[1]], "C": [[1]], "E": [[2]]}, "a descriptor system"),
        (
            {"A": np.eye(41), "B": np.ones((41, 1)), "C": np.ones((1, 41))},
            "the law has 41 states; at most 40 are supported: reduce it",
        ),
    ],
)
def test_plain_data_are_read_or_refused(fields, message):
    with pytest.raises(InputError) as refused:
        Compensator.from_fields(fields)
    assert message in str(refused.value)


def test_times_must_agree():
    plant, seen = lever(), at_sample_time(lever(), "0.01")
    slow = Compensator.from_text("1/(z - 0.5)", ["angle"], "0.02")
    with pytest.raises(
        InputError, match=r"moves every 20 ms, and lever in continuous time; sample the plant by"
    ):
        slow.beside(plant)
    with pytest.raises(InputError, match="moves every 20 ms, and lever every 10 ms"):
        slow.beside(seen)
    with pytest.raises(InputError, match="in continuous time, and lever in steps of 10 ms"):
        Compensator.from_text("1/(s + 1)", ["angle"]).beside(seen)
    with pytest.raises(InputError, match="in discrete time without a sample time; give its dt"):
        beside(plant, control.tf([1], [1, 1], True))


def test_signals_are_found_by_count_or_by_name():
    plant = UncertainPlant.from_vertices([-np.eye(2)], [[[1], [1]]])
    outputs = (Output("sum", C=[1, 1]), Output("difference", C=[1, -1]))
    both = UncertainPlant(plant.vertices, outputs=outputs, name="p")
    law = Compensator([[-1]], [[1, 2]], [[1]])
    with pytest.raises(InputError, match="p has 2 states and 2 outputs: both have as many; name"):
        law.beside(both)
    one = UncertainPlant(plant.vertices, outputs=outputs[:1], name="p")
    assert [y.name for y in Compensator([[-1]], [[1]], [[1]]).signals(one)] == ["sum"]
    named = control.ss([[-1]], [[1]], [[1]], 0, inputs=["difference"], outputs=["u"])
    assert [y.name for y in Compensator.from_control(named).signals(both)] == ["difference"]
    with pytest.raises(InputError, match="no signal 'differ'; did you mean 'difference'"):
        beside(both, Compensator([[-1]], [[1]], [[1]], measured=["differ"]))
    with pytest.raises(
        InputError, match="2 signals measured by name, and the law takes 1; name one for each"
    ):
        beside(both, Compensator([[-1]], [[1]], [[1]], measured=["sum", "difference"]))
