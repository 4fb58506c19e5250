"""The study of Leite & Peres (2005), computed afresh: numbers beside those that were published.

Two families throughout: ``as-printed``, the vertices (23)-(26) as the paper computed with them, and
``physical``, Table 1 with 20 %. Figures 3 to 6, the gains, the radii, the claim about slow centres,
and the paper's inconsistencies, each shown by a computation.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import NotProvedError
from polefence.design.design import Design
from polefence.design.limits import Limit, limits, sweep
from polefence.design.place import place
from polefence.design.rows import Row
from polefence.examples import family
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.family import UncertainPlant
from polefence.plant.points import edges, inside
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import Disk
from polefence.vehicle.vehicle import quarter_car

FAMILIES = ("as-printed", "physical")
PUBLISHED_ON = "as-printed"  # the family that the paper's own radii and gains are of
DISK = Disk(-40, 31)
CENTRES = tuple(float(c) for c in np.linspace(-5, -100, 60))
SAMPLES = 10_000
# Either side of where Lemmas 1 and 2 cease to stabilise.
EDGES = {"as-printed": (-12.0, -13.0, -14.0), "physical": (-20.0, -25.0)}


def published() -> dict[str, Any]:
    """Return the numbers the paper prints."""
    path = files("polefence.show") / "data" / "leite-peres-2005.json"
    data: dict[str, Any] = json.loads(path.read_text())
    return data


def nominal_gain(poles: Sequence[float]) -> Array:
    """Return K placing the poles of the nominal car of Table 1 (the paper's (27)), (1, 5)."""
    from scipy.signal import place_poles  # deferred: slow to import

    table = {name: entry["value"] for name, entry in published()["table1"].items()}
    A, B, _ = quarter_car(**table)
    return -np.asarray(place_poles(np.array(A, dtype=float), np.array(B), poles).gain_matrix)


def farthest(plant: UncertainPlant, gains: Array, centre: float) -> list[float]:
    """Distance of the farthest pole from the centre at each vertex, gains (N, m, n) or (m, n)."""
    poles = np.linalg.eigvals(plant.A + plant.B @ gains)
    return [float(d) for d in np.abs(poles - centre).max(axis=-1)]


def reproduce(
    folder: Path,
    resume: bool = False,
    executor: Executor | None = None,
    on_row: Callable[[Limit], None] | None = None,
    centres: Sequence[float] = CENTRES,
) -> dict[str, Any]:
    """Run the whole study; the sweeps of figures 3 and 4 are kept in ``folder`` row by row."""
    plants = {name: family(f"quarter-car-{name}") for name in (*FAMILIES, "m1")}

    def rows(name: str, centres: Sequence[float]) -> list[Limit]:
        return limits(plants[name], centres, METHODS, executor, on_row)

    sweeps = {
        name: sweep(
            plant,
            centres,
            METHODS,
            folder / f"limits-{name}.json",
            resume=resume,
            executor=executor,
            on_row=on_row,
        )
        for name, plant in plants.items()
    }
    designs = {name: place(plants[name], DISK, "scheduled") for name in FAMILIES}
    for name, design in designs.items():
        design.save(folder / f"design-{name}")
    results: dict[str, Any] = {
        "published": published(),
        "radii": _radii({name: rows(name, [DISK.centre]) for name in FAMILIES}),
        "nominal": _nominal(plants),
        "gains": _gains(plants, designs),
        "slow centres": _slow_centres({name: rows(name, EDGES[name]) for name in FAMILIES}),
        "limits": sweeps,
        "disk design": {n: _cloud_summary(plants[n], d.poles) for n, d in designs.items()},
    }
    return results | {"inconsistencies": _inconsistencies(plants, results)}


def total_rows(centres: Sequence[float] = CENTRES) -> int:
    """Return how many smallest radii a reproduction computes."""
    each = 3 * len(centres) + len(FAMILIES) + sum(len(edge) for edge in EDGES.values())
    return each * len(METHODS)


def cloud(plant: UncertainPlant, poles: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return closed-loop poles over a seeded sample with all edges, and at the vertices."""
    N = len(plant.vertices)
    simplex = Domain((N,))
    points = np.vstack([edges(simplex, 60), inside(simplex, SAMPLES)])
    return poles(points), poles(np.eye(N))


def nominal_poles(plant: UncertainPlant) -> Callable[[Array], Array]:
    """Return the closed-loop poles under the published nominal gain as a function of alpha."""
    K = np.array([published()["nominal_pole_placement"]["Kn"]])

    def poles(alpha: Array) -> Array:
        A, B = plant.at(alpha)
        return np.asarray(np.linalg.eigvals(A + B @ K))

    return poles


def _cloud_summary(plant: UncertainPlant, poles: Callable[[Array], Array]) -> dict[str, Any]:
    points, _ = cloud(plant, poles)
    return {
        "sampled alpha": len(points),
        "farthest pole from the centre": float(np.abs(points - DISK.centre).max()),
        "all in the disk": DISK.contains(points),
    }


def _radii(rows: Mapping[str, Sequence[Limit]]) -> list[Row]:
    claims = published()["claims"]
    printed = {
        "quadratic": claims["lemma1_feasible_at_40"],
        "slack": claims["lemma2_feasible_at_40"],
        "scheduled": claims["smallest_radius_theorem1_at_40"],
    }
    return [
        {
            "family": name,
            "published": printed[row.method] if name == PUBLISHED_ON else None,
            **row.as_row(),
        }
        for name, found in rows.items()
        for row in found
    ]


def _nominal(plants: Mapping[str, UncertainPlant]) -> dict[str, Any]:
    given = published()["nominal_pole_placement"]
    K = nominal_gain(given["poles"])[0]
    # (27) prints four decimals of a common factor 1e6.
    digits = np.round(K / 1e6, 4)
    return {
        "published": given["Kn"],
        "computed": K.tolist(),
        "agrees to all printed digits": bool(np.all(digits == np.array(given["Kn"]) / 1e6)),
        "poles over the family": {
            name: _cloud_summary(plants[name], nominal_poles(plants[name])) for name in FAMILIES
        },
    }


def _gains(
    plants: Mapping[str, UncertainPlant], designs: Mapping[str, Design]
) -> list[dict[str, Any]]:
    """Each published gain: how far its poles go on both families, and our gain for its disk."""
    data = published()
    printed = data["theorem1_example"]["K"]
    cases = [("scheduled", DISK, np.array([[printed[str(j)]] for j in range(1, 5)]), "(37)-(40)")]
    for key, method in (("lemma2", "slack"), ("lemma1", "quadratic")):
        case = data["fixed_gains"][key]
        region = Disk(case["centre"], case["radius"])
        cases.append((method, region, np.array([case["K"]]), f"K_{case['radius']:g}"))
    rows = []
    for method, region, K, label in cases:
        for name in FAMILIES:
            design = (
                designs[name] if method == "scheduled" else _placed(plants[name], region, method)
            )
            ours = None if design is None else design.law.gain(np.eye(len(plants[name].vertices)))
            rows.append(
                {
                    "gain": label,
                    "method": method,
                    "family": name,
                    "radius": region.radius,
                    "published": K.reshape(-1, K.shape[-1]).tolist()
                    if name == PUBLISHED_ON
                    else None,
                    "farthest pole of the published gain": max(
                        farthest(plants[name], K, region.centre)
                    ),
                    "computed": None
                    if ours is None
                    else (ours[:, 0] if method == "scheduled" else ours[0]).tolist(),
                }
            )
    return rows


def _placed(plant: UncertainPlant, region: Disk, method: str) -> Design | None:
    try:
        return place(plant, region, method)
    except NotProvedError:
        return None


def _slow_centres(rows: Mapping[str, Sequence[Limit]]) -> list[Row]:
    """Return d / sigma of every method on both sides of where Lemma 1 loses stability."""
    return [
        {"family": name, **row.as_row(), "d/sigma": row.ratio}
        for name, found in rows.items()
        for row in found
    ]


def _inconsistencies(
    plants: Mapping[str, UncertainPlant], results: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return the five places where the paper contradicts itself, each with what was computed."""
    data = results["published"]
    table = {name: entry["value"] for name, entry in data["table1"].items()}
    m1 = data["intervals_eq22_as_printed"]["m1"]
    stiffness = {"Table 1": table["k"], "(22)": 1000}
    ratios = {f"k of {where}": k / m1[0] for where, k in stiffness.items()}
    ratios["printed in (23)"] = data["vertices_eq23_26_as_printed"]["1"]["A"][2][0]
    away = {
        f"{row['gain']} on {row['family']}": row["farthest pole of the published gain"]
        for row in results["gains"]
    }
    found: list[tuple[str, dict[str, Any]]] = [
        (
            "Table 1 has k = 10000 N/m, equation (22) has 1000 +- 20 beta; "
            "k/m1 at the lightest car is neither in (23)",
            ratios,
        ),
        (
            "(23)-(26) follow from c = k = the bounds of m1; the published gains meet "
            "their disks there and not on the physical family",
            {
                "printed entries reproduced": printed_entries(plants["as-printed"]),
                **away,
            },
        ),
        (
            "the nominal gain (27) is that of Table 1, so figure 5 shows it on another family",
            {
                "(27) from Table 1": results["nominal"]["agrees to all printed digits"],
                **{
                    f"farthest pole on {name}": s["farthest pole from the centre"]
                    for name, s in results["nominal"]["poles over the family"].items()
                },
            },
        ),
        (
            '"only Theorem 1 below sigma = 13" holds on the printed vertices; on the '
            "physical ones Lemma 1 stops between 20 and 25",
            {
                f"{row['family']}, {row['method']}, sigma = {-row['centre']:g}: d/sigma [%]": row[
                    "d/sigma"
                ]
                for row in results["slow centres"]
            },
        ),
        _coarse_example(data),
    ]
    return [{"statement": statement, "computed": computed} for statement, computed in found]


def _coarse_example(data: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return what the printed example of Theorem 1 gives, K_1 = Z_1 W_1^-1."""
    example = data["theorem1_example"]
    W, Z = np.array(example["W"]["1"]), np.array([example["Z"]["1"]])
    K = np.array(example["K"]["1"])
    error = np.linalg.norm(np.linalg.solve(W, Z.T).T[0] - K) / np.linalg.norm(K)
    return (
        "K(alpha) and Z_j are m x n = 1 x 5, printed as n x m; and W_1, Z_1 are printed too "
        "coarsely to give K_1 = Z_1 W_1^-1",
        {
            "shape of Z_1": list(Z.shape),
            "condition number of W_1 as printed": float(np.linalg.cond(W)),
            "smallest eigenvalue of W_1 as printed": float(np.linalg.eigvalsh(W)[0]),
            "relative error of Z_1 W_1^-1": float(error),
        },
    )


def printed_entries(plant: UncertainPlant) -> str:
    """Count the entries of (23)-(26) that the as-printed family rounds to ("120 of 120")."""
    same = total = 0
    for j, vertex in enumerate(plant.vertices):
        printed = published()["vertices_eq23_26_as_printed"][str(j + 1)]
        for ours, theirs, decimals in (
            (vertex.A, np.array(printed["A"]), 2),
            (vertex.B[:, 0], np.array(printed["B"]), 4),
        ):
            same += int(np.sum(np.abs(np.round(ours, decimals) - theirs) < 1e-9))
            total += theirs.size
    return f"{same} of {total}"
