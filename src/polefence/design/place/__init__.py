"""Laws for a region, and the smallest region of a kind."""
