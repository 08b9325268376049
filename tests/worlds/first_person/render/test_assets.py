"""Textures, meshes and the files they may come from."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from kernel_build.meshes import SHAPES, build_meshes
from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.asset_files import OwnAssets, own_library, read_obj
from minihuman.worlds.first_person.render.built_in_meshes import COLOURS, MESH_FILE
from minihuman.worlds.first_person.render.built_in_textures import RECIPES, cloud, tiles
from minihuman.worlds.first_person.render.texture import MOST_SIZES

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"


def test_every_mesh_is_closed_enough_to_stand_and_faces_outwards() -> None:
    assets = OwnAssets()
    for name in [*SHAPES, *(f"{stem}_{colour}" for stem in ("ball", "key") for colour in COLOURS)]:
        mesh = assets.mesh(name)
        assert mesh.corners[:, :, 1].min() == pytest.approx(0.0, abs=1e-9)
        outward = np.cross(mesh.corners[:, 1] - mesh.corners[:, 0], mesh.corners[:, 2] - mesh.corners[:, 0])
        assert (np.einsum("ij,ij->i", outward, mesh.normals.mean(axis=1)) >= -1e-9).all(), name


def test_the_meshes_that_are_shipped_are_those_that_are_built() -> None:
    built = build_meshes()
    with np.load(MESH_FILE) as shipped:
        assert set(shipped) == set(built)
        assert all(np.array_equal(shipped[name], built[name]) for name in built)


def test_noise_joins_itself_at_its_edges() -> None:
    noise = cloud(4, 7)
    inside = np.abs(np.diff(noise, axis=1)).max()
    assert np.abs(noise[:, 0] - noise[:, -1]).max() <= inside * 1.5
    assert tiles(4, 4, 6)[0].min() == 0.0


def test_every_letter_variant_differs_and_unknown_names_say_what_there_is() -> None:
    assets = OwnAssets()
    assert (assets.texture("chars/ch_0x65_1").pixels != assets.texture("chars/ch_0x65_2").pixels).any()
    with pytest.raises(WorldError, match="brick_wall"):
        assets.texture("velvet_1")
    with pytest.raises(WorldError, match="duckie"):
        assets.mesh("dragon")


def test_a_texture_is_kept_in_four_sizes_for_each_halving_down_to_one_texel() -> None:
    library = own_library()
    row = library.texture_row("brick_wall_1")
    table = library.textures.table.reshape(-1, MOST_SIZES, 2)[row]
    last = int(table[-1, 1])
    widths = [int(both) & 0xFFFF for both in table[: last + 1, 1]]
    assert widths[::4] == [512 >> halving for halving in range(9)]
    assert widths[-1] == 1
    assert widths == sorted(widths, reverse=True)
    means = []
    for offset, both in table[: last + 1]:
        width, height = int(both) & 0xFFFF, int(both) >> 16
        ringed = library.textures.texels[int(offset) :][: (width + 2) * (height + 2)].reshape(height + 2, width + 2)
        assert np.array_equal(ringed[0], ringed[-2])
        means.append(float((ringed[1:-1, 1:-1] & 255).mean()))
    assert np.abs(np.array(means) - means[0]).max() < 6.0  # each mean is rounded upwards


@pytest.mark.parametrize(
    "name", [f"{name}_{variant + 1}" for name in RECIPES for variant in range(len(RECIPES[name][1]))]
)
def test_a_texture_is_as_bright_and_as_large_as_miniworlds(name: str) -> None:
    folder = Path(str(importlib.util.find_spec("miniworld").origin)).parent / "textures"
    file = next(file for file in (folder / f"{name}.png", folder / f"{name.removesuffix('_1')}.png") if file.exists())
    theirs, ours = Image.open(file).convert("RGB"), OwnAssets().texture(name)
    weights = np.array([0.2126, 0.7152, 0.0722])
    bright, wanted = (float((np.asarray(picture) @ weights).mean()) for picture in (ours.pixels, theirs))
    assert abs(bright - wanted) < 0.02 * wanted
    if name != "white_1":  # one colour
        assert ours.size_m == pytest.approx((theirs.width / 512, theirs.height / 512), rel=0.01)


def test_a_mesh_file_is_read_and_set_on_the_floor(tmp_path: Path) -> None:
    file = tmp_path / "flag.obj"
    file.write_text(TRIANGLE.replace("v 0 0 0", "v 0 -3 0"))
    (tmp_path / "flag.mtl").write_text("newmtl cloth\nKd 0.5 0.25 1\n")
    mesh = read_obj(file)
    assert mesh.height == 4.0
    assert mesh.corners[:, :, 1].min() == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no face"),
        ("v 1 2\n", "obj:1: expected 3 numbers"),
        ("v 1 2 nan\n", "obj:1: expected 3 numbers"),
        (TRIANGLE + "f 1//1 2//1 3//1 1//1\n", "obj:6: a face has 4 corners"),
        (TRIANGLE + "f 1//1 2//1 9//1\n", "vertex '9' does not exist; 3 precede"),
        (TRIANGLE + "f 1//1 2//1 0//1\n", "vertex '0' does not exist"),
        (TRIANGLE + "f 1 2 3\n", "has no normal"),
        (TRIANGLE.replace("v 0 1 0", "v 2 0 0"), "flat"),
    ],
)
def test_nonsense_in_a_mesh_file_is_named_by_its_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "nonsense.obj"
    file.write_text(text)
    with pytest.raises(WorldError, match=message):
        read_obj(file)


def test_a_missing_mesh_file_and_a_binary_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"none\.obj: cannot be read"):
        read_obj(tmp_path / "none.obj")
    (tmp_path / "binary.obj").write_bytes(b"\xff\xfe\x80\x81")
    with pytest.raises(WorldError, match="not a text file"):
        read_obj(tmp_path / "binary.obj")
