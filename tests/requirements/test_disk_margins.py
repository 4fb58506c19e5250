"""Disk margins: against factors in their disks, published ones, and of every kind of plant."""

import json

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, sampled
from polefence.cli.main import main
from polefence.law.laws import FixedGain, PolynomialGain, given_law
from polefence.law.structure import Structure
from polefence.plant.outputs import states
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.plant.weights import shape_of
from polefence.requirements import scales
from polefence.requirements.disk_margin import DiskMargin, Unmodelled
from polefence.requirements.specification import claim_of
from polefence.requirements.text import load_specifications, parse_specification
from polefence.response.modes import Modes
from support.files import is_accepted
from support.specs import MASS_ON_SPRING

THIRD_ORDER = """
states = ["a", "b", "c"]
inputs = ["u"]
[matrices]
A = [[0, 1, 0], [0, 0, 1], [-10, -10, -10]]
B = [[0], [0], [1]]
"""
SATELLITE = """
states = ["a", "b"]
inputs = ["u1", "u2"]
[matrices]
A = [[0, 10], [-10, 0]]
B = [[1, 0], [0, 1]]
[outputs]
y1 = {C = [1, 10]}
y2 = {C = [-10, 1]}
"""
FUNCTIONS = MASS_ON_SPRING.replace("range = [80, 120]", "range = [0, 1]").replace(
    '"-k"', '"-90*cos(k)"'
)
GAIN = np.array([[-20.0, -4.0]])


def factor(d, sigma):
    return (1 + (1 - sigma) / 2 * d) / (1 - (1 + sigma) / 2 * d)


def proved(plant, law, *named, sigma=0.0):
    """The margin that is proved, and what samples show."""
    law = given_law(plant, law)
    asked = DiskMargin.least(named if len(named) > 1 else named[0], sigma=sigma)
    bound = best_bound(plant, law, asked)
    return bound.number, 1 / sampled(plant, law, asked, seeded(plant, 200)).worst


@pytest.mark.parametrize(("sigma", "margin"), [(0, 0.458093), (1, 0.402146), (-1, 0.486367)])
def test_published_margins_of_a_third_order_loop(sigma, margin):
    """Seiler, Packard and Gahinet 2020: 25 / (s^3 + 10 s^2 + 10 s + 10)."""
    found, _ = proved(loads(THIRD_ORDER), [[-25, 0, 0]], "u", sigma=sigma)
    assert margin * (1 - 2e-5) < found < margin * (1 + 2e-6)


def test_published_margins_of_a_satellite():
    """The same: 2 of each loop, 0.0998 of both inputs, 0.0499 of inputs and outputs at once."""
    plant = loads(SATELLITE)
    law = PolynomialGain(
        ((0,),), -np.eye(2)[None], tuple(map(plant.signal, ("y1", "y2"))), plant.parameters
    )
    assert proved(plant, law, "u1")[0] == pytest.approx(2, rel=1e-5)
    assert proved(plant, law, "u1", "u2")[0] == pytest.approx(0.09975, rel=1e-4)
    both, _ = proved(plant, law, "u1", "u2", "y1", "y2")
    assert 0.0498 < both < 0.04995


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sigma", [-1.0, 0.0, 0.7])
def test_just_above_the_margin_a_factor_makes_a_loop_unstable(seed, sigma):
    random = np.random.default_rng(seed)
    n = 4
    A = random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    B, K = random.normal(size=(n, 2)), 0.3 * random.normal(size=(2, n))
    while np.linalg.eigvals(A + B @ K).real.max() > -0.1:
        K /= 2
    plant = pf.UncertainPlant.from_vertices([A], [B])
    margin, _ = proved(plant, K, "u1", sigma=sigma)
    turns = np.exp(2j * np.pi * np.linspace(0, 1, 20_000))

    def worst(size):
        f = factor(size * turns, sigma)
        at = np.stack([f, np.ones_like(f)], axis=1)
        return np.linalg.eigvals(A + (B * at[:, None]) @ K).real.max()

    assert worst(0.999 * margin) < 0 < worst(1.001 * margin)


