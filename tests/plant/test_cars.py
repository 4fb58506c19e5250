"""Cars on wheels, against their energies: another way to the same equations."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from polefence import Parameter, PlantError, SpecError
from polefence.examples import family, spec_text
from polefence.plant.cars import Bar, Body, Car, Wheel, car_family
from polefence.plant.spec import loads
from polefence.vehicle import quarter_car

SIZES = {"mass": 960.0, "pitch": 1500.0, "roll": 210.0}
PLACES = {
    "one": {"only": (0, 0)},
    "pitch": {"front": (1.1, 0), "rear": (-1.4, 0)},
    "roll": {"left": (0, 0.7), "right": (0, -0.65)},
    "three": {"front": (1.1, 0.05), "left": (-1.4, 0.7), "right": (-1.3, -0.65)},
    "four": {"fl": (1.1, 0.7), "fr": (1.2, -0.7), "rl": (-1.4, 0.65), "rr": (-1.4, -0.68)},
}
LOAD = (-0.9, 0.3)


def described(places, source):
    """A body, its load's place and its wheels, of random sizes."""
    turns = [("pitch", 0), ("roll", 1)]
    turns = [k for k, axis in turns if any(place[axis] for place in places.values())]
    body = {"mass": SIZES["mass"]} | {key: SIZES[key] for key in turns}
    x, y = (at if key in turns else 0 for at, key in zip(LOAD, ("pitch", "roll"), strict=True))
    wheels = {
        name: dict(zip(("mass", "spring", "damper", "tyre"), own, strict=True))
        for name, own in zip(places, source.uniform([30, 1e4, 500, 1e5], [60, 4e4, 3e3, 3e5],
                                                    (len(places), 4)), strict=True)
    }  # fmt: skip
    return body, (x, y), wheels


def built(places, body, load, wheels):
    """The family over the felt mass and the age."""

    def make(felt, age):
        turning = []
        for name, given in wheels.items():
            mass, k, c, kt = map(Fraction, given.values())
            place = map(str, places[name])
            turning.append(Wheel(name, mass, k * (1 + age), c * (1 + age), kt, *place))
        own = {key: Fraction(value) for key, value in body.items()}
        return Car(Body(**own, load=load, felt=felt), turning, {"seat": (0.2, 0.3)})

    empty = make(10**6, 0).body.empty
    parameters = [
        Parameter("felt", empty, empty + 300, "kg", "1/felt"),
        Parameter("age", Fraction(-1, 5), Fraction(1, 5)),
    ]
    return car_family(make, parameters, name="car"), float(empty)


def hessian(energy, n):
    """The matrix of a quadratic form, by its values."""
    eye = np.eye(n)
    alone = [energy(e) for e in eye]
    return np.array([[energy(a + b) - alone[i] - alone[j] for j, b in enumerate(eye)]
                     for i, a in enumerate(eye)])  # fmt: skip


def by_energy(places, body, load, wheels, pounds, age):
    """M, C, K and how roads push, of the absolute heave, pitch, roll and heights of the wheels."""
    turns = [key for key in ("pitch", "roll") if key in body]
    n, k = 1 + len(turns) + len(places), 1 + len(turns)

    def height(q, at):
        z = q[0]
        for number, key in enumerate(turns):
            z = z - at[0] * q[1 + number] if key == "pitch" else z + at[1] * q[1 + number]
        return z

    def kinetic(v):
        total = body["mass"] * v[0] ** 2 + pounds * height(v, load) ** 2
        total += sum(body[key] * v[1 + number] ** 2 for number, key in enumerate(turns))
        return (total + sum(w["mass"] * v[k + i] ** 2 for i, w in enumerate(wheels.values()))) / 2

    def between(key, share):
        def energy(q):
            pairs = enumerate(wheels.items())
            return sum(share * w[key] * (q[k + i] - height(q, places[name])) ** 2 / 2
                       for i, (name, w) in pairs)  # fmt: skip

        return energy

    def tyres(q):
        return sum(w["tyre"] * q[k + i] ** 2 / 2 for i, w in enumerate(wheels.values()))

    M, C = hessian(kinetic, n), hessian(between("damper", 1 + age), n)
    K = hessian(between("spring", 1 + age), n) + hessian(tyres, n)
    G = np.array([[height(e, places[name]) for e in np.eye(k)] for name in places])
    return M, C, K, G


