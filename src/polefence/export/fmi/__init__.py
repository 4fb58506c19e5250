"""Functional mock-up units from the C sources."""
