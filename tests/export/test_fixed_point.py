"""Code in fixed point: its integers against exact arithmetic, and each term of the error."""

from fractions import Fraction

import numpy as np
import pytest

from polefence import Design, InputError, analyse
from polefence.certify.given import worst_case
from polefence.export import check_guarantee, export_c99
from polefence.export.guarantee import roundings
from polefence.law.laws import PolynomialGain
from polefence.plant.outputs import states
from polefence.proof.claims import rounding, words
from polefence.proof.claims.words import Scales, two
from polefence.proof.work import FormatError
from support.commands import ran, refused
from support.cortex import run
from support.files import rewritten
from support.fixed_points import KINDS, RANGES, Exact, WordCode, exported, law_design
from support.shapes_of_laws import STRICT

COUNT = 400


def worst(made, folder, count=COUNT, seed=0):
    """Return the largest error of the code, as a share of what is stated."""
    code, exact, random = WordCode(made, folder), Exact(made), np.random.default_rng(seed)
    most = Fraction(0)
    for k in range(count):
        given, x, own = exact.random(random, k)
        found, _ = code.update(given, x, own)
        tops = [exact.top] * exact.m + exact.ranges
        for value, (wanted, error), top in zip(
            found, exact.answers(given, x, own), tops, strict=True
        ):
            off = abs(value - max(-top, min(top, wanted)))
            assert error > 0 or off == 0
            most = max(most, off / error) if error else most
    return float(most)


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize("kind", KINDS)
def test_the_error_is_within_what_is_stated_and_near_to_it(host_compiler, kind, bits, tmp_path):
    share = worst(exported(kind, bits), tmp_path)
    assert share <= 1
    assert share > 0.1


