"""Gappa scripts of exported laws: the dataflow of the C, and the bound stated of its rounding.

`Gappa <https://gappa.gitlabpages.inria.fr>`_ bounds the error of a program in floats by intervals
and rewriting, and knows nothing of us. Each row of a law is a script: every operation of the C in
its order, rounded to float32; the same in real numbers with the exact constants of the design; and
what `rounding` claims says that they are apart, for signals of given sizes. A parameter's place in
its interval is a script of its own, whose bound the rows then take.

The clamps of the C are left out: what is clamped is no farther from a number between the bounds.
"""

import re
import subprocess
from fractions import Fraction
from math import ceil, floor

from polefence.proof.claims.rounding import Rounded, _gain, gain_errors, share_error
from polefence.proof.matrices import Rationals
from support.needed import need

HARMLESS = "renaming identifier", "maximum number of iterations"
HEAD = "@rnd = float<ieee_32, ne>;\n"


def proved(script: str) -> bool:
    """Whether Gappa proves a script."""
    return _run(script)[0] == 0


def reached(script: str) -> Fraction:
    """Return the least bound that Gappa proves by itself of the goal of a script."""
    goal = re.sub(r"-> \|(.*)\| <= .* \}", r"-> |\1| in ? }", script)
    status, said = _run(goal)
    found = re.search(r"\| in \[.*?, (-?\d+)(?:b(-?\d+))?[ ,\]{]", said)
    assert status == 0, said
    assert found, said
    return Fraction(int(found[1])) * Fraction(2) ** int(found[2] or 0)


def _run(script: str) -> tuple[int, str]:
    done = subprocess.run(
        [need("gappa"), "-Eprecision=100"], input=script, capture_output=True, text=True, timeout=60
    )
    said = [line for line in done.stderr.splitlines() if not any(map(line.count, HARMLESS))]
    # such as a rewriting that Gappa would have to take on trust
    if any("Warning" in line or "syntax error" in line for line in said):
        raise AssertionError("\n".join([*said, script]))
    return done.returncode, done.stderr + done.stdout


def share_script(claim: Rounded, k: int) -> str:
    """Return the script about the place of parameter k in its interval, from 0 to 1."""
    share, given = claim.code.shares[k], claim.gain.subject.ranges[k]
    width = given.high - given.low
    over = " / p" if given.inverted else ""
    scale = given.high / width if given.inverted else 1 / width
    off, low = scale - share.scale, given.low - share.low
    return (
        f"{HEAD}p = rnd(p_);\n"
        f"m rnd= {_text(share.scale)} * (p - {_text(share.low)}){over};\n"
        f"code = {_text(share.scale)} * (p - {_text(share.low)}){over};\n"
        f"d = ({_text(off)} * (p - {_text(share.low)} - {_text(low)})"
        f" - {_text(share.scale)} * {_text(low)}){over};\n"
        "exact = code + d;\n"
        f"{{ p in [{_limit(given.low, up=False)}, {_limit(given.high, up=True)}]"
        f" -> |m - exact| <= {_limit(share_error(claim.code, share, given), up=False)} }}\n"
        f"m - exact -> (m - code) - d{' { p <> 0 }' if over else ''};\n"
    )


def bound(claim: Rounded, row: int, sizes: list[Fraction]) -> Fraction:
    """Return what is stated of an answer, u or a state after its step, with |y_j| <= sizes[j]."""
    total = sum(e * y for e, y in zip(gain_errors(claim)[row], sizes, strict=True))
    return total * (claim.code.memory.sample_time if _steps(claim, row) else 1)


