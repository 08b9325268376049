"""The shipped study of two groups as a static site, from its consent to its end, beside the served study."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import minihuman
from minihuman import study_site
from minihuman.admin.protocol_file import read_protocol
from minihuman.api import report
from minihuman.web.site.site_folder import plan_site_session, write_site
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.firefox import firefox_at
from tests.web.serving import serving
from tests.web.site.static_site import hosting
from tests.web.site.study_walk import Fingers, FirefoxHands, Hands, StudyWalk
from tests.web.test_phone import PHONE_PX, ChromiumPhone

pytestmark = pytest.mark.program
SHIPPED = Path(__file__).parents[3] / "protocols" / "online.toml"
STUDIES = ("online", "served/online")
COMPARED = {
    "episodes": ["participant", "group", "block", "world", "seed", "outcome", "steps", "reward"],
    "answers": ["participant", "questions", "item", "answer", "said"],
    "steps": ["participant", "episode", "step", "action", "key", "reward", "x", "z"],
}
GROUPS = 2  # which the first two slots are of


def write_online(folder: Path, *, on_phone: bool) -> Path:
    """Write the shipped study, without an address of a platform; for a phone, without its size of window."""
    text = SHIPPED.read_text(encoding="utf-8")
    text = re.sub(r"^(redirect|recruitment_platforms) = .*\n", "", text, flags=re.MULTILINE)
    if on_phone:
        text = re.sub(r"^min_window_size_px = .*$", "require_keyboard = false", text, flags=re.MULTILINE)
    path = folder / "online.toml"
    path.write_text(text, encoding="utf-8")
    return path


@contextmanager
def hands_at(browser: str, url: str, profile: Path) -> Iterator[Hands]:
    """Hands at a page, in a browser of their own."""
    if browser == "firefox":
        with firefox_at(url, profile) as page:
            yield FirefoxHands(page)
        return
    is_phone = browser == "phone"
    with browsing(size=PHONE_PX if is_phone else (1366, 768)) as sit_down:
        options = {"has_touch": True, "is_mobile": True, "device_scale_factor": 2} if is_phone else {}
        person = sit_down(url, **options)
        keys = Hands(person.page)
        yield Fingers(ChromiumPhone(person), keys) if is_phone else keys
        assert person.errors == []


def walk_site(browser: str, protocol: Path, folder: Path) -> list[list[str]]:
    """Have a participant of each group go through the site; return the words of their screens."""
    study = read_protocol(protocol)
    write_site(study, folder / "site", collector="http://127.0.0.1:9/", slots=GROUPS)
    words = []
    with hosting(folder / "site") as host:
        settings = folder / "site/study/site.json"
        settings.write_text(settings.read_text().replace("http://127.0.0.1:9/", f"{host.address}save"))
        for slot in range(GROUPS):
            with hands_at(browser, f"{host.address}?slot={slot + 1}", folder / f"site-{slot}") as hands:
                walk = StudyWalk(hands, plan_site_session(study, slot))
                walk.walk()
                words.append(walk.words)
        assert "C0MPLETE" in (folder / "site/study/slot-0.json").read_text()
        host.write_posted(folder / "parts")
    return words


def walk_served(browser: str, protocol: Path, folder: Path) -> list[list[str]]:
    """Have the same two go through the served study."""
    study = read_protocol(protocol)
    words = []
    with serving(protocol, folder / "served", links=GROUPS) as served:
        for slot, token in enumerate(served.tokens):
            url = f"http://127.0.0.1:{served.port}/#t={token}"
            with hands_at(browser, url, folder / f"served-{slot}") as hands:
                walk = StudyWalk(hands, plan_site_session(study, slot))
                walk.walk()
                words.append(walk.words)
    return words


def read_report(study: Path, out: Path) -> str:
    """Return a study's report without its pictures, the measures of time, and the sentence on witnesses."""
    report(study, out)
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "Consistent, not witnessed" in text or study.parent.name == "served"
    text = re.sub(r'<p class="key">Consistent, not witnessed:.*?</p>\s*', "", text, flags=re.DOTALL)
    text = re.sub(r'src="data:[^"]*"', "", text)
    text = re.sub(r"<details><summary>By session.*?</details>", "", text, flags=re.DOTALL)
    rows = re.sub(r"<tr>(?:(?!</tr>).)*(?:\((?:s|ms)\)|time)(?:(?!</tr>).)*</tr>", "", text, flags=re.DOTALL)
    rows = re.sub(r"<p>\d+ of \d+ presses were processed .*?</p>", "", rows, flags=re.DOTALL)
    rows = re.sub(r'<a href="tables/links\.\w+">links\.\w+</a>, ', "", rows)  # of connections, which a site has none of
    before, answers, after = re.split(r'(<h2 id="answers">.*?(?=<h2))', rows, maxsplit=1, flags=re.DOTALL)
    return before + re.sub(r"<td>[\d.]+</td></tr>", "</tr>", answers) + after  # the median times


@pytest.mark.nightly
@pytest.mark.parametrize(
    "browser",
    [
        pytest.param("chromium", marks=needs("chromium")),
        pytest.param("firefox", marks=needs("firefox")),
        pytest.param("phone", marks=needs("chromium")),
    ],
)
def test_a_site_and_a_server_record_the_same_study_of_the_same_presses(browser, tmp_path):
    protocol = write_online(tmp_path, on_phone=browser == "phone")
    site_words = walk_site(browser, protocol, tmp_path)
    records = list(study_site.import_site_data(tmp_path / "parts", study=tmp_path / "online", protocol=protocol))
    assert [(record.error, record.differences) for record in records] == [(None, ())] * GROUPS
    assert all(line.ok for line in minihuman.verify(tmp_path / "online"))
    served_words = walk_served(browser, protocol, tmp_path)
    assert site_words == served_words
    reports = {place: read_report(tmp_path / place, tmp_path / f"report-{place[:4]}") for place in STUDIES}
    assert reports[STUDIES[0]].split() == reports[STUDIES[1]].split()
    tables = [minihuman.open_study(tmp_path / place).table for place in STUDIES]
    for name, columns in COMPARED.items():
        site, served = (table(name, with_excluded=True)[columns] for table in tables)
        assert site.equals(served), name
        assert len(site) > 1
