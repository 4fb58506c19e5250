"""The page about laws of others: its robot with gains that are cubic polynomials of a length."""

import re

import numpy as np
import pytest

from support.paths import DOCS

PAGE = (DOCS / "verify.md").read_text()
CODE, SHOWN = re.search(
    r"```python\n(import numpy as np\n.*?)```\n\n```text\n(.*?)```", PAGE, re.DOTALL
).groups()


def matrix(rows, L):
    return np.array([[eval(str(e), {"L": L}) for e in row] for row in rows], dtype=float)


def slowest(names, gains, lengths):
    """The decay rate of the loop at each length, from the texts alone."""
    loops = [matrix(names["A"], L) + matrix(names["B"], L) @ matrix(gains, L) for L in lengths]
    return np.array([-np.linalg.eigvals(loop).real.max() for loop in loops])


@pytest.fixture(scope="module")
def robot():
    names = {}
    printed = []
    exec(CODE, {"print": lambda *words: printed.append(" ".join(map(str, words))), **names}, names)
    return names, printed


def test_it_prints_what_is_shown(robot):
    for own, shown in zip(robot[1], SHOWN.splitlines(), strict=True):
        assert re.fullmatch(re.escape(shown).replace(r"\.\.\.", r"\d*"), own)


def test_its_decay_rate_is_that_of_a_fine_grid(robot):
    names, printed = robot
    gains = [[*names["texts"][:6]], names["texts"][6:]]
    least = slowest(names, gains, np.linspace(0.1, 0.4, 601)).min()
    proved = float(re.search(r"half_plane\((.*?)\)", printed[1])[1])
    assert proved <= least * (1 + 1e-9)
    assert proved == pytest.approx(least, rel=1e-4)


def test_its_counterexample_is_one(robot):
    names, printed = robot
    L = float(re.search(r"L = ([\d.]+) m", printed[2])[1])
    assert slowest(names, names["K"], [L]) < -1
    assert slowest(names, names["K"], [0.1, 0.25, 0.4]).min() > 1.9