@pytest.mark.parametrize("named", [("u1", "u2"), ("u1", "x2"), ("u2", "x1", "x3")])
def test_several_loops_bear_factors_of_any_size_below_the_margin(named):
    random = np.random.default_rng(7)
    A = np.array([[0, 1.0, 0], [-4, -1, 1], [0, 0, -2]])
    B = np.array([[0, 0.1], [1, 0], [0, 1]])
    K = np.array([[-2.0, -1, 0.3], [0.5, -1, -3]])
    plant = pf.UncertainPlant.from_vertices([A], [B])
    margin, _ = proved(plant, K, *named)
    least = np.inf
    for _ in range(20_000):
        d = margin * np.exp(2j * np.pi * random.random(len(named)))
        at_u, at_x = np.ones(2, complex), np.ones(3, complex)
        for name, f in zip(named, factor(d, 0), strict=True):
            (at_u if name[0] == "u" else at_x)[int(name[1]) - 1] = f
        least = min(least, -np.linalg.eigvals(A + B * at_u @ K * at_x).real.max())
    assert least > 0
    # the same units of inputs and states change nothing
    scaled = pf.UncertainPlant.from_vertices([A], [B / 1000])
    assert proved(scaled, 1000 * K, *named)[0] == pytest.approx(margin, rel=2e-3)


def test_a_loop_of_one_input_and_one_signal_is_the_same_at_both_ends():
    plant = loads(THIRD_ORDER)
    at_input, _ = proved(plant, [[-25, 0, 0]], "u")
    assert proved(plant, [[-25, 0, 0]], "a")[0] == pytest.approx(at_input, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "sample_time", "delay", "loose"),
    [
        (MASS_ON_SPRING, None, 0, 1e-4),
        (MASS_ON_SPRING.replace("120]", "120]\nrate = [-5, 5]"), None, 0, 5e-3),
        (FUNCTIONS, None, 0, 2e-3),
        (MASS_ON_SPRING, 0.02, 0, 2e-3),
        (MASS_ON_SPRING, 0.02, "0.5", 2e-3),
        (FUNCTIONS, 0.02, 1, 2e-2),
        (MASS_ON_SPRING + "[dead_time.force]\ntime = 0.01\n", None, 0, 1.5),
    ],
)
@pytest.mark.parametrize("named", [("force",), ("force", "position")])
def test_margins_of_every_kind_of_plant(text, sample_time, delay, loose, named):
    plant = loads(text)
    if sample_time:
        plant = pf.at_sample_time(plant, sample_time, delay)
    K = np.zeros(plant.shape[::-1])
    K[0, :2] = GAIN
    margin, seen = proved(plant, K, *named)
    assert seen / (1 + loose) < margin < seen * (1 + 1e-9)


def test_a_margin_at_samples_is_that_of_the_digital_loop():
    """Against factors of the command between the computer and the hold, k = 80, one sample late."""
    plant = pf.at_sample_time(loads(MASS_ON_SPRING.replace("[80, 120]", "[80, 80.001]")), 0.02, 1)
    margin, _ = proved(plant, [[*GAIN[0], 0]], "force")
    F = expm(0.02 * np.array([[0, 1, 0], [-80, -2, 1], [0, 0, 0]]))
    turns = np.exp(2j * np.pi * np.linspace(0, 1, 5000))

    def worst(size):
        f = factor(size * turns, 0)
        loops = np.zeros((len(f), 3, 3), complex)
        loops[:, :2, :2], loops[:, :2, 2] = F[:2, :2], F[:2, 2]
        loops[:, 2, :2] = f[:, None] * GAIN
        return np.abs(np.linalg.eigvals(loops)).max()

    assert worst(0.999 * margin) < 1 < worst(1.002 * margin)


