"""The equations of a drive at given times: matrices of plant, actuator and stops, for all cars."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.vehicle.driving.parts import Actuator, BumpStops, Hardware
from polefence.vehicle.driving.scheduling import INSIDE, Gains, Reading
from polefence.vehicle.driving.trajectories import Courses
from polefence.vehicle.excitation import Excitation
from polefence.vehicle.vehicle import Ride, masses, require_ride

Row = tuple[Array, Array, Array, Array, Array | None]


@dataclass(frozen=True, eq=False)
class Pieces:
    """z' = F z + g + B u + S s at times: leading axes (times or 1, count).

    z is the state, behind it the forces of an actuator with a lag. u is the limited demand and s
    the stops' force. Where K is None the law is in F already; else u = K z.
    """

    F: Array
    g: Array
    B: Array
    S: Array
    K: Array | None

    def row(self, i: int) -> Row:
        """Return all at time number i."""
        F, g, B, S = [M[i if len(M) > 1 else 0] for M in (self.F, self.g, self.B, self.S)]
        return F, g, B, S, None if self.K is None else self.K[i if len(self.K) > 1 else 0]


@dataclass(frozen=True, eq=False)
class Model:
    """A drive's equations.

    ``reading`` gives the law's parameters where they do not depend on the state and the law is
    followed in continuous time; None where a controller sets gain or demand as it goes.
    """

    plant: UncertainPlant
    grid: Excitation
    courses: Courses
    gains: Gains
    reading: Reading | None
    hardware: Hardware
    known: Ride | None

    @property
    def actuator(self) -> Actuator:
        """That of the hardware."""
        return self.hardware.actuator

    @property
    def stops(self) -> BumpStops | None:
        """Those of the hardware."""
        return self.hardware.stops

    @property
    def gravity(self) -> float:
        """That of the hardware [m/s2]."""
        return self.hardware.gravity

    @property
    def width(self) -> int:
        """States, and forces of an actuator with a lag."""
        n, m = self.plant.shape
        return n + (m if self.actuator.rate else 0)

    @property
    def folded(self) -> bool:
        """Whether the law acts as it is, so that the loop is linear but for the stops."""
        return self.reading is not None and self.actuator.limit is None

    def open(self, times: Array, k: Array) -> tuple[Array, Array, Array]:
        """Return A, B and all that acts besides u, (times or 1, count, ...)."""
        alpha = self.courses.space.alpha(self.courses.at(times))
        A, B = self.plant.at(alpha)
        g = self.forcing(self.entry(alpha), times, k)
        if self.gravity and self.known is not None:
            place = self.known.places[2]
            share = self.first_load * B[..., place, self.known.input]
            g[..., place] -= self.gravity * (1 - share)
        return A, B, g

    def entry(self, alpha: Array) -> Array:
        """Return E at alpha, (..., n, q)."""
        Es = [v.E for v in self.plant.vertices if v.E is not None]
        if len(Es) < len(self.plant.vertices):
            return np.zeros((*alpha.shape[:-1], self.plant.shape[0], 0))
        return np.tensordot(alpha, np.stack(Es), 1)

    def forcing(self, E: Array, times: Array, k: Array) -> Array:
        """Return E w, (times, count, n)."""
        return np.asarray((E @ self.grid.disturbance(times, k)[:, None, :, None])[..., 0])

    @cached_property
    def first_load(self) -> Array:
        """Sprung masses of a quarter car as the drive begins, (count,) [kg]."""
        start = np.array([INSIDE * self.grid.step])
        alpha = self.courses.space.alpha(self.courses.at(start))[0]
        return masses(self.plant, require_ride(self.plant), alpha).m1

    def pieces(self, times: Array, k: Array) -> Pieces:
        """Return the equations at times (T,) that lie in steps number k (T,)."""
        A, B, g = self.open(times, k)
        n, m = self.plant.shape
        S = B[..., :, self.known.input] if self.known else np.zeros(B.shape[:-1])
        if self.width > n:
            rate, lead = self.actuator.rate, A.shape[:-2]
            F = np.zeros((*lead, n + m, n + m))
            F[..., :n, :n], F[..., :n, n:], F[..., n:, n:] = A, B, -rate * np.eye(m)
            g, S = (np.concatenate([v, np.zeros((*v.shape[:-1], m))], axis=-1) for v in (g, S))
            A, B = F, np.zeros((1, 1, n + m, m))
            B[..., n:, :] = rate * np.eye(m)
        if self.reading is None:
            return Pieces(A, g, B, S, None)
        K = self.padded(self.gains(self.reading.at(times)))
        return Pieces(A + B @ K, g, B, S, None) if self.folded else Pieces(A, g, B, S, K)

    def padded(self, K: Array) -> Array:
        """Return K with zeros for the actuator's forces."""
        extra = self.width - K.shape[-1]
        return np.concatenate([K, np.zeros((*K.shape[:-1], extra))], axis=-1) if extra else K

    def slope(
        self,
        z: Array,
        row: Row,
        gain: Array | None = None,
        held: Array | None = None,
    ) -> Array:
        """Return z' at z (count, width); ``gain`` or ``held`` demand where a controller set it."""
        F, g, B, S, K = row
        dz = (F @ z[:, :, None])[:, :, 0] + g
        if gain is not None:
            K = gain
        if held is not None or K is not None:
            u = held if held is not None else (K @ z[:, :, None])[:, :, 0]  # type: ignore[operator]
            dz = dz + (B @ self.actuator.limited(u)[:, :, None])[:, :, 0]
        if self.stops is not None and self.known is not None:
            x, sense = self.known.places[0], self.known.sense[0]
            dz = dz + S * self.stops.force(sense * z[:, x], sense * dz[:, x])[:, None]
        return np.asarray(dz)
