"""Specifications as people write them: ``[[specification]]`` tables of a spec, a line of text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances
from polefence.plant.spec import specification_tables
from polefence.plant.tracks import SOURCES
from polefence.proof.claims.gain_norm import LAW
from polefence.proof.short import Short
from polefence.proof.text import exactly
from polefence.requirements.bump import BumpMeasure
from polefence.requirements.delay_margin import DelayMargin
from polefence.requirements.disk_margin import DiskMargin, Unmodelled
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.factor_margin import GainMargin, PhaseMargin
from polefence.requirements.free import ImpulseMeasure, InitialMeasure
from polefence.requirements.gain import Gain
from polefence.requirements.gain_norm import GainNorm
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.margin import inverse
from polefence.requirements.peak_to_peak import PeakToPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.saturation import Saturation
from polefence.requirements.sector import SectorBound
from polefence.requirements.specification import (
    SIGNAL_REMEDY,
    Row,
    Specification,
    listed,
    number,
)
from polefence.requirements.step import StepMeasure
from polefence.requirements.worst_gain import WorstCaseGain
from polefence.response.stationary import velocity_density

KINDS: dict[str, type[Specification]] = {
    str(kind.kind): kind
    for kind in (
        Rms,
        RelativeRms,
        EnergyPeak,
        InitialPeak,
        Saturation,
        Gain,
        DiskMargin,
        Unmodelled,
        GainMargin,
        PhaseMargin,
        DelayMargin,
        WorstCaseGain,
        SectorBound,
        StepMeasure,
        InitialMeasure,
        ImpulseMeasure,
        BumpMeasure,
        PeakToPeak,
        GainNorm,
    )
}
COMMON = ("kind", "signal", "at_most", "minimise")
LISTS = ("points", "ellipsoid", "rows", "columns", "envelope")  # not on a line
NOTHING: Mapping[str, float] = MappingProxyType({})
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
# A list, as `polefence.requirements.specification.listed` writes it.
_ENTRY = r'(?:"(?:[^"\\]|\\.)*"|[^,*\[\]"]+?)'
_ITEM = re.compile(rf"\s*(?P<name>{_ENTRY})\s*(?:\*\s*(?P<scale>{_NUMBER})\s*)?(?:,|$)")
_LIMIT_ELSE = re.compile(r"(?:[<=≤]\s*-?|,)\d[\d.,]*$")  # written in another way
_FROM = re.compile(r"(?P<rest>.*\S)\s+from\s+\[(?P<items>.*)\]\s*")
_WITH = re.compile(r"(?P<rest>.*\S)\s+with\s+(?P<key>\w+)\s+(?P<value>\[[^\]]*\]|\S+)\s*")


@dataclass(frozen=True)
class RoadSpectrum(Short):
    """The road that rms values are asked for.

    Attributes
    ----------
    road_class : str
        "A" to "H" of ISO 8608.
    speed : float
        [m/s]
    under : tuple of str
        Disturbances that are roads under several wheels, each of this spectrum and independent of
        the others. An rms that names no disturbances is one of these alone.
    in_tracks : bool
        Whether the plant has delays and filters of the road, at this speed.
    """

    road_class: str
    speed: float
    under: tuple[str, ...] = ()
    in_tracks: bool = False

    @property
    def density(self) -> float:
        """One-sided density of its vertical velocity [m2/s2 per Hz].

        Raises
        ------
        InputError
            If there is no such class, or the speed is not above zero.
        """
        return velocity_density(self.road_class, self.speed)

    def acting(self, requirement: Specification, plant: UncertainPlant) -> Specification:
        """Return an rms that names no disturbances as one of these roads, where others act too.

        Only what is no velocity is left out: a wheel whose road nobody named is refused later.
        """
        chosen = requirement.disturbances is not None or not self.under
        if chosen or requirement.noise_density != self.density:
            return requirement
        pairs = list(zip(disturbances(plant), plant.physical, strict=True))
        others = {w.unit for w, physical in pairs if physical and w.name not in self.under}
        if not others or "m/s" in others:
            return requirement
        noise = {w.name: requirement.unnamed_noise for w, physical in pairs if not physical}
        roads = {w.name: 1.0 for w, _ in pairs if w.name in self.under}
        return replace(requirement, disturbances=roads | noise)


@explained
def load_specifications(
    path: str | Path, road: RoadSpectrum | None = None
) -> tuple[Specification | None, tuple[Specification, ...]]:
    """Read what a spec file asks to be minimised, None where it does not say, and the limits.

    Parameters
    ----------
    path : str or Path
        A TOML spec with ``[[specification]]`` tables.
    road : RoadSpectrum, optional
        In place of the spec's table ``[road]``, for every rms that names no density.

    Raises
    ------
    SpecError
        If the file cannot be read, or a table says something that cannot be used: one line with
        file, key, value and remedy.
    """
    written = spec_road(path)  # even where another takes its place it must make sense
    road = road or written
    tables, _ = specification_tables(path)
    try:
        read = [_read(table, f"specification {k + 1}", road) for k, table in enumerate(tables)]
    except InputError as error:
        raise SpecError(f"{path}: {' '.join(str(error).split())}") from error
    least = [one for one, minimised in read if minimised]
    if len(least) > 1:
        names = " and ".join(s.title for s in least)
        raise SpecError(f"{path}: minimise = true for {names}; keep it for one")
    return least[0] if least else None, tuple(one for one, minimised in read if not minimised)


def spec_road(path: str | Path) -> RoadSpectrum | None:
    """Return the road of a spec's table ``[road]``, None where it has none.

    Raises
    ------
    SpecError
        As `load_specifications` raises.
    """
    _, table = specification_tables(path)
    try:
        return None if table is None else _road(table)
    except InputError as error:
        raise SpecError(f"{path}: {error}") from error


def with_wheels(road: RoadSpectrum | None, path: str | Path) -> RoadSpectrum | None:
    """Return a road under the wheels that a spec names, or the spec's own road in its place."""
    written = spec_road(path)
    if road is None or written is None:
        return road or written
    if written.in_tracks and written.speed != road.speed:
        raise SpecError(
            f"{path}: road.tracks: wheels behind are later by a speed of {written.speed:g} m/s, "
            "which is in the plant; change it in the spec"
        )
    return replace(road, under=written.under, in_tracks=written.in_tracks)


