"""The methods text of a report, sentence by sentence, compared with the plan and the play of each participant.

A sentence that no checker here understands is wrong, and so is a block that a participant had and no sentence tells of.
"""

import itertools
import json
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from tests.recompute.page import MEASURES
from tests.recompute.tables import Session, Tally

DRAWN_ANEW = ("new", "shown")
PEOPLE = re.compile(
    r"(?P<people>\d+) participants took part(?: in (?P<sessions>\d+) sessions(?: \((?P<each>[^()]+)\))?)? "
    r"\((?P<groups>[^();]+)(?:; (?P<simulated>[^()]+))?\)"
)
LOSSES = re.compile(
    r"(?:Of (?P<came>\d+) people who came to the study, (?P<allocated>\d+) were allocated to a group "
    r"\((?P<before>[^()]+)\)\. )?"
    r"(?:Of these participants, (?P<withdrew>\d+ \([^()]+\)) withdrew after they had begun: no result "
    r"contains their data\. )?"
    r"(?:Withdrawn with no session on record: (?P<unbegun>\d+)\. )?"
    r"(?:Slots offered again, the data of their participants kept: (?P<replaced>\d+ \([^()]+\))\. )?"
)
ALLOCATION = re.compile(
    r"(?:Groups(?P<keys> and keys)?|(?P<alone>Keys)|Orders|Slots) came from an allocation list drawn before the "
    r"first session from the study's seed, "
    r"(?P<seed>\d+)(?P<later>; keys that later sessions drew anew came from that seed alone)?"
    r"(?:; in (?P<by_hand>\d+) sessions the participant or group was chosen by hand)?"
)
STRATA = re.compile(
    r"Groups were stratified by the answer to (?P<asked>\S+), with one allocation list per stratum \((?P<strata>.+)\)"
)
BLOCK = re.compile(
    r"Block (?P<name>\w[\w-]*)(?:, (?P<who>[^:]+))?: (?P<practice>practice, not analysed: )?(?P<most>up to )?"
    r"(?P<episodes>\d+) episodes(?: \((?P<ends>[^)]+)\))? in (?P<world>[^,]+)(?P<options>(?:, \w+ = [^,]+)*), "
    r"(?P<view>\w+) view, at most (?P<steps>\d+) steps(?: or (?P<seconds>[\d.]+) s)? each; (?P<pace>[^;]+); "
    r"actions (?P<actions>[\w, ]+) on (?P<keys>\d+) keys of (?P<pool>\d+)"
    r"(?:, (?P<distractors>[\w, ]+) on the other (?P<others>\d+))?; (?P<legend>[^(;]+?)"
    r"(?: \(except by (?P<known>[^:]+), who kept the keys that they had before\))?"
)
ENDS = re.compile(
    r"(?:until (?P<successes>\d+) of the last (?P<of>\d+) reached the goal)?(?:, )?"
    r"(?:for at most (?P<s>[\d.]+) s in all)?"
)
REAL_TIME = re.compile(
    r"one step every (?P<period>[\d.]+) ms, (?P<noop>no step|a body standing still|action \w+) without a key, "
    r"reaction times from (?P<onset>.+)"
)
LEGENDS = {
    True: "the keys and their actions were shown on the screen",
    False: "the actions of the keys had to be discovered",
}
KEPT = "the keys were those of an earlier block"  # by everyone whom the sentence is about
VALUE = "Unless stated otherwise, a participant's value is the mean over the included episodes"
FORMULAS = {
    "log_excess_steps_mean": "ln(1 + steps \N{MINUS SIGN} shortest), shortest: steps of the shortest known path",
    "log_steps_ratio_mean": "ln(steps / shortest)",
    "spl_mean": "shortest / steps with the goal, 0 without",
    "success": "episodes that ended at the goal / all",
    "reward_mean": "the rewards of the world, summed over the episode",
    "steps_at_limit_mean": "steps with the goal, the step limit without",
    "reward_first": "the rewards of the first included episode",
    "reward_slope": "slope of a straight line",
    "excess_steps_mean": "steps \N{MINUS SIGN} shortest",
    "playing_s_mean": "from the reset to the last step, without pauses",
    "response_median_ms": "key press minus stimulus onset, of all responses, right or wrong: the flip of the latest "
    "picture; in real time, of the picture from which the world or the block counts",
    "reaction_median_ms": "key press minus the flip of the latest picture, in real time of a tick's",
    "path_efficiency_mean": "straight distance from start to end / distance covered",
    "ineffective_share": "steps after which the participant's view was as before / steps",
    "all_keys_discovered_s": "playing time until the action of every key had shown",
}
SOFTWARE = {
    "version_minihuman": "minihuman", "git_commit": "commit", "rules": "rules of the worlds", "python": "Python",
    "version_numpy": "NumPy", "system": "on", "window_version": "shown by",
}  # fmt: skip


