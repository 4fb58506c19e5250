"""Colours that mean different things differ for red-green blind readers too."""

from itertools import combinations

import numpy as np
import pytest

from polefence.studio.palette import DARK, LIGHT

# Machado, Oliveira, Fernandes: A Physiologically-based Model for Simulation of Color Vision
# Deficiency, IEEE TVCG 15(6), 2009, severity 1; for linear RGB.
SEEN = {
    "all cones": np.eye(3),
    "no long cones": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "no medium cones": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
TOLD_APART = 15  # CIE 1976 difference; 2.3 is just noticed


def lab(colour, seen):
    """CIELAB of a colour as it is seen."""
    rgb = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ @ np.clip(seen @ linear, 0, 1) / XYZ.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(one, other, seen):
    return float(np.linalg.norm(lab(one, seen) - lab(other, seen)))


def test_the_formula_knows_what_red_and_green_are():
    red, green = "#c04040", "#6e7040"
    assert difference(red, green, SEEN["all cones"]) > 2 * TOLD_APART
    assert difference(red, green, SEEN["no medium cones"]) < TOLD_APART
    assert difference("#ffffff", "#000000", np.eye(3)) == pytest.approx(100, abs=0.1)


@pytest.mark.parametrize("name", SEEN)
@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_what_differs_in_meaning_differs_in_colour(palette, name):
    seen = SEEN[name]
    pairs = [
        (palette.inside, palette.looked),  # cells of the map: in the region, and out of it
        (palette.inside, palette.paper),
        (palette.cars, palette.inside),
        (palette.cars, palette.looked),
        (palette.cars, palette.ghost),
        (palette.ink, palette.paper),
        *combinations(palette.trails[:3], 2),
        *((own, palette.inside) for own in palette.trails),
        *((own, palette.paper) for own in palette.trails),
    ]
    for one, other in pairs:
        assert difference(one, other, seen) > TOLD_APART, (one, other)
