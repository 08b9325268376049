// The level editor's files and first states, which are those of the world in Python.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { Level } from "../../../minihuman/builder/page/level.js";

const drawn = JSON.parse(readFileSync(new URL("level.json", import.meta.url), "utf-8"));

test("a file that is read and written again is the same", () => {
  assert.equal(Level.read(drawn.file).file, drawn.file);
});

test("a level's first state is the one that Python lays out", () => {
  assert.deepEqual(Array.from(Level.read(drawn.file).row()), drawn.row);
});

test("a second agent takes the place of the first", () => {
  const level = new Level(5, 5);
  level.put(1, 1, ">>");
  level.put(2, 2, "vv");
  assert.deepEqual([level.cells[1][1], level.cells[2][2]], ["  ", "vv"]);
});

test("an erased border is a wall, so that the file has every row and column of the page", () => {
  const level = new Level(5, 4);
  for (let y = 0; y < 4; y++) level.put(0, y, "  ");
  for (let x = 0; x < 5; x++) level.put(x, 0, "  ");
  level.put(4, 1, ">>");
  level.put(1, 1, "<<"); // the agent leaves the border
  const walled = new Level(5, 4);
  walled.cells[1][1] = "<<";
  assert.deepEqual(level.cells, walled.cells);
  assert.deepEqual(Level.read(level.file).cells, level.cells);
});

test("common indentation and empty last rows of a file are left out, as Python leaves them out", () => {
  const drawn = new Level(5, 4);
  drawn.put(1, 1, "Gg");
  const indented = drawn.file.replace(/^WW/gm, "    WW").replace("WW\n'".concat("''"), "WW\n\n'".concat("''"));
  assert.notEqual(indented, drawn.file);
  assert.deepEqual(Level.read(indented).cells, drawn.cells);
});

test("an agent that is not drawn stands in an empty cell", () => {
  for (const at of [0, 0.5, 0.999]) {
    const [x, y] = new Level(5, 4).row(at).slice(2, 4);
    assert.ok(x >= 1 && x <= 3 && y >= 1 && y <= 2);
  }
});

test("another size keeps what lies inside, and another text is no level", () => {
  const level = new Level(5, 5);
  level.put(1, 1, "Gg");
  assert.equal(level.resized(7, 4).cells[1][1], "Gg");
  assert.equal(Level.read("world = 1"), null);
  assert.equal(Level.read(drawn.file.replace("Ky", "Zy")), null);
});
