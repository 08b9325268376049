// The gallery: every grid world played in the page from packed first states, without a server.

import { GridWorld, Kernels } from "./world.js";

const ROW_STEP = 6, MAX_STEPS = 7;
const KEYS = {
  ArrowLeft: "left", ArrowRight: "right", ArrowUp: "forward", " ": "toggle", Enter: "done", p: "pickup", d: "drop",
};
const LABELS = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", " ": "space", Enter: "enter" };
const $ = (id) => document.getElementById(id);

async function unpack(path) {
  const packed = (await fetch(path)).body.pipeThrough(new DecompressionStream("deflate"));
  return new Response(packed).arrayBuffer();
}

const [index, packedTiles] = await Promise.all([fetch("index.json").then((got) => got.json()), unpack("atlas.z")]);
const atlas = { tile_px: index.atlas.tile_px, small_px: index.atlas.small_px };
for (const [name, { at, bytes, kind }] of Object.entries(index.atlas.arrays)) {
  const part = packedTiles.slice(at, at + bytes);
  atlas[name] = kind === "int64" ? new BigInt64Array(part) : new Uint8Array(part);
}

let world, entry, starts, seed = 0, reward = 0;

async function choose(name) {
  entry = index.worlds.find((one) => one.name === name) ?? index.worlds[0];
  const packed = await unpack(`starts/${entry.name}.z`);
  const rows = entry.seeds * entry.row_length * 4;
  const words = new BigUint64Array(packed.slice(0, entry.seeds * 48));
  const end = entry.seeds * 48 + rows;
  const missions = JSON.parse(new TextDecoder().decode(packed.slice(end)));
  starts = { words, rows: new Int32Array(packed.slice(entry.seeds * 48, end)), missions };
  world = new GridWorld(await Kernels.load("worlds", "grid"), start());
  $("world").value = entry.name;
  $("keys").replaceChildren(...Object.entries(KEYS).filter(([, action]) => entry.actions.includes(action)).map(button));
  begin();
}

const start = () => ({
  row: starts.rows.subarray(seed * entry.row_length, (seed + 1) * entry.row_length),
  words: starts.words.subarray(seed * 6, (seed + 1) * 6),
  view_size: entry.view_size,
});

function begin() {
  world.begin(start());
  reward = 0;
  $("mission").textContent = starts.missions[seed] ?? starts.missions[0];
  $("outcome").textContent = "";
  location.hash = `${entry.name}/${seed}`;
  draw();
}

function button([key, action]) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = `${action} (${LABELS[key] ?? key})`;
  made.addEventListener("click", () => act(action));
  return made;
}

function act(action) {
  if (!world.playing) return;
  const done = world.step(entry.actions.indexOf(action));
  reward += done.reward;
  if (done.status > 0) {
    const how = done.status & 1 ? (done.reward > 0 ? "Success" : "Over") : "Out of steps";
    $("outcome").textContent = `${how}: reward ${reward.toFixed(3)} in ${world.row.data[ROW_STEP]} steps.`;
  }
  draw();
}

function draw() {
  $("whole").hidden = !$("full").checked;
  world.draw("partial", atlas).paint($("view"));
  if ($("full").checked) world.draw("full", atlas).paint($("whole"));
  const { data } = world.row;
  if (!$("details").open) return;
  $("state").textContent = `step ${data[ROW_STEP]} of ${data[MAX_STEPS]}\nrow ${Array.from(data).join(" ")}`;
}

for (const one of index.worlds) $("world").append(new Option(one.title, one.name));
$("world").addEventListener("change", () => { seed = 0; choose($("world").value); });
$("seed").addEventListener("click", () => { seed = (seed + 1) % entry.seeds; begin(); });
$("again").addEventListener("click", begin);
for (const id of ["full", "details"]) $(id).addEventListener(id === "full" ? "change" : "toggle", draw);
addEventListener("keydown", (event) => {
  const action = KEYS[event.key];
  if (!action || event.target instanceof HTMLSelectElement || event.target instanceof HTMLButtonElement) return;
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  act(action);
});

const [name, number] = decodeURIComponent(location.hash.slice(1)).split("/");
await choose(name);
if (Number(number) > 0 && Number(number) < entry.seeds) { seed = Number(number); begin(); }
