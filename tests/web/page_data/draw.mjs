// Draws worlds from seeds in Node: reads { worlds, seeds } and writes, per world, a digest of each reset's row, random
// numbers' state, first image and mission. node draw.mjs PACK < plan.json > digests.json

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const folder = pathToFileURL(`${process.argv[2]}/`);
const { World } = await import(new URL("packed_world.js", folder));
const { worlds, seeds } = JSON.parse(readFileSync(0, "utf8"));

const drawn = {};
for (const name of worlds) {
  const world = await World.make(name, { from: folder });
  drawn[name] = seeds.map((seed) => {
    const { image, mission } = world.reset({ seed }), { row, words } = world.state;
    const hash = createHash("sha256");
    for (const part of [row, words, image, Buffer.from(mission)]) hash.update(part);
    return hash.digest("hex").slice(0, 16);
  });
  world.close();
}
process.stdout.write(JSON.stringify(drawn));
