"""Foundations: errors, files from strangers, worker processes; and the version."""

VERSION = "0.2.0"
