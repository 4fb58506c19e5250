"""Foundations: errors, files from strangers, worker processes, time limits."""
