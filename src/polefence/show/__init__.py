"""Figures, pages, and the study of the paper."""
