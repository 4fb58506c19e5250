"""What many tests share: paths, plants, oracles, tools."""
