// What is shown in advance: the scene, the screen and the text that inputs lead to.

import assert from "node:assert/strict";
import { test } from "node:test";

import { predict, trailOf } from "../../../minihuman/web/page/episode.js";
import { ScreenPrefetch } from "../../../minihuman/web/page/prefetch.js";
import { editDraft } from "../../../minihuman/web/page/questions.js";

const scenes = new Map([
  [1, { picture: 1, edges: new Map([[0, [2, false]], [1, [1, false]]]) }],
  [2, { picture: 2, edges: new Map([[0, [3, true]], [1, [9, false]]]) }],
  [3, { picture: 3, edges: new Map() }],
]);
const presses = (...actions) => actions.map((action, i) => ({ n: i + 1, action }));
const follow = (...actions) => predict(scenes, 10, { step: 4, scene: 1 }, presses(...actions));

test("actions lead from scene to scene, and nothing follows an episode's end", () => {
  assert.deepEqual(follow(1, 0), { step: 6, scene: 2, ended: false, known: true, who: undefined });
  assert.deepEqual(follow(0, 0, 0), { step: 6, scene: 3, ended: true, known: true, who: undefined });
});

test("nothing is known behind an action that was not sent ahead, or a scene whose picture was not", () => {
  assert.deepEqual(follow(0, 5, 0), { step: 5, scene: 2, ended: false, known: false, who: undefined });
  assert.deepEqual(follow(0, 1, 0), { step: 6, scene: 9, ended: false, known: false, who: undefined });
});

test("the last step of the rules ends an episode", () => {
  assert.equal(predict(scenes, 5, { step: 4, scene: 1 }, presses(1)).ended, true);
});

test("handing back changes who steers, and makes no step", () => {
  const after = predict(scenes, 10, { step: 4, scene: 1, who: "person" }, [{ n: 1, action: null, who: "agent" }]);
  assert.deepEqual([after.step, after.who], [4, "agent"]);
});

test("a team's turn is one action: the first pressed, and the one that the server has heard of before it", () => {
  const rules = { team: "turns" }, trail = presses(0, 1);
  assert.deepEqual(trailOf({ rules, confirmed: { step: 4, scene: 1, action: -1 }, trail }), trail.slice(0, 1));
  assert.deepEqual(trailOf({ rules, confirmed: { step: 4, scene: 1, action: 1 }, trail: [] }), [{ n: 0, action: 1 }]);
  assert.deepEqual(trailOf({ rules: { team: "" }, confirmed: null, trail }), trail);
});

const screenNamed = (name) => ({ name, screen: {}, after: null, episode: -1, scene: -1 });
const shown = (name, through) => ({ id: name, name, through, at: 0, tick: null, screen: {} });

function openPrefetch() {
  const prefetch = new ScreenPrefetch();
  prefetch.learn({ screens: [screenNamed(1), screenNamed(2)], edges: [[1, "key:enter", 2]] });
  assert.equal(prefetch.tell(shown(1, 0)), true);
  prefetch.sawAt(1, 50);
  return prefetch;
}

test("a screen that was sent ahead is shown at once, and not again when the server says it", () => {
  const prefetch = openPrefetch();
  assert.equal(prefetch.took(1, "key:enter", 60)?.name, 2);
  assert.equal(prefetch.tell(shown(2, 1)), false);
});

test("an input before the screen was seen leads nowhere until the server has heard of it", () => {
  const prefetch = openPrefetch();
  assert.equal(prefetch.took(1, "key:enter", 40), null);
  assert.equal(prefetch.took(2, "key:enter", 60), null);
  prefetch.acknowledge(2);
  assert.equal(prefetch.took(3, "key:enter", 70)?.name, 2);
});

test("where the server stays, the page returns to its screen", () => {
  const prefetch = openPrefetch();
  prefetch.took(1, "key:enter", 60);
  assert.equal(prefetch.acknowledge(1), true);
  assert.equal(prefetch.at, 1);
});

test("keys edit by letters, not by their halves, and move with the writing's direction", () => {
  const field = { rtl: false, long: false };
  assert.deepEqual(editDraft({ text: "a😀b", caret: 3 }, "backspace", field), { text: "ab", caret: 1 });
  assert.deepEqual(editDraft({ text: "a😀b", caret: 1 }, "delete", field), { text: "ab", caret: 1 });
  assert.equal(editDraft({ text: "a😀b", caret: 1 }, "right", field)?.caret, 3);
  assert.equal(editDraft({ text: "ab", caret: 1 }, "right", { ...field, rtl: true })?.caret, 0);
  assert.equal(editDraft({ text: "ab", caret: 1 }, "enter", field), null);
  assert.equal(editDraft({ text: "ab", caret: 1 }, "enter", { ...field, long: true })?.text, "a\nb");
});
