// Scenes that the page computes, on the committed modules: stepped once, restored, placed anew, let go of.

import assert from "node:assert/strict";
import fs from "node:fs";
import { before, test } from "node:test";
import zlib from "node:zlib";

import { ComputedScenes, EpisodeComputer } from "../../../minihuman/web/page/computed.js";
import { predict } from "../../../minihuman/web/page/episode.js";
import { GridWorld, Kernels } from "../../../minihuman/web/page/world.js";

const FOLDER = new URL("../../../minihuman/web/page/worlds/", import.meta.url);
const LEFT = 0, RIGHT = 1, FORWARD = 2;
// a floor of 3 by 3 cells with the agent in the middle, looking right: no wall, nothing in it
const SIZE = 3, HEADER = 24, EMPTY = 1;
let world;

const state = (step = 0, x = 1) => ({
  world: "grid", step, row: [SIZE, 2, x, 1, 1, 1, 0, 1, EMPTY, 1, step, 1, 50, 1, 1, 1, 1, 1, 7, 1, 0, HEADER - 11, EMPTY, 9, 0, 18],
  rng_state: ["0", "0", "0", "0", "0", "0"], view_size: 3, full: true, in_view: false, atlas: "none",
});
const UNDRAWN = { unpacked: new Promise(() => {}), isFlat: true, draw: () => null };
const open = (mostSteps = 9) => new ComputedScenes(world, UNDRAWN, mostSteps, state());
const presses = (...actions) => actions.map((action, i) => ({ n: i + 1, action }));
const follow = (scenes, ...actions) => predict(scenes, scenes.mostSteps, { ...scenes.start }, presses(...actions));

before(async () => {
  const manifest = JSON.parse(fs.readFileSync(new URL("manifest.json", FOLDER), "utf8"));
  const kernels = await Kernels.compile(fs.readFileSync(new URL("grid.wasm", FOLDER)), manifest.modules.grid);
  const row = new Int32Array(HEADER + 3 * SIZE * SIZE);
  row[0] = row[1] = SIZE;
  world = new GridWorld(kernels, { row, words: new BigUint64Array(6), view_size: 3 });
});

test("actions lead to scenes whose state is the world's, each computed once", () => {
  const scenes = open();
  const { scene, step, known } = follow(scenes, FORWARD, LEFT);
  assert.deepEqual([step, known], [2, true]);
  assert.deepEqual([...scenes.get(scene).saved.row.subarray(2, 5)], [2, 1, 3]);
  assert.match(scenes.get(scene).digest, /^[0-9a-f]{16}$/);
  assert.equal(follow(scenes, FORWARD, LEFT).scene, scene);
  assert.notEqual(follow(scenes, FORWARD, RIGHT).scene, scene);
});

test("the last step of the rules ends an episode, and its digest says so", () => {
  const [one, two] = [open(1), open(2)];
  const [ended, on] = [follow(one, LEFT), follow(two, LEFT)];
  assert.deepEqual([ended.ended, on.ended], [true, false]);
  assert.deepEqual(one.get(ended.scene).saved.row, two.get(on.scene).saved.row);
  assert.notEqual(one.get(ended.scene).digest, two.get(on.scene).digest);
});

test("a correction is where the episode goes on, and what was before is let go of", () => {
  const scenes = open();
  const before_ = follow(scenes, LEFT, LEFT).scene;
  scenes.place(state(4, 2));
  const { step, scene } = follow(scenes, RIGHT);
  assert.equal(step, 5);
  assert.deepEqual([...scenes.get(scene).saved.row.subarray(2, 5)], [2, 1, 1]);
  scenes.forget(scene);
  assert.deepEqual([scenes.has(before_), scenes.has(scenes.start.scene), scenes.has(scene)], [false, true, true]);
});

test("nothing is drawn before the tiles are there", () => {
  const computer = new EpisodeComputer(world.kernels, world.kernels);
  const packed = zlib.deflateSync(new Uint8Array(new BigInt64Array([32n, 10n]).buffer)).toString("base64");
  computer.learnArrays({ t: "arrays", name: "none", arrays: [["px", "int64", 16]], packed });
  assert.equal(computer.open(state(), 9).draw(0), null);
});
