"""A study without a server: a static folder in Chromium, and its record run again by the real session machine."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import msgspec
import pytest

import minihuman
from minihuman import study_site
from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.protocol_file import read_protocol
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.web.site.record_import import ImportedRecord, import_records
from minihuman.web.site.site_error import SiteError
from minihuman.web.site.site_folder import plan_site_session, write_site
from minihuman.web.site.support import require_site_support
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import Serving
from tests.web.site.static_site import READ_ARCHIVE, Visitor, hosting, write_protocol

TO_THE_GOAL = (2, 2, 1, 2, 2)  # forward, forward, right, ... in Empty-5x5


@dataclass(frozen=True)
class PlayedSite:
    protocol: Path
    folder: Path
    record: Path


def make_site(folder: Path, *, collector: str = "download", slots: int = 1, **settings: Any) -> tuple[Path, Path]:
    protocol = write_protocol(folder, **settings)
    write_site(read_protocol(protocol), folder / "site", collector=collector, slots=slots)
    return protocol, folder / "site"


def read_script(site: Path, slot: int = 0) -> dict[str, Any]:
    return json.loads((site / "study" / f"slot-{slot}.json").read_text())


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> PlayedSite:
    """A whole session, with the page loaded again in an episode, and a question whether to end it."""
    folder = tmp_path_factory.mktemp("played")
    protocol, site = make_site(folder)
    with hosting(site) as host, browsing() as sit_down:
        person = sit_down(host.address)
        visitor = Visitor(person, read_script(site))
        visitor.until_words("green square")
        visitor.press("Enter")
        visitor.until_words("Ready?")
        visitor.begin_episode(0)
        visitor.act(0, *TO_THE_GOAL)
        visitor.until_words("Goal reached after 5 steps.")
        visitor.begin_episode(1)
        visitor.act(1, *TO_THE_GOAL[:2])
        person.page.reload()
        person.until_seen("s.welcomed && s.playing && s.step === 2")
        visitor.press("Escape")
        visitor.until_words("End the session?")
        visitor.press("Enter")
        person.until_seen("s.playing && s.step === 2")
        visitor.act(1, *TO_THE_GOAL[2:])
        visitor.until_words("Reward: 0.9")
        visitor.press("Enter")
        visitor.until_words("How hard was it?")
        visitor.press("4")
        visitor.press("Enter")
        visitor.until_words("What did you see?")
        visitor.press("PageUp")
        visitor.until_words("How hard was it?")
        assert person.page.locator("[aria-checked=true]").count() == 1
        visitor.press("5")
        visitor.press("Enter")
        visitor.until_words("What did you see?")
        visitor.press("1")
        visitor.press("Enter")
        visitor.until_words("That was all.")
        with person.page.expect_download() as download:
            visitor.press("Enter")
        download.value.save_as(folder / "record.json")
        person.until("s.finished")
        assert not person.errors
        person.page.reload()
        person.page.wait_for_function("document.body.innerText.includes('already taken part')")
    return PlayedSite(protocol, site, folder / "record.json")


def import_record(played: PlayedSite, data: Path, *records: Path) -> list[ImportedRecord]:
    return list(import_records(records or [played.record], data / "thin", read_protocol(played.protocol)))


def change_record(played: PlayedSite, folder: Path, **changes: Any) -> Path:
    record = json.loads(played.record.read_text()) | changes
    path = folder / "changed.json"
    path.write_text(json.dumps(record))
    return path


@needs("chromium")
@pytest.mark.program
def test_a_session_of_a_site_is_the_session_machines_own(played, tmp_path):
    (imported,) = import_record(played, tmp_path)
    assert imported.differences == ()
    assert imported.screens >= 11  # each of which was waited for
    assert all(line.ok for line in minihuman.verify(tmp_path / "thin"))
    study = minihuman.open_study(tmp_path / "thin")
    (session,) = study.sessions
    assert [(episode.outcome, episode.steps) for episode in session.episodes] == [("goal", 5), ("goal", 5)]
    assert session.end_reason == "complete"
    assert study.table("participants").evidence.tolist() == ["consistent"]
    answers = study.table("answers", with_excluded=True)
    assert answers.item.tolist() == ["hard", "hard", "seen"]
    assert "imported before" in import_record(played, tmp_path)[0].text


@needs("chromium")
@pytest.mark.program
def test_a_second_participant_of_a_slot_is_another_participant(played, tmp_path):
    other = change_record(played, tmp_path, id="00112233aabbccdd")
    first, second = import_record(played, tmp_path, played.record, other)
    assert {first.log.parts[-3], second.log.parts[-3]} == {"sub-01", "sub-100001"}
    assert "slot 1 was taken 1 times before" in second.text


@needs("chromium")
@pytest.mark.program
def test_an_imported_slot_is_of_the_protocols_own_allocation_list(played, tmp_path):
    import_record(played, tmp_path)
    protocol = read_protocol(played.protocol)
    (slot,) = read_enrolled(tmp_path / "thin")
    study = msgspec.structs.replace(protocol.study, participants=slot.list_length)
    slots = build_allocation_list(msgspec.structs.replace(protocol, study=study))
    assert slot.allocation_sha256 == allocation_sha256(slots)


@needs("chromium")
@pytest.mark.program
def test_changes_of_a_record_are_refused_or_reported(played, tmp_path):
    messages = json.loads(played.record.read_text())["messages"]
    press = next(
        number for number, text in enumerate(messages) if text.startswith('["k"') and len(json.loads(text)) > 6
    )
    key = json.loads(messages[press])
    key[6] = "0" * 16
    tampered = [*messages[:press], json.dumps(key), *messages[press + 1 :]]
    (imported,) = import_record(played, tmp_path, change_record(played, tmp_path, messages=tampered))
    (difference,) = imported.differences
    assert "was computed otherwise in the page: its digest is 0000000000000000" in difference
    assert all(line.ok for line in minihuman.verify(imported.log))
    for changes, error in [
        ({"build": "0" * 32}, "recorded by build"),
        ({"slot": 9}, "slot 10 is none of the study's 4"),
        ({"messages": messages[:3] + messages[4:]}, "messages in between are missing"),
    ]:
        (refused,) = import_record(played, tmp_path, change_record(played, tmp_path, **changes))
        assert error in str(refused.error)
    with pytest.raises(SiteError, match="is no record of a site"):
        import_record(played, tmp_path, change_record(played, tmp_path, slot="first"))


@needs("chromium")
@pytest.mark.program
def test_nothing_is_sent_before_the_consent_and_a_left_session_is_kept_in_part(tmp_path):
    protocol, site = make_site(tmp_path, collector="http://127.0.0.1:9/", slots=1)
    with hosting(site) as host, browsing() as sit_down:
        settings = json.loads((site / "study/site.json").read_text())
        (site / "study/site.json").write_text(json.dumps(settings | {"collector": f"{host.address}save"}))
        decliner = sit_down(host.address)
        Visitor(decliner, read_script(site)).until_words("green square")
        decliner.page.wait_for_timeout(6_000)  # longer than a period of saving
        decliner.page.locator("[data-target=decline]").click()
        decliner.until("s.finished")
        assert host.posted == []
        person = sit_down(host.address)
        visitor = Visitor(person, read_script(site))
        visitor.until_words("green square")
        visitor.press("Enter")
        visitor.until_words("Ready?")
        visitor.begin_episode(0)
        visitor.act(0, *TO_THE_GOAL[:3])
        person.page.wait_for_timeout(6_000)
        person.page.close()
        assert host.posted
        folder = host.write_posted(tmp_path / "parts")
    (imported,) = study_site.import_site_data(folder, study=tmp_path / "thin", protocol=protocol)
    (session,) = minihuman.open_study(tmp_path / "thin").sessions
    assert imported.differences == ()
    assert [(episode.outcome, episode.steps) for episode in session.all_episodes] == [("abandoned", 3)]


def test_what_no_page_runs_alone_is_refused_by_name(tmp_path):
    for block, error in [
        ('pace = "real_time"\nstep_period_ms = 200', "block 'rooms' has pace 'real_time'"),
        ("max_episode_s = 20", "part 'rooms' limits an episode's time"),
        ("points = { goal = 1 }", "part 'rooms' gives points"),
    ]:
        protocol = read_protocol(write_protocol(tmp_path, block=block))
        with pytest.raises(SiteError, match=f"thin: {error}.*serve the study with: minihuman serve"):
            require_site_support(protocol, plan_site_session(protocol, 0))
    with pytest.raises(SiteError, match="collector 'ftp://x' is none; use download"):
        write_site(protocol, tmp_path / "site", collector="ftp://x")


@needs("chromium")
@pytest.mark.program
@pytest.mark.nightly
def test_the_same_presses_give_the_tables_of_a_served_study(played, tmp_path):
    import_record(played, tmp_path / "site")
    server = Serving(played.protocol, tmp_path / "served")
    with browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        visitor = Visitor(person, read_script(played.folder))
        visitor.until_words("green square")
        visitor.press("Enter")
        visitor.until_words("Ready?")
        for number in range(2):
            visitor.begin_episode(number)
            visitor.act(number, *TO_THE_GOAL)
            visitor.until_words("Goal reached after 5 steps.")
        visitor.press("Enter")
        for words, keys in (("How hard was it?", "5"), ("What did you see?", "1"), ("That was all.", "")):
            visitor.until_words(words)
            for key in (*keys, "Enter"):
                visitor.press(key)
        person.until("s.finished")
    server.stop()
    tables = [minihuman.open_study(tmp_path / place / "thin").table for place in ("site", "served")]
    for name, columns in (
        ("episodes", ["world", "seed", "outcome", "steps", "reward"]),
        ("steps", ["episode", "step", "action", "key", "reward", "x", "z"]),
    ):
        site, served = (table(name)[columns] for table in tables)
        assert site.equals(served), name
    answers = [table("answers").groupby("item").answer.last().to_dict() for table in tables]
    assert answers[0] == answers[1] == {"hard": "5", "seen": "1"}


def turn_around(episode: EpisodePlan) -> tuple[str, int]:
    """Turn left until the episode ends: how, and after how many steps."""
    env = gymnasium.make(episode.world, **episode.options).unwrapped
    env.reset(seed=episode.seed)
    for step in range(1, episode.max_steps):
        if env.step(0)[2]:
            return "goal", step
    return "timeout", episode.max_steps


@needs("chromium")
@pytest.mark.program
@pytest.mark.nightly
def test_a_first_person_world_and_the_keyboard_check_run_without_a_server(tmp_path):
    protocol, site = make_site(tmp_path, world="MiniWorld-OneRoom-v0", check=True, block="final_frame_ms = 0")
    outcome, steps = turn_around(plan_site_session(read_protocol(protocol), 0).episodes[0])
    with hosting(site) as host, browsing() as sit_down:
        person = sit_down(host.address)
        visitor = Visitor(person, read_script(site))
        visitor.until_words("green square")
        visitor.press("Enter")
        person.until_seen("document.querySelector('.keyboard') !== null")
        for key in "dfjk":
            visitor.press(key)
            person.page.wait_for_timeout(200)
        visitor.until_words("Ready?")
        visitor.begin_episode(0)
        visitor.act(0, *([0] * steps))
        visitor.until_words(f"after {steps} steps")
        assert not person.errors
        host.posted.append(person.page.evaluate(READ_ARCHIVE))
        folder = host.write_posted(tmp_path / "parts")
    (imported,) = study_site.import_site_data(folder, study=tmp_path / "thin", protocol=protocol)
    assert imported.differences == ()
    (session,) = minihuman.open_study(tmp_path / "thin").sessions
    assert [(episode.outcome, episode.steps) for episode in session.all_episodes] == [(outcome, steps)]
