"""The quarter car with actuator; its uncertain families are `polefence.examples`.

States: suspension deflection [m], tyre deflection [m], sprung-mass velocity [m/s], unsprung-mass
velocity [m/s], integral of suspension deflection [m s]. Input: actuator force [N]. Disturbance:
vertical road velocity [m/s]. Leite & Peres (2005), equations (1)-(3) and Table 1.
"""

from __future__ import annotations

from typing import Any

from polefence.plant.vehicle import Vehicle

# What names the plant's signals, and says that it is a car.
SIGNALS: dict[str, Any] = {
    "states": (
        "suspension deflection [m]",
        "tyre deflection [m]",
        "sprung-mass velocity [m/s]",
        "unsprung-mass velocity [m/s]",
        "integral of suspension deflection [m s]",
    ),
    "inputs": ("actuator force [N]",),
    "disturbances": ("road velocity [m/s]",),
    "vehicle": Vehicle(),
}


def quarter_car(m1: Any, m2: Any, k: Any, kt: Any, c: Any) -> tuple[Any, Any, Any]:
    """Return A, B, E as nested lists for masses [kg], stiffnesses [N/m], damping [N s/m].

    `SIGNALS` are the names that go with them, as `UncertainPlant` takes them. Works on any numbers
    that add, multiply and divide: floats, Fractions, rational functions.
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