@pytest.mark.parametrize(("size", "time_invariant"), [(1, False), (2, False), (2, True)])
def test_slopes_are_those_of_central_differences(size, time_invariant, monkeypatch):
    random = np.random.default_rng(3)
    A, B = random.normal(size=(4, 4)), random.normal(size=(4, 2))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(4)
    plant = pf.UncertainPlant.from_vertices([A], [B])
    names = ["u1", "u2"][:size] if size > 1 else "u1"
    own = DiskMargin(names, sigma=-0.5, time_invariant=time_invariant)
    channel = own.channel(plant, np.ones((1, 1)))

    def found(K):
        return own.slopes(channel.closed(K[None], Modes(channel.A + channel.B @ K)))

    K = random.normal(size=(2, 4))
    while np.linalg.eigvals(A + B @ K).real.max() > -0.3:
        K /= 1.5
    first = found(K)
    loops = channel.closed(K[None], Modes(channel.A + channel.B @ K))
    best = scales.scaled(loops, 0, 1.0, leads=time_invariant)
    monkeypatch.setattr(scales, "scaled", lambda *_, **__: best)  # best is best to 1e-4
    top = int(first.values.argmax())
    slopes = channel.slopes(first)[top]
    for _ in range(4):
        step = random.normal(size=K.shape)
        ahead, back = (found(K + s * 1e-4 * step).values.max() for s in (1, -1))
        along = (slopes * step).sum()
        assert (ahead - back) / 2e-4 == pytest.approx(along, abs=2e-3 * np.abs(slopes).max())


def test_a_law_is_tuned_for_a_margin_and_its_file_says_so(tmp_path, capsys):
    spec = tmp_path / "spring.toml"
    asked = """
[road]
class = "C"
speed = 20
[[specification]]
kind = "rms"
signal = "position"
density = 1
minimise = true
[[specification]]
kind = "rms"
signal = "force"
density = 1
at_most = 3
"""
    margin = '[[specification]]\nkind = "disk margin"\nloops = ["force"]\nat_least = 1.9\n'
    spec.write_text(MASS_ON_SPRING + asked + margin)
    summary = tmp_path / "said.json"
    command = ["optimise", str(spec), "--json", str(summary), "-o", str(tmp_path / "out")]
    assert main(command) == 0
    row = json.loads(summary.read_text())["bounds"][2]
    assert (row["kind"], row["signal"], row["limit"]) == ("disk margin", "force", 1.9)
    assert row["proved"] == pytest.approx(1.9, rel=1e-12)
    assert row["worst sampled"] >= 1.9
    assert main(["check", str(tmp_path / "out"), "--spec", str(spec)]) == 0
    assert "disk margin of the loop at 'force' = u1 >= 1.90000, on" in capsys.readouterr().out
    free = tmp_path / "free.toml"
    free.write_text(MASS_ON_SPRING + asked)
    limit = ["--limit", "rms of force <= 3", "--limit", "disk margin of force >= 1.9"]
    assert main(["optimise", str(free), *limit[:2], "-o", str(tmp_path / "less")]) == 0
    design = pf.Design.load(tmp_path / "less")
    assert proved(design.plant, design.law, "force")[0] < 1.9  # it does bind


