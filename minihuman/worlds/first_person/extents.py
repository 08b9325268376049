"""How large the meshes are in their own units, and how many pictures a texture name stands for.

The numbers are those of the files Miniworld ships: they decide how wide a thing is once it is scaled to its height, and
how many textures there are to draw one from, and so which moves collide and which numbers a seed yields.
"""

import numpy as np

# Half the width (x), the height (y), half the depth (z).
_EXTENTS: dict[str, tuple[float, float, float]] = {
    "ball": (1.284565, 2.564372, 1.285002),
    "barrel": (0.30539, 0.882287, 0.30538952),
    "barrier": (2.032784, 1.143, 0.4064),
    "building": (1.84, 3.45, 1.22),
    "cone": (10.0, 31.5229, 10.0),
    "doom_door": (0.05, 1.0, 0.5),
    "duckie": (0.8303055, 1.518421, 0.58813),
    "key": (0.401406, 2.0, 2.4187405),
    "keycard": (0.085815, 2.3173308, 0.90595853),
    "medkit": (28.1319, 51.0648, 15.62425),
    "office_chair": (14.544351, 47.314598, 13.73),
    "office_desk": (33.45795, 63.6329, 16.451252),
    "potion": (0.6400001, 2.513775, 0.6400001),
    "tree": (13.99055, 26.541735, 10.40086),
    "tree_pine": (2.1321554, 7.543869, 2.1399379),
}
_COLOURED = ("ball", "key")  # one shape, a file a colour: "ball_red"

_SEVERAL = {"cardboard": 4, "concrete": 4, "door_doom": 2, "grass": 2, "lava": 2, "marble": 2, "metal_grill": 2}
_SEVERAL |= {"water": 3, "wood": 2}
_CHARACTER_VARIANTS = 9


def mesh_extents(mesh: str) -> tuple[np.float32, np.float32, np.float32] | None:
    """Half the width, the height and half the depth of a mesh of ours, in single precision; None for another's."""
    stem = next((name for name in _COLOURED if mesh.startswith(f"{name}_") and mesh != "keycard"), mesh)
    if stem not in _EXTENTS:
        return None
    x, y, z = _EXTENTS[stem]
    return np.float32(x), np.float32(y), np.float32(z)


def texture_variants(texture: str) -> int:
    """How many pictures a texture name stands for when worlds are randomised."""
    return _CHARACTER_VARIANTS if texture.startswith("chars/") else _SEVERAL.get(texture, 1)
