"""Proofs in exact arithmetic, from the standard library alone."""
