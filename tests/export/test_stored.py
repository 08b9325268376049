"""Worlds that have changed since: refused, unless the log holds what was observed and that is asked for."""

import io

import av
import pytest
from click.testing import CliRunner

from minihuman.cli.command_line import make_command_line
from minihuman.dataset.selection import Selection
from minihuman.errors import ExportError, LogError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.exporters.exporter import export_study
from minihuman.log.read.session_reader import read_events, read_log
from tests.export import changing
from tests.export.study import DEMO, recorded

PROTOCOL = """
[study]
name = "changing"
version = "1"
seed = 5

[[groups]]
name = "all"
blocks = ["wall"]

[[blocks]]
name = "wall"
world = "tests.export.changing:Changing-v0"
episodes = 2
actions = ["left", "right"]
max_steps = 10
record_observations = {recorded}
"""


def study(folder, *, stored):
    toml = PROTOCOL.format(recorded=str(stored).lower()).encode()
    return recorded(folder, participants=1, player="random", toml=toml)


def log_in(study):
    (log,) = study.rglob("*.mcap")
    return log


def exported(source, out, **how):
    import datasets

    export_study("imitation", source, out, Selection(), **how)
    return {
        str(dataset.parent.relative_to(out)): datasets.load_from_disk(str(dataset.parent)).to_dict()
        for dataset in sorted(out.rglob("dataset_info.json"))
    }


def test_stored_observations_are_those_of_the_replay_in_every_world_of_ours(tmp_path):
    toml = DEMO.read_bytes().replace(b"[[blocks]]\n", b"[[blocks]]\nrecord_observations = true\n")
    source = recorded(tmp_path / "data", participants=1, toml=toml)
    assert find_violations(read_events(log_in(source))) == []
    again, stored = exported(source, tmp_path / "again"), exported(source, tmp_path / "stored", stored_frames=True)
    assert len(again) == 2
    assert stored == again
    assert "stored in the logs" in (tmp_path / "stored" / "README.md").read_text()
    assert "played again" in (tmp_path / "again" / "README.md").read_text()


def test_a_changed_world_is_refused_and_then_exported_from_what_the_log_holds(tmp_path, monkeypatch):
    source = study(tmp_path / "data", stored=True)
    before = exported(source, tmp_path / "before")
    monkeypatch.setattr(changing, "shade", 90)
    with pytest.raises(ExportError, match=r"step 0: the replayed observation .*, or export those in the log with --st"):
        exported(source, tmp_path / "refused")
    assert not (tmp_path / "refused").exists()
    assert exported(source, tmp_path / "after", stored_frames=True) == before
    words = ["export", "parquet", str(source), str(tmp_path / "typed"), "--stored-frames"]
    typed = CliRunner().invoke(make_command_line(), words)
    assert (typed.exit_code, typed.output.splitlines()[-1][:20]) == (0, "2 episodes, 20 steps")
    assert "stored in the logs" in (tmp_path / "typed" / "README.md").read_text()


def test_a_log_that_holds_none_cannot_give_them(tmp_path, monkeypatch):
    from minihuman.replay.recording import save_recording

    source = study(tmp_path / "data", stored=False)
    with pytest.raises(ExportError, match=r"episode 1 has no stored observations .* export without --stored-frames"):
        exported(source, tmp_path / "out", stored_frames=True)
    monkeypatch.setattr(changing, "shade", 90)
    with pytest.raises(ExportError, match=r"export with \d+\.\d+\.\d+$"):
        exported(source, tmp_path / "out")
    with pytest.raises(LogError, match="no longer shows what the participant saw"):
        save_recording([read_log(log_in(source))], tmp_path / "view.rrd", with_view=True)


def test_the_replay_shows_what_the_log_holds_where_the_world_has_changed(tmp_path, monkeypatch):
    from rerun.chunk import RrdReader

    from minihuman.replay.recording import save_recording

    log = read_log(log_in(study(tmp_path / "data", stored=True)))
    monkeypatch.setattr(changing, "shade", 90)
    saved = save_recording([log], tmp_path / "view.rrd", with_view=True)
    [film] = [
        bytes(row["AssetVideo:blob"][0])
        for chunk in RrdReader(saved).stream().to_chunks()
        for row in chunk.to_record_batch().to_pylist()
        if row.get("AssetVideo:blob")
    ]
    with av.open(io.BytesIO(film)) as container:
        shown = [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(video=0)]
    seen = [observation for episode in log.episodes for observation in episode.observations]
    assert len(shown) == len(seen) == 22
    for one, other in zip(shown, seen, strict=True):  # a film's colours differ by some levels; the world's shade by 50
        assert abs(one[: other.shape[0], : other.shape[1]] - other).mean() < 10
    assert all(abs(picture[0, 0, 0] - 40) < 10 for picture in shown)
