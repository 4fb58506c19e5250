"""Crossing a bump: what its height, or the rate of its height, makes of a signal, from rest.

The height is that of `polefence.proof.drives.Bump`, which is crossed in length / speed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.measured import MeasuredResponse
from polefence.proof.claims.signal import Subject
from polefence.proof.drives import Bump
from polefence.proof.matrices import ONE, ZERO
from polefence.proof.plant import Output, Plant, split
from polefence.proof.polynomials import Polynomial
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down, number_text, quoted
from polefence.proof.work import FormatError

HEIGHT, RATE = "height", "rate"


@dataclass(frozen=True)
class BumpResponse(MeasuredResponse):
    """A measure of y while a bump is crossed, and after it, is at most ``level``.

    Attributes
    ----------
    height, length, speed : Fraction
        [m], [m] and [m/s].
    acts : tuple of str
        Whether each disturbance is the "height" of the road, times its scale, or its "rate".
    late : tuple of Fraction
        How much later each comes to the bump [s].
    """

    kind: ClassVar[str] = "bump"

    height: Fraction = field(default=ZERO, kw_only=True)
    length: Fraction = field(default=ZERO, kw_only=True)
    speed: Fraction = field(default=ZERO, kw_only=True)
    acts: tuple[str, ...] = field(default=(), kw_only=True)
    late: tuple[Fraction, ...] = field(default=(), kw_only=True)

    @classmethod
    def read_extra(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read the bump, too."""
        own = {key: table.number(key) for key in ("height", "length", "speed")}
        return {
            **super().read_extra(table, subject, outputs),
            **own,
            "acts": table.texts("acts"),
            "late": table.numbers("late", subject.q),
        }

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        own = {key: plain(getattr(self, key)) for key in ("height", "length", "speed", "late")}
        return own | {"acts": list(self.acts)} | super().write_extra()

    def require_extra(self) -> None:
        """Refuse a bump that is none, too."""
        super().require_extra()
        for key in ("height", "length", "speed"):
            if getattr(self, key) <= 0:
                raise FormatError(f"{key} of a bump must be above zero")
        q = self.subject.q
        if len(self.acts) != q or any(word not in (HEIGHT, RATE) for word in self.acts):
            raise FormatError(f'acts must hold "{HEIGHT}" or "{RATE}" for each of {q} disturbances')
        if len(self.late) != q or any(t < 0 for t in self.late):
            raise FormatError(f"late must hold {q} times of zero or more")

    @property
    def driving(self) -> Polynomial:
        """The disturbances, as they act."""
        return self.subject.driving(self.scales, self.subject.sizes)

    @property
    def drives(self) -> tuple[Bump, ...]:
        """The bump, as each disturbance comes to it."""
        duration = self.length / self.speed
        return tuple(
            Bump(self.height, late, duration, word == RATE)
            for late, word in zip(self.late, self.acts, strict=True)
        )

    @property
    def passing(self) -> Polynomial | None:
        """What the disturbances add to the output."""
        return self.subject.through(self.outputs, self.scales)

    @property
    def after(self) -> str:
        """The bump, in numbers."""
        height, length, speed = map(number_text, (self.height, self.length, self.speed))
        return f"over a bump of {height} m in {length} m at {speed} m/s"

    def acting_words(self, plant: Plant) -> str:
        """Say what each disturbance is of the bump, and how much later."""
        said, labels, scales = [], plant.disturbances, self.scales or (ONE,) * self.subject.q
        for k, (scale, word, late) in enumerate(zip(scales, self.acts, self.late, strict=True)):
            if not scale:
                continue
            name = f"{quoted(split(labels[k])[0])} = " if k < len(labels) else ""
            times = "" if scale == 1 else f"{digits_down(scale)} times "
            later = f", {number_text(late)} s later" if late else ""
            said.append(f"{name}w{k + 1} is {times}its {word}{later}")
        alone = "" if all(scales) else " alone"
        return f", where {' and '.join(said)}{alone}"
