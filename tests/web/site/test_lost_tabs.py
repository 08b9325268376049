"""Sessions of a site whose tab is killed or network cut at a drawn moment, with stand-ins of the collectors."""

import random
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import minihuman
from minihuman import study_site
from minihuman.admin.protocol_file import read_protocol
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.read.session_reader import read_log
from minihuman.web.site.site_folder import plan_site_session, write_site
from tests.counts import count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.site.collectors import EXPERIMENT, DataPipe, Jatos, running_datapipe, running_jatos
from tests.web.site.static_site import hosting, write_protocol
from tests.web.site.study_walk import Hands, StudyWalk

pytestmark = [pytest.mark.program, needs("chromium")]
SESSIONS = count(4, 200)
EPISODES = 3
SLOTS = 4
ACTS = 24  # of a whole session: a text, three times a start and five steps, two questions, and what is between
SCENARIOS = ("killed for good", "killed, comes back", "cut for a while", "cut and killed, comes back")
COLLECTORS = {"datapipe": f"datapipe:{EXPERIMENT}", "jatos": "jatos"}


class TabLostError(Exception):
    """The tab is gone."""


class Hit:
    """What happens to a tab before an act of its participant, once.

    Args:
        person: the participant.
        scenario: one of `SCENARIOS`.
        moment: the number of acts before it.
        wait_ms: from the act before to the kill.
    """

    def __init__(self, person: Somebody, scenario: str, moment: int, wait_ms: float) -> None:
        self._person = person
        self._scenario = scenario
        self._moment = moment
        self._wait_ms = wait_ms

    def __call__(self) -> None:
        """Count an act; kill the tab or cut the network if it is time.

        Raises:
            TabLostError: if the tab is killed.
        """
        self._moment -= 1
        if self._moment != -1:
            return
        page = self._person.page
        if self._scenario.startswith("cut"):
            page.context.set_offline(True)
        page.wait_for_timeout(self._wait_ms)
        if "killed" in self._scenario:
            page.close()
            raise TabLostError
        page.context.set_offline(False)


@contextmanager
def collecting(name: str, site: Path) -> Iterator[tuple[str, DataPipe | Jatos]]:
    """Run a stand-in of a collector; yields the address of the study, and the stand-in."""
    if name == "jatos":
        with running_jatos(site) as run:
            yield run.address, run
        return
    script = site / "static" / "collectors.js"
    with running_datapipe() as pipe, hosting(site) as host:
        script.write_text(re.sub(r"const DATAPIPE = .*;", f'const DATAPIPE = "{pipe.address}";', script.read_text()))
        yield host.address, pipe


def go_through(sit_down: Any, url: str, study: Protocol, draw: random.Random, scenario: str) -> StudyWalk:
    """Go through the study until the tab is lost, or to the end, also in a second tab if the participant comes back."""
    slot = draw.randrange(SLOTS)
    person = sit_down(f"{url}?slot={slot + 1}")
    hit = Hit(person, scenario, draw.randrange(1, ACTS), draw.uniform(0, 1_000))
    walk = StudyWalk(Hands(person.page), plan_site_session(study, slot), hit)
    try:
        walk.walk()
    except TabLostError:
        if scenario.endswith("comes back"):
            person.page.context.set_offline(False)
            walk.come_back(Hands(Somebody(person.page.context, f"{url}?slot={slot + 1}").page))
    return walk


@pytest.mark.nightly(by_day=["datapipe"])
@pytest.mark.parametrize("collector", ["datapipe", "jatos"])
def test_a_lost_tab_costs_at_most_the_running_episode(collector, tmp_path):
    protocol = write_protocol(tmp_path)
    protocol.write_text(protocol.read_text().replace("episodes = 2", f"episodes = {EPISODES}"))
    study = read_protocol(protocol)
    write_site(study, tmp_path / "site", collector=COLLECTORS[collector], slots=SLOTS)
    draw = random.Random(collector)
    walks = []
    with browsing() as sit_down:
        for number in range(SESSIONS // 2):
            scenario = SCENARIOS[3 * number % len(SCENARIOS)]
            with collecting(collector, tmp_path / "site") as (url, store):
                walks.append((scenario, go_through(sit_down, url, study, draw, scenario)))
            keep = store.write_files if isinstance(store, DataPipe) else store.write_results
            keep(tmp_path / f"data-{number}")
    outcomes: Counter[str] = Counter()
    for number, (scenario, walk) in enumerate(walks):
        outcomes += check_session(tmp_path / f"data-{number}", tmp_path / "thin", protocol, scenario, walk)
    verified = [line.ok for line in minihuman.verify(tmp_path / "thin")]
    assert all(verified)
    print(f"{collector}: {len(walks)} sessions, {len(verified)} logs verified; {dict(sorted(outcomes.items()))}")


def check_session(data: Path, folder: Path, protocol: Path, scenario: str, walk: StudyWalk) -> Counter[str]:
    """Import what a collector has of a session, and compare it with how far the participant came."""
    if not any(path.stat().st_size for path in data.iterdir()):
        assert walk.n_begun <= 1
        return Counter({f"{scenario}: nothing sent": 1})
    (imported,) = study_site.import_site_data(data, study=folder, protocol=protocol)
    assert (imported.error, imported.differences) == (None, ())
    assert imported.log is not None
    episodes = read_log(imported.log).episodes
    n_complete = sum(episode.outcome == "goal" for episode in episodes)
    assert len({episode.start.plan.episode for episode in episodes}) == len(episodes), "none is doubled"
    if scenario != "killed for good":
        assert n_complete == EPISODES
    assert walk.n_begun - n_complete <= 1
    return Counter({f"{scenario}: {walk.n_begun - n_complete} lost": 1})
