"""The checker reads the regions that there are, number for number, and no others."""

from __future__ import annotations

import json
import math
import re
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from polefence.base.errors import RegionError
from polefence.cli.main import main
from polefence.proof import regions, work
from polefence.proof.__main__ import main as alone
from polefence.proof.regions import parts_of
from polefence.region.regions import CLASSES, Ellipse, HalfPlane, Sector, region_of

NUMBERS = [
    *(0.0, -0.0, 1e-300, 1e-101, 1e-100, 1e-9, 1e-8, 0.3, 0.5, math.nextafter(0.5, 0), 0.999),
    *(math.nextafter(1, 0), 1.0, math.sqrt(3), math.nextafter(math.sqrt(3), 0), 3.0, 1e100, 1e101),
]
SIGNED = sorted({*NUMBERS, *(-x for x in NUMBERS)})
FAULT = re.compile(r"region\.[a-z]+ = [^\n]+")  # names the key and the value


def read(kind, numbers):
    """The part that the checker reads, None where it refuses."""
    table = {"kind": kind} | dict(zip(regions.KINDS[kind].names(), numbers, strict=True))
    try:
        return parts_of(json.loads(json.dumps(table)))
    except work.FormatError as error:
        return None if FAULT.fullmatch(str(error)) else str(error)


def region(kind, numbers):
    try:
        return region_of([(kind, numbers)])
    except RegionError:
        return None


@pytest.mark.parametrize("kind", regions.KINDS)
def test_what_is_read_is_what_there_is(kind):
    counts = {True: 0, False: 0}
    for numbers in product(SIGNED, repeat=len(regions.KINDS[kind].names())):
        mine, theirs = read(kind, numbers), region(kind, numbers)
        assert (mine is None) == (theirs is None), numbers
        if mine is not None:
            assert mine == (regions.KINDS[kind](*map(Fraction, numbers)),)
        counts[mine is None] += 1
    assert min(counts.values()) > 0


def test_every_sector_is_read():
    """The checker's own rounding of the slope is that of the region, which rounds it down."""
    dice = np.random.default_rng(13)
    for damping in [*dice.uniform(1e-8, 1, 2000), *10 ** dice.uniform(-8, 0, 2000)]:
        (part,) = parts_of(Sector(float(damping)).document())
        ratio, slope = part.numbers
        steeper = slope * (1 + Fraction(1, 2**50))
        assert ratio**2 * (1 + slope**2) <= 1 < ratio**2 * (1 + steeper**2)


def test_regions_of_all_kinds_are_read_in_an_intersection():
    whole = HalfPlane(1) & Sector(0.3) & Ellipse(-9, 8, 7)
    assert len(parts_of(whole.document())) == 3
    assert set(CLASSES) == set(regions.KINDS)


def scalar(path, pole, region):
    """A design file of x' = pole x, with no control, that claims a region."""
    document = {
        "format": "polefence-proof",
        "version": 2,
        "plant": {
            "name": "x",
            **{key: [] for key in ("states", "inputs", "disturbances", "parameters")},
            "vertices": [{"A": [[pole]], "B": [[1]]}],
        },
        "law": {"kind": "fixed", "K": [[0]]},
        "claims": [
            {
                "kind": "region",
                "region": region,
                "method": "quadratic",
                "evidence": {"W": [[1]]},
            }
        ],
    }
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("pole", "region", "key"),
    [
        (5, {"kind": "disk", "centre": 5, "radius": 3}, "region.centre = 5 "),
        (-5, {"kind": "disk", "centre": -5, "radius": -3}, "region.radius = -3 "),
        (-5, {"kind": "sector", "damping": 0.5, "slope": 1.0}, "region.slope = 1 "),
        (-5, {"kind": "sector", "damping": 0.5, "slope": 2.0}, "region.slope = 2 "),
        (0, {"kind": "ellipse", "centre": 0.5, "real": 3, "imaginary": 1}, "region.centre = 0.5 "),
        (-1, {"kind": "vertical_strip", "low": 0, "high": -2}, "region.low = 0 "),
        (-5, {"kind": "half_plane", "decay": 1e-200}, "region.decay = 1e-200 "),
    ],
    ids=str,
)
def test_a_file_whose_numbers_make_no_region_is_bad_input(tmp_path, capsys, pole, region, key):
    """It says nothing that is false, so nothing refutes it."""
    path = scalar(tmp_path / "design.json", pole, region)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert str(path) in said.err
    assert key in said.err
    assert alone([str(path)]) == 2


def test_a_pole_outside_is_still_refuted(tmp_path, capsys):
    claims = [
        {"kind": "disk", "centre": -5, "radius": 3},
        Sector(0.5).document(),
        {"kind": "ellipse", "centre": -3, "real": 1, "imaginary": 2},
    ]
    for claim in claims:
        assert main(["check", str(scalar(tmp_path / "design.json", 5, claim))]) == 1
        assert "refuted: at alpha = (1) a pole is not in the region" in capsys.readouterr().out
