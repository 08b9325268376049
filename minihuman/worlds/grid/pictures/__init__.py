"""Pictures of the grid: palettes, tiles and whole pictures."""
