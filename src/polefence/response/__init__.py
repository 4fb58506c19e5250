"""How the plant behaves under a law: responses, roads, comfort, drives."""
