"""The options that choose a method: name, degree, elevation, domain, budget."""

from __future__ import annotations

import argparse
from typing import Any

from polefence.base.errors import InputError
from polefence.lmi.conditions.methods import METHODS, Method, Scheduled, Slack

OPTIONS = ("degree", "elevation", "on")


def method_arguments(
    parser: argparse.ArgumentParser, several: bool = False, auto: bool = False
) -> None:
    """Declare --method, one or several, and its options; ``auto`` for what takes that degree."""
    if several:
        parser.add_argument(
            "--method", action="append", choices=METHODS, help="repeat for more; default: all three"
        )
    else:
        parser.add_argument(
            "--method", choices=METHODS, default="scheduled", help="default: scheduled"
        )
    parser.add_argument(
        "--degree",
        type=_degree if auto else int,
        metavar="N|auto" if auto else "N",
        help="scheduled, slack: degree of the Lyapunov matrix in alpha; default: 1"
        + ("; auto: raised until it is proved" if auto else ""),
    )
    parser.add_argument(
        "--elevation",
        type=int,
        metavar="N",
        help="scheduled, slack: degree of the multiplier; default: 1 for scheduled, 0 for slack",
    )
    parser.add_argument(
        "--on",
        choices=("simplex", "box"),
        help="scheduled, slack: box uses that the parameters are independent; default: simplex",
    )


def _degree(text: str) -> int | str:
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number, and not auto") from error


def method_of(name: str, options: Any) -> Method:
    """Return the method with the options given.

    Raises
    ------
    InputError
        If an option does not belong to the method, or has no such value.
    """
    given = _given(options)
    if name == "quadratic" and given:
        raise InputError(f"--{next(iter(given))} belongs to scheduled and slack, not to quadratic")
    if given.get("degree") == "auto":
        return _climbing(name, options, given)
    if getattr(options, "budget", None) is not None:
        raise InputError("--budget belongs to --degree auto")
    if name == "slack":
        return Slack(**given)
    return Scheduled(**given) if given else name


def methods_of(names: list[str], options: Any) -> list[Method]:
    """Return several methods, the options applied to those of them that take some."""
    alone = set(names) == {"quadratic"}
    return [n if n == "quadratic" and not alone else method_of(n, options) for n in names]


def _given(options: Any) -> dict[str, Any]:
    return {key: getattr(options, key) for key in OPTIONS if getattr(options, key) is not None}


def _climbing(name: str, options: Any, given: dict[str, Any]) -> Scheduled:
    if name != "scheduled":
        raise InputError(f"--degree auto belongs to the method scheduled, not {name}")
    if "elevation" in given:
        raise InputError("--degree auto chooses the elevation too; leave --elevation out")
    if options.budget is not None:
        if not 0 < options.budget < float("inf"):
            raise InputError(f"--budget = {options.budget:g} must be positive, in seconds")
        given["budget"] = options.budget
    return Scheduled(**given)
