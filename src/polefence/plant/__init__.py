"""Plants: linear systems, uncertain parameters, and the polytope they span."""
