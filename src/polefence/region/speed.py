"""A bound on how fast poles may be: without one, gains may grow without bound."""

from __future__ import annotations

from polefence.region.regions import Disk, Ellipse, Region, VerticalStrip


def bounds_speed(region: Region | None) -> bool:
    """Whether the region bounds the real parts of poles on both sides."""
    parts = () if region is None else region.parts
    return any(isinstance(part, Disk | Ellipse | VerticalStrip) for part in parts)


def bounded(region: Region | None, fastest: float) -> Region:
    """Return the region within the disk that touches the imaginary axis and reaches so far.

    A region that bounds the speed of poles itself is returned as it is.
    """
    if region is not None and bounds_speed(region):
        return region
    # rounded, so that people can read it
    half = float(f"{fastest / 2:.2g}")
    disk = Disk(-half, half)
    return disk if region is None else region & disk
