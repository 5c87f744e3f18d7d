"""From poses to maps: occupancy grids, occupied cells, static and dynamic points."""
