"""Specs and design files that ask for too much are refused at once, not computed."""

from __future__ import annotations

import json
import time
from fractions import Fraction

import pytest

from polefence import PlantError, load
from polefence.cli.main import main
from polefence.plant.spec import loads
from polefence.proof import document as files
from polefence.proof import work
from polefence.proof.claims.base import prove
from polefence.proof.laws import Law

CHAIN = "\n".join(f'd{i} = "d{i - 1}*d{i - 1}"' for i in range(1, 60))
BOMBS = {
    "nested powers": '[[vertex]]\nA = [["(((((9**32)**32)**32)**32)**32)**32"]]\nB = [[1]]\n',
    "power of powers": '[[vertex]]\nA = [["9**(9**9)"]]\nB = [[1]]\n',
    "squaring chain": f'[parameter.k]\nrange = [1, 2]\n[definitions]\nd0 = "k"\n{CHAIN}\n'
    '[matrices]\nA = [["d59"]]\nB = [[1]]\n',
    "long integer": f"[[vertex]]\nA = [[{'9' * 350}]]\nB = [[1]]\n",
    "large": "[[vertex]]\nA = [[1e350]]\nB = [[1]]\n",
    "small": "[[vertex]]\nA = [[1]]\nB = [[1e-350]]\n",
    "product": '[[vertex]]\nA = [["1e300*1e300"]]\nB = [[1]]\n',
    "long fraction": '[[vertex]]\nA = [["1/3**32/5**32/7**32/11**32/13**32/17**32/19**32"]]\n'
    "B = [[1]]\n",
    "range": '[parameter.k]\nrange = [1e350, 2e350]\n[matrices]\nA = [["k"]]\nB = [[1]]\n',
    "large centre": "",
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_bomb_is_defused(bomb, tmp_path, capsys):
    path = tmp_path / "bomb.toml"
    path.write_text(BOMBS[bomb] or "[[vertex]]\nA = [[1]]\nB = [[1]]\n")
    start = time.monotonic()
    assert main(["limits", str(path), "--centre", "-1" if BOMBS[bomb] else "-1e300"]) == 2
    assert time.monotonic() - start < 10
    assert capsys.readouterr().err.count("\n") == 1


def test_many_parameters_are_read_in_good_time():
    """Eight parameters, 256 vertices: the multi-affinity test is one look at each entry."""
    names = [f"p{i}" for i in range(8)]
    parameters = "".join(f"[parameter.{n}]\nrange = [1, 2]\n" for n in names)
    entry = " + ".join(f"{i + 1}*{n}" for i, n in enumerate(names)) + " + p0*p1*p2"
    text = f'{parameters}[matrices]\nA = [["{entry}", 1], ["({entry})/(1 + p0*0)", 0]]\n'
    text += "B = [[0], [1]]\n"
    start = time.monotonic()
    assert len(loads(text).vertices) == 256
    assert time.monotonic() - start < 20


def test_long_common_denominators_are_refused_before_a_design_is_saved():
    primes = [3, 5, 7, 11, 13, 17, 19, 23, 29, 31]
    rows = [[f"1/{p}**{k}" for p in primes] for k in range(23, 33)]
    rows = [
        [f'"{e}*{1 + i}/{10**40 + 7 * i + 10 * j + 1}"' for j, e in enumerate(row)]
        for i, row in enumerate(rows)
    ]
    text = "[[vertex]]\nA = [" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]\n"
    text += "B = [" + ", ".join("[1]" for _ in range(10)) + "]\n"
    plant = loads(text)
    assert plant.shape == (10, 1)  # ten by ten long fractions are still fine
    many = text + "".join(
        text.replace(f"/{10**40}"[:6], f"/{10**40 + 1000 * k}"[:6]).replace("007", f"{k}07")
        for k in range(1, 9)
    )
    with pytest.raises(PlantError, match="common denominator"):
        loads(many)


def document(small_designs, **changes):
    text = json.loads(small_designs["scheduled"].certificate.dumps())
    for path, value in changes.items():
        place = text
        *keys, last = path.split("__")
        for key in keys:
            place = place[int(key) if key.isdigit() else key]
        place[int(last) if last.isdigit() else last] = value
    return json.dumps(text)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("law__K", [[1e9]], "unknown key law.K"),
        ("claims__0__evidence__W", [], "unknown key claims.1..evidence.W"),
        ("claims__0__region__radii", 3, "unknown key claims.1..region.radii"),
        ("version", True, "format version True"),
        ("version", 1.0, r"format version 1\.0"),
        ("law__W__0__0__0", "9" * 300 + "1", "finite number"),
        ("plant__vertices__0__A__0__0", f"1/{'9' * 302}", "finite number"),
    ],
)
def test_what_a_design_file_may_not_hold(small_designs, path, value, message):
    with pytest.raises(work.FormatError, match=message):
        files.loads(document(small_designs, **{path: value}))


def test_a_design_file_with_endless_denominators_is_refused(small_designs):
    text = json.loads(document(small_designs))
    text["plant"]["vertices"][0]["A"] = [
        [f"1/{10**299 + 2 * (i + 40 * j) + 1}" for i in range(40)] for j in range(40)
    ]
    text["plant"]["vertices"][0]["B"] = [[1, 1]] * 40
    text["plant"]["vertices"] = text["plant"]["vertices"][:1]
    with pytest.raises(work.FormatError, match="common denominator"):
        files.loads(json.dumps(text))


def test_a_centre_on_the_right_is_not_proved(small_designs, tmp_path):
    """A claim about a disk in the right half-plane is no design, whatever its inequalities say."""
    with pytest.raises(work.FormatError, match="centre = 3 must be negative"):
        files.loads(document(small_designs, claims__0__region__centre=3.0))


def test_claims_put_together_by_hand_must_be_consistent(small_designs):
    from dataclasses import replace

    quadratic = small_designs["quadratic"].certificate.claim()
    (evidence,), K = quadratic.evidence, quadratic.law.K
    X = evidence.X
    for damage in (
        {"evidence": (replace(evidence, G=X[0]),)},
        {"evidence": (replace(evidence, X=[]),)},
        {"evidence": (replace(evidence, multiple=(Fraction(1),)),)},
        {"evidence": (replace(evidence, degree=1),)},
        {"evidence": (replace(evidence, elevation=-1),)},
        {"evidence": (replace(evidence, elevation=10**6),)},
        {"evidence": (replace(evidence, tau=Fraction(1)),)},
        {"evidence": (evidence, evidence)},
        {"evidence": ()},
        {"law": Law()},
        {"law": Law(K=K, Z=K)},
        {"law": Law(K=[*K, *K])},
        {"method": "cubic"},
        {"method": "slack"},
        {"method": "scheduled"},
        {"on": "box"},
        {"on": "ball"},
        {"weights": (Fraction(1),) * 3},
        {"region": ()},
        {"A": []},
        {"B": quadratic.B[:1]},
    ):
        with pytest.raises(work.FormatError):
            prove(replace(quadratic, **damage))


def test_spec_files_that_are_not_there(tmp_path):
    with pytest.raises(Exception, match="cannot be read"):
        load(tmp_path)
