"""The paper's agent study: weights that move from the grid to its 3D twin."""
