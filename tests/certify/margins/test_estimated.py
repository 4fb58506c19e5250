"""Laws designed for estimates that are off: poles at pairs of parameters and estimates; faults."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, NotProvedError
from polefence.certify.margins.service import estimation_error
from polefence.proof.claims.base import prove
from polefence.proof.document import check, loads
from support.commands import refused

REGION = pf.Disk(-40, 33)
ERRORS = {"m1": 40}


@pytest.fixture(scope="module")
def car():
    return pf.examples.family("quarter-car-physical")


@pytest.fixture(scope="module")
def design(car):
    return pf.place(car, REGION, errors=ERRORS)


def worst(car, law, errors, count=1500):
    """The largest distance from the centre of a pole, at pairs of parameters and estimates."""
    random, most = np.random.default_rng(0), 0.0
    low, high = (np.array([float(getattr(p, e)) for p in car.parameters]) for e in ("low", "high"))
    size = np.array([errors.get(p.name, 0.0) for p in car.parameters], dtype=float)
    for _ in range(count):
        q = low + (high - low) * random.choice([0.0, 1.0, random.uniform()], size=len(low))
        p = np.clip(
            q + size * random.choice([-1.0, 1.0, random.uniform(-1, 1)], len(low)), low, high
        )
        at, given = (
            np.array([float(x) for x in car.alpha(**dict(zip(("m1", "beta"), v, strict=True)))])
            for v in (p, q)
        )
        A, B = (M[0] for M in car.at(at[None]))
        poles = np.linalg.eigvals(A + B @ law.gain(given))
        most = max(most, np.abs(poles - REGION.centre).max())
    return most


def test_estimates_may_be_off_by_more_than_a_law_bears_that_was_not_designed_for_it(car, design):
    own = pf.place(car, REGION)
    margin = next(m for m in estimation_error(own) if m.name == "estimate-m1")
    assert margin.value < 10
    assert margin.upper < 40  # there a pole leaves, in exact arithmetic
    assert worst(car, own.law, ERRORS) > REGION.radius
    assert worst(car, design.law, ERRORS) < REGION.radius


def test_the_file_holds_both_claims(design, tmp_path):
    document = loads(design.save(tmp_path).read_text())
    answer = check(document)
    assert answer.proved
    assert [claim.kind for claim in document.claims] == ["region", "estimate"]
    assert document.claims[1].errors == (40, 0)
    assert "m1 wrong by up to 40 kg" in answer.claims[1]


def test_larger_errors_are_not_proved(design):
    (claim,) = design.more
    assert prove(claim).proved
    assert not prove(replace(claim, errors=(Fraction(90), Fraction(0)))).proved
    assert not prove(replace(claim, errors=(Fraction(40), Fraction(20)))).proved


def test_all_parameters_at_once(car):
    errors = {"m1": 20, "beta": 3}
    own = pf.place(car, REGION, errors=errors)
    assert worst(car, own.law, errors) < REGION.radius


def test_parts_of_a_region(car):
    region = pf.HalfPlane(5) & pf.Sector(0.2) & pf.Disk(-60, 60)
    own = pf.place(car, region, errors={"m1": 30})
    assert all(prove(claim).proved for claim in (own.certificate.claim(), *own.more))


def test_what_cannot_be_borne_is_not_proved(car):
    with pytest.raises(NotProvedError, match="with m1 off by 100; try smaller errors"):
        pf.place(car, pf.Disk(-40, 29.5), errors={"m1": 100})


@pytest.mark.parametrize(
    ("errors", "more", "says"),
    [
        ({"m3": 1}, {}, "no parameter 'm3'; known: beta, m1"),
        ({"m1": -1}, {}, "error of m1 = -1 must be zero or more"),
        ({"m1": 500}, {}, "at most the width of its range, 115.56"),
        ({"m1": 0}, {}, "each is zero"),
        ({"m1": float("nan")}, {}, "must be a finite number"),
        ({"m1": 1}, {"method": "quadratic"}, "one gain needs no estimates"),
        ({"m1": 1}, {"method": "slack"}, "one gain needs no estimates"),
        ({"m1": 1}, {"structure": pf.Structure()}, "leave them out"),
    ],
)
def test_errors_that_are_none(car, errors, more, says):
    with pytest.raises(InputError, match=says):
        pf.place(car, REGION, errors=errors, **more)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--error", "m1"], "--error 'm1' is not NAME=SIZE"),
        (["--error", "m1=x"], "is not NAME=SIZE"),
        (["--error", "m1=1", "--error", "m1=2"], "--error m1 is given twice"),
    ],
)
def test_what_the_command_line_refuses(words, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(pf.examples.spec_text("quarter-car-physical"))
    assert says in refused(capsys, "design", "car.toml", "--disk", "-40", "33", *words)
