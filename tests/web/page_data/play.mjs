// Plays scripted episodes in Node: reads a list of { world, seed, policy, max_steps } and writes jsPsych's trials.
// node play.mjs PACK < plan.json > trials.json

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [pack] = process.argv.slice(2);
const folder = pathToFileURL(`${pack}/`);
const { World } = await import(new URL("packed_world.js", folder));
const { EpisodeRecord } = await import(new URL("episode_record.js", folder));

const KEYS = "fjdksla", LONGEST = 400, STARTED_UNIX_MS = 1_790_000_000_000;
const POLICIES = {
  random: (draw, count) => draw(count),
  walks: (draw, count) => (draw(3) ? Math.min(2, count - 1) : draw(Math.min(2, count))),
  uses: (draw, count) => (draw(2) ? draw(count) : count - 1 - draw(Math.min(4, count))),
};

/** A stream of numbers: the same wherever it runs. */
function stream(seed) {
  let state = (seed * 2_654_435_761) >>> 0 || 1;
  return (below) => {
    state ^= state << 13; state ^= state >>> 17; state ^= state << 5;
    return (state >>> 0) % below;
  };
}

const worlds = new Map(), trials = [];
for (const { world: id, seed, policy, max_steps } of JSON.parse(readFileSync(0, "utf8"))) {
  const name = `${id} ${max_steps}`;
  if (!worlds.has(name)) worlds.set(name, await World.make(id, { from: folder, max_steps }));
  const world = worlds.get(name), draw = stream(trials.length + 1);
  world.reset({ seed });
  const key_map = Object.fromEntries(world.actions.slice(0, KEYS.length).map((action, number) => [KEYS[number], action]));
  const record = new EpisodeRecord(world, { view: draw(2) ? "partial" : "full", key_map, now: 0 });
  for (let stamp = 0; !world.ended && record.steps < LONGEST;) {
    const action = POLICIES[policy](draw, Object.keys(key_map).length), key = KEYS[action];
    stamp += 150 + draw(4_000) / 10;
    record.add(key, action, world.step(action), stamp);
    record.release(key, stamp + 40 + draw(80));
  }
  const started_unix_ms = STARTED_UNIX_MS + trials.length * 1_000_000;
  const data = { ...record.columns, started_unix_ms };
  if (!world.ended) data.playing_ms = data.rt_ms.at(-1);
  trials.push({ ...data, trial_type: "minihuman-episode", trial_index: trials.length, plugin_version: "0.1.0" });
}
process.stdout.write(JSON.stringify(trials));