@dataclass(frozen=True)
class Had:
    """A block as a participant had it in a session: by the log."""

    session: Session
    plan: Any  # of its first episode
    spec: dict[str, Any]
    before: str  # the block before, of an earlier session too
    known: bool  # came with the keys of an earlier block

    @property
    def name(self) -> str:
        return str(self.plan.block_name)

    @property
    def where(self) -> str:
        return f"{self.session.who['participant']} session {self.session.plan.session} block {self.name}"


def list_blocks(sessions: Sequence[Session]) -> Iterator[Had]:
    """Every block that a participant was to have, in their order."""
    history: dict[str, list[tuple[str, dict[str, int]]]] = defaultdict(list)
    for session in sorted(sessions, key=lambda one: one.plan.session):
        earlier = history[session.who["participant"]]
        begun: dict[str, Any] = {}
        for plan in session.plan.episodes:
            begun.setdefault(plan.block_name, plan)
        for plan in begun.values():
            actions = list(plan.actions)
            keys = {one.key: actions.index(one.action) for one in plan.key_map.keys if one.action in actions}
            spec = session.block(plan.block_name)
            known = spec.get("key_map", "new") not in DRAWN_ANEW and any(keys == those for _, those in earlier)
            yield Had(session, plan, spec, earlier[-1][0] if earlier else "", known)
            earlier.append((plan.block_name, keys))


def check_methods(paragraphs: Sequence[str], sessions: Sequence[Session], register: Sequence[Any] = ()) -> Tally:
    """Check every sentence; the tally counts facts compared with a participant's plan or play."""
    tally = Tally()
    people, *others = paragraphs
    if others[0].startswith("Parts by group: "):
        tally.same("methods, parts by group", others.pop(0), parts_by_group(sessions[0].protocol))
    if others[0].startswith("The order of "):
        check_orders(others.pop(0), sessions, tally)
    *blocks, measures, software, report = others
    check_people(people, sessions, register, tally)
    check_blocks(" ".join(blocks), sessions, tally)
    check_measures(measures, sessions, tally)
    check_software(software, report, sessions, tally)
    return tally


def parts_by_group(protocol: Mapping[str, Any]) -> str:
    """The sentence on what each group had, of a protocol whose sessions or groups list their parts."""
    told = []
    for group in protocol["groups"]:
        lists = [session["parts"] for session in protocol.get("sessions", ())]
        lists = lists or [group.get("parts") or group.get("blocks")]
        changes = group.get("replace_parts", group.get("instead", {}))
        named = [", ".join(filter(None, (changes.get(part, part) for part in parts))) or "none" for parts in lists]
        if len(named) > 1:
            named = [f"in session {number} {names}" for number, names in enumerate(named, 1)]
        told.append(f"{group['name']} had {' and '.join(named)}")
    return f"Parts by group: {'; '.join(told)}."


def check_orders(text: str, sessions: Sequence[Session], tally: Tally) -> None:
    """Check that participants had the parts in several orders, which the protocol says how to draw."""
    its = re.fullmatch(
        r"The order of (?P<parts>.+) (?:followed (?P<squares>a Latin square|two Latin squares) \(Williams, 1949\) "
        r"for each (?P<size>\d+) successive participants(?: of a group)?"
        r"|(?P<drawn>was drawn for each participant))\.",
        text,
    )
    if its is None:
        tally.wrong.append(f"no checker for {text!r}")
        return
    (order,) = sessions[0].protocol["orders"]
    named = [re.sub(r" \(with .*\)", "", part) for part in re.split(r", (?![^(]*\))| and ", its["parts"])]
    units = [unit if isinstance(unit, str) else unit[0] for unit in order["parts"]]
    tally.same("methods, parts in order", named, units)
    if its["size"] is not None:
        is_odd = len(units) % 2
        tally.same("methods, rows of a square", int(its["size"]), len(units) * (1 + is_odd))
        tally.same("methods, squares", its["squares"], ("a Latin square", "two Latin squares")[is_odd])
    tally.same("methods, order drawn", its["drawn"] is not None, order.get("order") == "shuffled")


