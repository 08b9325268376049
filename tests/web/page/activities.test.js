// The modules that kinds of activity bring for their own screens: what they make of the page's tools.

import assert from "node:assert/strict";
import test from "node:test";

import { draw as drawFilm } from "../../../minihuman/activities/correction/page.js";
import { draw as drawPair } from "../../../minihuman/activities/preferences/page.js";

/** Tools that note which films were opened. */
const tools = () => {
  const opened = [];
  return {
    opened,
    el: () => null, prose: () => null,
    words: (tag, name, text) => ({ tag, name, text }),
    films: { open: (message, settings) => { opened.push({ message, settings }); return []; } },
  };
};
const message = { id: 1, name: 2 };

test("both films of a pair run by themselves, and its key begins them again", () => {
  const page = tools();
  const screen = { title: "Which?", prompt: "f or j", progress: "1 of 2", films: [[0, -1], [1, -1]], step: 0, period: 5, replay_key: "r" };
  const words = drawPair(screen, message, page).filter((element) => element?.text);
  assert.deepEqual(words.map(({ text }) => text), ["Which?", "f or j", "1 of 2"]);
  const [{ settings }] = page.opened;
  assert.deepEqual(settings.sides, [[0, -1], [1, -1]]);
  assert.equal(settings.period, 5);
  assert.equal(settings.stepOf("r", false, 1), 0);
  assert.equal(settings.stepOf("r", true, 1), null);
  assert.equal(settings.stepOf("x", false, 1), null);
});

test("keys go through an episode, and no further than its ends", () => {
  const page = tools();
  drawFilm({ title: "", prompt: "", progress: "1 of 3", films: [[0, -1, -1]], step: 1, back: "comma", forward: "period" }, message, page);
  const [{ settings }] = page.opened;
  assert.equal(settings.period, null);
  assert.deepEqual([settings.stepOf("period", false, 1), settings.stepOf("comma", true, 1)], [2, 0]);
  assert.deepEqual([settings.stepOf("period", false, 2), settings.stepOf("comma", false, 0)], [null, null]);
  assert.equal(settings.stepOf("enter", false, 1), null);
});
