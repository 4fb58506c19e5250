"""Laws for limits on signals: specifications, their bounds, trade-offs."""
