"""Families from measured data: responses in time or frequency, and what a family misses them by.

Nothing here is proved: a family that is fitted says so, and so does whatever is said of it.
"""

from polefence.data.files import Question, load_measurements
from polefence.data.grey import refined_ranges
from polefence.data.measured import FrequencyResponse, Measurement, Response, measured

__all__ = [
    "FrequencyResponse",
    "Measurement",
    "Question",
    "Response",
    "load_measurements",
    "measured",
    "refined_ranges",
]
