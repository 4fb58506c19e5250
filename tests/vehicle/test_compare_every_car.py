"""Comparisons of half and full cars, of samples, of hardware and tracks: beside other computations.

The systems beside are assembled here, in coordinates of their own, and solved by scipy.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov
from scipy.signal import cont2discrete

from polefence import Disk, FixedGain, Rms, at_sample_time, with_actuator, with_sensor
from polefence.base.errors import InputError
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.fleet.questions import Ride
from polefence.plant.cars import Bar, Body, Car, Wheel, car_family
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_states
from polefence.plant.tracks import Tracks
from polefence.response.stationary import velocity_density
from polefence.response.weighting import WK
from polefence.search.tradeoff import Asked, Front
from polefence.show.plots import COMPARED, comparison_figure
from polefence.vehicle.compare import AT_WHEELS, QUANTITIES, compare, standard_laws
from polefence.vehicle.excitation import on_road, on_wheels
from polefence.vehicle.reference_laws import (
    Sizes,
    beside_reference_laws,
    lqr,
    nominal,
    skyhook,
)
from polefence.vehicle.roads import kerb
from polefence.vehicle.vehicle import SIGNALS, quarter_car
from support.commands import refused

S = velocity_density("C", 20) / 2  # two-sided
M1, M2, K, KT, C = 288.9, 28.58, 10000.0, 155900.0, 850.0
THREE = ("passive", "skyhook", "lqr")
AT = {"passive": None}


def wheel(name, x=0.0, y=0.0, **other):
    return Wheel(
        name, **({"mass": M2, "spring": K, "damper": C, "tyre": KT, "x": x, "y": y} | other)
    )


def plant_of(car):
    return replace(car_family(lambda: car, ()), car=car)


@pytest.fixture(scope="module")
def quarter():
    A, B, E = (np.array(M, float)[:4] for M in quarter_car(M1, M2, K, KT, C))
    names = SIGNALS | {"states": SIGNALS["states"][:4]}
    return UncertainPlant.from_vertices([A[:, :4]], [B], [E], **names)


@pytest.fixture(scope="module")
def twice():
    """A half car whose ends do not feel each other: J = m a^2, two quarter cars."""
    a = 1.3
    body = Body(mass=2 * M1, pitch=2 * M1 * a * a)
    return plant_of(Car(body, [wheel("front", a), wheel("rear", -a)], {"f": (a, 0), "r": (-a, 0)}))


@pytest.fixture(scope="module")
def four():
    """A full car with a bar in front."""
    a, b = 1.3, 0.7
    body = Body(mass=3 * M1, pitch=2.2 * M1 * a * a, roll=2.5 * M1 * b * b)
    wheels = [
        wheel(f"{e} {s}", x, y) for e, x in (("f", a), ("r", -a)) for s, y in (("l", b), ("r", -b))
    ]
    return plant_of(Car(body, wheels, {"seat": (0.2, 0.3)}, [Bar("front", ("f l", "f r"), 4000.0)]))


def numbers(compared, law):
    return dict(
        zip(
            (q.name for q in compared.quantities),
            compared.values[compared.laws.index(law), 0],
            strict=True,
        )
    )


# --- a system of one's own ----------------------------------------------------------------------


def wheels_of_the_road(car):
    """Of x = compressions of suspensions and tyres, velocities of body and wheels: A, B, E, G."""
    G = np.array([[1.0, -w.x, w.y][: len(car.body.motions)] for w in car.wheels], float)
    inertia = [
        float(getattr(car.body, k)) for k in ("mass", "pitch", "roll") if getattr(car.body, k)
    ]
    w, d = len(G), len(inertia)
    n = 3 * w + d
    s, t, v, u = slice(0, w), slice(w, 2 * w), slice(2 * w, 2 * w + d), slice(2 * w + d, n)
    k, c, kt, m = (
        np.diag([float(getattr(x, key)) for x in car.wheels])
        for key in ("spring", "damper", "tyre", "mass")
    )
    for bar in car.bars:
        i, j = ([x.name for x in car.wheels].index(name) for name in bar.between)
        k[i, i] += float(bar.stiffness)
        k[j, j] += float(bar.stiffness)
        k[i, j] -= float(bar.stiffness)
        k[j, i] -= float(bar.stiffness)
    force = np.zeros((w, n))
    force[:, s], force[:, v], force[:, u] = k, -c @ G, c
    A, B, E = np.zeros((n, n)), np.zeros((n, w)), np.zeros((n, w))
    plane = G @ np.linalg.pinv(G)
    A[s, v], A[s, u], A[t, u], E[t] = -G, np.eye(w), -np.eye(w), plane
    A[s, s] = A[s, t] = plane - np.eye(w)  # a twist of the road is left out: of both it is none
    A[v], B[v] = np.diag(1 / np.array(inertia)) @ G.T @ force, np.diag(1 / np.array(inertia)) @ G.T
    A[u], B[u] = -np.linalg.inv(m) @ force, -np.linalg.inv(m)
    A[u, t] += np.linalg.inv(m) @ kt
    return A, B, E, G, (s, t, v, u), np.diag(kt)


def own_numbers(car, gain, noise):
    """Return the quantities with forces gain x, by scipy's Lyapunov solver."""
    A, B, E, G, (s, t, v, u), kt = wheels_of_the_road(car)
    loop = A + B @ gain
    a, b, c, _ = WK.state_space()
    out = dict[str, float]()
    X = solve_continuous_lyapunov(loop, -noise * E @ E.T)
    for seat, (x, y) in car.seats.items():
        g = np.array([1.0, -float(x), float(y)])[: G.shape[1]]
        felt = g @ loop[v]
        both = np.block([[loop, np.zeros((len(loop), len(a)))], [b @ felt[None], a]])
        wide = np.vstack([E, np.zeros((len(a), E.shape[1]))])
        Z = solve_continuous_lyapunov(both, -noise * wide @ wide.T)[len(loop) :, len(loop) :]
        out[f"{seat} weighted acceleration"] = float(np.sqrt((c @ Z @ c.T)[0, 0]))
        out[f"{seat} acceleration"] = float(np.sqrt(felt @ X @ felt))
    power = drawn = 0.0
    for i, one in enumerate(car.wheels):
        tyre, travel = np.sqrt(np.diag(X)[t][i]), np.sqrt(np.diag(X)[s][i])
        apart = np.zeros(len(loop))
        apart[v], apart[u.start + i] = G[i], -1.0
        f, r = np.sqrt(gain[i] @ X @ gain[i]), np.sqrt(apart @ X @ apart)
        mean = gain[i] @ X @ apart
        power += mean
        if f:
            # by quadrature over the angle of the joint normal distribution
            angle = np.linspace(0, 2 * np.pi, 40001)[:-1]
            share = mean / (f * r)
            products = np.cos(angle) * (
                share * np.cos(angle) + np.sqrt(1 - share**2) * np.sin(angle)
            )
            drawn += 2 * f * r * np.maximum(products, 0).mean()
        names = ("tyre deflection", "tyre load variation", "suspension travel", "actuator force")
        for name, value in zip(names, (tyre, kt[i] * tyre, travel, f), strict=True):
            out[f"{one.name} {name}"] = float(value)
    return out | {"mean power": float(power), "mean power drawn": float(drawn)}


