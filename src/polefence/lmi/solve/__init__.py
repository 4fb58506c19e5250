"""From data to numbers: scaling, the conic solver's adapter, the search. Proves nothing."""
