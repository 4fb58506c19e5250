"""A law on a microprocessor: C99, FMU, MATLAB; what rounding and sampling leave of the claim."""