def in_own_coordinates(car, plant, law):
    """Return a law's gain of the states of `wheels_of_the_road`, by its forces in random states."""
    G = wheels_of_the_road(car)[3]
    k, w = G.shape[1], len(G)
    n = 2 * (k + w)
    own = np.zeros((3 * w + k, n))  # from the plant's state
    own[:w, :k], own[:w, k : k + w] = -G, -np.eye(w)
    own[w : 2 * w, k : k + w] = np.eye(w)
    own[2 * w :, k + w :] = np.eye(k + w)
    gain = np.zeros((w, n)) if law is None else law.K
    found = gain @ np.linalg.pinv(own)
    assert np.allclose(found @ own, gain, atol=1e-9 * np.abs(gain).max() if gain.any() else 0)
    return found


@pytest.mark.parametrize("law", THREE)
@pytest.mark.parametrize("which", ["twice", "four"])
def test_every_number_is_that_of_a_system_assembled_by_hand(which, law, request):
    plant = request.getfixturevalue(which)
    given = standard_laws(plant, names=(law,))
    found = numbers(compare(plant, given, "C", 20), law)
    beside = own_numbers(plant.car, in_own_coordinates(plant.car, plant, given[law]), S)
    assert found.keys() == beside.keys()
    for name, value in beside.items():
        assert found[name] == pytest.approx(value, rel=1e-6, abs=1e-9), name


