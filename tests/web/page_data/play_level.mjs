// Plays a drawn level in Node as the level editor does, and writes the kept game: node play_level.mjs PACK LEVEL_JS < level.toml

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const folder = pathToFileURL(`${process.argv[2]}/`);
const { World, WorldPack } = await import(new URL("packed_world.js", folder));
const { Level } = await import(pathToFileURL(process.argv[3]));
const { EpisodeRecord, writeGame } = await import(new URL("episode_record.js", folder));

const ACTIONS = ["left", "right", "forward", "pickup", "drop", "toggle", "done"];
const level = Level.read(readFileSync(0, "utf8"));
const start = () => ({ row: level.row(), words: new BigUint64Array(6), view_size: 7 });
const about = { name: "Level-v0", actions: ACTIONS, view_size: 7, options: level.options };
const world = await World.ofStates(await WorldPack.open(folder), about, { at: start, mission: () => level.mission });
world.reset();
const record = new EpisodeRecord(world, { view: "full", key_map: { f: "left", j: "right", d: "forward" }, now: 0 });
for (let stamp = 300; !world.ended; stamp += 300) record.add("d", 2, world.step("forward"), stamp);
process.stdout.write(writeGame([record.columns]));
