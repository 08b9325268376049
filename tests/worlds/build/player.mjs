// Plays cases in the page's own modules, in Node or in a browser, and answers with a digest of all that came of each.
// The cases come from `address`/next until there are none left; it never sees the digests that they are compared with.
const inNode = typeof process !== "undefined";
const [address, world, simd] = inNode
  ? process.argv.slice(2)
  : [location.origin, "/page/world.js", new URLSearchParams(location.search).get("simd")];
const { Kernels, FirstPersonWorld, GridWorld, Scene } = await import(world);
const TYPES = { int32: Int32Array, int64: BigInt64Array, uint64: BigUint64Array, uint8: Uint8Array, uint32: Uint32Array, float64: Float64Array };

const fetched = async (path) => (await fetch(`${address}/${path}`)).arrayBuffer();
const manifest = await (await fetch(`${address}/page/worlds/manifest.json`)).json();
const modules = new Map(), files = new Map();

async function kernelsOf(name) {
  const entry = manifest.modules[name];
  const file = entry.files.find((one) => one.simd === (simd === "simd")) ?? entry.files[0];
  if (!modules.has(name)) modules.set(name, await Kernels.compile(await fetched(`page/worlds/${file.file}`), entry));
  return modules.get(name).again();
}

// arrays that many cases share are kept: tiles, tables, textures
async function numbers({ file, kind, shared }) {
  const bytes = files.get(file) ?? (await fetched(`files/${file}`));
  if (shared) files.set(file, bytes);
  return new TYPES[kind](bytes.slice(0));
}
async function read(named) {
  const arrays = {};
  for (const [name, where] of Object.entries(named)) arrays[name] = where?.file ? await numbers(where) : where;
  return arrays;
}
const copyOf = (view) => new Uint8Array(view.buffer, view.byteOffset, view.byteLength).slice();
const bytesOf = (text) => new TextEncoder().encode(text);
async function sha256(parts) {
  const all = await new Blob(parts).arrayBuffer();
  return [...new Uint8Array(await crypto.subtle.digest("SHA-256", all))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

async function playGrid(one) {
  const start = { ...(await read(one.start)), view_size: one.view_size, in_view: one.in_view };
  const world = new GridWorld(await kernelsOf("grid"), start);
  const atlas = await read(one.atlas), full = await read(one.full), parts = [];
  one.actions.forEach((action, at) => {
    const done = world.step(action);
    parts.push(new Uint8Array([done.status, done.direction]), copyOf(new Float64Array([done.reward])));
    for (const array of [world.row, world.words, world.image]) parts.push(copyOf(array.data));
    parts.push(bytesOf(world.digest(done.reward, done.status & 1 ? 1 : done.status)));
    if (at % one.every === 0) {
      parts.push(copyOf(world.draw("partial", atlas).rgb.data), copyOf(world.draw("full", full).rgb.data));
    }
    if (done.status > 0) world.begin(start);
  });
  return sha256(parts);
}

let drawn = { name: "" }; // the textures that were unpacked last
async function playFirstPerson(one) {
  const tables = await read(one.tables), { looks, n_actions, uses } = one;
  const start = { ...(await read(one.state)), looks, n_actions, uses };
  const name = one.textures.map(({ file }) => file).join();
  if (drawn.name !== name) {
    const kernels = await kernelsOf("first_person"), textures = [];
    for (const where of one.textures) textures.push(await numbers(where));
    drawn = { name, kernels, texels: Scene.unpackTextures(kernels, tables, textures) };
  }
  const world = new FirstPersonWorld(await kernelsOf("first_person"), start);
  const scene = new Scene(drawn.kernels, tables, drawn.texels);
  const first = world.save(), parts = [];
  [scene.width, scene.height] = one.size;
  one.actions.forEach((action, at) => {
    if (at % one.every === 1) { // a detour that is taken back leaves nothing behind
      const saved = world.save();
      one.actions.slice(at, at + 3).reverse().forEach((other) => world.step(other));
      world.restore(saved);
    }
    const done = world.step(action);
    parts.push(new Uint8Array([done.status]), copyOf(new Float64Array([done.reward])));
    parts.push(bytesOf(world.digest(done.reward, done.status & 1 ? 1 : done.status)));
    if (at % one.every === 0) {
      world.look(scene);
      parts.push(copyOf(scene.draw(world.view.data, world.places.data).picture.data));
    }
    if (done.status > 0) world.restore(first);
  });
  return sha256(parts);
}

const answer = (path, value) => fetch(`${address}/${path}`, { method: "POST", body: JSON.stringify(value) });
try {
  for (;;) {
    const cases = await (await fetch(`${address}/next`)).json();
    if (!cases) break;
    const digests = {};
    for (const one of cases) digests[one.id] = await (one.tables ? playFirstPerson(one) : playGrid(one));
    await answer("done", digests);
  }
} catch (error) {
  await answer("failed", String(error.stack ?? error));
}