def test_a_half_car_of_two_quarter_cars_rides_as_they_do(quarter, twice):
    one, both = (compare(plant, standard_laws(plant, names=THREE)) for plant in (quarter, twice))
    assert [q.name for q in one.quantities] == [name for name, _ in QUANTITIES]
    for law in THREE:
        alone, half = numbers(one, law), numbers(both, law)
        for what, _ in QUANTITIES:
            places = [q.place for q in both.quantities if q.what == what]
            assert places == (
                ["f", "r"]
                if "acceleration" in what
                else ["front", "rear"]
                if what in dict(AT_WHEELS)
                else [""]
            )
            share = 2 if "power" in what else 1
            for place in places:
                value = half[f"{place} {what}".strip()]
                assert value == pytest.approx(share * alone[what], rel=1e-7, abs=1e-9), (law, what)


def test_a_bare_quantity_is_that_of_the_worst_place(four):
    found = compare(four, {"lqr": lqr(four)})
    worst = max(
        (row for row in found.rows if row.quantity.endswith("tyre deflection")),
        key=lambda r: r.worst,
    )
    assert found.row("lqr", "tyre deflection") == worst
    assert found.row("lqr").quantity == "seat weighted acceleration"
    assert found.row("lqr", worst.quantity) == worst
    with pytest.raises(InputError, match="did you mean 'lqr: f l tyre deflection'"):
        found.row("lqr", "f l tyre deflecton")
    rows = json.loads(json.dumps(found.document()))["rows"]
    assert len(rows) == len(found.quantities) == 2 + 4 * 4 + 2


def test_braking_and_sensors_do_not_change_the_road(twice):
    """A manoeuvre is no noise; noise of a sensor has a density of its own."""
    car = replace(twice.car, body=replace(twice.car.body, height=0.5))
    high = plant_of(car)
    assert high.disturbance_count == 3
    names = ("passive", "skyhook")
    assert compare(high, standard_laws(high, names=names)).values == pytest.approx(
        compare(twice, standard_laws(twice, names=names)).values, rel=1e-9
    )
    noisy = with_sensor(twice, "front suspension deflection", 50, 0.001)
    K = np.zeros((2, 9))
    K[0, 8] = 3000.0
    found = numbers(compare(noisy, {"law": FixedGain(K)}), "law")
    A, B = noisy.at(np.ones((1, 1)))
    E, loop = noisy.vertices[0].E, (A + B @ K)[0]
    X = solve_continuous_lyapunov(loop, -E @ np.diag([S, S, 0.5]) @ E.T)
    assert found["front actuator force"] == pytest.approx(3000 * np.sqrt(X[8, 8]), rel=1e-6)


def test_behind_an_actuator_laws_ask_for_the_force(four, twice):
    for plant in (four, twice):
        lagging = plant
        for one in plant.car.wheels[1:]:  # one wheel has none
            lagging = with_actuator(lagging, f"{one.name} force", 20)
        n = plant.shape[0]
        for law in (skyhook, lqr):
            assert law(lagging).K[:, :n] == pytest.approx(law(plant).K, rel=1e-9, abs=1e-6)
            assert not law(lagging).K[:, n:].any()
    quick = with_actuator(with_actuator(twice, "front force", 1e5), "rear force", 1e5)
    laws = standard_laws(twice, names=THREE)
    near = compare(quick, standard_laws(quick, names=THREE)).values
    assert near == pytest.approx(compare(twice, laws).values, rel=2e-3, abs=0.02)


def test_tracks_change_no_end_that_does_not_feel_the_other(twice):
    on_tracks = Tracks(20).under(twice, twice.car.places)
    found = compare(on_tracks, standard_laws(on_tracks, names=("passive", "skyhook")))
    beside = compare(twice, standard_laws(twice, names=("passive", "skyhook")))
    assert found.values == pytest.approx(beside.values, rel=1e-7, abs=1e-9)