def check_people(text: str, sessions: Sequence[Session], register: Sequence[Any], tally: Tally) -> None:
    pattern = f"{PEOPLE.pattern}\\. {LOSSES.pattern}{ALLOCATION.pattern}\\.(?: {STRATA.pattern}\\.)?"
    its = re.fullmatch(pattern, text)
    if its is None:
        tally.wrong.append(f"no checker for {text!r}")
        return
    people = read_people(register) | {session.who["participant"]: session.who["group"] for session in sessions}
    gone = {line["withdrawn"] for line in register if "withdrawn" in line}
    erased = {line["sealed"].removesuffix(".mcap") for line in register if "sealed" in line}
    began = {(code, int(number)) for code, _, number in (name.partition("_ses-") for name in erased) if code in gone}
    began |= {(session.who["participant"], session.plan.session) for session in sessions}
    groups = {code: people[code] for code, _ in began}
    tally.same("methods, people", its["people"], str(len(groups)))
    many = Counter(groups.values())
    tally.same("methods, groups", its["groups"], ", ".join(f"{many[group]} in group {group}" for group in sorted(many)))
    each = Counter(number for _, number in began)
    tally.same("methods, sessions", its["sessions"], str(len(each)) if len(each) > 1 else None)
    told = ", ".join(f"{each[number]} in session {number}" for number in sorted(each))
    tally.same("methods, each session", its["each"], told if len(set(each.values())) > 1 else None)
    check_losses(its, register, {code for code, _ in began}, tally)
    simulated = sum(session.facts("facts")[0].get("player") != "human" for session in sessions)
    every = "all sessions on record simulated" if gone & groups.keys() else "all simulated"
    some = None if not simulated else f"{simulated} of the sessions simulated"
    tally.same("methods, simulated", its["simulated"], every if simulated == len(sessions) else some)
    tally.same("methods, seed", its["seed"], str(sessions[0].plan.study_seed))
    by_hand = sum(session.plan.overridden for session in sessions)
    tally.same("methods, by hand", its["by_hand"], str(by_hand) if by_hand else None)
    for session in sessions:
        tally.same(f"{session.path.name}, from the list", session.plan.HasField("allocation_sha256"), True)
    policies: dict[bool, set[str]] = {True: set(), False: set()}
    for had in list_blocks(sessions):
        first = had.plan.block == 0 and had.spec.get("key_map") == "carry_over"
        policies[had.session.plan.session > 1].add("new" if first else had.spec.get("key_map", "new"))
    drawn = any(policy in (*DRAWN_ANEW, "constant") for policy in policies[True] | policies[False])
    tally.same("methods, keys of the list", (its["keys"] or its["alone"]) is not None, drawn)
    tally.same("methods, keys of later sessions", its["later"] is not None, bool(policies[True] & {*DRAWN_ANEW}))
    check_strata(its["asked"], its["strata"], sessions, tally)


def read_people(register: Sequence[Any]) -> dict[str, str]:
    """The groups of those who have a slot, "" where none is drawn."""
    people: dict[str, str] = {}
    for line in register:
        if "participant" in line:
            people[line["participant"]] = line["group"]
        elif "drawn" in line:
            people[line["drawn"]] = line["group"]
        elif "freed" in line:
            people.pop(line["freed"], None)
    return people


def check_losses(its: re.Match[str], register: Sequence[Any], began: set[str], tally: Tally) -> None:
    """Check the sentences about who was lost: those there must be, and no others."""
    people = read_people(register)
    gone = {line["withdrawn"] for line in register if "withdrawn" in line} & people.keys()
    replaced = ({line["replaced"] for line in register if "replaced" in line} & people.keys()) - gone

    def tell(codes: set[str]) -> str | None:
        many = Counter(people[code] for code in codes)
        return (
            f"{len(codes)} ({', '.join(f'{many[group]} in group {group}' for group in sorted(many))})" if many else None
        )

    freed = sum("freed" in line for line in register)
    undrawn = sum(not group for group in people.values())
    came = len(people) + freed
    tally.same("methods, came", its["came"], str(came) if freed + undrawn else None)
    if its["came"]:
        before = sum(int(number) for number in re.findall(r"(?:^|, )(\d+) ", its["before"]))
        tally.same("methods, allocated", (int(its["allocated"]), before), (came - freed - undrawn, freed + undrawn))
    tally.same("methods, withdrew", its["withdrew"], tell(gone & began))
    tally.same("methods, unbegun", its["unbegun"], str(len(gone - began)) if gone - began else None)
    tally.same("methods, replaced", its["replaced"], tell(replaced))


