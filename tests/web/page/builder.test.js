// The builder's page without a browser: the edits that its buttons make, and what becomes of them in a conflict.
import assert from "node:assert/strict";
import { test } from "node:test";
import { quoteWord } from "../../../minihuman/builder/page/command.js";
import { applyEdit, buildMemberEdits, followPath } from "../../../minihuman/builder/page/edits.js";
import { readLike } from "../../../minihuman/builder/page/fields.js";
import { buildEntryEdits, buildLeaveEdits, buildMoveEdits } from "../../../minihuman/builder/page/lanes.js";
import { OpenStudy, formatPath } from "../../../minihuman/builder/page/open_study.js";
import { OpenTable } from "../../../minihuman/builder/page/media.js";
import { findSession } from "../../../minihuman/builder/page/preview.js";
import { findTranslations, listTexts } from "../../../minihuman/builder/page/texts.js";
import { buildLengthEdits, buildStartEdits, layOutTrial } from "../../../minihuman/builder/page/timeline.js";
import { Level } from "../../../minihuman/builder/page/level.js";
import { buildLevelEdits, chooseCell, nameCell } from "../../../minihuman/builder/page/level_editor.js";
import { buildDayEdits, findDayProblem } from "../../../minihuman/builder/page/lane_settings.js";
import { buildProcessingRecord, fillPlaceholder, listPlaceholders } from "../../../minihuman/builder/page/consent.js";
import { sortFiles } from "../../../minihuman/builder/page/import.js";
import { findWait, listPoints } from "../../../minihuman/builder/page/replay.js";
import { writeDeparture } from "../../../minihuman/builder/page/departure.js";
import { formatMinutes, makeName, renderSentence, spellName } from "../../../minihuman/builder/page/words.js";
import { buildWorldEdits } from "../../../minihuman/builder/page/worlds.js";

const TREE = {
  study: { name: "walk", consent: "May we?" },
  groups: [{ name: "a", blocks: ["one", "two"] }, { name: "b", blocks: ["two"] }],
  pages: [{ name: "how", text: "Walk." }],
  blocks: [{ name: "one", instructions: "Go.", feedback: { goal: "Well done" } }, { name: "two" }],
  questions: [{ name: "ask", items: [{ name: "age", kind: "number", ask: "How old?" }] }],
};

/** A study as the server sends it. @param {Record<string, unknown>} fields */
const makeDocument = (fields = {}) => /** @type {any} */ ({
  key: "walk.toml", name: "walk", version: "1", text: "", tree: TREE, lines: {}, mistakes: [], durations: [], pay: null,
  parts: [
    { name: "how", kind: "page", path: ["pages", 0], title: "", used_in: [], line: 1 },
    { name: "one", kind: "play", path: ["blocks", 0], title: "", used_in: [], line: 2 },
    { name: "two", kind: "play", path: ["blocks", 1], title: "", used_in: [], line: 3 },
  ],
  lanes: [
    { group: "a", session: "", parts: ["one", "two"], path: ["groups", 0, "blocks"], replaced: {} },
    { group: "b", session: "", parts: ["two"], path: ["groups", 1, "blocks"], replaced: {} },
  ],
  restrictions: { enrolled: 0, fields: [], message: "" }, can_undo: false, can_redo: false, trusted: true, read_only: [],
  ...fields,
});

/** @param {any} content @returns {OpenStudy} */
function open(content = makeDocument()) {
  const study = new OpenStudy("walk.toml", () => {});
  study.show(content);
  return study;
}

/** Answer each request with the next answer. @param {{ status: number, content: unknown }[]} answers @returns {any[]} what was sent */
function serve(answers) {
  /** @type {any[]} */
  const sent = [];
  globalThis.fetch = /** @type {any} */ (async (/** @type {string} */ _, /** @type {any} */ request) => {
    sent.push(JSON.parse(request.body));
    const { status, content } = /** @type {any} */ (answers.shift());
    return { ok: status < 400, status, json: async () => content };
  });
  return sent;
}

