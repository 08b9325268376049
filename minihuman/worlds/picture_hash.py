"""Hashes of pictures that were shown. Apart from the hashes of states, which the kernels' build imports."""

import numpy as np
import xxhash
from numpy.typing import NDArray


def hash_picture(picture: NDArray[np.uint8]) -> int:
    """Hash a picture uint8[H, W, 3] by its bytes and size: XXH3, from 1 to 2**64 - 1; 0 stands for no picture."""
    height, width = picture.shape[:2]
    return xxhash.xxh3_64_intdigest(np.ascontiguousarray(picture).data, seed=height << 32 | width) or 1
