// Keys that are held, axes and the mouse's motion combine as in the session: minihuman/experiment/machine/running_episode.py.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { HeldInputs } from "../../../minihuman/web/page/held.js";
import { roundHalfEven } from "../../../minihuman/web/page/world.js";

// speed, turn, and what the hands do; of the elements 1 to 5: back, ahead, right, left, pick up
const VECTORS = {
  elements: [[0, -1], [0, 1], [1, -1], [1, 1], [2, 1]], rest: [0, 0, 0], low: [-1, -1, 0], high: [1, 1, 1],
  adds: [true, true, false], whole: [false, false, true],
};
const RULES = {
  actions: { down: 1, up: 2, right: 3, left: 4, space: 5 }, noop: 0, vectors: VECTORS,
  combines: { axes: { mouse_x: [1, -0.02], pad_left_y: [0, -1] }, chords: [] },
};
let held;

beforeEach(() => { held = new HeldInputs(); });

const key = (name, down = true) => {
  held.take({ t: "key", key: name, down });
  if (down) held.press(name);
};

test("keys that are down together move their components, and opposite ones cancel each other", () => {
  key("up");
  key("left");
  held.drop(); // a step has the presses; the keys stay down
  assert.deepEqual(held.combine(RULES), [1, 1, 0]);
  key("right");
  assert.deepEqual(held.combine(RULES), [1, 0, 0]);
  key("up", false);
  key("left", false);
  assert.deepEqual(held.combine(RULES), [0, -1, 0]);
});

test("a press between two steps is in the next one, though the key is up again", () => {
  key("space");
  key("space", false);
  assert.deepEqual(held.combine(RULES), [0, 0, 1]);
  held.drop();
  assert.equal(held.combine(RULES), 0, "at rest the no-op is done");
  assert.equal(held.combine({ ...RULES, noop: null }), null);
});

test("the mouse's motion adds up until a step, is no more than the whole, and keys add to it", () => {
  for (const pixels of [10, 5]) held.take({ t: "motion", axis: "mouse_x", pixels });
  assert.deepEqual(held.combine(RULES), [0, -0.3, 0]);
  held.take({ t: "motion", axis: "mouse_x", pixels: -400 });
  key("up");
  assert.deepEqual(held.combine(RULES), [1, 1, 0]);
  held.drop();
  assert.deepEqual(held.combine(RULES), [1, 0, 0]);
});

test("a stick stays where it is", () => {
  held.take({ t: "axis", axis: "pad_left_y", value: -0.5 });
  held.drop();
  assert.deepEqual(held.combine(RULES), [0.5, 0, 0]);
});

test("without the focus nothing is down, and no script presses a key", () => {
  key("up");
  held.take({ t: "focus", focused: false });
  held.take({ t: "key", key: "left", down: true, cause: "held_before_focus" });
  held.drop();
  assert.equal(held.combine(RULES), 0);
});

test("numbered actions: the latest key's, or the chord's of all", () => {
  const numbered = { actions: { up: 1, right: 2 }, noop: 0, vectors: null, combines: { axes: {}, chords: [[[1, 2], 7]] } };
  key("right");
  assert.equal(held.combine(numbered), 2);
  key("up");
  assert.equal(held.combine(numbered), 7);
  assert.equal(held.combine({ ...numbered, combines: { axes: {}, chords: [] } }), 1);
});

test("what the server says is held counts", () => {
  key("up");
  held.restore({ down: ["left"], pressed: [], axes: { pad_left_y: 1 } });
  assert.deepEqual(held.combine(RULES), [-1, 1, 0]);
});

test("numbers are rounded as NumPy rounds them", () => {
  assert.deepEqual([0.5, 1.5, 2.5, -0.5, -1.5, 2.4, -2.6, 3].map(roundHalfEven), [0, 2, 2, -0, -2, 2, -3, 3]);
});
