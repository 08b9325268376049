"""How the grid is drawn: shapes, palettes, tiles and pictures."""