@pytest.mark.parametrize(
    ("kind", "bits"),
    [("one gain", 16), ("square", 32), ("own state", 32), ("scheduled", 32), ("degree 2", 16)],
)
def test_the_folder_is_proved_and_its_own_test_passes(host_compiler, kind, bits, tmp_path, capsys):
    made = exported(kind, bits)
    assert made.proved
    made.save(tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror -ftrapv", cwd=tmp_path).splitlines()
    assert lines[-1].endswith("passed (0 failed)")
    assert f"as the fixed{bits} code computes it" in ran(capsys, "check", tmp_path)
    text = made.files["law.c"].decode() + made.files["law.h"].decode()
    code = [line for line in text.splitlines() if not line.lstrip().startswith(("*", "/*"))]
    assert not any(word in line for line in code for word in ("float", "double", "<math"))
    run("gcc", *STRICT, "-c", "law.c", "-o", "law.o", cwd=tmp_path)


@pytest.mark.parametrize("bits", [16, 32])
def test_what_is_too_large_is_cut_and_does_not_wrap(host_compiler, bits, tmp_path):
    made = exported("own state", bits, 0.5)
    code, exact = WordCode(made, tmp_path), Exact(made)
    limit = int(Fraction(1, 2) * two(exact.scales.answers[0]))
    least, top = -exact.top - 1, exact.top
    edge = exact.ranges[0]
    far = 2 ** (2 * bits - 1)
    for y in (least, top):
        for own in (-far, -edge, 0, edge, far - 1):
            for given in ([least, least], [top, top], [0, 0]):
                (u, state), flags = code.update(given, [y], [own])
                assert abs(u) <= limit
                assert abs(state) <= edge
                assert flags & 1  # parameters are far outside
    (u, _), flags = code.update([1 << (bits - 3), 10 << (bits - 6)], [top], [0])
    assert (abs(u), flags & 8) == (limit, 8)


# --- the bound -----------------------------------------------------------------------------------


def stated(claim):
    """The error of each entry of the gain, anew, of a law of parameters; and that of u."""
    code, subject = claim.code, claim.gain.subject
    law, scales, bits = subject.design.law, code.scales, code.bits
    h = Fraction(1, 2 ** (bits - 1))
    ends = []
    for share, given in zip(code.shares, subject.ranges, strict=True):
        width = given.high - given.low
        true = given.high / width if given.inverted else 1 / width
        reach = share.high - share.low
        off = abs(share.scale - true) * reach + abs(true) * (given.low - share.low)
        if given.inverted:
            off /= min(abs(share.low), abs(share.high))
        ends.append(2 * (off + h))
    E = []
    for i, r in enumerate(scales.rows):
        row = []
        for j, s in enumerate(scales.signals):
            entry = Fraction(1, 2) * two(s - r)
            for e, K, rounded in zip(law.powers, law.K, code.terms, strict=True):
                of_c = sum(k * end for k, end in zip(e, ends, strict=True))
                of_c += h * max(0, sum(e) - 1)
                entry += abs(K[i][j] - rounded[i][j]) + of_c * abs(rounded[i][j])
            row.append(entry)
        E.append(row)
    return E, [two(-t) / 2 for t in scales.answers]


@pytest.mark.parametrize(("kind", "bits"), [("square", 16), ("square", 32), ("below zero", 16)])
def test_the_bound_is_the_sum_of_its_terms(kind, bits):
    claim = exported(kind, bits).guarantee.claim
    E, off = stated(claim)
    assert rounding.gain_errors(claim) == E
    assert rounding.answer_errors(claim.code) == off


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_proof_must_bear_is_no_less_than_the_bound(kind, bits):
    """The nearest float may be: then no proof of the loop at samples has enough."""
    made = exported(kind, bits)
    for one in roundings(made.guarantee.design, made.program):
        assert one.needed >= rounding.rounding_error(one.blank)


FAULTS = {
    "no rounding of constants": (
        words,
        "gain_errors",
        lambda exact, code, *more: PLAIN["gain_errors"](code, code, *more),
    ),
    "no rounding of entries": (
        words,
        "gain_errors",
        lambda exact, code, off, scales, varies: PLAIN["gain_errors"](
            exact, code, off, scales, False
        ),
    ),
    "no errors of c": (
        rounding,
        "word_errors",
        lambda claim: [Fraction(0)] * len(claim.code.terms),
    ),
    "no rounding of the answer": (
        words,
        "answer_errors",
        lambda code, scales, states: [
            error - two(-t - 1)
            for error, t in zip(
                PLAIN["answer_errors"](code, scales, states), scales.answers, strict=True
            )
        ],
    ),
    "no rounding of states that are read": (
        words,
        "answer_errors",
        lambda code, scales, states: PLAIN["answer_errors"](code, scales, 0),
    ),
}
PLAIN = {"gain_errors": words.gain_errors, "answer_errors": words.answer_errors}
SHOWS = {
    "no rounding of constants": "one gain",
    "no rounding of entries": "flat",
    "no errors of c": "steep",
    "no rounding of the answer": "one gain",
    "no rounding of states that are read": "own state",
}


def designed(kind):
    """Laws in which one term of the error is nearly all: of whole numbers, which round exactly."""
    if kind not in ("flat", "steep"):
        return law_design(kind)
    plant = law_design("square").plant
    small = 2.0**-12 if kind == "flat" else 2.0
    gains = [[[-4.0, -4.0]], [[small, small]]]
    law = PolynomialGain(((0, 0), (1, 0)), gains, states(plant), plant.parameters)
    return analyse(plant, law, law_design("square").region).design


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bound_without_one_of_its_terms_is_exceeded(host_compiler, fault, monkeypatch, tmp_path):
    kind = SHOWS[fault]
    if kind in ("flat", "steep"):
        made = export_c99(designed(kind), fixed=16, ranges=RANGES)
    else:
        made = exported(kind, 16)
    assert worst(made, tmp_path, 2000, seed=3) <= 1
    monkeypatch.setattr(*FAULTS[fault])
    assert worst_or_none(made, tmp_path) > 1


def worst_or_none(made, folder):
    """Return the same, infinite where an error is stated to be zero and is not."""
    try:
        return worst(made, folder, 2000, seed=3)
    except AssertionError:
        return np.inf


# --- what a file may say -------------------------------------------------------------------------


def test_a_file_that_says_less_of_its_integers_is_refused(tmp_path):
    made = exported("square", 16)
    for key, change in (
        ("signals", lambda v: [v[0] - 3, *v[1:]]),  # coarser signals: smaller constants
        ("rows", lambda v: [v[0] + 1, *v[1:]]),  # a sum that has no room
        ("answers", lambda v: [v[0] + 1, *v[1:]]),  # another code than that in the folder
        ("given", lambda v: [v[0] + 1, *v[1:]]),
        ("given", lambda v: v[:1]),
    ):
        made.save(tmp_path)
        with rewritten(tmp_path / "guarantee.json") as whole:
            scales = whole["claims"][0]["code"]["scales"]
            scales[key] = change(scales[key])
        try:
            proved = check_guarantee(tmp_path).proved
        except (FormatError, InputError, ValueError):
            proved = False
        assert not proved, key


def test_sums_and_constants_are_bounded():
    one = [[[Fraction(1)]]]
    fits = Scales((0,), (), (14,), (0,))
    words.require(16, one, fits, 0, 0)
    for scales, entries in (
        (Scales((0,), (), (15,), (0,)), one),  # 2^15 is no integer of 16 bits
        (Scales((0,), (), (14,), (15,)), one),  # more bits than there are
        (fits, [[[Fraction(1, 3)]]]),
        (fits, [[[Fraction(1)] * 1]] * 3),  # terms' sum
        (Scales((0,), (), (14, 14), (0,)), one),
    ):
        with pytest.raises(FormatError):
            words.require(16, entries, scales, 0, 0)
    five = [[[Fraction(1)] * 5]]
    with pytest.raises(FormatError, match="a sum may take"):
        words.require(16, five, Scales((0,) * 5, (), (14,), (0,)), 0, 0)


# --- what is asked -------------------------------------------------------------------------------


def test_what_is_missing_is_said_in_a_line(tmp_path, capsys):
    law_design("one gain").save(tmp_path / "d")
    base = ["export", tmp_path / "d", "-o", tmp_path / "c"]
    said = refused(capsys, *base, "--fixed", "16", "--range", "position = 0.3")
    assert "--fixed needs the range of speed" in said
    assert "--range 'speed = 0.1'" in said
    both = [x for name, v in RANGES.items() for x in ("--range", f"{name} = {v}")]
    assert "is of no signal" in refused(capsys, *base, "--fixed", "16", "--range", "force = 3")
    assert "must be a name and a number" in refused(capsys, *base, "--fixed", "16", "--range", "x")
    assert "give --fixed too" in refused(capsys, *base, *both)
    assert "not allowed with" in refused(capsys, *base, "--fixed", "16", "--float", "32", *both)
    said = ran(capsys, *base, "--fixed", "16", *both)
    assert "fixed-point code, 16 bits" in said
    assert "an absolute error" in " ".join(said.split())


def test_a_word_that_cannot_hold_the_gains_says_which_can():
    design = law_design("one gain")
    edge = Design(worst_case(design.plant, design.law, "half_plane").certificate)
    with pytest.raises(InputError, match="cannot hold the gains.*take --fixed 32"):
        export_c99(edge, fixed=16, ranges=RANGES)
    assert export_c99(edge, fixed=32, ranges=RANGES).proved