@pytest.mark.parametrize("kind", PLACES)
@pytest.mark.parametrize("seed", range(3))
def test_it_moves_as_its_energies_say(kind, seed):
    source = np.random.default_rng(seed)
    places = PLACES[kind]
    body, load, wheels = described(places, source)
    plant, empty = built(places, body, load, wheels)
    pounds, age = source.uniform(0, 300), source.uniform(-0.2, 0.2)
    felt = empty + pounds
    assert plant.parameters[0].high == pytest.approx(empty + 300)
    low, high = 1 / (empty + 300), 1 / empty
    sides = ((1 / felt - low) / (high - low), (age + 0.2) / 0.4)
    weights = [
        (sides[0] if a == 0 else 1 - sides[0]) * (sides[1] if b else 1 - sides[1])
        for a, b in product((0, 1), repeat=2)
    ]
    A = np.einsum("v,vij->ij", weights, plant.A)
    B = np.einsum("v,vij->ij", weights, plant.B)
    E = np.array(plant.vertices[0].exact_E, dtype=float)
    M, C, K, G = by_energy(places, body, load, wheels, pounds, age)
    m, k = G.shape
    # a plane road: its heave, pitch and roll, and how fast they change
    road, rate, u = source.normal(size=k), source.normal(size=k), source.normal(size=m)
    q, v = source.normal(size=(2, k + m))
    push = np.concatenate([G.T, -np.eye(m)]) @ u
    tyre = np.array([w["tyre"] for w in wheels.values()])
    push[k:] += tyre * (G @ road)
    theirs = np.linalg.solve(M, push - C @ v - K @ q)
    x = np.concatenate([q[:k] - road, G @ road - q[k:], v])
    ours = A @ x + B @ u + E @ (G @ rate)
    assert ours[k + m :] == pytest.approx(theirs, rel=1e-9, abs=1e-9 * np.abs(theirs).max())
    assert ours[:k] == pytest.approx(v[:k] - rate, abs=1e-12)
    assert ours[k : k + m] == pytest.approx(G @ rate - v[k:], abs=1e-12)
    values = {}
    for own in plant.every_output:
        rows = []
        for key in "CD":
            each = np.array(getattr(own, key), dtype=float)
            each = np.zeros(((4, len(x)), (4, m))[key == "D"]) if not each.size else each
            rows.append(np.einsum("v,vj->j", weights, np.broadcast_to(each, (4, each.shape[-1]))))
        values[own.name] = rows[0] @ x + rows[1] @ u
    seat = theirs[0] + sum(
        theirs[1 + i] * {"pitch": -0.2, "roll": 0.3}[key]
        for i, key in enumerate(key for key in ("pitch", "roll") if key in body)
    )
    assert values["seat acceleration"] == pytest.approx(seat, rel=1e-9)
    assert values["heave acceleration"] == pytest.approx(theirs[0], rel=1e-9)
    for i, name in enumerate(places):
        assert values[f"{name} suspension deflection"] == pytest.approx(q[k + i] - G[i] @ q[:k])
        force = tyre[i] * (G[i] @ road - q[k + i])
        assert values[f"{name} tyre force variation"] == pytest.approx(force)


