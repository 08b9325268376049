// What a page's world does, in Node: node check_world.mjs PACK, with FourRooms, a maze and a first-person world in it, of
// which seeds 3 to 5 are packed.

import assert from "node:assert/strict";
import { pathToFileURL } from "node:url";

const folder = pathToFileURL(`${process.argv[2]}/`);
const { World } = await import(new URL("packed_world.js", folder));
const FOUR_ROOMS = "minihuman/MiniGrid-FourRooms-v0", ROOM = "MiniWorld-OneRoom-v0";
const MAZE = "MiniGrid-WFC-MazeSimple-v0";

const world = await World.make(FOUR_ROOMS, { from: folder });
assert.deepEqual(world.seeds, [0, 2 ** 53]);
assert.throws(() => world.step("left"), /none has begun/);
for (const seed of [-1, 1.5, NaN, 2 ** 53]) assert.throws(() => world.reset({ seed }), /is no whole number from 0 to 9007199254740991/);
const { image, shape, direction, mission } = world.reset({ seed: 4 });
assert.deepEqual([shape, image.length, mission], [[7, 7, 3], 147, "reach the goal"]);
assert.throws(() => world.step("fly"), /no action fly; it has left, right/);
const first = world.step("right");
assert.equal(first.observation.direction, (direction + 1) % 4);
assert.match(first.digest, /^[0-9a-f]{16}$/);

const saved = world.save(), ahead = [world.step("right").digest, world.step("left").digest];
world.restore(saved);
assert.equal(world.steps, 1);
assert.deepEqual([world.step("right").digest, world.step("left").digest], ahead, "a restored state goes on as before");

world.close();
assert.throws(() => world.reset({ seed: 4 }), /is closed/);
const memory = new Set();
for (let turn = 0; turn < 20; turn++) { // a closed world's memory is the next one's
  const next = await World.make(FOUR_ROOMS, { from: folder });
  next.reset({ seed: 4 });
  assert.equal(next.step("right").digest, first.digest);
  memory.add(next.state.row.length);
  next.close();
}
const other = await World.make(FOUR_ROOMS, { from: folder }), third = await World.make("BabyAI-GoToLocal-v0", { from: folder });
other.reset({ seed: 4 });
third.reset({ seed: 4 });
assert.equal(other.step("right").digest, first.digest, "worlds that are open at once do not share a layout's memory");
other.close();
third.close();

const maze = await World.make(MAZE, { from: folder });
assert.deepEqual(maze.seeds, [3, 6]);
assert.throws(() => maze.reset({ seed: 2 }), /seed 2 is not packed, 3 to 5 are/);
assert.equal(maze.reset({ seed: 4 }).mission, "traverse the maze to get to the goal");
const short = await World.make(FOUR_ROOMS, { from: folder, max_steps: 2 });
short.reset({ seed: 3 });
assert.deepEqual([short.step("left").truncated, short.step("left").truncated], [false, true]);
assert.deepEqual(short.options, { max_steps: 2 });
await assert.rejects(World.make("MiniGrid-Nowhere-v0", { from: folder }), /minihuman pack MiniGrid-Nowhere-v0/);

const room = await World.make(ROOM, { from: folder });
room.reset({ seed: 3 });
const before = room.step("turn_left").digest, place = room.save();
const after = room.step("move_forward").digest;
room.restore(place);
assert.equal(room.step("move_forward").digest, after);
assert.notEqual(before, after);
assert.deepEqual(room.options, { trig: 1 });
console.log("fine");