def row_script(claim: Rounded, row: int, sizes: list[Fraction], most: Fraction) -> str:
    """Return the script that says that a row of the law is off by no more than ``most``."""
    code, law = claim.code, claim.gain.subject.design.law
    gains = [code.K] if code.K is not None else list(code.terms)
    powers = [()] if code.K is not None else law.powers
    signals = range(len(sizes))
    lines = [f"y{j} = rnd(y{j}_);" for j in signals]
    given = [f"|y{j}| <= {_text(size)}" for j, size in enumerate(sizes)]
    for k, share in enumerate(code.shares):
        off = share_error(code, share, claim.gain.subject.ranges[k])
        lines += [f"m{k} = rnd(m{k}_);", f"l{k} rnd= 1 - m{k};", f"c{k} rnd= m{k} - l{k};"]
        lines += [f"C{k} = s{k} - (1 - s{k});"]
        given += [f"m{k} in [0, 1]", f"s{k} in [0, 1]", f"|m{k} - s{k}| <= {_limit(off, up=True)}"]
    for k, e in enumerate(powers):
        factors = [j for j, power in enumerate(e) for _ in range(power)]
        lines += [f"w{k} rnd= {' * '.join(f'c{j}' for j in factors) or '1'};"]
        lines += [f"W{k} = {' * '.join(f'C{j}' for j in factors) or '1'};"]
    for j in signals:
        terms = [_text(g[row][j]) for g in gains]
        for name, w, how in (("k", "w", "rnd="), ("K", "W", "=")):
            entry = " + ".join(f"{term} * {w}{k}" for k, term in enumerate(terms))
            lines += [f"{name}{j} {how} {entry if powers != [()] else terms[0]};"]
    lines += [f"u rnd= {' + '.join(f'k{j} * y{j}' for j in signals)};"]
    lines += [f"code = {' + '.join(f'K{j} * y{j}' for j in signals)};"]
    apart = [
        f"{_text(a[row][j] - b[row][j])} * W{k} * y{j}"
        for k, (a, b) in enumerate(zip(exact_gains(claim), gains, strict=True))
        for j in signals
    ]
    lines += [f"d = {' + '.join(apart)};"]
    answer, near, more = "u", "code", "d"
    if _steps(claim, row):
        memory = code.memory
        own = len(sizes) - memory.states + row - (len(gains[0]) - memory.states)
        h, T = _text(memory.step), _text(memory.sample_time)
        lines += [f"x rnd= y{own} + {h} * u;", f"after = y{own} + {h} * code;"]
        lines += [f"e = {_text(memory.sample_time - memory.step)} * code + {T} * d;"]
        answer, near, more = "x", "after", "e"
    lines += [f"exact = {near} + {more};"]
    hypotheses = " /\\ ".join(given)
    goal = f"{{ {hypotheses} -> |{answer} - exact| <= {_limit(most, up=False)} }}"
    hint = f"{answer} - exact -> ({answer} - {near}) - {more};"
    return HEAD + "\n".join([*lines, goal, hint]) + "\n"


def exact_gains(claim: Rounded) -> list[Rationals]:
    """Return the design's gains, one for each of the code's."""
    law = claim.gain.subject.design.law
    return [_gain(claim)] if claim.code.K is not None else list(law.K or [])


def _steps(claim: Rounded, row: int) -> bool:
    """Whether a row is of a state of the law's own."""
    memory, rows = claim.code.memory, claim.code.K or claim.code.terms[0]
    return memory is not None and row >= len(rows) - memory.states


def _limit(value: Fraction, *, up: bool) -> str:
    """Return a number of binary digits near a rational, on the side that proves more."""
    digits = 60 - (value.numerator.bit_length() - value.denominator.bit_length())
    scaled = value * Fraction(2) ** digits
    return f"{ceil(scaled) if up else floor(scaled)}b{-digits}"


def _text(value: Fraction) -> str:
    """Return a rational as Gappa reads it."""
    if value < 0:
        return f"(-{_text(-value)})"
    bottom = value.denominator
    if bottom & (bottom - 1) == 0:
        return f"{value.numerator}b-{bottom.bit_length() - 1}"
    return f"({value.numerator} / {bottom})"
