"""Responses of a plant under a law: steps, impulses, frequencies, stationary noise.

Values are in SI units, arrays (alpha, time or frequency, signal). `polefence` itself does not
import this package. The function `stationary` is named as the module that it is in: here the name
is the function.
"""

from polefence.plant.outputs import Output, Signal, inputs, rate_of, states, weighted_sum
from polefence.response.bands import (
    MOTION,
    RIDE,
    Bands,
    StationaryRide,
    quadrature,
    stationary_ride,
    thirds,
)
from polefence.response.linear import Frequency, Response, frequency, impulse, simulate, step
from polefence.response.loop_margins import (
    DiskRanges,
    LeastMargin,
    LoopMargins,
    MarginValues,
    disk_margin,
    disk_ranges,
    margins,
)
from polefence.response.opened import Opened, Place, family_points, opened, places
from polefence.response.stationary import Stationary, stationary, velocity_psd
from polefence.response.weighting import WD, WE, WF, WK, BandFilter, Weighting

__all__ = [
    "MOTION",
    "RIDE",
    "WD",
    "WE",
    "WF",
    "WK",
    "BandFilter",
    "Bands",
    "DiskRanges",
    "Frequency",
    "LeastMargin",
    "LoopMargins",
    "MarginValues",
    "Opened",
    "Output",
    "Place",
    "Response",
    "Signal",
    "Stationary",
    "StationaryRide",
    "Weighting",
    "disk_margin",
    "disk_ranges",
    "family_points",
    "frequency",
    "impulse",
    "inputs",
    "margins",
    "opened",
    "places",
    "quadrature",
    "rate_of",
    "simulate",
    "states",
    "stationary",
    "stationary_ride",
    "step",
    "thirds",
    "velocity_psd",
    "weighted_sum",
]