test("a page that enters a study whose groups list blocks makes every group list its parts", () => {
  const study = open();
  const [lane] = makeDocument().lanes;
  assert.deepEqual(buildEntryEdits(study, lane, 2, "how", ""), [
    { op: "remove", path: ["groups", 0, "blocks"] },
    { op: "set", path: ["groups", 0, "parts"], value: ["one", "two", "how"] },
    { op: "remove", path: ["groups", 1, "blocks"] },
    { op: "set", path: ["groups", 1, "parts"], value: ["two"] },
  ]);
  assert.deepEqual(buildEntryEdits(study, lane, 0, "two", "block"), [{ op: "insert", path: ["groups", 0, "blocks", 0], value: "two" }]);
});

/** The parts of a lane after edits. @param {string[]} parts @param {(lane: any) => any[]} build @returns {string[]} */
function changeLane(parts, build) {
  const tree = { groups: [{ parts: [...parts] }] };
  for (const edit of build({ parts, path: ["groups", 0, "parts"] })) applyEdit(tree, edit);
  return tree.groups[0].parts;
}

test("a part that is dropped before another stands there, and one that leaves a lane leaves each of its places", () => {
  assert.deepEqual(changeLane(["a", "b", "c"], (lane) => buildMoveEdits(lane, 0, 3)), ["b", "c", "a"]);
  assert.deepEqual(changeLane(["a", "b", "c"], (lane) => buildMoveEdits(lane, 2, 0)), ["c", "a", "b"]);
  assert.deepEqual(changeLane(["a", "b", "c"], (lane) => buildMoveEdits(lane, 0, 2)), ["b", "a", "c"]);
  assert.deepEqual(buildMoveEdits(/** @type {any} */ ({ path: ["groups", 0, "parts"] }), 1, 2), []);
  assert.deepEqual(changeLane(["a", "b", "a", "c"], (lane) => buildLeaveEdits(lane, "a")), ["b", "c"]);
});

test("an edit changes the values, and where a field is, as it does in the file", () => {
  const tree = { blocks: [{ name: "a" }, { name: "b" }, { name: "c", keys: { up: "jump" } }] };
  const edits = /** @type {any[]} */ ([
    { op: "move", path: ["blocks", 2], to: 0 }, { op: "duplicate", path: ["blocks", 0], value: { name: "d" } },
    { op: "remove", path: ["blocks", 2] }, { op: "insert", path: ["blocks", 0], value: { name: "e" } },
    { op: "set", path: ["blocks", 1, "keys", "down"], value: "duck" }, { op: "remove", path: ["blocks", 1, "keys", "up"] },
    { op: "set", path: ["blocks", 3, "points", "per_step"], value: 2 }, { op: "rename", path: ["blocks", 2], value: "f" },
    { op: "insert", path: ["pages", 0], value: { name: "g" } },
  ]);
  for (const edit of edits) applyEdit(tree, edit);
  assert.deepEqual(tree, {
    blocks: [{ name: "e" }, { name: "c", keys: { down: "duck" } }, { name: "f", keys: { up: "jump" } }, { name: "b", points: { per_step: 2 } }],
    pages: [{ name: "g" }],
  });
  const follow = (/** @type {any[]} */ path) => edits.reduce((/** @type {any} */ moved, edit) => moved && followPath(moved, edit), path);
  assert.deepEqual([0, 1, 2].map((number) => follow(["blocks", number, "x"])), [null, ["blocks", 3, "x"], ["blocks", 1, "x"]]);
  assert.deepEqual(follow(["blocks", 2, "keys", "up"]), null);
  assert.deepEqual(follow(["pages", 1, "x"]), ["pages", 2, "x"]);
});

test("a member of a list that the file lacks is edited in what the list usually is", () => {
  const edit = /** @type {any} */ ({ op: "remove", path: [0] });
  assert.deepEqual(buildMemberEdits(["a", "b"], undefined, [1, 2], edit), [{ op: "set", path: ["a", "b"], value: [2] }]);
  assert.deepEqual(buildMemberEdits(["a", "b"], [1, 2], [1, 2], edit), [{ op: "remove", path: ["a", "b", 0] }]);
});

