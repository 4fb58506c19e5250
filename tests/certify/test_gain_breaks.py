"""An error of the gain as a whole that leaves a region, and what is not tried then."""

from fractions import Fraction

import numpy as np
import pytest

from polefence import Disk, UncertainPlant, place
from polefence.base.errors import NotProvedError
from polefence.certify.design import Design
from polefence.certify.margins import claims
from polefence.certify.margins.breaks import breaks
from polefence.certify.margins.gain_scales import gain_claim
from polefence.export import guarantee
from polefence.export.exported import export_c99


@pytest.fixture(scope="module")
def car():
    A = [[[0.0, 1.0], [-2.0, -0.3]], [[0.0, 1.0], [-3.0, -0.2]]]
    return place(UncertainPlant.from_vertices(A, [[[0.0], [1.0]]] * 2), Disk(-5, 4), "quadratic")


def test_no_error_breaks_that_is_proved_to_be_borne(car):
    rows, columns = np.ones(1), np.array([2.0, 0.5])
    largest, claim = gain_claim(car, rows, columns, 0.0)
    assert claim is not None
    right = np.diag(columns)
    assert not breaks(car, car.region, rows, right, 0.999 * largest)
    assert breaks(car, car.region, rows, right, 100 * largest)
    # of one vertex Petersen's bound is sharp up to a factor: where it breaks, poles are outside
    sizes = largest * np.geomspace(1, 100, 40)
    first = next(e for e in sizes if breaks(car, car.region, rows, right, e))
    turns = [np.array([[np.cos(t), np.sin(t)]]) for t in np.linspace(0, 2 * np.pi, 200)]
    A, B = car.plant.A, car.plant.B

    def outside(error):
        loops = (
            a + b @ (car.law.K + error * D @ right)
            for a, b in zip(A, B, strict=True)
            for D in turns
        )
        return max(car.region.distance(np.linalg.eigvals(M)).max() for M in loops)

    assert outside(1.02 * first) > 0
    assert outside(0.7 * first) < 0


def test_a_law_at_its_edge_is_refused_without_other_matrices(car, monkeypatch):
    asked = []
    monkeypatch.setattr(claims, "analysed", lambda *given: asked.append(given) or given_up)
    given_up = claims.analyse(car.plant, car.law, Disk(-5, 2))
    assert given_up.certificate is None
    # a share of the gain that leaves the region, and one that is neither found to nor proved not to
    for off, tried in ((Fraction(1), False), (Fraction(1, 4), True)):
        asked.clear()
        monkeypatch.setattr(guarantee, "rounding_error", lambda claim, off=off: off)
        with pytest.raises(NotProvedError, match="rounding in float32 may change the gain"):
            export_c99(car, 32)
        assert bool(asked) is tried


def test_a_smaller_region_is_tried_by_no_more_than_proved_it(car, monkeypatch):
    wide = Design(claims.analyse(car.plant, car.law, Disk(-5, 4.5)).certificate)
    seen = []
    plain = claims.analysed
    monkeypatch.setattr(claims, "analysed", lambda *given: seen.append(given) or plain(*given))
    others = list(claims.firmer(wide, wide.region))
    assert others
    assert all(given[-1] is wide.certificate for given in seen)
    assert all(one.certificate.prove().proved for one in others)
