"""The study of partners in Chromium: people of `analysis/team_partners.toml`, each in a browser of their own.

    python -m tests.activities.team.partners FOLDER [--teams 8] [--episodes 2] [--steps 40] [--at-once 6]

FOLDER has `clone.pt` and `self-play.pt` (`python analysis/team_partners.py FOLDER` makes them). Each person presses the
keys of the scripted cook's next action, found from the log that the server writes; the logs go to FOLDER/browsers.
"""

import argparse
import shutil
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import minihuman
from minihuman.activities.team.events import JointStepped, TeamFormed
from minihuman.admin.verify.episodes import verify_teams
from minihuman.agents.team_agents import KitchenView
from minihuman.experiment.machine.events import EpisodeStarted
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving

PROTOCOL = Path(__file__).parents[3] / "analysis" / "team_partners.toml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--teams", type=int, default=8, help="per condition")
    parser.add_argument("--episodes", type=int, default=2)
    parser.add_argument("--steps", type=int, default=40, help="per episode")
    parser.add_argument("--at-once", type=int, default=6, help="people")
    browse_study(**vars(parser.parse_args()))


def browse_study(folder: Path, *, teams: int, episodes: int, steps: int, at_once: int) -> None:
    """Play the study, so many teams a condition, and print what its logs prove."""
    policies, folder = folder, folder / "browsers"
    folder.mkdir(exist_ok=True)
    for name in ("clone.pt", "self-play.pt"):
        shutil.copy(policies / name, folder)
    text = PROTOCOL.read_text(encoding="utf-8").replace("max_steps = 200", f"max_steps = {steps}")
    text = text.replace("episodes = 4", f"episodes = {episodes}").replace(
        'stand_in = "scripted:cook"', 'stand_in = "scripted:cook"\nlobby_s = 3600.0\npartner_wait_s = 3600.0'
    )
    text = text.replace("participants = 100", f"participants = {5 * teams}")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    began_s = time.monotonic()
    play_study(folder / "study.toml", folder / "data", 5 * teams, at_once)
    print(f"{time.monotonic() - began_s:.0f} s", *describe(folder / "data" / "team-partners"), sep="\n")


def play_study(protocol: Path, data: Path, people: int, at_once: int) -> None:
    """Let people come, so many at once, and play to the end of their sessions."""
    with serving(protocol, data, links=people) as served, browsing() as sit_down:
        tokens, playing = list(served.tokens), list[Cook]()
        moved_s = time.monotonic()
        while tokens or playing:
            while tokens and len(playing) < at_once:
                playing.append(Cook(sit_down(f"http://127.0.0.1:{served.port}/#t={tokens.pop(0)}"), data))
            for cook in list(playing):
                if cook.somebody.state["finished"]:
                    assert cook.somebody.errors == []
                    cook.somebody.page.context.close()
                    playing.remove(cook)
                    moved_s = time.monotonic()
                elif cook.act():
                    moved_s = time.monotonic()
            assert time.monotonic() - moved_s < PATIENCE_S, [cook.somebody.screen() for cook in playing]
        served.stop()


class Cook:
    """A person in front of a page, who wants what the scripted cook does."""

    def __init__(self, somebody: Somebody, data: Path) -> None:
        before = set(find_logs(data))
        self.somebody, self._step = somebody, (-1, -1)
        somebody.until("s.welcomed && s.kind !== ''")
        while not (new := set(find_logs(data)) - before):
            somebody.press("enter")
            somebody.page.wait_for_timeout(100)
        [self._folder] = {path.parent for path in new}

    def act(self) -> bool:
        """Press what the screen asks for; in play one key for each step. Whether something was pressed."""
        if not self.somebody.state["playing"]:
            self.somebody.press("4", "enter")
            return False
        [log] = find_logs(self._folder)
        steps = list[tuple[int, ...]]()
        started = seat = None
        for event in read_events(log):
            match event:
                case TeamFormed():
                    seat = event.seat
                case EpisodeStarted():
                    started, steps = event, []
                case JointStepped():
                    steps.append(event.actions)
        if started is None or seat is None or (place := (started.plan.episode, len(steps))) == self._step:
            return False
        plan = started.plan
        with closing(World(plan.world, {**plan.options, "seat": seat, "script": steps})) as world:
            world.reset(plan.seed)
            for joint in steps:
                world.step(joint[seat])
            action = world.action_names[KitchenView(world.unwrapped.team, seat).choose()[0]]
        self._step = place
        keys = {name: key for key, name in plan.key_map.keys.items()}
        self.somebody.press(keys.get(action, keys["interact"]))  # "stay" has no key, and a turn waits for one
        return True


def find_logs(folder: Path) -> Iterator[Path]:
    """The logs in a data folder, live or finished."""
    return (path for path in folder.rglob("*.mcap*"))


def describe(study: Path) -> Iterator[str]:
    """What the logs prove, and a line per condition."""
    lines, logs = list(minihuman.verify(study)), [read_log(path) for path in sorted(study.rglob("*.mcap"))]
    yield f"{len(logs)} logs, {sum(not line.ok for line in lines)} lines of verify not as logged"
    yield f"{sum(good for _, good in verify_teams(study))} teams of several people proven in all their logs"
    ended = Counter(log.end_reason for log in logs)
    yield f"sessions ended: {dict(ended)}"
    for group in sorted({log.plan.participant.group for log in logs}):
        own = [log for log in logs if log.plan.participant.group == group]
        episodes = [episode for log in own for episode in log.episodes if episode.team is not None]
        teams = {episode.team.team for episode in episodes if episode.team is not None}
        sources = Counter(source for one in episodes if one.team for step in one.team.sources for source in step)
        mean = sum(episode.return_ for episode in episodes) / max(1, len(episodes))
        steps = sum(len(episode.actions) for episode in episodes)
        played = f"{len(own)} people, {len(teams)} teams, {steps} steps, reward {mean:.1f}"
        yield f"{group}: {played}, actions {dict(sources)}"


if __name__ == "__main__":
    main()
