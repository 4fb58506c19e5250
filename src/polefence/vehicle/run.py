"""One plant under one law over time: exact where nothing changes or saturates, else a drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, inputs, states
from polefence.plant.system import Array
from polefence.region.text import digits_down
from polefence.response import linear
from polefence.response.closed import close
from polefence.response.grid import longest_step
from polefence.response.result import Response
from polefence.vehicle.driving.drive import drive
from polefence.vehicle.driving.events import Event, spans, summary
from polefence.vehicle.driving.integration import LOST
from polefence.vehicle.driving.parts import Actuator, Hardware
from polefence.vehicle.driving.result import GRAVITY, RUNS_AWAY
from polefence.vehicle.driving.trajectories import Trajectories, read_trajectories
from polefence.vehicle.excitation import Excitation
from polefence.vehicle.vehicle import masses, ride

Column = tuple[str, str, Array]


@dataclass(frozen=True, eq=False)
class Setup:
    """What moves a plant, and with which hardware.

    Attributes
    ----------
    plant : UncertainPlant
    excitation : Excitation
    parameters : mapping or array, optional
        As `drive` takes them, for one plant.
    outside : bool
        Drive on where parameters leave their intervals.
    hardware : Hardware
        As `drive` takes it.
    """

    plant: UncertainPlant
    excitation: Excitation
    parameters: Mapping[str, Any] | Array | None = None
    outside: bool = False
    hardware: Hardware = field(default_factory=Hardware)

    @property
    def time(self) -> Array:
        """All instants [s]."""
        return self.excitation.times

    @property
    def step(self) -> float:
        """Between instants [s]."""
        return self.excitation.step

    @cached_property
    def trajectories(self) -> Trajectories:
        """Parameters over time, checked."""
        found = read_trajectories(self.plant, self.parameters, self.time)
        found.check(self.time, self.outside)
        return found

    @cached_property
    def alpha(self) -> Array:
        """Weights of the vertices at time 0, (1, N)."""
        return self.trajectories.space.alpha(self.trajectories.at(np.zeros(1))[0])

    @property
    def still(self) -> bool:
        """Whether nothing moves and the law is told the truth."""
        return self.trajectories.constant and not self.hardware.learns

    @property
    def exact(self) -> bool:
        """Whether the plant is linear and constant throughout, and nothing stands beside it."""
        return self.hardware == Hardware() and self.still and not self.outside


@dataclass(frozen=True, eq=False)
class Run:
    """What came of it.

    Attributes
    ----------
    setup : Setup
    response : Response
        All signals, of one car.
    more : tuple of (name, unit, values)
        What else there was: demands, forces of the stops, parameters.
    events : tuple of Event
    notes : tuple of str
        As those of a `Drive`.
    covered : (time,) array of bool, optional
        As that of a `Drive`; None where no margins were given.
    """

    setup: Setup
    response: Response
    more: tuple[Column, ...] = ()
    events: tuple[Event, ...] = ()
    notes: tuple[str, ...] = ()
    covered: Any = None

    @property
    def lost(self) -> Event | None:
        """Of a loop that runs away: since when."""
        return next((event for event in self.events if event.kind == "lost"), None)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Name, unit and values (time,) of every signal."""
        own = zip(self.response.signals, self.response.values[0].T, strict=True)
        return (*((s.name, s.unit, values) for s, values in own), *self.more)

    def report(self) -> list[str]:
        """Return in plain lines where the guarantee does not hold, and what is in none."""
        lines = summary(self.events, 1) or ["no limit was met"]
        if self.covered is not None:
            end = self.response.time[-1]
            lasting = self.covered[:-1].mean() * end
            lines = [f"the margins cover {digits_down(lasting)} s of {end:g} s", *lines]
        return lines + [f"note: {note}" for note in self.notes]


def run(setup: Setup, law: Any, margins: Any = None) -> Run:
    """Follow one plant under one law.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    margins : Margins, Margin or sequence of Margin, optional
        As `drive` takes them; not looked at where nothing moves and the law is told the truth.

    Raises
    ------
    InputError
        If the step is too long for the fastest pole (the bound is named), parameters leave their
        intervals, or as `linear.simulate` and `drive` raise.
    """
    plant, asked, moved = setup.plant, signals(setup.plant), setup.excitation
    if setup.exact:
        start = moved.begin(plant, setup.alpha)
        hold: Literal["held", "linear"] = "held" if moved.held else "linear"
        w = moved.samples if plant.disturbance_count else None
        found = linear.simulate(plant, law, setup.alpha, w, setup.time, asked, hold, start)
        return Run(setup, found, events=(*_contact(found), *_lost(found)))
    if setup.still:
        margins = ()
    done = drive(plant, law, moved, setup.parameters, setup.hardware, margins, setup.outside)
    more = list[Column]()
    parts = setup.hardware
    if law is not None and (parts.sampling is not None or parts.actuator != Actuator()):
        for j, own in enumerate(inputs(plant)):
            more.append((f"{own.name} demanded", own.unit, done.demanded[0, :, j]))
    if setup.hardware.stops is not None:
        more.append(("stop force", "N", done.stop_force[0]))
    if not setup.still:
        space = setup.trajectories.space
        for i, (name, unit) in enumerate(zip(space.names, space.units, strict=True)):
            more.append((name, unit, done.parameters[0, :, i]))
            if setup.hardware.learns:
                more.append((f"{name} estimated", unit, done.used[0, :, i]))
    covered = None if setup.still or done.covered is None else done.covered[0]
    notes = (*done.notes, *_slow(setup, law))
    return Run(setup, done.response(asked), tuple(more), done.events, notes, covered)


def signals(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return all states, outputs and inputs."""
    return (*states(plant), *plant.every_output, *inputs(plant))


def _slow(setup: Setup, law: Any) -> list[str]:
    """Say where a controller samples more slowly than the poles it is to set."""
    if setup.hardware.sampling is None or law is None:
        return []
    first = setup.trajectories.space.inside(setup.trajectories.at(np.zeros(1))[0])
    alpha = setup.trajectories.space.alpha(first)
    bound = longest_step(close(setup.plant, law, alpha, disturbed=False))
    if setup.hardware.sampling.period <= bound:
        return []
    return [f"the fastest pole that the law sets asks for a period of at most {bound:.3g} s"]


def _contact(response: Response) -> list[Event]:
    """Return where the tyre would have to pull, which the equations do not know."""
    plant, known = response.plant, ride(response.plant)
    if known is None:
        return []
    car = masses(plant, known, response.alpha)
    weight = ((car.m1 + car.m2) * GRAVITY)[:, None]
    force = weight + known.sense[1] * car.kt[:, None] * response.of(known.tyre.name)
    words = "the tyre leaves the road, which the equations do not know"
    return spans("road", force < 0, -force, response.time, lambda *_: words)


def _lost(response: Response) -> list[Event]:
    """Return when a state first leaves what a drive would go on with."""
    size = np.abs(response.values[:, :, : response.plant.shape[0]]).max(axis=2)
    return spans("lost", size >= LOST, size, response.time, lambda *_: RUNS_AWAY)