def test_a_margin_is_made_as_large_as_it_can_be(tmp_path, capsys):
    spec = tmp_path / "satellite.toml"
    spec.write_text(
        SATELLITE
        + '[law]\nmeasured = ["y1", "y2"]\nschedule = []\n[[specification]]\nkind = "disk margin"\n'
        + 'loops = ["u1", "y2"]\nmaximise = true\n'
        + '[[specification]]\nkind = "gain norm"\nat_most = 20\n'
    )
    assert main(["optimise", str(spec), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    found = float(said.partition("disk margin of [u1, y2]")[2].split()[0])
    assert found > 1.99  # of two loops that share nothing, 2
    assert "maximised" in said


def files(tmp_path):
    plant = loads(MASS_ON_SPRING)
    law = FixedGain(GAIN)
    asked = DiskMargin.least(["force", "position"], sigma=0.5)
    analysis = pf.analyse(plant, law, pf.parse_region("half_plane(0)"), limits=[asked])
    analysis.design.save(tmp_path)
    return json.loads((tmp_path / "design.json").read_text())


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda x: x * 0.999),
        ("skew", lambda _: "3/2"),
        ("weights", lambda x: [x[0], "1/3"]),
        ("inputs", lambda _: [2]),
        ("inputs", lambda _: []),
        ("measured", lambda _: [2]),
        ("measured", lambda _: [1, 1]),
        ("measured", lambda _: [3]),
        ("weights", lambda x: x[:1]),
        ("weights", lambda x: [x[0], 0]),
    ],
)
def test_one_fault_in_a_file_and_it_is_not_proved(tmp_path, key, change):
    document = files(tmp_path)
    assert is_accepted(document)
    claim = next(own for own in document["claims"] if own["kind"] == "disk margin")
    claim[key] = change(claim[key])
    assert not is_accepted(document)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('loops = ["force"]', "give at_least = MARGIN or maximise = true"),
        ("at_least = 1", r'loops is missing; write loops = \["NAME"\]'),
        ('signal = "force"\nat_least = 1', "signal is for other kinds; a disk margin has loops"),
        ('loops = ["force"]\nat_most = 1', "at_most is for other kinds; .* has at_least"),
        ('loops = ["force"]\nminimise = true', "minimise is for other kinds; .* has maximise"),
        ('loops = ["force"]\nat_least = 0', "at_least = 0 must be a positive number"),
        ('loops = ["force"]\nat_least = "a"', "must be a finite number"),
        ("loops = []\nat_least = 1", "an empty list"),
        ('loops = ["force"]\nat_least = 1\nsigma = 1e9', "must be from -100 to 100"),
        ('loops = ["force"]\nat_least = 1\ndisturbances = ["push"]', "unknown key disturbances"),
    ],
)
def test_bad_margins_are_refused_in_a_line(tmp_path, table, said):
    path = tmp_path / "bad.toml"
    path.write_text(MASS_ON_SPRING + f'[[specification]]\nkind = "disk margin"\n{table}\n')
    with pytest.raises(SpecError, match=said) as error:
        load_specifications(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("sigma", "most"), [(0, 2), (1, 1), (3, 0.5)])
def test_a_margin_that_no_loop_has_is_refused_in_a_line(sigma, most):
    plant = loads(MASS_ON_SPRING)
    for share, refused in [(1.001, True), (0.999, False)]:
        asked = DiskMargin.least("force", at_least=share * most, sigma=sigma)
        if refused:
            with pytest.raises(InputError, match=f"no loop has more than {most}, for at high"):
                asked.require_fit(plant)
        else:
            asked.require_fit(plant)
    # nor is one proved of the loop with the largest margin, that without a law
    bound = best_bound(plant, given_law(plant, 0 * GAIN), DiskMargin("force", sigma=sigma))
    assert most * 0.999 < bound.number <= most


def test_lines_of_margins_read_back():
    for text in ("disk margin of force >= 1.9", "disk margin of [force, a b] >= 0.3 with sigma 1"):
        one = parse_specification(text)
        assert parse_specification(pf.requirements.specification.limit_text(one)) == one
    with pytest.raises(InputError, match=">= NUMBER"):
        parse_specification("disk margin of force <= 1")
    with pytest.raises(InputError, match="<= NUMBER"):
        parse_specification("rms of force >= 1")


def test_a_loop_that_is_none_is_refused():
    plant = loads(MASS_ON_SPRING)
    with pytest.raises(InputError, match="no loop at 'forse'.*did you mean 'force'"):
        best_bound(plant, given_law(plant, GAIN), DiskMargin("forse"))
    scheduled = pf.place(plant, pf.HalfPlane(1), "scheduled").law
    with pytest.raises(InputError, match="nor among what the law measures"):
        best_bound(plant, scheduled, DiskMargin("position"))
    assert states(plant)[0].name == "position"


