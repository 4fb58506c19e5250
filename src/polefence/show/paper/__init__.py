"""Worked plants from vehicle dynamics: the quarter car, and the paper's study of it."""
