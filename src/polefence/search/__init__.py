"""Laws searched in floats, and certified: for a region, for limits on signals, for estimates."""