def test_a_full_car_and_states_of_a_law_of_no_use(four):
    larger = with_states(four, 2)
    for law in (skyhook, lqr):
        assert law(larger).K[:4, :14] == pytest.approx(law(four).K)
        assert not law(larger).K[4:].any()
    found = compare(larger, standard_laws(larger, names=THREE))
    assert found.values == pytest.approx(compare(four, standard_laws(four, names=THREE)).values)


# --- at a sample time ---------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_samples_are_those_of_a_loop_that_is_stepped(quarter, delay):
    """Held, and late: by the matrix exponential, and by scipy's equation of samples."""
    T = 0.005
    law = skyhook(quarter)
    plant = at_sample_time(quarter, T, delay)
    found = numbers(compare(plant, {"law": skyhook(plant)}), "law")
    A, B, E = quarter.vertices[0].A, quarter.vertices[0].B, quarter.vertices[0].E
    whole = expm(T * np.block([[A, B, E], [np.zeros((2, 6))]]))
    F, G, H = whole[:4, :4], whole[:4, 4:5], whole[:4, 5:]
    n = 4 + delay  # what is sent acts after `delay` samples
    step, gain = np.zeros((n, n)), np.pad(law.K, ((0, 0), (0, delay)))
    step[:4, :4] = F
    force = gain if not delay else np.eye(n)[-1:]
    unit = 1e5  # N, of what is on its way, for the sake of conditions
    if delay:
        force = unit * force
        step[4] = gain / unit
        step[5:, 4:-1] = np.eye(delay - 1)
    step[:4] += G @ force
    noise = np.zeros((n, n))
    noise[:4, :4] = H @ H.T * S / T
    X = solve_discrete_lyapunov(step, noise)
    felt = np.zeros(n)
    felt[:4] = A[2]
    felt = felt + force[0] / M1
    a, b, c = cont2discrete(WK.state_space(), T)[:3]
    both = np.block([[step, np.zeros((n, len(a)))], [b @ felt[None], a]])
    Z = solve_discrete_lyapunov(both, np.pad(noise, (0, len(a))))[n:, n:]
    moved = -(step[0] - np.eye(n)[0]) / T  # body from wheel, over the step
    own = {
        "weighted acceleration": np.sqrt(c @ Z @ c.T)[0, 0],
        "acceleration": np.sqrt(felt @ X @ felt),
        "tyre deflection": np.sqrt(X[1, 1]),
        "tyre load variation": KT * np.sqrt(X[1, 1]),
        "suspension travel": np.sqrt(X[0, 0]),
        "actuator force": np.sqrt(force @ X @ force.T)[0, 0],
        "mean power": (force @ X @ moved)[0],
    }
    for name, value in own.items():
        assert found[name] == pytest.approx(value, rel=1e-5), name


@pytest.mark.parametrize(("delay", "before"), [(0.5, 10), (1.3, 6)])
@pytest.mark.parametrize("lag", [None, 20])
def test_power_counts_each_force_that_acts_in_a_step(quarter, delay, before, lag):
    """Steps of T / 20, of which so many are under the force of the sample before."""
    T, parts = 0.005, 20
    plant = quarter if lag is None else with_actuator(quarter, "actuator force", lag)
    law, whole = skyhook(quarter).K[0, :4], plant.shape[0]
    delayed = at_sample_time(plant, T, delay)
    gain = np.zeros((1, delayed.shape[0]))
    gain[0, :4] = law
    found = numbers(compare(delayed, {"law": gain}), "law")
    A, B, E = plant.vertices[0].A, plant.vertices[0].B, plant.vertices[0].E
    fine = expm(T / parts * np.block([[A, B], [np.zeros((1, whole + 1))]]))[:whole]
    states = np.eye(whole, delayed.shape[0])
    on_the_way = [gain, *np.eye(delayed.shape[0])[whole:, None]]
    seen = []
    for k in range(parts):
        force = on_the_way[int(np.ceil(delay)) - (k >= before)]
        moved = fine[:, :whole] @ states + fine[:, whole:] @ force
        acting = force if lag is None else ((states + moved) / 2)[4][None]
        seen.append((acting, -(moved[:1] - states[:1]) * parts / T))
        states = moved
    step = np.zeros((len(gain[0]), len(gain[0])))
    step[:whole], step[whole : whole + 1] = states, gain
    step[whole + 1 :, whole:-1] = np.eye(len(step) - whole - 1)
    noise = np.zeros_like(step)
    H = expm(T * np.block([[A, E], [np.zeros((1, whole + 1))]]))[:whole, whole:]
    noise[:whole, :whole] = H @ H.T * S / T
    X = noise
    for _ in range(30):  # twice the time each
        X, step = X + step @ X @ step.T, step @ step
    wanted = np.mean([(force @ X @ apart.T).item() for force, apart in seen])
    assert found["mean power"] == pytest.approx(wanted, rel=1e-6 if lag is None else 5e-3)


