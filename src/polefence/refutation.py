"""Limits on rms values that no law whatever keeps at once: found in floats, proved exactly.

At one vertex the least weighted sum of mean squares over all laws is that of the linear-quadratic
regulator, E[sum a_i y_i^2] >= tr E'P E with P from a Riccati equation. Over its share of the
limits' own sum it is concave in the weights a, and its largest value is the square of the factor by
which every law exceeds one of the limits (Boyd & Barratt 1991, section 12.2: by duality no less).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from polefence.augmented import with_weights
from polefence.checks import require_type
from polefence.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.exact import FormatError, Rationals
from polefence.proof.performance import Output
from polefence.proof.performance.refutation import RmsLimit, RmsRefutation, prove_refutation
from polefence.region_text import digits_down
from polefence.regular import Regular, regular
from polefence.solve.tradeoff import NoRegulator, heaviest, regulator
from polefence.specification import Rms, Specification, disturbance, rows, signal_of

# Decay taken off the plant, of its own rates, so that P proves the inequality with a margin; and
# whether something is taken off the cost too, for directions that no output sees.
MARGINS = tuple((d, e) for e in (0.0, 1.0) for d in (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3))
