"""Regions of the complex plane for closed-loop poles."""

from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Intersection,
    Region,
    Sector,
    VerticalStrip,
    Wedge,
)

__all__ = [
    "Disk",
    "Ellipse",
    "HalfPlane",
    "HorizontalStrip",
    "Intersection",
    "Region",
    "Sector",
    "VerticalStrip",
    "Wedge",
]