test("another world changes the actions that it lacks, and its length", () => {
  const facts = { id: "w", actions: ["up", "down"], usual_actions: ["up", "down"], default_keys: {}, max_steps: 50 };
  const block = { world: "v", actions: ["left"], max_steps: 100 };
  assert.deepEqual(buildWorldEdits(block, ["blocks", 0, "world"], "w", facts), [
    { op: "set", path: ["blocks", 0, "world"], value: "w" },
    { op: "set", path: ["blocks", 0, "actions"], value: ["up", "down"] },
    { op: "set", path: ["blocks", 0, "max_steps"], value: 50 },
  ]);
  assert.equal(buildWorldEdits({ ...block, actions: ["up"], max_steps: 50 }, ["blocks", 0, "world"], "w", facts).length, 1);
});

test("every text that participants read is listed with its place in the file", () => {
  const texts = listTexts(TREE).map(({ path, text }) => `${formatPath(path)} ${text}`);
  assert.deepEqual(texts, [
    "study.consent May we?", "pages[0].text Walk.", "blocks[0].instructions Go.", "blocks[0].feedback.goal Well done",
    "questions[0].items[0].ask How old?",
  ]);
});

test("a translation is a study with the same parts", () => {
  const parts = makeDocument().parts;
  const card = /** @type {any} */ ({ key: "walk-de.toml", parts: parts.toReversed(), has_protocol: true, problem: "" });
  assert.deepEqual(findTranslations([card, { ...card, parts: [] }, { ...card, key: "walk.toml" }], makeDocument()), [card]);
});

test("edits are sent one after the other, each on the version that the one before it left", async () => {
  const sent = serve([{ status: 200, content: makeDocument({ version: "2" }) }, { status: 200, content: makeDocument({ version: "3" }) }]);
  const study = open();
  assert.deepEqual(await Promise.all([study.edit([]), study.edit([])]), [true, true]);
  assert.deepEqual(sent.map(({ version }) => version), ["1", "2"]);
  assert.equal(study.document?.version, "3");
  assert.equal(study.unsaved, 0);
});

test("edits are shown before they are answered, and the next one is addressed to what they leave", async () => {
  const study = open();
  serve([{ status: 200, content: makeDocument({ version: "2" }) }, { status: 200, content: makeDocument({ version: "3" }) }]);
  study.edit([{ op: "remove", path: ["blocks", 0] }]);
  assert.deepEqual(study.read(["blocks", 0]), { name: "two" });
  assert.deepEqual(study.document?.parts.map(({ name, path }) => [name, ...path]), [["how", "pages", 0], ["two", "blocks", 0]]);
  const last = study.edit([{ op: "remove", path: ["groups", 0, "blocks", 0] }, { op: "insert", path: ["groups", 0, "blocks", 1], value: "how" }]);
  assert.deepEqual(study.document?.lanes[0].parts, ["two", "how"]);
  assert.equal(study.unsaved, 2);
  assert.deepEqual([await last, study.unsaved], [true, 0]);
  assert.deepEqual(study.read(["blocks", 0]).name, "one"); // the server's answer is what counts
});

test("edits behind one that meets another file are not made either, and none of them is lost", async () => {
  const conflict = { error: "conflict", message: "the file was changed", path: [], line: 0, document: makeDocument({ version: "9" }) };
  const sent = serve([{ status: 409, content: conflict }, { status: 200, content: makeDocument({ version: "10" }) }]);
  const study = open();
  const edits = ["seed", "theme"].map((field) => /** @type {any} */ ({ op: "set", path: ["study", field], value: 3 }));
  assert.deepEqual(await Promise.all(edits.map((edit) => study.edit([edit]))), [false, false]);
  assert.deepEqual([sent.length, study.failure?.edits, study.read(["study", "seed"])], [1, edits, undefined]);
  assert.equal(await study.retry(), true);
  assert.deepEqual(sent[1], { version: "9", edits });
});

test("what was not saved stays until it is made again, left, or replaced", async () => {
  const refusal = { error: "not_editable", message: "no", path: [], line: 0 };
  serve([{ status: 400, content: refusal }, ...["2", "3", "4"].map((version) => ({ status: 200, content: makeDocument({ version }) }))]);
  const study = open();
  const set = (/** @type {string} */ field) => study.edit([{ op: "set", path: ["study", field], value: 3 }]);
  assert.deepEqual(await Promise.all([set("seed"), set("theme")]), [false, true]); // the second has nothing to do with the first
  await set("version");
  assert.equal(study.failure?.edits.length, 1);
  await set("seed");
  assert.equal(study.failure, null);
});

