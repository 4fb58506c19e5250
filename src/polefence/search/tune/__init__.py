"""Laws of any structure, searched directly: proposed here, proved elsewhere."""