@explained
def parse_specification(
    text: str, road: RoadSpectrum | None = None, known: Mapping[str, float] = NOTHING
) -> Specification:
    """Read a specification from a line, ``KIND of SIGNAL [<= LIMIT] [with KEY VALUE] ...``.

    For example ``rms of actuator force <= 700`` or ``initial peak of suspension deflection <= 0.08
    with impulse 0.05``. A vector of signals is ``[a, b]``, and what acts of the disturbances stands
    behind it: ``gain of [a, b] from [road * 0.5, wind] <= 2``. Names with one of ``,*[]"`` in them
    are in quotes there.

    Parameters
    ----------
    road : RoadSpectrum, optional
        For an rms that names no density.
    known : mapping
        Without a road: the density by signal, as the spec's own tables have it.

    Raises
    ------
    InputError
        Naming the word that cannot be used.
    """
    table = dict[str, Any]()
    rest = _without_ends(text, text, table)
    what, less, limit = rest.partition(">=" if ">=" in rest else "<=")
    if less:  # a title has its ends before its limit
        what = _without_ends(what, text, table)
    if not less and (ending := _LIMIT_ELSE.search(what)):
        raise InputError(
            f"{text!r}: {ending[0]!r} at its end; a limit is written <= NUMBER, with a "
            "decimal point"
        )
    kind, of, signal = what.partition(" of ")
    if not of or not signal.strip() or (less and not limit.strip()):
        raise InputError(
            f"{text!r} is not of the form KIND of SIGNAL <= LIMIT; write 'rms of NAME <= 700'"
        )
    table["kind"] = " ".join(kind.split()).casefold()
    asked = KINDS.get(table["kind"])
    if match := _FROM.fullmatch(signal):
        moved_by = Specification.moved_by if asked is None else asked.moved_by
        signal, table[moved_by] = match["rest"], _acting(match["items"], text)
    table["signal"] = signal = signal.strip()
    if less and asked is not None and (less == ">=") != asked.is_margin:
        sign = ">=" if asked.is_margin else "<="
        raise InputError(f"{text!r}: a limit of a {asked.kind} is written {sign} NUMBER")
    if signal.startswith("[") and signal.endswith("]"):
        names = _items(signal[1:-1], text)
        weighted = any(scale is not None for _, scale in names)
        table["signal"] = (
            _scaled(names, text, "signal") if weighted else [name for name, _ in names]
        )
    if less:
        table["at_most"] = value = _value(limit.strip())
        if isinstance(value, str):
            raise InputError(
                f"{text!r}: {value!r} behind {less}; a limit is a number alone, in the signal's "
                "unit"
            )
        if asked is not None and asked.is_margin:
            table["at_most"] = _margin(value, repr(text))
    return _specification(table, repr(text), road, known)