ACCELEROMETER = (
    MASS_ON_SPRING
    + """
[outputs]
acceleration = {C = ["-k", -2], D = [1], F = [0.3]}
"""
)


@pytest.mark.parametrize("named", [("force",), ("acceleration",), ("force", "acceleration")])
def test_a_factor_at_an_input_passes_into_what_is_measured_of_it(named):
    """Code takes off what it sent: f u - u of an actuator that is off is left in the signal."""
    plant = loads(ACCELEROMETER.replace("[80, 120]", "[80, 80.0001]"))
    structure = Structure(measured=("acceleration without inputs", "position"), schedule=())
    law = structure.law(plant, np.array([[[-0.5, -10.0]]]))
    margin, _ = proved(plant, law, *named)
    A, B = np.array([[0, 1.0], [-80, -2]]), np.array([0, 1.0])

    def worst(size):
        largest = -np.inf
        for angles in np.random.default_rng(1).random((6000, 2)):
            f = factor(size * np.exp(2j * np.pi * angles), 0)
            at_u, at_y = (f[0] if name in named else 1 for name in ("force", "acceleration"))
            at_y = f[1] if len(named) == 2 else at_y
            # u = -0.5 (at_y (c x + at_u u) - u) - 10 x1
            gain = np.array([-0.5 * at_y * -80 - 10, -0.5 * at_y * -2]) / (
                1 + 0.5 * at_y * at_u - 0.5
            )
            largest = max(largest, np.linalg.eigvals(A + at_u * np.outer(B, gain)).real.max())
        return largest

    assert worst(0.999 * margin) < 0 < worst(1.01 * margin)


# -- dynamics that no model has ------------------------------------------------------------------

WEIGHT = "(3*s + 18.5)/(s + 46.3)"


def borne(plant, law, *named, weight=WEIGHT):
    bound = best_bound(plant, given_law(plant, law), Unmodelled(named, weight=weight))
    return bound.number


@pytest.mark.parametrize(
    "weight", [WEIGHT, "1/(s + 1)", "makeweight(0.4, 15, 3)", "s/(s**2 + s + 9)"]
)
def test_just_above_it_a_number_in_the_place_of_dynamics_makes_a_loop_unstable(weight):
    plant, K = loads(THIRD_ORDER), np.array([[-25.0, 0, 0]])
    A, B = plant.A[0], plant.B[0]
    shape = shape_of(weight, "u")
    a, b, c = (np.array(M, dtype=float) for M in (shape.a, shape.b, shape.c))
    most, turns = borne(plant, K, "u", weight=weight), np.exp(2j * np.pi * np.linspace(0, 1, 9001))

    def worst(size):
        d = size * turns[:, None, None]
        straight = A + B @ K * (1 + d * float(shape.d))
        rows = np.concatenate([straight, d * (B @ c)], axis=2)
        below = np.broadcast_to(np.hstack([b @ K, a]), (len(d), len(a), rows.shape[2]))
        return np.linalg.eigvals(np.concatenate([rows, below], axis=1)).real.max()

    assert worst(0.999 * most) < 0 < worst(1.001 * most)


def test_of_two_inputs_units_change_nothing_and_each_alone_bears_more():
    A = np.array([[0, 1.0, 0], [-4, -1, 1], [0, 0, -2]])
    B = np.array([[0, 0.1], [1, 0], [0, 1]])
    K = np.array([[-2.0, -1, 0.3], [0.5, -1, -3]])
    plant = pf.UncertainPlant.from_vertices([A], [B])
    both = borne(plant, K, "u1", "u2")
    scaled = pf.UncertainPlant.from_vertices([A], [B * [1000, 0.01]])
    in_units = K / np.array([[1000], [0.01]])
    assert borne(scaled, in_units, "u1", "u2") == pytest.approx(both, rel=2e-3)
    assert both <= min(borne(plant, K, "u1"), borne(plant, K, "u2")) * (1 + 1e-5)


