"""Laws: one gain, a gain scheduled on the parameters, a table of gains."""

from polefence.law.laws import FixedGain, Law, ScheduledGain
from polefence.law.table import GainTable

__all__ = ["FixedGain", "GainTable", "Law", "ScheduledGain"]