@pytest.mark.parametrize("which", ["quarter", "twice", "lagging"])
def test_samples_tend_to_the_continuous_ride(which, quarter, twice):
    plant = {
        "quarter": quarter,
        "twice": twice,
        "lagging": with_actuator(quarter, "actuator force", 20),
    }[which]

    def ride(one):
        return compare(one, standard_laws(one, names=THREE)).values

    wanted = ride(plant)
    scale = np.abs(wanted)
    scale[..., -2] = scale[..., -1]  # mean power may be zero
    scale = np.where(scale > 0, scale, 1.0)
    off = [np.abs(ride(at_sample_time(plant, T, 1)) - wanted) / scale for T in (2e-3, 2e-4)]
    assert off[0].max() > 0.01
    assert off[1].max() < 0.13 * off[0].max()
    assert off[1].max() < 0.03


def test_power_of_a_lagging_force_is_near_at_samples_already(quarter):
    """Means over the step: the products at its instants would be off by its length."""
    lagging = with_actuator(quarter, "actuator force", 20)
    wanted = numbers(compare(lagging, {"lqr": lqr(lagging)}), "lqr")["mean power"]
    T = 1e-3
    held = at_sample_time(lagging, T)
    found = numbers(compare(held, {"lqr": lqr(held)}), "lqr")["mean power"]
    assert found == pytest.approx(wanted, rel=0.05)


def test_a_design_of_another_car_is_taken_as_a_gain(quarter):
    """Only of the same car a plant of its own is compared; else its law has to fit."""
    from polefence import place

    design = place(with_states(quarter, 1), Disk(-500, 499.9))
    found = compare(quarter, {"law": design, "passive": None})
    assert found.laws == ("law", "passive")
    A, B = (np.array(M, float)[:4] for M in quarter_car(2 * M1, M2, K, KT, C)[:2])
    names = SIGNALS | {"states": SIGNALS["states"][:4]}
    other = UncertainPlant.from_vertices([A[:, :4]], [B], [quarter.vertices[0].E], **names)
    with pytest.raises(InputError, match="the gain is 2 x 5"):
        compare(other, {"law": design})


def test_laws_that_lose_a_sampled_car_are_told(quarter):
    plant = at_sample_time(quarter, 0.02, 1)
    hard = FixedGain(np.array([[0.0, 0, -60000, 0, 0]]))
    found = compare(plant, AT | {"hard": hard})
    assert found.laws == ("passive",)
    assert found.left_out["hard"].startswith("unstable: a pole at ")
    assert ", stationary, at samples every 20 ms; 1 points" in found.lines[0]


# --- parts of it, and the command ---------------------------------------------------------------


def test_dampings_and_sizes_of_each_corner(four):
    K = skyhook(four, [1.0, 2.0, 3.0, 4.0]).K
    G = wheels_of_the_road(four.car)[3]
    assert K[:, 7:10] == pytest.approx(-np.arange(1, 5)[:, None] * G)
    assert not np.delete(K, [7, 8, 9], axis=1).any()
    for wrong in ([1.0, 2.0], "much"):
        with pytest.raises(InputError, match="give one number, or 4"):
            skyhook(four, wrong)
    calm, free = (lqr(four, Sizes(force=size)) for size in (10.0, 1e4))
    assert np.abs(free.K).max() > 10 * np.abs(calm.K).max()
    A, B = four.at(nominal(four))
    assert np.linalg.eigvals(A + B @ free.K).real.max() < 0


