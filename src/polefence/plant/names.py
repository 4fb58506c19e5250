"""Names and units of strangers, as they can be shown."""

from polefence.proof.text import quoted, rate_text, unit_text, visible

__all__ = ["quoted", "rate_text", "unit_text", "visible"]