@pytest.mark.parametrize(
    "text", [MASS_ON_SPRING, MASS_ON_SPRING.replace("120]", "120]\nrate = [-5, 5]"), FUNCTIONS]
)
def test_unmodelled_dynamics_of_families(text):
    plant = loads(text)
    law = given_law(plant, GAIN)
    asked = Unmodelled("force", weight=WEIGHT)
    seen = 1 / sampled(plant, law, asked, seeded(plant, 200)).worst
    assert 0.99 * seen < borne(plant, GAIN, "force") < seen * (1 + 1e-9)


def test_a_law_is_tuned_for_unmodelled_dynamics(tmp_path, capsys):
    spec, other = tmp_path / "spring.toml", tmp_path / "other.toml"
    spec.write_text(
        MASS_ON_SPRING
        + '[[specification]]\nkind = "rms"\nsignal = "position"\ndensity = 1\nminimise = true\n'
        + '[[specification]]\nkind = "rms"\nsignal = "force"\ndensity = 1\nat_most = 3\n'
        + '[[specification]]\nkind = "unmodelled dynamics"\nloops = ["force"]\n'
        + f'weight = "{WEIGHT}"\nat_least = 1.3\n'
    )
    other.write_text(spec.read_text().replace("18.5", "18.6"))
    assert main(["optimise", str(spec), "-o", str(tmp_path / "out")]) == 0
    assert main(["check", str(tmp_path / "out"), "--spec", str(spec)]) == 0
    said = capsys.readouterr().out
    assert "unmodelled dynamics of the loop at 'force' = u1 in multiples of" in said
    assert main(["check", str(tmp_path / "out"), "--spec", str(other)]) == 1
    assert "is not what its name says" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "design.json").read_text())
    claim = next(own for own in document["claims"] if own["kind"] == "unmodelled dynamics")
    for key, value in [("d", 6), ("c", [[100]]), ("a", [[1]])]:
        kept = dict(claim["filters"][0])
        claim["filters"][0][key] = value
        assert not is_accepted(document)
        claim["filters"][0] = kept
    assert is_accepted(document)
    for key, value in [("filters", []), ("skew", 0), ("filters", [{}])]:
        kept = claim[key]
        claim[key] = value
        assert not is_accepted(document)
        claim[key] = kept
    del claim["filters"]
    assert not is_accepted(document)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("", "weight is missing"),
        ('weight = "s"', "the numerator has degree 1, the denominator 0"),
        ('weight = "1/(s - 1)"', "the pole 1 .*is not stable"),
        ('weight = "0.5"', "is constant; ask for a disk margin with sigma = -1"),
        ('weight = "__import__(1)"', "unmodelled dynamics"),
        ('weight = "1/(s + 1)"\nsigma = 0', "unknown key sigma"),
    ],
)
def test_bad_weights_are_refused_in_a_line(tmp_path, keys, said):
    path = tmp_path / "bad.toml"
    table = f'kind = "unmodelled dynamics"\nloops = ["force"]\nat_least = 1\n{keys}\n'
    path.write_text(MASS_ON_SPRING + f"[[specification]]\n{table}")
    with pytest.raises(SpecError, match=said) as error:
        load_specifications(path)
    assert "\n" not in str(error.value)


def test_unmodelled_dynamics_are_of_inputs_in_continuous_time():
    plant, asked = loads(MASS_ON_SPRING), Unmodelled("force", weight=WEIGHT)
    with pytest.raises(InputError, match="'position' is no input; name a path from it"):
        Unmodelled("position", weight=WEIGHT).require_fit(plant)
    with pytest.raises(InputError, match="write the weight in z"):
        asked.require_fit(pf.at_sample_time(plant, 0.01))
    limited = Unmodelled("force", 1.0, weight=WEIGHT)
    with pytest.raises(InputError, match="so that a law is tuned"):
        pf.optimise(plant, pf.Rms("position", density=1), [limited], method="quadratic")
    line = pf.requirements.specification.limit_text(Unmodelled("force", 0.5, weight=WEIGHT))
    assert parse_specification(line) == Unmodelled("force", 0.5, weight=WEIGHT)