def test_a_front_and_a_study_have_them_of_a_half_car(twice):
    force = Rms("front force", density=2 * S)
    least, few = Rms("f acceleration", density=2 * S), (Rms("rear force", 1.0, 2 * S),)
    asked = Asked(twice, least, force, few, Disk(-50, 50), None, (twice, ()))
    rows = {row["name"]: row for row in beside_reference_laws(Front(asked, ())).references}
    assert rows.keys() == {"passive", "skyhook", "LQR"}
    beside = compare(twice, {"skyhook": skyhook(twice)})
    assert rows["skyhook"]["over"] == pytest.approx(beside.row("skyhook", "actuator force").worst)
    assert rows["skyhook"]["minimise"] == pytest.approx(
        beside.row("skyhook", "f acceleration").worst
    )
    assert [rows[name]["keeps"] for name in rows] == [True, False, False]
    study = [spec_text("half-car")]
    (worst,) = Ride("a", law="skyhook", quantity="tyre load variation").answers(study)
    ends = [
        Ride("b", law="skyhook", quantity=f"{end} tyre load variation").answers(study)[0].worst
        for end in ("front", "rear")
    ]
    assert worst.worst == max(ends)
    with pytest.raises(InputError, match="quantity = 'front tyre' is unknown"):
        Ride("c", quantity="front tyre")


def test_a_road_is_one_for_every_car(twice):
    road = kerb(0.05, before=1.0, after=10.0)
    one, other = (
        on_road(twice, road, 10.0, 1e-3),
        on_wheels(twice, twice.car.places, road, 10.0, 1e-3),
    )
    assert np.array_equal(one.w, other.w)
    with pytest.raises(InputError, match="is not described as a car"):
        on_road(replace(twice, car=None), road, 10.0, 1e-3)


def test_the_figure_names_every_wheel(four):
    figure = comparison_figure(compare(four, {"passive": None, "lqr": lqr(four)}))
    texts = [[text.get_text() for text in ax.texts] for ax in figure.axes]
    wheels = [name for name in ("f l", "f r", "r l", "r r") for _ in range(2)]
    assert [ax.get_xlabel().split(" [")[0] for ax in figure.axes] == list(COMPARED)
    assert texts == [[], wheels, wheels, wheels]


def test_the_command_takes_a_half_car_at_a_sample_time(twice, tmp_path, capsys, monkeypatch):
    from polefence import Design, optimise

    monkeypatch.chdir(tmp_path)
    least = Rms(["f acceleration", "front tyre deflection"], density=2 * S)
    optimise(at_sample_time(twice, 0.005, 1), least).save("held")
    assert main(["compare", "held", "--json", "c.json", "--plot", "c.png"]) == 0
    out = capsys.readouterr().out
    assert "stationary, at samples every 5 ms; " in out
    rows = json.loads((tmp_path / "c.json").read_text())["rows"]
    assert {row["law"] for row in rows} == {"held", *THREE}
    direct = compare(Design.load("held").plant, {"passive": None})
    (row,) = [r for r in rows if (r["law"], r["quantity"]) == ("passive", "rear suspension travel")]
    assert row["worst"] == direct.row("passive", "rear suspension travel").worst
    # beside it a design in continuous time, and the other way round
    optimise(twice, least).save("free")
    both = capsys.readouterr() and ["compare", "held", "--law", "free", "--law", "passive"]
    assert main([*both, "--json", "c.json"]) == 0
    assert "\nfree: in continuous time\n" in capsys.readouterr().out
    assert main(["compare", "free", "--law", "held", "--json", "d.json"]) == 0
    assert "\nheld: at samples every 5 ms\n" in capsys.readouterr().out
    mine, theirs = (
        {
            (r["law"], r["quantity"]): r["worst"]
            for r in json.loads((tmp_path / name).read_text())["rows"]
        }
        for name in ("c.json", "d.json")
    )
    for law in ("held", "free"):
        assert mine[law, "mean power"] == theirs[law, "mean power"]
    assert mine["held", "mean power"] != mine["free", "mean power"]
    servo = tmp_path / "servo.toml"
    servo.write_text(spec_text("servo"))
    assert "is not described as a car; add a table [vehicle]" in refused(
        capsys, "compare", str(servo)
    )
