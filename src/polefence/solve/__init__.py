"""From data to numbers: scaling, the conic solver's adapter, the smallest radius. Proves nothing."""