test("cells that are edited in quick succession are all in the table", async () => {
  const rows = [["a", "b"], ["c", "d"]];
  const read = { name: "t.csv", version: "1", columns: ["x", "y"], rows };
  globalThis.fetch = /** @type {any} */ (async () => ({ ok: true, status: 200, json: async () => read }));
  const table = new OpenTable("walk.toml", "t.csv", () => {});
  await table.read();
  const sent = serve(["2", "3"].map((version) => ({ status: 200, content: { ...read, version, rows: [["A", "b"], ["c", version]] } })));
  table.write({ rows: rows.with(0, ["A", "b"]) });
  await table.write({ rows: /** @type {any} */ (table.table).rows.with(1, ["c", "D"]) });
  assert.deepEqual(sent.map(({ version, rows }) => [version, rows]), [["1", [["A", "b"], ["c", "d"]]], ["2", [["A", "b"], ["c", "D"]]]]);
  assert.deepEqual(table.table?.rows[1], ["c", "3"]);
});

test("in a conflict the file is shown as it is, and the edit is kept to be made again", async () => {
  const conflict = { error: "conflict", message: "the file was changed", path: [], line: 0, document: makeDocument({ version: "9" }) };
  const sent = serve([{ status: 409, content: conflict }, { status: 200, content: makeDocument({ version: "10" }) }]);
  const study = open();
  const edits = /** @type {any} */ ([{ op: "set", path: ["study", "seed"], value: 3 }]);
  assert.equal(await study.edit(edits), false);
  assert.equal(study.document?.version, "9");
  assert.deepEqual(study.failure, { message: "the file was changed", edits, isConflict: true });
  assert.equal(await study.retry(), true);
  assert.deepEqual(sent[1], { version: "9", edits });
  assert.equal(study.failure, null);
});

test("an edit that the desk does not answer is not lost", async () => {
  globalThis.fetch = async () => { throw new TypeError("no connection"); };
  const study = open();
  assert.equal(await study.edit(/** @type {any} */ ([{ op: "set", path: ["study", "seed"], value: 3 }])), false);
  assert.match(study.failure?.message ?? "", /does not answer/);
  assert.equal(study.failure?.edits.length, 1);
  assert.equal(study.document?.version, "1");
});

test("mistakes and restrictions are those of a field and what is below it", () => {
  const mistake = { path: ["blocks", 0, "episodes"], line: 4, message: "is 0" };
  const restrictions = { enrolled: 2, fields: [{ path: ["groups"], reason: "two have enrolled" }], message: "" };
  const study = open(makeDocument({ mistakes: [mistake], restrictions }));
  assert.deepEqual(study.mistakesAt(["blocks", 0]), [mistake]);
  assert.deepEqual(study.mistakesAt(["blocks", 1]), []);
  assert.equal(study.restrictionAt(["groups", 0, "blocks"]), "two have enrolled");
  assert.equal(study.restrictionAt(["blocks", 0]), "");
});

test("names and sentences are written as people read them", () => {
  assert.equal(spellName("response_deadline_ms"), "Response deadline");
  assert.equal(makeName("Four Rooms", ["four-rooms"]), "four-rooms-2");
  assert.equal(formatMinutes([4.2, 9.6]), "4–10 min");
  assert.equal(renderSentence("see [docs](x.md) and `name`").length, 3);
});

test("a part is previewed in the first session that has it, also by an order", () => {
  const tree = { sessions: [{ parts: ["how"] }, { parts: ["main"] }], orders: [{ name: "main", parts: ["one", ["two", "ask"]] }] };
  const study = makeDocument({ tree });
  assert.deepEqual(["how", "two", "ask", "lost"].map((name) => findSession(study, name)), [1, 2, 2, 1]);
});

