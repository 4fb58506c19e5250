"""Laws: one gain, a gain scheduled on the parameters, a table of gains."""

from polefence.law.laws import FixedGain, GainTable, Law, PolynomialGain, ScheduledGain

__all__ = ["FixedGain", "GainTable", "Law", "PolynomialGain", "ScheduledGain"]
