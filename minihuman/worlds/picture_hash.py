"""Hashes of the pictures that were shown.

They are in a separate module because the kernels' build imports the module of the state hashes.
"""

import numpy as np
import xxhash
from numpy.typing import NDArray


def hash_picture(picture: NDArray[np.uint8]) -> int:
    """Return the XXH3 hash of a picture's bytes and size, from 1 to 2**64 - 1. The value 0 stands for no picture.

    Args:
        picture: the picture, uint8[H, W, 3].
    """
    height, width = picture.shape[:2]
    # pictures of equal bytes and different sizes get different seeds
    return xxhash.xxh3_64_intdigest(np.ascontiguousarray(picture).data, seed=height << 32 | width) or 1
