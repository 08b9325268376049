"""A grid observation in words, held to the wording of BabyAI-Text as BALROG prints it."""

import numpy as np
import pytest

import minihuman  # noqa: F401 - registers the worlds
from minihuman.errors import WorldError
from minihuman.worlds.adapters.world import World
from minihuman.worlds.adapters.world_text import describe_view, draw_text
from tests.models import balrog_progression
from tests.models.balrog_text import DIGESTS, describe_states, digest_states

WALL, DOOR, KEY, BALL = 2, 4, 5, 6


def view(*cells: tuple[int, int, int, int, int], carries: tuple[int, int, int] | None = None) -> np.ndarray:
    """An empty view of 7 x 7 with some (column, row, kind, colour, state)."""
    image = np.zeros((7, 7, 3), np.uint8)
    image[..., 0] = 1
    for x, y, *cell in cells:
        image[x, y] = cell
    if carries:
        image[3, 6] = carries
    return image


def test_walls_are_named_only_where_nothing_is_in_between() -> None:
    image = view((3, 2, WALL, 5, 0), (0, 6, WALL, 5, 0), (2, 6, BALL, 0, 0), (6, 6, WALL, 5, 0))
    assert list(describe_view(image)) == ["a wall 4 steps forward", "a wall 3 steps right", "a red ball 1 step left"]


def test_things_come_column_by_column_with_their_state() -> None:
    image = view((4, 5, DOOR, 4, 2), (1, 6, KEY, 2, 0), (3, 5, DOOR, 0, 0), carries=(BALL, 3, 0))
    assert list(describe_view(image)) == [
        "You carry a purple ball",
        "a blue key 2 steps left",
        "a open red door 1 step forward",
        "a locked yellow door 1 step right and 1 step forward",
    ]


def test_ten_thousand_states_are_in_the_words_that_balrog_gives_a_model() -> None:
    """The digests are those of BALROG's Minigrid; the states are our worlds' of the same names and seeds."""
    ours = describe_states("minihuman/", lambda observation, _: list(describe_view(observation["image"])))
    assert digest_states(ours) == DIGESTS.read_text().split()


def test_a_view_without_a_grid_has_no_words() -> None:
    world = World("minihuman/MiniWorld-Hallway-v0")
    world.reset(0)
    with pytest.raises(WorldError, match="modality = 'picture'"):
        world.text()
    world.close()


def test_people_get_the_text_of_the_moment_in_a_picture_of_one_size() -> None:
    world = World("minihuman/BabyAI-GoTo-v0")
    world.reset(3)
    shown = [world.frame("text", (320, 240))]
    saved = world.save()
    world.advance(0)  # which makes no observation
    turned, ahead = world.frame("text", (320, 240)), world.text()
    world.restore(saved)
    assert world.text() != ahead
    world.step(0)
    assert world.text() == ahead
    shown += [turned, world.frame("text", (320, 240))]
    assert {picture.shape for picture in shown} == {(240, 320, 3)}
    assert np.array_equal(shown[1], shown[2])
    assert not np.array_equal(shown[0], shown[1])
    world.close()


def test_a_text_of_many_lines_fits_its_picture() -> None:
    rows, lines = ["WW" * 7] * 7, ["a closed purple door 12 steps right and 10 steps forward"] * 30
    picture = draw_text("\n".join([*rows, "", *lines]), (640, 480))
    inked = np.argwhere((picture > 60).any(2))
    assert inked.min() >= 5
    assert (inked.max(0) <= (475, 635)).all()
    assert (picture > 60).any((1, 2)).sum() > 300


@pytest.mark.program
@pytest.mark.filterwarnings("ignore:.*Overriding environment")  # Gymnasium's, where another test registered them
def test_actions_make_the_progress_that_they_make_in_minigrid() -> None:
    minigrid = pytest.importorskip("minigrid")
    minigrid.register_minigrid_envs()
    episodes, reached, different = balrog_progression.compare(episodes=1)
    assert episodes == 2 * len(balrog_progression.LEVELS)
    assert 0 < reached < episodes
    assert different == []