def check_strata(asked: str | None, told: str | None, sessions: Sequence[Session], tally: Tally) -> None:
    question = sessions[0].protocol.get("allocation", {}).get("stratify_by")
    tally.same("methods, stratified by", asked, question)
    if question is None or told is None:
        return
    drawn = {
        session.who["participant"]: (session.plan.participant.stratum, session.who["group"]) for session in sessions
    }
    many = Counter(drawn.values())
    groups = sorted({group for _, group in many})
    strata = sorted({stratum for stratum, _ in many})
    lines = (f"{one}: {', '.join(f'{group} {many[one, group]}' for group in groups)}" for one in strata)
    tally.same("methods, strata", told, "; ".join(lines))


def is_of(who: str | None, session: Session) -> bool:
    """Whether a sentence about these is about a participant's session."""
    for label in (who or "").split(" and "):
        group, number = re.search(r"group (\S+)", label), re.search(r"in session (\d+)", label)
        person = re.search(r"participant (\S+)", label)
        if (
            (group is None or group[1] == session.who["group"])
            and (number is None or int(number[1]) == session.plan.session)
            and (person is None or person[1] == session.who["participant"])
        ):
            return True
    return False


def is_known(known: str | None, had: Had) -> bool:
    if known == "those who had played another block":
        return bool(had.before)
    for label in (known or "").split(", "):
        match = re.fullmatch(r"(\S*)(?: in session (\d+))?(?: after block (\S+))?", label)
        if match is not None:
            name, session, after = match.groups()
            if (
                name == had.session.who["group"]
                and (session is None or int(session) == had.session.plan.session)
                and (after is None or after == had.before)
            ):
                return True
    return False


def check_blocks(text: str, sessions: Sequence[Session], tally: Tally) -> None:
    sentences = []
    for part in re.split(r"(?<=\.) (?=Block )", text):
        its = BLOCK.fullmatch(part.removesuffix("."))
        if its is None:
            tally.wrong.append(f"no checker for {part!r}")
        else:
            sentences.append(its)
    used = set()
    for had in list_blocks(sessions):
        told = [its for its in sentences if its["name"] == had.name and is_of(its["who"], had.session)]
        tally.same(f"{had.where}, sentences", len(told), 1)
        for its in told[:1]:
            used.add(its[0])
            check_plan(its, had, tally)
            check_play(its, had, tally)
    tally.wrong += [f"true of no participant: {its[0]!r}" for its in sentences if its[0] not in used]


def check_plan(its: re.Match[str], had: Had, tally: Tally) -> None:
    plan, spec, where = had.plan, had.spec, had.where
    criterion, longest = spec.get("stop_criterion"), spec.get("max_block_s")
    tally.same(f"{where}, practice", its["practice"] is not None, not spec.get("analysed", True))
    tally.same(f"{where}, episodes", its["episodes"], str(plan.episodes_in_block))
    tally.same(f"{where}, up to", its["most"] is not None, bool(criterion or longest))
    ends = ENDS.fullmatch(its["ends"] or "")
    told = (None,) * 3 if ends is None else ends.groups()
    expected = (
        criterion and str(criterion["successes"]),
        criterion and str(criterion["of"]),
        longest and f"{longest:g}",
    )
    tally.same(f"{where}, ends", told, expected)
    tally.same(f"{where}, world", its["world"], plan.world)
    options = "".join(f", {name} = {value!r}" for name, value in sorted(json.loads(plan.options_json or "{}").items()))
    tally.same(f"{where}, options", its["options"], options)
    tally.same(f"{where}, view", its["view"], plan.view)
    tally.same(f"{where}, steps", its["steps"], str(plan.max_steps))
    seconds = spec.get("max_episode_s")
    tally.same(f"{where}, seconds", its["seconds"], f"{seconds:g}" if seconds else None)
    tally.same(f"{where}, actions", its["actions"].split(", "), list(plan.actions))
    own = [one for one in plan.key_map.keys if one.action in plan.actions]
    others = [one.action for one in plan.key_map.keys if one.action not in plan.actions]
    tally.same(f"{where}, keys", its["keys"], str(len(own)))
    tally.same(f"{where}, pool", its["pool"], str(len(plan.key_map.keys) + len(plan.key_map.spare_keys)))
    tally.same(f"{where}, distractors", its["distractors"], ", ".join(sorted({*others})) or None)
    tally.same(f"{where}, distractors' keys", its["others"], str(len(others)) if others else None)
    if its["legend"] == KEPT:
        tally.same(f"{where}, kept keys", (plan.show_keys, had.known), (False, True))
    else:
        tally.same(f"{where}, legend", its["legend"], LEGENDS[plan.show_keys])
        if not plan.show_keys:
            tally.same(f"{where}, known keys", is_known(its["known"], had), had.known)
    if plan.pace == "on_key":
        more = ", a held key more of them" if plan.auto_repeat else ""
        tally.same(f"{where}, pace", its["pace"], f"each press of a key made one step{more}")
        return
    pace = REAL_TIME.fullmatch(its["pace"])
    onset = "the first picture" if plan.onset_at_reset else "the onsets that the world names"
    noop = "a body standing still" if spec.get("team") else "no step"
    noop = f"action {plan.noop}" if plan.HasField("noop") else noop
    tally.same(f"{where}, pace", pace and pace.groups(), (f"{plan.step_period_ms:g}", noop, onset))


