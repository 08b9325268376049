// The gallery: worlds played in the page, laid out from a seed or from packed first states, without a server. A game can
// be kept as a file that `minihuman verify` accepts, and shared as a link that plays it again.

import {
  $, actionButtons, copyLink, keyMapOf, onActionKeys, outcomeOf, releaseClickedButtons, saveFile,
} from "./common.js";
import { EpisodeRecord, writeGame } from "./episode_record.js";
import { MAX_STEPS } from "./row.js";
import { World, WorldPack } from "./packed_world.js";

const STEPS_SHOWN = 4; // decimals of a first-person state
const REPLAY_MS = 150; // from one action of a shared game to the next
const pack = await WorldPack.open("./");
let world, record, seed = 0, reward = 0, choice = 0, episode = 0;

async function choose(name) {
  const mine = choice += 1;
  const entry = pack.index.worlds.find((one) => one.name === name) ?? pack.index.worlds[0];
  const loaded = await World.make(entry.name, { from: "./" });
  if (mine !== choice) return loaded.close(); // another was chosen meanwhile
  world?.close();
  world = loaded;
  const [first, end] = world.seeds;
  seed = first + (seed - first) % (end - first);
  $("world").value = entry.name;
  $("keys").replaceChildren(...actionButtons(world.actions, act));
  $("full").parentElement.hidden = !world.isGrid;
  $("pictures").className = world.isGrid ? "grid" : "first-person";
  await begin();
}

async function begin() {
  const mine = episode += 1;
  record = null;
  world.reset({ seed });
  reward = 0;
  $("mission").textContent = world.mission;
  $("outcome").textContent = "";
  location.hash = `${world.name}/${seed}`;
  $("keep").disabled = $("share").disabled = true;
  await draw();
  if (mine !== episode) return; // another has begun meanwhile
  record = new EpisodeRecord(world, { view: $("full").checked && world.isGrid ? "full" : "partial", key_map: keyMapOf(world.actions) });
}

function act(action, key, event, button) {
  if (!record || world.ended) return;
  const number = world.actions.indexOf(action), done = world.step(number);
  record.add(key, number, done, event.timeStamp, { button, trusted: event.isTrusted });
  reward += done.reward;
  $("outcome").textContent = outcomeOf(done, reward, world.steps);
  $("keep").disabled = $("share").disabled = false;
  void draw();
}

/** Play a shared game again. @param {string} actions a digit each */
async function replay(actions) {
  const mine = episode;
  for (const digit of actions) {
    await new Promise((resolve) => setTimeout(resolve, REPLAY_MS));
    if (mine !== episode || world.ended) return;
    const action = world.actions[Number(digit)], key = Object.entries(keyMapOf(world.actions)).find(([, own]) => own === action)?.[0];
    if (key) act(action, key, { timeStamp: performance.now(), isTrusted: false }, false);
  }
}

async function draw() {
  await drawPictures();
  if ($("details").open) $("state").textContent = describeState(); // after the picture, which it is read with
}

async function drawPictures() {
  const isWhole = world.isGrid && $("full").checked;
  $("whole").hidden = !isWhole;
  await world.draw($("view"), { view: "partial" });
  if (isWhole) await world.draw($("whole"), { view: "full" });
}

function describeState() {
  const { state, steps } = world;
  if (world.isGrid) return `step ${steps} of ${state.row[MAX_STEPS]}\nrow ${Array.from(state.row).join(" ")}`;
  const rows = (data, columns) => Array.from(data, (value) => String(Number(value.toFixed(STEPS_SHOWN))))
    .reduce((text, value, i) => text + (i % columns ? " " : "\n") + value, "");
  return `step ${steps}\nthings${rows(state.things, 9)}\nnumbers${rows(state.numbers, 12)}`;
}

for (const one of pack.index.worlds) {
  const group = $("world").querySelector(`[label="${one.kind}"]`) ?? $("world").appendChild(
    Object.assign(document.createElement("optgroup"), { label: one.kind }));
  group.append(new Option(one.title, one.name));
}
let isListClicked = false; // the arrow keys go on through the list if it was opened by a key, and to the world after a click
$("world").addEventListener("pointerdown", () => { isListClicked = true; });
$("world").addEventListener("keydown", () => { isListClicked = false; });
$("world").addEventListener("change", () => {
  seed = 0;
  if (isListClicked) $("world").blur();
  choose($("world").value);
});
$("seed").addEventListener("click", () => {
  const [first, end] = world.seeds;
  seed = seed + 1 < end ? seed + 1 : first;
  begin();
});
$("again").addEventListener("click", begin);
$("keep").addEventListener("click", () => {
  saveFile(writeGame([record.columns]), `${world.name}-${seed}.json`, "application/json");
});
$("share").addEventListener("click", () => copyLink($("share"), `#${world.name}/${seed}/${record.columns.actions.join("")}`));
for (const id of ["full", "details"]) $(id).addEventListener(id === "full" ? "change" : "toggle", draw);
onActionKeys(act, () => world?.actions ?? []);
releaseClickedButtons();

const [name, number, actions = ""] = decodeURIComponent(location.hash.slice(1)).split("/");
seed = Math.max(0, Math.floor(Number(number) || 0));
await choose(name);
document.body.dataset.ready = "true";
await replay(actions);
