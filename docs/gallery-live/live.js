// The gallery: every grid world played in the page from packed first states, without a server.

import { $, actionButtons, loadIndex, MAX_STEPS, onActionKeys, outcomeOf, ROW_STEP, unpack } from "./common.js";
import { GridWorld, Kernels } from "./world.js";

const { index, atlas } = await loadIndex();
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
  $("keys").replaceChildren(...actionButtons(entry.actions, act));
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

function act(action) {
  if (!world.playing) return;
  const done = world.step(entry.actions.indexOf(action));
  reward += done.reward;
  $("outcome").textContent = outcomeOf(done, reward, world.row.data[ROW_STEP]);
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
onActionKeys(act);

const [name, number] = decodeURIComponent(location.hash.slice(1)).split("/");
await choose(name);
if (Number(number) > 0 && Number(number) < entry.seeds) { seed = Number(number); begin(); }