def _without_ends(part: str, text: str, table: dict[str, Any]) -> str:
    """Return a part of a line without `with KEY VALUE` at its end, which is read into a table."""
    while match := _WITH.fullmatch(part):
        part, key = match["rest"], match["key"]
        if key in (*COMMON, *LISTS, "disturbances", "start"):
            told = "write it there, in a [[specification]]"
            if key == "disturbances":
                told = "name disturbances by from [NAME]"
            elif key == "start":
                told = "name states by from [NAME * 0.1]"
            elif key in COMMON:
                told = "give the limit by <="
            raise InputError(f"{text!r}: {key} is for a spec's tables; {told}")
        if key in table:
            raise InputError(f"{text!r}: {key} is given twice; give it once")
        table[key] = _value(match["value"])
    return part


def parse_names(text: str) -> tuple[str, ...]:
    """Read a list of names from a line, ``A, B``; a name with one of ``,*[]"`` in it in quotes.

    Raises
    ------
    InputError
        If it is none.
    """
    items = _items(text, text)
    if any(scale is not None for _, scale in items):
        raise InputError(f"{text!r}: names have no numbers here; write NAME, NAME")
    return tuple(name for name, _ in items)


def _items(items: str, text: str) -> list[tuple[str, Fraction | None]]:
    """Return the names of a list, and what each is multiplied by."""
    pairs, at = list[tuple[str, Fraction | None]](), 0
    while match := _ITEM.match(items, at):
        name, scale, at = match["name"], match["scale"], match.end()
        pairs.append((_unquoted(name, text), None if scale is None else Fraction(scale)))
        if at == len(items) and not items.endswith(","):
            return pairs
    raise InputError(f"{text!r}: cannot read [{items}]; write [NAME, NAME], or [NAME * 0.5]")


def _unquoted(name: str, text: str) -> str:
    try:
        return str(json.loads(name)) if name.startswith('"') else name
    except ValueError as error:
        raise InputError(f"{text!r}: cannot read {name}; mend its quotes") from error


def _acting(items: str, text: str) -> dict[str, Fraction]:
    """Return the disturbances that act, with scales."""
    return _scaled(_items(items, text), text, "disturbance")


def _scaled(items: list[tuple[str, Fraction | None]], text: str, what: str) -> dict[str, Fraction]:
    """Return names with what each is multiplied by, one where that is left out."""
    names = [name for name, _ in items]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{text!r}: {what} {name!r} is given twice; give it once")
    return {name: Fraction(1) if scale is None else scale for name, scale in items}


def _value(word: str) -> Any:
    if word.startswith("[") and word.endswith("]"):
        return [
            Fraction(entry) if re.fullmatch(_NUMBER, entry) else entry
            for entry in map(str.strip, word[1:-1].split(","))
        ]
    if word in ("true", "false"):
        return word == "true"
    return Fraction(word) if re.fullmatch(_NUMBER, word) else word


def _road(table: Mapping[str, Any]) -> RoadSpectrum:
    _known(table, ("class", "speed", "under", "tracks"), "road")
    for key in ("class", "speed"):
        if key not in table:
            raise SpecError(f'road: {key} is missing; write class = "C" and speed = 20  # m/s')
    if not isinstance(table["class"], str):
        raise SpecError(f'road: class = {shown(table["class"])} must be text, for example "C"')
    under = table.get("under", [])
    if not isinstance(under, list) or not all(isinstance(name, str) for name in under):
        raise SpecError(f"road: under = {shown(under)} must be a list of names of disturbances")
    if "tracks" in table and under:
        raise SpecError("road: under and tracks: all wheels are in tracks; leave under out")
    road = RoadSpectrum(
        table["class"],
        number(table["speed"], "road: speed"),
        SOURCES if "tracks" in table else tuple(under),
        "tracks" in table,
    )
    try:
        _ = road.density
    except InputError as error:
        raise SpecError(f"road: {error}") from error
    return road


def _read(
    table: Mapping[str, Any], where: str, road: RoadSpectrum | None
) -> tuple[Specification, bool]:
    """Return a table's specification, and whether it is to be minimised."""
    table = _turned(table, where)
    minimised = table.get("minimise", False)
    if not isinstance(minimised, bool):
        raise SpecError(f"{where}: minimise = {shown(minimised)} must be true or false")
    if ("limits" in table or "envelope" in table) and not minimised:  # as large as they are
        table = {"at_most": 1} | dict(table)
    specification = _specification(table, where, road)
    if minimised == ("at_most" in table):
        raise SpecError(
            f"{where}, {specification.title}: give at_most = LIMIT or minimise = true, one of them"
        )
    return specification, minimised


