"""Meshes and textures of a lab's own add to ours."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Mesh
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.render.asset_files import FolderAssets, read_glb, read_obj

MINT = (120, 200, 160)


class Room(FirstPersonEnv):
    """The agent looks at one mesh, two metres ahead."""

    def __init__(self, mesh="tower", floor="floor_tiles_bw", **options):
        self.mesh, self.floor = mesh, floor
        super().__init__(**options)

    def build(self):
        room = self.add_rect_room(min_x=-1, max_x=6, min_z=-3, max_z=3, floor=self.floor)
        self.thing = self.place_entity(Mesh(self.mesh, 1.0), pos=(2.0, 0.0, 0.0), dir=0.0)
        self.place_agent(room=room, pos=(0.0, 0.0, 0.0), dir=0.0)


@pytest.fixture
def folder(tmp_path):
    import trimesh

    (tmp_path / "meshes").mkdir()
    (tmp_path / "textures").mkdir()
    Image.new("RGB", (32, 32), MINT).save(tmp_path / "textures" / "mint.png")
    tower = trimesh.creation.box((1.0, 4.0, 2.0))
    tower.visual.face_colors = (255, 0, 0, 255)
    tower.export(tmp_path / "meshes" / "tower.glb")
    return tmp_path


def reds(picture):
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 50) & (green < 30) & (blue < 30)).sum())


def test_an_own_mesh_is_drawn_and_measured(folder):
    world = Room(assets=folder)
    observation, _ = world.reset(seed=0)
    assert reds(observation) > 100
    assert world.thing.radius == pytest.approx(0.25 * (0.5**2 + 1.0**2) ** 0.5, abs=1e-6)
    assert world.map().things[0].name == "tower"


def test_an_own_texture_is_drawn_beside_ours(folder):
    ours = Room(mesh="duckie").reset(seed=0)[0]
    with_folder = Room(mesh="duckie", assets=folder).reset(seed=0)[0]
    assert np.array_equal(ours, with_folder)
    mint = Room(mesh="duckie", floor="mint", assets=folder).reset(seed=0)[0]
    assert not np.array_equal(ours, mint)
    assert (mint == MINT).all(axis=-1).mean() > 0.1


def test_a_file_from_a_system_that_writes_suffixes_in_capitals_is_found(folder):
    expected = Room(floor="mint", assets=folder).reset(seed=0)[0]
    for file in (folder / "meshes" / "tower.glb", folder / "textures" / "mint.png"):
        file.rename(file.with_suffix(file.suffix.upper()))
    assert np.array_equal(Room(floor="mint", assets=folder).reset(seed=0)[0], expected)


def test_a_world_that_names_its_folder_is_saved_restored_and_pickled_with_it(folder):
    world = type("Own", (Room,), {"assets": folder})()
    world.reset(seed=0)
    saved, before = world.save(), world.state_hash()
    picture = world.picture()
    world.step(2)
    world.restore(saved)
    assert world.state_hash() == before
    assert np.array_equal(world.picture(), picture)


def test_a_texture_inside_a_glb_file_is_drawn(folder):
    import trimesh

    square = trimesh.Trimesh([[0, 0, 0], [0, 2, 0], [0, 2, 1], [0, 0, 1]], [[0, 2, 1], [0, 3, 2]])
    image = Image.new("RGB", (8, 8), (255, 0, 0))
    square.visual = trimesh.visual.TextureVisuals([[0, 0], [0, 1], [1, 1], [1, 0]], image=image)
    square.export(folder / "meshes" / "poster.glb")
    assert reds(Room(mesh="poster", assets=folder).reset(seed=0)[0]) > 50


def test_a_name_that_nobody_has_says_what_there_is(folder):
    with pytest.raises(WorldError, match=r"no mesh 'dragon'; unknown mesh 'dragon'; use one of ball"):
        Room(mesh="dragon", assets=folder).reset(seed=0)
    with pytest.raises(WorldError, match="unknown mesh 'dragon'"):
        Room(mesh="dragon").reset(seed=0)
    with pytest.raises(WorldError, match="no texture 'velvet_1'"):
        Room(mesh="duckie", floor="velvet", assets=folder).reset(seed=0)


def test_a_file_that_is_no_mesh_is_named(folder):
    (folder / "meshes" / "noise.glb").write_bytes(b"glTF but not really")
    with pytest.raises(WorldError, match=r"noise\.glb: cannot be read as a mesh"):
        Room(mesh="noise", assets=folder).reset(seed=0)


def test_a_folder_without_either_is_refused(tmp_path):
    with pytest.raises(WorldError, match="neither a textures nor a meshes folder"):
        Room(assets=tmp_path).reset(seed=0)


def test_obj_and_glb_of_one_shape_are_one_mesh(tmp_path):
    import trimesh

    shape = trimesh.creation.icosphere(1)
    shape.export(tmp_path / "one.glb")
    (tmp_path / "one.obj").write_text(trimesh.exchange.obj.export_obj(shape, include_normals=True))
    a, b = read_glb(tmp_path / "one.glb"), read_obj(tmp_path / "one.obj")
    low = [mesh.corners.min(axis=(0, 1)) for mesh in (a, b)]  # an OBJ file's middle is Miniworld's, which is another
    assert np.allclose(a.corners - low[0], b.corners - low[1], atol=1e-6)
    assert np.allclose(a.normals, b.normals, atol=1e-6)


@pytest.mark.filterwarnings("ignore::RuntimeWarning:trimesh", "ignore:All-NaN")  # its own, over missing texture places
def test_every_mesh_of_miniworld_has_the_triangles_that_trimesh_reads():
    """OBJ files keep a reader of our own: shapes agree, but trimesh loses colours that stand in an .mtl file."""
    import trimesh

    meshes = Path(find_spec("miniworld").origin).parent / "meshes"
    for file in sorted(meshes.glob("*.obj")):
        ours = FolderAssets(meshes.parent).mesh(file.stem).corners
        parts = trimesh.load_scene(file, process=False, maintain_order=True).geometry.values()
        theirs = np.concatenate([part.triangles for part in parts])
        assert len(ours) == len(theirs)
        sizes = [
            np.sort(np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)) for t in (ours, theirs)
        ]
        assert np.allclose(*sizes, rtol=1e-4, atol=1e-6), file.name
