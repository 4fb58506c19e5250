"""Laws that are given: analysed, and how far they go."""