test("a list that is edited as a text stays a list, and keeps what it was where the text is none", () => {
  assert.deepEqual(readLike('["red", "blue"]', ["red"], "any"), ["red", "blue"]);
  assert.deepEqual(readLike("red", ["red"], "any"), ["red"]);
  assert.equal(readLike("0.5", 2, "any"), 0.5);
  assert.equal(readLike("true", false, "any"), true);
  assert.equal(readLike("circle", undefined, "string"), "circle");
});

test("a word of a command is quoted where a shell would read it otherwise", () => {
  assert.equal(quoteWord("--tag=exclude"), "--tag=exclude");
  assert.equal(quoteWord("--note=the phone rang"), "'--note=the phone rang'");
  assert.equal(quoteWord("it's; rm -r ."), `'it'"'"'s; rm -r .'`);
});

const PRIMING = [
  { name: "fixation", text: "+", duration_ms: [400, 700] }, { name: "prime", duration_ms: 33 },
  { name: "mask", duration_ms: 67 }, { name: "target", until: "response" },
];

test("stimuli follow each other, a range is drawn at its middle, and the last stays until the deadline", () => {
  const { bars, length_ms } = layOutTrial(PRIMING, 1000);
  assert.deepEqual(bars.map((bar) => [bar.start_ms, bar.end_ms]), [[0, 550], [550, 583], [583, 650], [650, 1650]]);
  assert.deepEqual([bars.map((bar) => bar.isKnown), bars[3].isOpen, length_ms], [[false, true, true, true], true, 1650]);
});

test("times count from the onset or the end of another stimulus, and what comes with the feedback has no bar", () => {
  const { bars } = layOutTrial([
    { name: "go", until: "response", onset_ms: 500 }, { name: "stop", since: "go", onset_ms: "{delay}", duration_ms: 100 },
    { name: "mask", after: "stop", onset_ms: 50, duration_ms: 20 }, { name: "bell", feedback: "goal" },
  ], 0);
  assert.deepEqual(bars.map((bar) => bar.start_ms), [500, 800, 950]);
});

test("a bar that is dragged away from the one before it keeps its distance from it", () => {
  const list = ["blocks", 0, "timeline", "stimuli"];
  assert.deepEqual(buildStartEdits(PRIMING, 2, 700, list, 0), [
    { op: "set", path: [...list, 2, "after"], value: "prime" }, { op: "set", path: [...list, 2, "onset_ms"], value: 117 },
  ]);
  assert.deepEqual(buildStartEdits(PRIMING, 2, 560, list, 0), [
    { op: "set", path: [...list, 2, "since"], value: "prime" }, { op: "set", path: [...list, 2, "onset_ms"], value: 10 },
  ]);
  const apart = [{ name: "a", duration_ms: 100 }, { name: "b", after: "a", onset_ms: 50, duration_ms: 100 }];
  assert.deepEqual(buildStartEdits(apart, 1, 203, list, 0), [{ op: "set", path: [...list, 1, "onset_ms"], value: 100 }]);
  assert.deepEqual(buildStartEdits(apart, 1, 98, list, 0).map(({ op, path }) => [op, path.at(-1)]), [["remove", "after"], ["remove", "onset_ms"]]);
  assert.deepEqual(buildLengthEdits(apart[1], 1, 254, list), [{ op: "set", path: [...list, 1, "duration_ms"], value: 250 }]);
  assert.deepEqual(buildLengthEdits(PRIMING[0], 0, 254, list), []);
});

test("a level brings the actions and keys that it needs, and leaves those that the block has", () => {
  const level = Level.start();
  level.put(3, 3, "Ly");
  const block = { actions: ["left", "forward"], fixed_keys: { left: "left" }, options: {} };
  const facts = /** @type {any} */ ({ default_keys: { left: "left", right: "right", space: "toggle" } });
  const edits = Object.fromEntries(buildLevelEdits(block, ["blocks", 0], level, facts).map((edit) => [edit.path.at(-1), edit.value]));
  assert.deepEqual(edits.actions, ["left", "forward", "right", "toggle"]);
  assert.deepEqual(edits.fixed_keys, { left: "left", right: "right", space: "toggle" });
  assert.equal(edits.diagram.split("\n")[3], "WW    Ly        WW");
  const same = { actions: edits.actions, options: { diagram: edits.diagram, mission: level.mission } };
  assert.deepEqual(buildLevelEdits(same, ["blocks", 0], level, facts), []);
});

