"""Names and units of strangers, as they can be shown: on one line, and never more than a name."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 80  # characters of a name in a sentence

# Of Unicode's categories those that draw nothing of their own, but move, hide or end a line.
_HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
# Products of powers of units that are in use: kg, N s/m, m/s^2, 1/s, %, m/s per m/s2.
_SYMBOLS = (
    "m g s A K mol cd rad sr Hz N Nm Pa J W Wh C V VA F Ω Ohm ohm S Wb T H lm lx Bq L l t bar eV "
    "rev deg degC min h d in ft lb psi mph"
)
_PREFIX = "(?:da|[YZEPTGMkhdcmµμunpfazy])?"
_WORD = (
    rf"(?:{_PREFIX}(?:{'|'.join(_SYMBOLS.split())})|%|°C?|rpm|per)(?:\^?[-+]?\d(?:\.\d)?|⁻?[¹²³⁴])?"
)
_UNIT = re.compile(rf"(?:1/)?\(?{_WORD}(?:[ /*·]\(?{_WORD}\)?){{0,7}}|/s|")


def visible(text: str) -> str:
    r"""Return text that stays on its line: what is no letter, sign or space as ``\n``, ``\x1b``."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode() if unicodedata.category(c) in _HIDDEN else c
        for c in text
    )


def quoted(name: str) -> str:
    """Return a name in quotes, which it does not leave, cut short where it is endless."""
    short = name if len(name) <= LONGEST else f"{name[: LONGEST - 3]}..."
    return repr(short)


def unit_text(unit: str) -> str:
    """Return a unit as it is, or in quotes where it might be read as more than one."""
    return unit if _UNIT.fullmatch(unit) else quoted(unit)


def rate_text(unit: str) -> str:
    """Return a printable unit per second: "1/s" of none, "(N s/m)/s" of a quotient."""
    return f"({unit})/s" if "/" in unit else f"{unit or 1}/s"
