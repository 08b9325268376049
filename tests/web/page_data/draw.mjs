// Draws worlds from seeds, in Node or in a browser: per world a digest of each reset's row, random numbers' state, first
// image and mission. In Node: node draw.mjs PACK < plan.json > digests.json, the plan being { worlds, seeds }.

const DIGITS = 16;

/** @param {URL} folder of a pack @param {{ worlds: string[], seeds: number[] }} plan */
export async function drawWorlds(folder, { worlds, seeds }) {
  const { World } = await import(new URL("packed_world.js", folder)), drawn = {};
  for (const name of worlds) {
    const world = await World.make(name, { from: folder });
    drawn[name] = [];
    for (const seed of seeds) {
      const { image, mission } = world.reset({ seed }), { row, words } = world.state;
      drawn[name].push(await digest([row, words, image, new TextEncoder().encode(mission)]));
    }
    world.close();
  }
  return drawn;
}

async function digest(parts) {
  const hash = await crypto.subtle.digest("SHA-256", await new Blob(parts).arrayBuffer());
  return [...new Uint8Array(hash)].map((byte) => byte.toString(16).padStart(2, "0")).join("").slice(0, DIGITS);
}

if (typeof process !== "undefined") {
  const { readFileSync } = await import("node:fs"), { pathToFileURL } = await import("node:url");
  const drawn = await drawWorlds(pathToFileURL(`${process.argv[2]}/`), JSON.parse(readFileSync(0, "utf8")));
  process.stdout.write(JSON.stringify(drawn));
}
