// Plays what a file says in the page's own module, and prints a digest of everything that came of each case.
import { createHash } from "node:crypto";
import fs from "node:fs";

const [, , page, casesPath, simd] = process.argv;
const { Kernels, GridWorld, Scene } = await import(`${page}/world.js`);
const manifest = JSON.parse(fs.readFileSync(`${page}/worlds/manifest.json`, "utf8"));
const cases = JSON.parse(fs.readFileSync(casesPath, "utf8"));
const folder = casesPath.replace(/[^/]*$/, "");
const TYPES = { int32: Int32Array, int64: BigInt64Array, uint64: BigUint64Array, uint8: Uint8Array, uint32: Uint32Array, float64: Float64Array };

const numbers = ({ file, kind }) => {
  const bytes = fs.readFileSync(folder + file);
  return new TYPES[kind](bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
};
const bytesOf = (view) => new Uint8Array(view.buffer, view.byteOffset, view.byteLength);
const kernelsOf = (name) => {
  const entry = manifest.modules[name];
  const file = entry.files.find((one) => one.simd === (simd === "simd")) ?? entry.files[0];
  return Kernels.compile(fs.readFileSync(`${page}/worlds/${file.file}`), entry);
};

async function playGrid(one) {
  const world = new GridWorld(await kernelsOf("grid"), start(one));
  const atlas = one.atlas && { ...one.atlas };
  for (const name of ["number", "under", "tiles", "agents", "carried"]) if (atlas) atlas[name] = numbers(atlas[name]);
  const full = one.full && { ...one.full };
  for (const name of ["number", "under", "tiles", "agents", "carried"]) if (full) full[name] = numbers(full[name]);
  const hash = createHash("sha256");
  const reward = new Float64Array(1);
  one.actions.forEach((action, at) => {
    const done = world.step(action);
    reward[0] = done.reward;
    hash.update(new Uint8Array([done.status, done.direction]));
    for (const view of [reward, world.row.data, world.words.data, world.image.data]) hash.update(bytesOf(view));
    hash.update(world.digest(done.reward, done.status & 1 ? 1 : done.status));
    if (atlas && at % 10 === 0) hash.update(world.draw("partial", atlas).rgb.data);
    if (full && at % 10 === 0) hash.update(world.draw("full", full).rgb.data);
    if (done.status > 0) world.begin(start(one));
  });
  return hash.digest("hex");
}

const start = (one) => ({
  row: numbers(one.row), words: numbers(one.words), view_size: one.view_size, in_view: one.in_view,
});

async function drawScene(one) {
  const tables = Object.fromEntries(Object.entries(one.tables).map(([name, where]) => [name, numbers(where)]));
  const textures = { texels: numbers(one.texels), table: numbers(one.table) };
  const scene = new Scene(await kernelsOf("first_person"), tables, textures, one.things, one);
  const hash = createHash("sha256");
  const views = numbers(one.views), places = numbers(one.places);
  const view = tables.view.length, place = one.things * 6;
  for (let at = 0; at < one.pictures; at++) {
    if (!scene.draw(views.subarray(at * view, (at + 1) * view), places.subarray(at * place, (at + 1) * place))) {
      throw new Error(`${one.id}: a row has too many spans`);
    }
    hash.update(scene.picture.data);
  }
  return hash.digest("hex");
}

const digests = {};
for (const one of cases) digests[one.id] = await (one.tables ? drawScene(one) : playGrid(one));
console.log(JSON.stringify(digests));
