"""Specs that ship with the package, to copy and edit: `polefence example NAME` prints one."""

from __future__ import annotations

from pathlib import Path

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import loads

SPECS = {
    "quarter-car-as-printed": "the paper's printed vertices, equations (23)-(26)",
    "quarter-car-physical": "Table 1, load and age uncertain by 20 %",
    "quarter-car-m1": "Table 1, load alone uncertain by 20 % (figure 3)",
    "quarter-car-ride": "Table 1, four states; a smooth ride within limits",
    "quarter-car-level": "the same, with the integral of the deflection; level on a grade",
    "semi-active": "Table 1 with a controllable damper, load uncertain",
    "half-car": "heave and pitch, two wheels; a load on the rear seat, age",
    "full-car": "heave, pitch and roll, four wheels; the same",
    "f16": "short period of an F-16 over dynamic pressure and airspeed",
    "f4e": "short period of an F4-E with canards at four flight conditions",
    "active-suspension": "two sensors, a law of order 3; load and actuator uncertain",
    "active-suspension-ride": "the same on a road; its actuator uncertain by 40 %",
    "active-suspension-robust": "the same, with weights, noise and unmodelled dynamics",
    "van": "rear corner of a light van: an actuator, two sensors, a law of order 2",
    "two-masses": "Wie and Bernstein's problem, one position measured; order 4",
    "servo": "position servo with a flexible shaft and an uncertain load",
}

STUDIES = {"fleet": "a study of car.toml, one of the quarter cars: other wheels, tyres and loads"}


def spec_path(name: str) -> Path:
    """Return where a spec, or a study, that ships with the package lies.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in SPECS | STUDIES:
        raise InputError(f"no example named {name!r}; {suggest(name, SPECS | STUDIES)}")
    return Path(__file__).with_name(f"{name}.toml")


@explained
def spec_text(name: str) -> str:
    """Return the text of a spec or study that ships with the package, as `SPECS` and `STUDIES`."""
    return spec_path(name).read_text(encoding="utf-8")


@explained
def family(name: str) -> UncertainPlant:
    """Return a family that ships with the package; names as in `SPECS`."""
    return loads(spec_text(name), name)
