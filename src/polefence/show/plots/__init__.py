"""Figures. Data in, Figure out; no file is touched."""