def check_play(its: re.Match[str], had: Had, tally: Tally) -> None:
    """Whether what was played is as the sentence says."""
    episodes = [one for one in had.session.episodes if one.block == had.name]
    finished = {one.number for one in episodes if one.outcome in ("goal", "timeout", "failure")}
    where = had.where
    tally.same(f"{where}, at most as many", len(finished) <= int(its["episodes"]), True)
    if its["most"] is None and had.session.end_reason == "complete":
        tally.same(f"{where}, all episodes", len(finished), int(its["episodes"]))
    for one in episodes:
        tally.same(f"{where}, steps at most", len(one.steps) <= int(its["steps"]), True)
        if its["seconds"]:
            tally.same(f"{where}, seconds at most", one.played_ns() / 1e9 <= float(its["seconds"]) + 0.05, True)
        pace = REAL_TIME.fullmatch(its["pace"])
        if pace is None:
            tally.same(f"{where}, keys make steps", all(step.key for step in one.steps), True)
            continue
        names = one.start.action_names
        alone = {names[step.action] for step in one.steps if not step.key}
        tally.same(f"{where}, ticks without a key", alone <= {pace["noop"].removeprefix("action ")}, True)
        times = [one.start.t_ns, *(step.t_ns for step in one.steps)]
        closest = min((b - a for a, b in itertools.pairwise(times)), default=None)
        period_ns = float(pace["period"]) * 1e6
        tally.same(f"{where}, period", closest is None or closest >= 0.99 * period_ns, True)
    if its["ends"] and "until" in its["ends"]:
        ends = ENDS.fullmatch(its["ends"])
        assert ends is not None
        of, successes = int(ends["of"]), int(ends["successes"])
        last: dict[int, str] = {one.number: one.outcome for one in episodes if one.number in finished}
        outcomes = [last[number] == "goal" for number in sorted(last)]
        met = [sum(outcomes[max(0, at - of) : at]) >= successes for at in range(1, len(outcomes) + 1)]
        tally.same(f"{where}, ended as soon as it was met", any(met[:-1]), False)


def check_measures(text: str, sessions: Sequence[Session], tally: Tally) -> None:
    several = len({session.plan.session for session in sessions}) > 1
    value = f"{VALUE}; of several sessions it is the mean of theirs" if several else VALUE
    defined = {name: formula for name, formula in FORMULAS.items() if f"{MEASURES[name]} = " in text}  # those shown
    formulas = "; ".join(f"{MEASURES[name]} = {formula}" for name, formula in defined.items())
    tally.same("methods, measures", text, f"{value}. The measures: {formulas}.")


def check_software(text: str, report: str, sessions: Sequence[Session], tally: Tally) -> None:
    protocols = sorted({(session.plan.study_version, session.plan.protocol_sha256) for session in sessions})
    versions = "; ".join(f"version {name}, SHA-256 {sha}" for name, sha in protocols)
    made = []
    for name, word in SOFTWARE.items():
        values = sorted({facts[name] for session in sessions for facts in session.facts("facts") if name in facts})
        if name == "git_commit":
            values = [f"{one[:-1]} with changed files" if one.endswith("+") else one for one in values]
        made += [f"{word} {' and '.join(values)}"] if values else []
    told = f"Protocol of study {sessions[0].plan.study}: {versions}. Run with {', '.join(made)}."
    tally.same("methods, software", text, told)
    used = {"minihuman": "minihuman-lab", "pandas": "pandas", "scipy": "scipy"}
    packages = ", ".join(f"{name} {version(package)}" for name, package in used.items())
    tally.same("methods, report", report, f"This report: {packages}.")
