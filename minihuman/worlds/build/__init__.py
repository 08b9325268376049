"""The definition of kernels and their compilation by Numba; ``kernel_build`` compiles them ahead of time."""
