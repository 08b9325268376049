"""What a replay's file holds, read back with rerun's own reader."""

from itertools import pairwise

import numpy as np
import pytest

from minihuman.errors import LogError
from minihuman.experiment.machine.events import KeyPressed, Noted, Paused
from tests.builders import made, plan, session, session_of
from tests.disks import fill, read_only, small_disk


@pytest.fixture(autouse=True)
def _strict():
    import rerun as rr

    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def rows(path, entity):
    """Every row of one entity, static ones left out, as (timelines, components) in order of session time."""
    from rerun.chunk import RrdReader

    from minihuman.replay.rerun_scene import SESSION_TIME

    found = []
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path == f"/{entity}" and not chunk.is_static:
            found += chunk.to_record_batch().to_pylist()
    return sorted(found, key=lambda row: row[SESSION_TIME])


def column(found, component):
    return [row[component] for row in found]


@pytest.fixture(scope="module")
def log():
    return session(episodes=2)


@pytest.fixture(scope="module")
def saved(log, tmp_path_factory):
    from minihuman.replay.recording import save_recording

    return save_recording([log], tmp_path_factory.mktemp("replay") / "session.rrd")


def test_the_agent_stands_and_looks_as_logged_at_every_step(log, saved):
    found = rows(saved, "sub-01_ses-01/map/agent")
    poses = np.concatenate([episode.poses for episode in log.episodes])
    origins = np.array(column(found, "Arrows2D:origins"))[:, 0]
    vectors = np.array(column(found, "Arrows2D:vectors"))[:, 0]
    assert np.allclose(origins, poses[:, [0, 2]], atol=1e-6)
    assert np.allclose(
        np.arctan2(-vectors[:, 1], vectors[:, 0]), np.arctan2(np.sin(poses[:, 3]), np.cos(poses[:, 3])), atol=1e-5
    )


def test_three_timelines_carry_time_step_and_episode(log, saved):
    from minihuman.replay.rerun_scene import EPISODE, SESSION_TIME, STEP

    found = rows(saved, "sub-01_ses-01/map/agent")
    times = np.concatenate([episode.t_ns for episode in log.episodes])
    assert [row[SESSION_TIME].value for row in found] == times.tolist()
    assert column(found, STEP) == list(range(len(times)))
    numbers = [episode.plan.episode + 1 for episode in log.episodes for _ in episode.t_ns]
    assert column(found, EPISODE) == numbers


def test_the_path_grows_to_the_whole_way_and_starts_again_in_the_next_episode(log, saved):
    strips = column(rows(saved, "sub-01_ses-01/map/path"), "LineStrips2D:strips")
    lengths = [len(strip[0]) for strip in strips]
    moved = [1 + int((np.abs(np.diff(e.poses[:, [0, 2]], axis=0)).sum(axis=1) > 0).sum()) for e in log.episodes]
    assert lengths == [length for whole in moved for length in range(1, whole + 1)]
    assert np.allclose(strips[moved[0] - 1][0][-1], log.episodes[0].poses[-1, [0, 2]])


def test_the_trail_is_the_last_stretch_of_the_path(saved):
    strips = [strip[0] for strip in column(rows(saved, "sub-01_ses-01/map/trail"), "LineStrips2D:strips")]
    whole = [strip[0] for strip in column(rows(saved, "sub-01_ses-01/map/path"), "LineStrips2D:strips")]
    assert max(map(len, strips)) == 13
    assert all(trail == path[-len(trail) :] for trail, path in zip(strips, whole, strict=True))


def test_each_episode_brings_its_walls_and_things(log, saved):
    walls = column(rows(saved, "sub-01_ses-01/map/walls"), "LineStrips2D:strips")
    assert [len(strips) for strips in walls] == [len(episode.start.map.walls) for episode in log.episodes]
    assert np.allclose(np.array(walls[0]).reshape(-1, 4), log.episodes[0].start.map.walls)
    things = rows(saved, "sub-01_ses-01/map/things")
    assert column(things, "Points2D:labels") == [["green goal"]] * 2 + [["red box"]] * 2


def test_rewards_and_reaction_times_are_the_logs(log, saved):
    rewards = np.array(column(rows(saved, "sub-01_ses-01/reward"), "Scalars:scalars")).ravel()
    assert rewards.tolist() == np.concatenate([episode.rewards for episode in log.episodes]).tolist()
    times = np.array(column(rows(saved, "sub-01_ses-01/reaction_ms"), "Scalars:scalars")).ravel()
    assert times.tolist() == np.concatenate([episode.rt_ms for episode in log.episodes]).tolist()


def test_keys_show_what_became_of_them_until_they_come_up(tmp_path):
    from minihuman.replay.recording import save_recording

    first = session(episodes=1).episodes[0]
    t_ns = int(first.t_ns[0])
    keys = tuple(
        KeyPressed(t_ns + i, key, key, down, None, verdict, "playing")
        for i, (key, down, verdict) in enumerate(
            [("9", True, "unmapped"), ("9", True, "repeat"), ("9", False, "release"), ("4", True, "spare")]
        )
    )
    log = session_of([first], keys=keys)
    saved = save_recording([log], tmp_path / "keys.rrd")
    assert column(rows(saved, "sub-01_ses-01/keys/9"), "StateChange:state") == [["unmapped"], [""]]
    assert column(rows(saved, "sub-01_ses-01/keys/4"), "StateChange:state") == [["spare"]]


