"""How far the ranges of a plant's parameters may grow before a law loses what it keeps."""

from polefence.certify.robust.reach import (
    MARGINS,
    REFUTED,
    Attained,
    Reach,
    Robustness,
    robust,
)

__all__ = ["MARGINS", "REFUTED", "Attained", "Reach", "Robustness", "robust"]
