"""Worlds by Wave Function Collapse lay out what Minigrid lays out of the same picture, draw for draw."""

import hashlib
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from minigrid.envs.wfc import WFCEnv
from minigrid.envs.wfc.config import WFC_PRESETS, WFCConfig
from PIL import Image

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.wfc.collapse import largest_part
from minihuman.worlds.grid.wfc.family import PICTURES, PRESETS, wfc
from tests.counts import count
from tests.machine import needs, where

SIZE = count(9, 25)
SEEDS = count(1, 40)

# of 20 layouts of 25 x 25 cells, start, goal and direction included, from Minigrid's own pictures (commit 90928729)
FROM_ITS_PICTURES = {
    "MazeSimple": "cc6324487dd6edf7",
    "DungeonMazeScaled": "5271cb9e88ea09f6",
    "RoomsFabric": "44f2df7cc43ce096",
    "ObstaclesBlackdots": "c35c2ea0f6391099",
    "ObstaclesAngular": "3ceace83b37e9d5a",
    "ObstaclesHogs3": "d1c13a8da114e206",
}
FROM_OURS = {
    **FROM_ITS_PICTURES,
    "RoomsFabric": "f247ffeff647d514",
    "ObstaclesAngular": "b8ff200cc127a26e",
    "ObstaclesHogs3": "9183c219d7bfcbbe",
}
ITS_PICTURES = where("patterns")  # a folder: no package holds them


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Our pictures as files, for a reader of files."""
    folder = tmp_path_factory.mktemp("pictures")
    for name, text in PICTURES.items():
        lines = np.array([[255 * (sign != "#") for sign in line] for line in text.split()], np.uint8)
        Image.fromarray(np.stack([lines] * 3, -1)).save(folder / f"{name}.png")
    return folder


def world(preset, **options):
    return gymnasium.make(f"minihuman/MiniGrid-WFC-{preset}-v0", **options).unwrapped


def its_world(preset, folder, **options):
    read, as_it_has_it = PRESETS[preset], WFC_PRESETS[preset]
    config = WFCConfig(
        Path(folder, f"{read.picture}.png"),
        pattern_width=as_it_has_it.pattern_width,
        output_periodic=as_it_has_it.output_periodic,
    )
    return WFCEnv(config, **options)


def assert_same(ours, theirs, seed):
    observation, _ = ours.reset(seed=seed)
    expected, _ = theirs.reset(seed=seed)
    codes = ours.state.cells
    np.testing.assert_array_equal(np.stack([codes & 15, codes >> 4 & 7, codes >> 7 & 3], -1), theirs.grid.encode())
    np.testing.assert_array_equal(observation["image"], expected["image"])
    assert (ours.state.position, ours.state.direction) == (tuple(theirs.agent_pos), theirs.agent_dir)
    assert (ours.mission, ours.max_steps) == (theirs.mission, theirs.max_steps)
    assert ours.np_random.bit_generator.state == theirs.np_random.bit_generator.state


@pytest.mark.nightly(by_day=["MazeSimple-True", "DungeonMazeScaled-False", "ObstaclesBlackdots-True"])
@pytest.mark.parametrize("connected", [True, False])
@pytest.mark.parametrize("preset", PRESETS)
def test_the_same_picture_and_seed_give_minigrids_layout_and_stream(preset, connected, pictures):
    ours = world(preset, size=SIZE, ensure_connected=connected, patterns=str(pictures))
    theirs = its_world(preset, pictures, size=SIZE, ensure_connected=connected)
    for seed in range(SEEDS):
        assert_same(ours, theirs, seed)
    assert_same(ours, theirs, None)  # and where the last episode left the stream


def test_the_presets_are_minigrids():
    assert list(PRESETS) == list(WFC_PRESETS)
    for name, config in WFC_PRESETS.items():
        assert PRESETS[name] == (config.pattern_path.stem, config.pattern_width, config.output_periodic)
        assert (config.tile_size, config.rotations, config.backtracking) == (1, 8, False)
        assert (config.loc_heuristic, config.choice_heuristic) == ("entropy", "weighted")


def layouts(preset, **options):
    env = world(preset, **options)
    found = hashlib.sha256()
    for seed in range(20):
        env.reset(seed=seed)
        found.update((env.state.cells.astype(np.int64) & 511).tobytes())
        found.update(np.array([*env.state.position, env.state.direction]).tobytes())
    return found.hexdigest()[:16]


@pytest.mark.parametrize("preset", PRESETS)
def test_layouts_stay_what_they_are(preset):
    assert layouts(preset) == FROM_OURS[preset]


@needs("patterns")
@pytest.mark.parametrize("preset", PRESETS)
def test_layouts_of_minigrids_own_pictures_are_its_layouts(preset):
    assert layouts(preset, patterns=ITS_PICTURES) == FROM_ITS_PICTURES[preset]
    if count(0, 1):
        ours, theirs = world(preset, patterns=ITS_PICTURES), its_world(preset, ITS_PICTURES)
        for seed in range(SEEDS):
            assert_same(ours, theirs, seed)


def test_a_picture_of_ones_own_is_read_from_a_folder(tmp_path):
    stripes = np.full((4, 4, 3), 255, np.uint8)
    stripes[:, 0] = 0
    Image.fromarray(stripes).save(tmp_path / "Blackdots.png")
    env = world("ObstaclesBlackdots", patterns=str(tmp_path), ensure_connected=False, size=9)
    env.reset(seed=1)
    inside = env.state.kinds[1:-1, 1:-1] == 2
    assert inside.any()
    assert (inside == inside[:1]).all() or (inside == inside[:, :1]).all()  # the same in every row, or column


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"wfc_config": "Maze"}, "wfc_config is 'Maze'; use one of 'MazeSimple'"),
        ({"size": 4}, "size is 4; it must be a whole number from 5 to 64"),
        ({"patterns": 3}, "patterns must be the path of a folder, not 3"),
        ({"patterns": "/nowhere"}, "cannot be read as a picture"),
        ({"ensure_connected": 1}, "ensure_connected is 1; it must be true or false"),
    ],
)
def test_what_is_not_possible_is_said_in_a_line(options, words):
    with pytest.raises(WorldError, match=words):
        wfc(**options)


def test_a_picture_whose_patterns_never_fit_is_given_up(tmp_path):
    picture = np.full((3, 3, 3), 255, np.uint8)  # three colours, each in one place: beside none of them is another
    picture[:, :, 1] = np.arange(9).reshape(3, 3)
    Image.fromarray(picture).save(tmp_path / "Hogs.png")
    env = world("ObstaclesHogs3", patterns=str(tmp_path), size=12)
    with pytest.raises(WorldError, match="1000 attempts at 10 x 10 cells ended in contradiction"):
        env.reset(seed=0)


def test_the_largest_part_comes_in_the_layouts_order_unless_it_is_small():
    whole = [(x, y) for x in range(4) for y in range(4)]
    assert largest_part(whole) == whole
    small = [(0, 0), (0, 1), (0, 2), *((10 + 2 * k, 0) for k in range(9))]
    assert set(largest_part(small)) == {(0, 0), (0, 1), (0, 2)}
    assert largest_part([(0, 0), (5, 5)]) == []
