"""Trials in a study without a server: the page's rules are the session's, and so are its tables."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import msgspec
import pytest

import minihuman
from minihuman import study_site
from minihuman.admin.protocol_file import read_protocol
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.runtime.machine import collect_machine_facts
from minihuman.web.computed import PageWorld
from minihuman.web.messages import DisplayedMessage, NumberedMessage
from minihuman.web.page_inputs import PageInputs
from minihuman.web.prefetch import describe_screen
from minihuman.web.site.site_error import SiteError
from minihuman.web.site.site_folder import digest_build, plan_site_session, write_site
from minihuman.web.site.support import require_site_support
from tests.counts import count
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.web.site.static_site import hosting

DRIVER = Path(__file__).with_name("follow_trials.mjs")
N_MESSAGES = 400  # of a walk
HEAD = """
[study]
name = "walked"
version = "1"
seed = 3
participants = 2

[keys]
pool = ["f", "j"]
keyboard_check = false

[[groups]]
name = "one"
blocks = [{blocks}]
"""
BLOCK = """
[[blocks]]
name = "{name}"
kind = "trials"
world = "minihuman/Stimulus-v0"
options = {{ responses = ["yes", "no"] }}
stimuli.rows = [{{ word = "YES", wait = 60, correct = "yes" }}, {{ word = "NO", wait = 90, correct = "no" }}]
episodes = {episodes}
actions = ["yes", "no"]
key_map = "fixed"
fixed_keys = {{ f = "yes", j = "no" }}
max_steps = 1
{settings}
"""
CROSS = '{ name = "cross", text = "+", duration_ms = [80, 200] }'
BLOCKS = {
    "plain": (
        'noop_action = "none"\nready = "first"\ninter_trial_interval_ms = [50, 90]\nresponse_deadline_ms = 400\n'
        f'timeline.stimuli = [{CROSS}, {{ name = "mask", text = "###", duration_ms = "{{wait}}" }}, '
        '{ name = "word", text = "{word}", until = "response" }]'
    ),
    "told": (
        'ready = "each"\nfeedback = { failure = "Wrong after {steps}: {reward:.1f}" }\nfixation_ms = 40\n'
        f'timeline.stimuli = [{CROSS}, {{ name = "word", text = "{{word}}", until = "response" }}]'
    ),
    "rhythm": (
        'noop_action = "none"\nready = "none"\nresponse_deadline_ms = 250\ntimeline.ends = "time"\n'
        'timeline.soa_ms = 500\ntimeline.stimuli = [{ name = "word", text = "{word}", duration_ms = 120 }]'
    ),
    "heard": (
        'noop_action = "none"\nready = "first"\nresponse_deadline_ms = 300\ntimeline.target = "tone"\n'
        'timeline.opens_ms = 30\ntimeline.responses = 2\nfeedback = { goal = "Right" }\nfeedback_ms = 100\n'
        'timeline.stimuli = [{ name = "word", text = "{word}", until = "end" }, '
        '{ name = "tone", sound = "tone", onset_ms = 50, duration_ms = 60 }, '
        '{ name = "late", sound = "noise", onset_ms = 260, duration_ms = 40, until = "response" }]'
    ),
}


def write_trials(folder: Path, *names: str, episodes: int = 3) -> Path:
    """Write a study of blocks of trials."""
    path = folder / "walked.toml"
    blocks = [BLOCK.format(name=name, episodes=episodes, settings=BLOCKS[name]) for name in names]
    path.write_text(HEAD.format(blocks=", ".join(f'"{name}"' for name in names)) + "".join(blocks), encoding="utf-8")
    return path


def follow_walks(site: Path, *, seed: int, n_walks: int) -> list[list[dict[str, Any]]]:
    """Walk through a site's first session in Node; return each walk's messages, with what the page says after each."""
    script = (site / "study/slot-0.json").read_text(encoding="utf-8")
    words = ["node", str(DRIVER), str(site), str(seed), str(n_walks), str(N_MESSAGES)]
    done = subprocess.run(words, input=script, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    walks: list[list[dict[str, Any]]] = json.loads(done.stdout)
    return walks


def follow_in_session(protocol: Protocol, walk: list[dict[str, Any]]) -> list[tuple[int, int | None]]:
    """Take a walk's messages in the real session; return the screen's name and the due time after each."""
    session = build_session(plan_site_session(protocol, 0), PageWorld, collect_machine_facts(), picture_px=(96, 96))
    page_inputs = PageInputs(())
    name = 0
    followed: list[tuple[int, int | None]] = []
    for step in walk:
        message = msgspec.convert({name: step[name] for name in ("n", "at", "what")}, NumberedMessage)
        is_present = isinstance(message.what, DisplayedMessage) and message.what.name == name
        happened = page_inputs.convert(message.what, message.at, is_present=is_present)
        if happened is not None:
            session.receive(happened, at_ns=message.at)
        name = describe_screen(session, lambda _: 0, name)[1]
        followed.append((name, find_due(None if session.over else session.next_tick_ns, message.at)))
    session.close()
    return followed


def find_due(due_ns: int | None, now_ns: int) -> int | None:
    """Return when the session goes on by itself; None where nothing is still to come."""
    return due_ns if due_ns is not None and due_ns > now_ns else None


@needs("node")
@pytest.mark.program
@pytest.mark.parametrize("names", [("plain", "told"), ("rhythm", "heard")], ids="-".join)
def test_drawn_walks_through_trials_are_the_sessions_own(tmp_path, names):
    protocol = read_protocol(write_trials(tmp_path, *names))
    write_site(protocol, tmp_path / "site", slots=1)
    walks = follow_walks(tmp_path / "site", seed=7, n_walks=count(15, 1_000))
    for walk in walks:
        followed = [(step["name"], find_due(step["due"], step["at"])) for step in walk]
        assert followed == follow_in_session(protocol, walk)
    shown = {step["name"] for walk in walks for step in walk}
    assert len(shown) > 40
    print(f"{len(walks)} walks, {sum(map(len, walks))} messages, 0 differ in their screens' digests and due times")


# A shipped classic, in Chromium

FLANKER = Path(__file__).parents[3] / "protocols/trials/flanker.toml"
COUNT_PAINTS = """(() => {
  window.trials = [];
  const { prototype } = CanvasRenderingContext2D, { drawImage } = prototype;
  prototype.drawImage = function (...places) {
    drawImage.apply(this, places);
    if (!document.querySelector("#screen.trial")?.contains(this.canvas)) return;
    if (trials.at(-1)?.canvas !== this.canvas) trials.push({ canvas: this.canvas, paints: 0 });
    trials.at(-1).paints += 1;
  };
})()"""
PAINTS_TO_TARGET = 2  # the cross, then the arrows
COMPARED = {
    "episodes": ["participant", "group", "block", "episode", "world", "seed", "outcome", "steps", "reward"],
    "trials": ["participant", "block", "episode", "trial", "stimulus", "labels", "correct", "response", "is_correct"],
    "trial_stimuli": ["participant", "episode", "picture", "stimuli"],
    "trial_responses": ["participant", "episode", "number", "key"],
}


def write_flanker(folder: Path, episodes: int) -> Path:
    """Write the shipped flanker task with a number of trials and more time to respond, and its table beside it."""
    text = FLANKER.read_text(encoding="utf-8")
    for field, number in (("episodes", episodes), ("response_deadline_ms", 6_000)):  # a busy machine presses late
        text = re.sub(rf"^{field} = .*$", f"{field} = {number}", text, flags=re.MULTILINE)
    path = folder / "flanker.toml"
    path.write_text(text, encoding="utf-8")
    table = FLANKER.with_suffix(".csv")
    (folder / table.name).write_bytes(table.read_bytes())
    return path


def list_presses(protocol: Protocol) -> list[str]:
    """Return the key of each trial: the correct one, a wrong one in every fourth trial, none ("") in every fifth."""
    keys = []
    for number, episode in enumerate(plan_site_session(protocol, 0).episodes, start=1):
        sides = ["left", "right"]
        correct = sides.index(str(episode.options["correct"]))
        keys.append(sides[correct ^ (number % 4 == 0)] if number % 5 else "")
    return keys


def press_through(person: Any, keys: list[str]) -> None:
    """Go through a session of trials by real keys; each answers its target."""
    page = person.page
    page.evaluate(COUNT_PAINTS)
    person.until_seen("s.welcomed && s.kind === 'page'")
    page.keyboard.press("Enter")
    person.until_seen("s.welcomed && document.querySelector('#screen').innerText.includes('Ready?')")
    page.keyboard.press("Enter")
    for number, key in enumerate(keys, start=1):
        if not key:
            continue
        person.until_seen(f"trials.length === {number} && trials.at(-1).paints === {PAINTS_TO_TARGET}")
        page.keyboard.press(f"Arrow{key.capitalize()}")
    person.until_seen("document.querySelector('#screen').innerText.includes('Thank you')")
    page.keyboard.press("Enter")
    person.until("s.finished")
    assert person.errors == []


@pytest.mark.nightly
@needs("chromium")
@pytest.mark.program
def test_a_classic_of_a_site_has_the_tables_of_a_served_study(tmp_path):
    path = write_flanker(tmp_path, count(5, 80))
    protocol = read_protocol(path)
    keys = list_presses(protocol)
    write_site(protocol, tmp_path / "site", slots=1)
    with hosting(tmp_path / "site") as host, browsing() as sit_down:
        person = sit_down(host.address)
        with person.page.expect_download(timeout=0) as download:
            press_through(person, keys)
        download.value.save_as(tmp_path / "record.json")
    (imported,) = study_site.import_site_data(tmp_path / "record.json", study=tmp_path / "flanker", protocol=path)
    assert (imported.error, imported.differences) == (None, ())
    assert imported.screens > 3 * len(keys)
    assert all(line.ok for line in minihuman.verify(tmp_path / "flanker"))
    with serving(path, tmp_path / "served") as served, browsing() as sit_down:
        press_through(sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"), keys)
    tables = [minihuman.open_study(tmp_path / place).table for place in ("flanker", "served/flanker")]
    for name, columns in COMPARED.items():
        site, served_table = (table(name, with_excluded=True)[columns] for table in tables)
        assert site.equals(served_table), name
    assert tables[0]("trials").response.tolist() == [key or "none" for key in keys]
    assert tables[0]("participants").evidence.tolist() == ["consistent"]
    print(f"{len(keys)} trials, {imported.screens} screens, {len(imported.differences)} differ, tables equal")


# What is refused, and what is recognised

RUN = ["auditory-oddball", "flanker", "n-back", "posner", "priming", "rsvp", "simon", "stroop", "visual-search"]
REFUSED = {
    "bandit": "a bonus is paid",
    "cued-corridor": "part 'colours' goes on until a criterion is met",
    "go-no-go": "part 'go-no-go' is a block of trials without a timeline",
    "stop-signal": "part 'stop-signal' has an adaptive design",
    "threshold": "part 'discs' has an adaptive design",
    "two-step": "a bonus is paid",
}


def test_each_shipped_classic_runs_in_a_site_or_is_refused_by_name():
    for path in sorted(FLANKER.parent.glob("*.toml")):
        protocol = read_protocol(path)
        plan = plan_site_session(protocol, 0)
        if path.stem in RUN:
            require_site_support(protocol, plan)
            continue
        with pytest.raises(SiteError, match=re.escape(f"{path.stem}: {REFUSED[path.stem]}")):
            require_site_support(protocol, plan)


def test_what_no_page_does_in_a_trial_is_refused_by_name(tmp_path):
    path = write_trials(tmp_path, "heard")
    text = path.read_text(encoding="utf-8")
    buzz = '{ name = "buzz", sound = "noise", feedback = "goal", duration_ms = 50 }'
    path.write_text(text.replace('until = "response" }]', f'until = "response" }}, {buzz}]'), encoding="utf-8")
    protocol = read_protocol(path)
    with pytest.raises(SiteError, match="part 'heard' plays the sound 'buzz' with the feedback"):
        require_site_support(protocol, plan_site_session(protocol, 0))


def test_a_changed_stimulus_table_makes_another_build(tmp_path):
    path = write_flanker(tmp_path, 6)
    before = digest_build(read_protocol(path))
    table = tmp_path / "flanker.csv"
    table.write_text(table.read_text(encoding="utf-8").replace("<<<<<", "<<-<<"), encoding="utf-8")
    assert digest_build(read_protocol(path)) != before