def test_a_loop_that_a_factor_would_not_change_so_is_refused():
    """What a law remembers of its demands no actuator changes; a PID integrates what it reads."""
    plant = pf.at_sample_time(loads(MASS_ON_SPRING), 0.02, 1)
    asked = DiskMargin.least("force", at_least=1)
    assert best_bound(plant, given_law(plant, [[-20, -4, 0]]), asked).number > 1
    with pytest.raises(InputError, match="feeds back its own demands that are on their way"):
        best_bound(plant, given_law(plant, [[-20, -4, 0.1]]), asked)
    structure = Structure(kind="pid", measured=("position",), derivative_bandwidth=20)
    larger, wide = structure.extended(loads(MASS_ON_SPRING))
    gains = np.zeros((len(wide.powers(larger)), 1, len(wide.outputs(larger))))
    with pytest.raises(InputError, match="a PID reads 'position' by its integral"):
        DiskMargin("position").posed(larger, wide.law(larger, gains))


def test_a_law_at_samples_does_not_read_its_demands_on_their_way(tmp_path):
    plant = pf.at_sample_time(loads(MASS_ON_SPRING), 0.02, 1)
    asked = DiskMargin.least("force", at_least=1.2)
    done = pf.optimise(plant, pf.Rms("position", density=1), [asked, pf.Rms("force", 3, density=1)])
    assert np.all(done.law.gain(np.eye(2))[..., 2] == 0)
    assert done.bounds[1].number >= 1.2


@pytest.mark.parametrize("named", [("force",), ("force", "position")])
def test_a_claim_made_anew_is_the_one_that_is_proved_whatever_its_weights(named):
    """Studies and trade-offs compare files so."""
    plant = loads(MASS_ON_SPRING)
    law = given_law(plant, GAIN)
    every = [DiskMargin(named, sigma=0.5)]
    every += [Unmodelled.least(named, WEIGHT, 0.5)] if len(named) == 1 else []
    for asked in every:
        claim = best_bound(plant, law, asked).claim
        evidence = claim.subject.evidence
        again = claim_of(plant, law.exact, claim.subject.on, asked, evidence, claim.level)
        assert again.bare == claim.bare
        other = claim_of(plant, law.exact, claim.subject.on, asked, evidence, claim.level * 2)
        assert other.bare != claim.bare


@pytest.mark.parametrize(
    "limit",
    [
        DiskMargin.least(["force", "position"], at_least=0.5),
        Unmodelled.least("force", WEIGHT, 0.5),
    ],
)
def test_a_trade_off_keeps_what_no_lmi_has_and_goes_on(limit, tmp_path):
    plant, path = loads(MASS_ON_SPRING), tmp_path / "rows.json"
    asked = pf.Rms("position", density=1), pf.Rms("force", density=1), [3.0, 4.0], [limit]
    front = pf.tradeoff(plant, *asked, path=path)
    for row in front.rows:
        assert row["answer"] == "proved"
        assert row["bounds"][1]["at_most"] == limit.limit <= row["bounds"][1]["proved"]
    seconds = [row["seconds"] for row in front.rows]
    again = pf.tradeoff(plant, *asked, path=path, resume=True)
    assert [row["seconds"] for row in again.rows] == seconds  # none is worked out again
    for swept in (asked[:1] + (limit,), (limit, asked[1])):
        with pytest.raises(InputError, match="give it a limit, and name signals"):
            pf.tradeoff(plant, *swept, [0.5, 0.6])
    with pytest.raises(InputError, match="leave out the method"):
        pf.tradeoff(plant, *asked, methods=["quadratic"])