def _turned(table: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """Return a table of a margin with its keys as those of a bound on 1 over it."""
    asked = KINDS.get(table["kind"]) if isinstance(table.get("kind"), str) else None
    if asked is None or not asked.is_margin:
        return table
    turned = dict(table)
    for key, instead in (
        ("signal", "loops" if asked.of_loops else "signal"),
        ("at_most", "at_least"),
        ("minimise", "maximise"),
    ):
        if key in table and key != instead:
            raise SpecError(f"{where}: {key} is for other kinds; a {asked.kind} has {instead}")
        if instead in table:
            turned[key] = turned.pop(instead)
    if "signal" not in turned and asked.of_loops:
        raise SpecError(
            f'{where}: loops is missing; write loops = ["NAME"], an input or a measured signal'
        )
    if "at_most" in turned:
        turned["at_most"] = _margin(turned["at_most"], f"{where}: at_least")
    elif turned.get("minimise") is not True:
        if asked.of_loops:
            raise SpecError(f"{where}: give at_least = MARGIN or maximise = true, one of them")
        turned["at_most"] = 1
    return turned


def _margin(value: Any, where: str) -> Fraction:
    """Return 1 over a margin."""
    if number(value, where) <= 0:
        raise SpecError(f"{where} = {shown(value)} must be a positive number")
    return Fraction(inverse(Fraction(value)))


def _specification(
    table: Mapping[str, Any],
    where: str,
    road: RoadSpectrum | None,
    known: Mapping[str, float] = NOTHING,
) -> Specification:
    kind = table.get("kind")
    asked = KINDS.get(kind) if isinstance(kind, str) else None
    if asked is not None and not asked.of_signal:
        table = {"signal": LAW} | dict(table)
    for key in ("kind", "signal"):
        if key not in table:
            raise SpecError(f"{where}: {key} is missing; {_remedy(key)}")
    if not isinstance(kind, str):
        raise SpecError(f"{where}: kind = {shown(kind)} must be text; {_remedy('kind')}")
    if asked is None:
        raise SpecError(f"{where}: kind = {shown(kind)} is unknown; {suggest(kind, KINDS)}")
    try:
        signal = _words(asked.signal_of(table["signal"]))
    except SpecError as error:
        raise SpecError(f"{where}: {error}") from error
    if not asked.of_signal and signal != LAW:
        raise SpecError(f"{where}: signal = {shown(signal)}; a {kind} is of {LAW}; leave it out")
    where = f"{where}, {kind} of {signal}"
    _known(table, (*COMMON, *asked.keys), where)
    if isinstance(several := table.get("at_most"), list):
        raise SpecError(f"{where}: {_one_number(several, asked)}")
    try:
        density = known.get(signal) if road is None else road.density
        return asked.read(Row(table, where, density))
    except SpecError as error:
        raise SpecError(_placed(str(error), where)) from error
    except InputError as error:
        raise SpecError(f"{where}: {error}") from error


def _one_number(several: list[Any], asked: type[Specification]) -> str:
    """Return what to write where a limit is a list."""
    written = ", ".join(map(shown, several))
    if "limits" in asked.keys:
        each = (
            f"write <= 1 with limits [{written}], or in a spec limits = [{written}] in place of "
            "at_most"
        )
    else:
        each = "it bounds all entries of a vector together; for one each, ask for each alone"
    return f"at_most = [{written}] must be one number; {each}"


def _words(signal: Any) -> str:
    """Return a signal as a line has it: a name, a list, or a list with numbers."""
    if isinstance(signal, Mapping):
        ends = ["" if x == 1 else f" * {exactly(float(x))}" for x in signal.values()]
        return listed(list(signal), ends)
    names = signal if isinstance(signal, list) else [signal]
    return str(names[0]) if len(names) == 1 else listed(names)


def _placed(text: str, where: str) -> str:
    return text if text.startswith(where) else f"{where}: {text}"


def _known(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key, value in table.items():
        if key not in known:
            raise SpecError(f"{where}: unknown key {key} = {shown(value)}; {suggest(key, known)}")


def _remedy(key: str) -> str:
    if key == "kind":
        return f"one of {', '.join(map(repr, KINDS))}"
    return SIGNAL_REMEDY