def test_on_one_wheel_it_is_the_quarter_car():
    car = Car(Body(289), [Wheel("only", 28, 10000, 850, 155900)])
    A, B, E, _ = car.matrices
    theirs = [np.array(X, float) for X in quarter_car(289, 28, 10000, 155900, 850)]
    T = np.array([[-1, -1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])  # their states
    ours = [np.array(X, float) for X in (A, B, E)]
    assert T @ ours[0] @ np.linalg.inv(T) == pytest.approx(theirs[0][:4, :4])
    assert T @ ours[1] == pytest.approx(theirs[1][:4])
    assert T @ ours[2] == pytest.approx(theirs[2][:4])


def test_a_road_that_twists_moves_nothing():
    body, load, wheels = described(PLACES["four"], np.random.default_rng(1))
    plant, _ = built(PLACES["four"], body, load, wheels)
    E = np.array(plant.vertices[0].exact_E, dtype=float)
    assert np.linalg.matrix_rank(E) == 3
    G = np.array([[1, -x, y] for x, y in PLACES["four"].values()])
    twist = np.linalg.svd(G.T)[2][3]
    assert np.abs(E @ twist).max() < 1e-12


# --- bars, braking and cornering ------------------------------------------------------------------

SIDES = ("front left", "front right", "rear left", "rear right")


def at_rest(plant, disturbance):
    """Each tyre's force under a disturbance of one, at each vertex."""
    number = [own.split(" [")[0] for own in plant.disturbances].index(disturbance)
    known = {own.name: own for own in plant.every_output}
    found = []
    for A, vertex in zip(plant.A, plant.vertices, strict=True):
        x = np.linalg.solve(A, -np.array(vertex.exact_E, float)[:, number])
        rows = (known[f"{side} tyre force variation"].C[0] for side in SIDES)
        found.append([float(np.array(row, float) @ x) for row in rows])
    return np.array(found)


def with_lines(text, *lines):
    return text.replace("[car.seat]", "\n".join([*lines, "[car.seat]"]))


def full_car(*lines):
    raised = spec_text("full-car").replace("roll_inertia", "height = 0.55\nroll_inertia")
    return loads(with_lines(raised, *lines))


def test_braking_and_cornering_move_the_load_that_statics_say():
    plant = full_car()
    moment = 965.7 * 0.55
    front = at_rest(plant, "braking")
    assert front[:, :2].sum(axis=1) == pytest.approx(moment / (1.156 + 1.423))
    assert front.sum(axis=1) == pytest.approx(0, abs=1e-9)
    tyres = at_rest(plant, "cornering")  # a turn to the left: the right side is outside
    leverage = tyres @ [-0.6935, 0.6935, -0.682, 0.682]
    assert leverage == pytest.approx(moment)
    assert tyres[:, 1].min() > 0 > tyres[:, 0].max()


def test_the_axle_with_the_bar_carries_more_of_a_turn():
    bar = ("[car.bar.front]", 'between = ["front left", "front right"]', 'stiffness = "kf / 2"')
    bare, barred = (at_rest(full_car(*lines), "cornering") for lines in ((), bar))
    assert np.all(barred[:, 1] > 1.2 * bare[:, 1])
    assert barred @ [-0.6935, 0.6935, -0.682, 0.682] == pytest.approx(965.7 * 0.55)
    # neither heave nor pitch feels it
    for first, second in zip(full_car().A, full_car(*bar).A, strict=True):
        assert (second - first)[[7, 8]] == pytest.approx(0, abs=1e-12)


def test_a_bar_is_a_spring_between_deflections():
    wheels = [Wheel(name, 30, 2e4, 1e3, 2e5, y=y) for name, y in (("left", "0.7"), ("right", -0.6))]
    cars = [
        Car(Body(500, roll=200), wheels, bars=bars)
        for bars in ((), [Bar("only", ("left", "right"), 7000)])
    ]
    first, second = (np.array(car.matrices[0], float) for car in cars)
    M = np.diag([500, 200, 30, 30.0])
    apart = np.array([0, -0.7 - 0.6, -1, 1.0])  # left deflection less the right, by h and t
    push = np.array([0, 0.7 + 0.6, -1, 1.0])
    extra = 7000 * np.outer(np.linalg.solve(M, push), apart)
    assert (second - first)[4:, :4] == pytest.approx(extra)
    assert (second - first)[:, 4:] == pytest.approx(0)


def test_accelerations_have_what_manoeuvres_add():
    known = {own.name: own for own in full_car().every_output}
    g = np.array([1, 0.9, 0])  # of the load
    empty = np.diag([965.7, 1566, 207.3])
    felt = [644.1, 644.1, 844, 844]
    for row, own in zip(known["driver acceleration"].exact(full_car())[2], felt, strict=True):
        M = empty + (own - 1 / (g @ np.linalg.inv(empty) @ g)) * np.outer(g, g)
        pushed = 965.7 * 0.55 * np.linalg.solve(M, np.eye(3)[:, 1:])
        assert np.array(row, float)[4:] == pytest.approx([1, -0.1, 0.35] @ pushed)
        assert not any(row[:4])


MANOEUVRE_FAULTS = [
    ('between = ["front left", "front"]\nstiffness = 1', "no wheel 'front'; did you mean"),
    ('between = ["front left", "front left"]\nstiffness = 1', "must name two wheels"),
    ('between = ["front left", "rear left"]\nstiffness = -1', "stiffness = -1 is negative"),
    ('between = ["front left", "rear left"]', "stiffness is missing"),
    ('between = "front left"\nstiffness = 1', "must be a list of strings"),
    ('between = ["front left", "rear left"]\nrate = 1', "unknown key 'rate'"),
]


@pytest.mark.parametrize(("lines", "words"), MANOEUVRE_FAULTS)
def test_bars_that_are_none_are_refused(lines, words):
    with pytest.raises((SpecError, PlantError), match=words):
        full_car("[car.bar.front]", lines)


def test_height_needs_something_that_turns():
    with pytest.raises(PlantError, match="height without inertia"):
        Body(300, height=0.5)


# --- examples and specs --------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "n", "m"), [("half-car", 8, 2), ("full-car", 14, 4)])
def test_the_examples_are_stable_cars(name, n, m):
    plant = family(name)
    assert plant.shape == (n, m)
    assert len(plant.vertices) == 4
    assert plant.disturbance_count == m
    for A in plant.A:
        poles = np.linalg.eigvals(A)
        assert poles.real.max() < -1
        assert 5 < np.abs(poles).min() < 20 < 60 < np.abs(poles).max() < 90  # bodies and wheels


def test_the_full_car_is_symmetric():
    """What heave and pitch do has nothing to do with roll."""
    plant = family("full-car")
    left = [0, 1, 7, 8]
    for A in plant.A:
        assert np.abs(A[np.ix_([7, 8], [2, 9])]).max() == 0
        assert np.abs(A[np.ix_([9], left)]).max() == 0


FAULTS = [
    ("roll_inertia = 207.3", "roll_inertia = -207.3", "body: roll = -207.3 is negative"),
    ("mass = 965.7", "mass = 0", "body: mass = 0 is zero"),
    ("x = -1.423", "x = 1.423", "centre of mass between them in x"),
    ('damper = "cf*(1 + age)"', "damper = -1", "front left: damper = -1 is negative"),
    ('spring = "kf*(1 + age)"', 'spring = "kf*(age - 1)"', "spring = -26889.5 is negative"),
    ('spring = "kf*(1 + age)"', 'spring = "kg"', "unknown name 'kg'"),
    ("range = [644.1, 844]", "range = [500, 844]", "felt = 500 kg is less than the 644.0"),
    ('felt = "felt"', "", "the effective mass there"),
    ("load = [-0.9, 0]", "load = [-0.9]", "car.body.load must be two numbers"),
    ("driver = [0.1, 0.35]", 'driver = "left"', "car.seat.driver must be two numbers"),
    ("pitch_inertia", "yaw_inertia", "unknown key 'yaw_inertia'"),
    ("tyre = 158240", "", "front left': tyre is missing"),
    ("roll_inertia = 207.3", "", "the body no inertia in roll"),
    ("[car.seat]", "[matrices]\n[car.seat]", "matrices and car exclude each other"),
    ("[car.seat]", 'states = ["x"]\n[car.seat]', "car.body: unknown key|unknown key"),
    ("y = 0.6935", 'y = "age"', "front left: y"),
    ("[road]", '[outputs]\n"driver acceleration [m/s2]" = {C = [1]}\n[road]', "choose another"),
]


@pytest.mark.parametrize(("old", "new", "words"), FAULTS)
def test_cars_that_are_none_are_refused(old, new, words):
    text = spec_text("full-car")
    assert old in text
    with pytest.raises((SpecError, PlantError), match=words) as caught:
        loads(text.replace(old, new), "car.toml")
    message = str(caught.value)
    assert message.startswith("car.toml: ")
    assert "\n" not in message


def test_wheels_in_a_line_or_too_few_are_refused():
    body = Body(900, 1500, 200)
    wheel = Wheel("a", 30, 2e4, 1e3, 2e5)
    names = "abc"
    for places, words in (
        ([(1, 0.5), (-1, -0.5)], "2 wheels; heave and pitch and roll need 3"),
        ([(1, 0.5), (-1, -0.5), (0, 0)], "in a line"),
    ):
        wheels = [Wheel(n, 30, 2e4, 1e3, 2e5, *p) for n, p in zip(names, places, strict=False)]
        with pytest.raises(PlantError, match=words):
            Car(body, wheels)
    with pytest.raises(PlantError, match="two wheels have one name"):
        Car(Body(900, 1500), [Wheel("a", 30, 1, 1, 1, 1), Wheel("a", 30, 1, 1, 1, -1)])
    with pytest.raises(PlantError, match="1 wheel; "):
        Car(Body(900, 1500), [wheel])
    with pytest.raises(PlantError, match="must be a finite number"):
        Body(float("nan"))


def test_own_outputs_may_be_added():
    text = spec_text("half-car")
    row = "[0, 0, '158240', '158240', 0, 0, 0, 0]"
    more = text.replace("[road]", f'[outputs]\n"both tyres [N]" = {{C = {row}}}\n[road]')
    known = {own.name: own for own in loads(more).every_output}
    front, rear = (known[f"{side} tyre force variation"].C for side in ("front", "rear"))
    total = np.array(front, float) + np.array(rear, float)
    assert np.array(known["both tyres"].C, float) == pytest.approx(total)


def test_parameters_are_bounded_before_any_car_is_built():
    many = [Parameter(f"p{k}", 1, 2) for k in range(40)]
    with pytest.raises(PlantError, match="40 parameters; at most 8"):
        car_family(lambda **values: pytest.fail("built"), many)


def test_one_parameter_is_enough():
    car = car_family(
        lambda m: Car(Body(m), [Wheel("only", 30, 1e4, 1e3, 2e5)]),
        Parameter("m", 200, 300, "kg", "1/m"),
    )
    assert len(car.vertices) == 2
    assert car.shape == (4, 1)
