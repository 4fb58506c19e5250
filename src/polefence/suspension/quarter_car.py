"""The quarter car with actuator, and its uncertain families as specs that can be copied.

States: suspension deflection [m], tyre deflection [m], sprung-mass velocity [m/s], unsprung-mass
velocity [m/s], integral of suspension deflection [m s]. Input: actuator force [N]. Disturbance:
vertical road velocity [m/s]. Leite & Peres (2005), equations (1)-(3) and Table 1.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from polefence.errors import InputError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import loads

SPECS = {
    "quarter-car-as-printed": "the paper's printed vertices, equations (23)-(26)",
    "quarter-car-physical": "Table 1, load and age uncertain by 20 %",
    "quarter-car-m1": "Table 1, load alone uncertain by 20 % (figure 3)",
    "quarter-car-ride": "Table 1, four states, for designs for the ride",
}


def quarter_car(m1: Any, m2: Any, k: Any, kt: Any, c: Any) -> tuple[Any, Any, Any]:
    """Return A, B, E as nested lists for masses [kg], stiffnesses [N/m], damping [N s/m].

    Works on any numbers that add, multiply and divide: floats, Fractions, rational functions.
    """
    A = [
        [0, 0, -1, 1, 0],
        [0, 0, 0, -1, 0],
        [k / m1, 0, -c / m1, c / m1, 0],
        [-k / m2, kt / m2, c / m2, -c / m2, 0],
        [1, 0, 0, 0, 0],
    ]
    B = [[0], [0], [1 / m1], [-1 / m2], [0]]
    E = [[0], [1], [0], [0], [0]]
    return A, B, E


def spec_text(name: str) -> str:
    """Return the text of a spec that ships with the package.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in SPECS:
        raise InputError(f"no example named {name!r}; {suggest(name, SPECS)}")
    return (files("polefence.suspension") / "data" / f"{name}.toml").read_text()


def family(name: str) -> UncertainPlant:
    """Return a family that ships with the package; names as in `SPECS`."""
    return loads(spec_text(name), name)