def test_pauses_notes_and_presses_read_as_lines_in_order(tmp_path):
    from minihuman.replay.recording import save_recording

    first = session(episodes=1).episodes[0]
    notes = (Noted(1, "consent", "given"), Paused(5, "focus_lost"))
    saved = save_recording([session_of([first], notes=notes)], tmp_path / "events.rrd")
    lines = [text[0] for text in column(rows(saved, "sub-01_ses-01/events"), "TextLog:text")]
    assert lines[:2] == ["consent: given", "paused: focus_lost"]
    assert lines[2].startswith("episode 1 begins: minihuman/MiniGrid-FourRooms-v0, seed 100")
    assert lines[-1].startswith("episode 1 ends: goal")


def test_only_a_press_that_nothing_came_of_is_a_warning(tmp_path):
    from minihuman.replay.recording import save_recording

    presses = [
        KeyPressed(1, "enter", "enter", True, None, "accepted", "ready"),
        KeyPressed(2, "8", "8", True, None, "spare", "playing"),
    ]
    made_of = session_of([], keys=presses)
    found = rows(save_recording([made_of], tmp_path / "presses.rrd"), "sub-01_ses-01/events")
    assert column(found, "TextLog:level") == [["INFO"], ["WARN"]]


def test_the_facts_say_who_what_and_how_it_ended(log):
    from minihuman.replay.rerun_scene import build_facts_page

    page = build_facts_page(log)
    assert "# sub-01, session 1" in page
    assert (
        "| 2 | 1 | grid | minihuman/MiniGrid-FourRooms-v0 (seed 101) | 1: forward, 2: right, 3: left | timeout |"
        in page
    )


def test_the_layout_travels_inside_the_file(saved):
    from rerun.chunk import RrdReader

    assert len(RrdReader(saved).blueprints()) == 1


def test_several_sessions_share_a_timeline_on_which_their_episodes_begin_together(tmp_path):
    from minihuman.replay.recording import save_recording
    from minihuman.replay.rerun_scene import ALIGNED, session_root

    logs = [session(participant=f"sub-0{i}", seed=i, episodes=2) for i in (1, 2)]
    saved = save_recording(logs, tmp_path / "two.rrd")
    starts = [column(rows(saved, f"{session_root(log)}/map/walls"), ALIGNED) for log in logs]
    assert starts[0] == starts[1]
    for log, i in ((log, i) for log in logs for i in range(3)):
        took = int(log.episodes[i].t_ns[-1] - log.episodes[i].t_ns[0])
        assert (starts[0][i + 1] - starts[0][i]).value > took


def test_one_session_twice_is_refused(log, tmp_path):
    from minihuman.replay.recording import save_recording

    with pytest.raises(LogError, match="one session or several different ones"):
        save_recording([log, log], tmp_path / "x.rrd")


def test_the_return_stays_level_and_changes_at_once(log, saved):
    from minihuman.replay.rerun_scene import SESSION_TIME

    found = rows(saved, "sub-01_ses-01/return")
    points = [(row[SESSION_TIME].value, row["Scalars:scalars"][0]) for row in found]
    assert all(time == later or value == after for (time, value), (later, after) in pairwise(points))
    told = dict(points)  # the last of each time
    assert [told[int(episode.t_ns[0])] for episode in log.episodes] == [0.0] * len(log.episodes)
    assert [told[int(episode.t_ns[-1])] for episode in log.episodes] == [episode.return_ for episode in log.episodes]


def test_a_world_without_poses_still_shows_its_keys_and_rewards(tmp_path):
    from minihuman.replay.recording import save_recording

    blind = session_of([made(plan(), [(np.nan,) * 4] * 3, [2, 2], None)])
    saved = save_recording([blind], tmp_path / "blind.rrd")
    assert rows(saved, "sub-01_ses-01/map/agent") == []
    assert len(rows(saved, "sub-01_ses-01/reward")) == 2


def test_the_web_viewer_listens_on_this_machine_only(tmp_path):
    from minihuman.replay.recording import viewer_command

    command = viewer_command(tmp_path / "x.rrd", web=True)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert "--web-viewer" in command


@pytest.mark.parametrize(("with_first_bytes", "more_bytes"), [(False, 0), (False, 30_000), (True, 4096)])
def test_a_recording_that_a_disk_has_no_room_for_is_named_and_not_there(tmp_path, with_first_bytes, more_bytes):
    from minihuman.replay.recording import FIRST_BYTES, save_recording

    free = with_first_bytes * FIRST_BYTES + more_bytes
    log = session(episodes=60)
    with small_disk(tmp_path, 4 * 2**20):
        fill(tmp_path, but=free)
        with pytest.raises(OSError, match="No space left on device") as raised:
            save_recording([log, session(participant="sub-02", episodes=60)], tmp_path / "session.rrd")
        assert raised.value.filename == str(tmp_path / "session.rrd")
        assert [path.name for path in tmp_path.iterdir()] == ["ballast"]


def test_a_recording_that_cannot_be_written_is_named(log, tmp_path):
    from minihuman.replay.recording import save_recording

    with pytest.raises(IsADirectoryError) as raised:
        save_recording([log], tmp_path)
    assert raised.value.filename == str(tmp_path)
    with read_only(tmp_path), pytest.raises(OSError, match="Read-only file system") as raised:
        save_recording([log], tmp_path / "session.rrd")
    assert raised.value.filename == str(tmp_path / "session.rrd")