test("a click on the agent turns it, and cells have names", () => {
  assert.deepEqual([chooseCell(">>", "y", ">>"), chooseCell(">>", "y", "  "), chooseCell("G", "y", ""), chooseCell("K", "b", "")], ["vv", ">>", "Gg", "Kb"]);
  assert.deepEqual(["Ly", "Gg", "^^", "  "].map(nameCell), ["yellow locked door", "goal", "agent, looking up", "empty"]);
});

test("a second day has the parts of the first without the agreement; groups with other parts must come together first", () => {
  const tree = { groups: [{ name: "a", parts: ["consent", "one"] }], pages: [{ name: "consent", asks_consent: true }] };
  const lanes = [{ group: "a", session: "", parts: ["consent", "one"], path: ["groups", 0, "parts"], replaced: {} }];
  const study = open(makeDocument({ tree, lanes }));
  assert.deepEqual(buildDayEdits(study), [
    { op: "remove", path: ["groups", 0, "parts"] },
    { op: "set", path: ["sessions"], value: [{ name: "day-1", parts: ["consent", "one"] }, { name: "day-2", parts: ["one"], days_after_previous: [1, 3] }] },
  ]);
  assert.equal(findDayProblem(study), "");
  assert.match(findDayProblem(open()), /different parts/);
});

test("what a consent leaves open is filled in place by place, and dollar signs stay", () => {
  const text = "Purpose: [what]. Contact: [who]. [what]";
  assert.deepEqual(listPlaceholders(text), ["what", "who", "what"]);
  assert.equal(fillPlaceholder(text, "who", "$& at [lab]"), "Purpose: [what]. Contact: $& at [lab]. [what]");
  assert.equal(fillPlaceholder(text, "what", "sleep"), "Purpose: sleep. Contact: [who]. [what]");
});

test("a record of processing says what the file says, and nothing where the file is silent", () => {
  const tree = {
    study: { name: "walk", participants: 1, consent: "Contact: [who]." }, groups: [{}, {}], web: { recruitment_platforms: ["prolific"] },
    questions: [{ items: [{ name: "age", ask: "How old?" }] }], design: { question: "Does sleep help?" },
  };
  const record = Object.fromEntries(buildProcessingRecord(tree));
  assert.deepEqual(record.Purpose, ["Does sleep help?"]);
  assert.deepEqual(record["Whose data"], ["1 participant, 2 groups, 1 session each", "recruited by prolific"]);
  assert.ok(record["Which data"].some((line) => line.includes("How old?")));
  assert.deepEqual([record.Responsible, record["Recipients, place and duration of storage"]], [[], []]);
});

test("of a colleague's folder, the files of a study are copied, and what programs leave behind is not", () => {
  const paths = ["My Study/walk.toml", "My Study/img/a.png", "My Study/.git/config.txt", "My Study/__pycache__/a.py", "My Study/sessions/a/b/c.csv", "My Study/run.sh"];
  assert.deepEqual(sortFiles(paths), { folder: "my-study", wanted: ["walk.toml", "img/a.png"], left: [".git/config.txt", "__pycache__/a.py", "sessions/a/b/c.csv", "run.sh"] });
});

test("a replay waits as the participant did, and its way leaves out what has no place", () => {
  const step = (/** @type {number} */ t_ms, /** @type {any} */ place) => /** @type {any} */ ({ t_ms, place });
  const steps = [step(0, [1, 2]), step(900, null), step(60_900, [3, 4])];
  assert.deepEqual([findWait(steps, 0, 1), findWait(steps, 0, 4), findWait(steps, 1, 1), findWait(steps, 2, 1)], [900, 225, 4000, 0]);
  assert.deepEqual([listPoints(steps, 1), listPoints(steps, 2)], ["1,2", "1,2 3,4"]);
});

test("the command of a departure is one that a shell can take", () => {
  assert.equal(writeDeparture("withdraw", "sub-01", "my data/walk", "it's over"), "minihuman withdraw sub-01 '--study=my data/walk' '--reason=it'\"'\"'s over' --erase");
});
