"""What kernels are, and their compilation by Numba; ``kernel_build`` beside the package compiles them ahead of time."""
