"""What is drawn, told from pixels and distances."""

from dataclasses import replace

import numpy as np
import pytest

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render.asset_files import OwnAssets
from minihuman.worlds.first_person.render.assets import Assets, Library, MeshData, Texture
from minihuman.worlds.first_person.render.drawing import render, render_depth, render_top, visible_things
from minihuman.worlds.first_person.render.scene import Camera, MeshLook, ShadowLook, Surface, build_scene
from minihuman.worlds.pose import Pose
from tests.worlds.first_person.render.stages import CAMERA, library, room, two_rooms


def test_the_wall_ahead_is_as_far_as_it_is() -> None:
    depth = render_depth(two_rooms(), Camera((-1.0, 1.5, 0.0), np.pi / 2), 40, 30)
    assert depth[10, 20] == pytest.approx(2.0, abs=1e-4)


def test_through_the_opening_the_far_wall_of_the_next_room_is_seen() -> None:
    depth = render_depth(two_rooms(), Camera((-1.0, 1.9, 0.0), 0.0), 40, 30)
    assert depth[12, 20] == pytest.approx(7.0, abs=1e-3)


def test_drawing_only_what_openings_show_changes_no_pixel() -> None:
    rng = np.random.default_rng(3)
    closed, open_air = two_rooms(), two_rooms(roofed=False)  # without roofs, every room is drawn whole
    for _ in range(30):
        x, z, yaw = rng.uniform(-1.9, 5.9), rng.uniform(-0.9, 0.9), rng.uniform(-np.pi, np.pi)
        camera = Camera((x, 1.5, z), yaw, -0.9)
        a, b = render_depth(closed, camera, 40, 30), render_depth(open_air, camera, 40, 30)
        both = b < 100.0
        np.testing.assert_array_equal(a[15:][both[15:]], b[15:][both[15:]])


def test_a_hidden_thing_is_not_drawn_and_a_moved_one_is_drawn_elsewhere() -> None:
    scene = two_rooms()
    places = scene.places.copy()
    places[0] = np.nan
    without = render(scene.at(places), CAMERA, 80, 60)
    places[0] = [0.8, 0.0, 0.9, 0.4]
    elsewhere = render(scene.at(places), CAMERA, 80, 60)
    shown = render(scene, CAMERA, 80, 60)
    red = [int((p[:, :, 0].astype(int) > 2 * p[:, :, 1] + 80).sum()) for p in (without, elsewhere, shown)]
    assert red[0] < min(red[1:])
    assert (elsewhere != shown).any()


def test_things_are_seen_unless_a_wall_or_a_turned_back_hides_them() -> None:
    scene = two_rooms()
    assert visible_things(scene, CAMERA, 80, 60) == [0, 1]
    assert visible_things(scene, Camera((5.5, 1.5, -1.8), np.pi / 2), 80, 60) == []


def test_the_plan_shows_the_agent_where_it_stands() -> None:
    scene = two_rooms()
    picture = render_top(scene, 120, 60, agent=Pose(4.0, 0.0, -1.0, 0.0))
    x0, z0, x1, z1 = scene.layout.bounds
    scale = min(120 / (x1 - x0 + 2), 60 / (z1 - z0 + 2))  # pixels a metre, with a metre of sky all round
    column, row = 60 + scale * (4.0 - (x0 + x1) / 2), 30 + scale * (-1.0 - (z0 + z1) / 2)
    assert tuple(picture[int(row), int(column)]) == (255, 0, 0)


def test_a_picture_without_pixels_and_a_surface_without_area_are_refused() -> None:
    with pytest.raises(WorldError, match="0 x 60"):
        render(two_rooms(), CAMERA, 0, 60)
    with pytest.raises(WorldError, match="give 3 or more of x, y, z"):
        Surface(np.zeros((2, 3)), np.zeros((2, 2)), "wood_1")


class Crumbs(Assets):
    """One mesh of 240 triangles that lie anyhow, and the same in pieces of 40."""

    def __init__(self) -> None:
        rng = np.random.default_rng(5)
        corners = rng.uniform((-1.0, 0.1, -1.0), (1.0, 2.0, 1.0), (240, 1, 3)) + rng.normal(0.0, 0.15, (240, 3, 3))
        self.corners = corners - (0.0, corners[:, :, 1].min(), 0.0)
        self.colours = rng.uniform(0.2, 1.0, (240, 3))

    def texture(self, name: str) -> Texture:
        return OwnAssets().texture(name)

    def mesh(self, name: str) -> MeshData:
        kept = slice(None) if name == "whole" else slice(40 * int(name), 40 * int(name) + 40)
        corners = self.corners[kept]
        up = np.broadcast_to((0.0, 1.0, 0.0), corners.shape)
        return MeshData(corners, up, np.zeros((*corners.shape[:2], 2)), self.colours[kept], (None,) * len(corners))


@pytest.mark.parametrize("roofed", [True, False])
def test_a_thing_of_many_faces_is_drawn_as_its_pieces_are_wherever_it_is_partly_hidden(roofed: bool) -> None:
    crumbs = Crumbs()
    pictures = []
    for names in (["whole"], ["0", "1", "2", "3", "4", "5"]):
        looks = [MeshLook(name, crumbs.mesh(name).height) for name in names]
        rng = np.random.default_rng(1)
        rooms = [room(-2.0, 2.0, {0: 1}, roofed=roofed), room(2.0, 6.0, {2: 0}, roofed=roofed)]
        scene = build_scene(rooms, looks, library=Library(crumbs))
        for _ in range(60):
            place = [rng.uniform(-1.5, 5.5), rng.uniform(-0.5, 0.5), rng.uniform(-1.5, 1.5), rng.uniform(-3.0, 3.0)]
            eye = rng.uniform(-1.9, 5.9), rng.uniform(0.3, 2.2), rng.uniform(-1.9, 1.9)
            camera = Camera(eye, rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5))
            pictures.append(render(scene.at(np.array([place] * len(looks))), camera, 80, 60))
    whole, pieces = np.split(np.array(pictures), 2)
    np.testing.assert_array_equal(whole, pieces)


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.0, -1.0])
@pytest.mark.parametrize("pitch", [0.0, -0.3])
def test_a_shadow_at_the_edge_of_the_picture_has_room_for_all_of_its_corners(yaw: float, pitch: float) -> None:
    scene = build_scene([room(-2.0, 2.0, {})], [ShadowLook(2.0)], library=library(), places=np.zeros((1, 4)))
    roomier = replace(scene, layout=replace(scene.layout, most_corners=40))
    camera = Camera((-0.5, 1.2, 0.3), yaw, pitch)
    np.testing.assert_array_equal(render(scene, camera, 80, 60), render(roomier, camera, 80, 60))
