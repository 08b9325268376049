// The level editor: draw a grid, play it by the worlds' own rules, save it as a file for protocols and training.

import {
  $, actionButtons, copyLink, keyMapOf, onActionKeys, outcomeOf, releaseClickedButtons, saveFile,
} from "./common.js";
import { EpisodeRecord, writeGame } from "./episode_record.js";
import { AGENTS, codeOf, Level } from "./level.js";
import { World, WorldPack } from "./packed_world.js";

const ACTIONS = ["left", "right", "forward", "pickup", "drop", "toggle", "done"];
const COLOURS = { r: "red", g: "green", b: "blue", p: "purple", y: "yellow", "-": "grey" };
const KINDS = {
  "  ": "erase", WW: "wall", ">>": "agent", G: "goal", V: "lava", F: "floor", K: "key", A: "ball", B: "box",
  D: "door", L: "locked door", O: "open door",
};
const FIXED = { G: "g", V: "r" };
const VIEW_SIZE = 7;

const pack = await WorldPack.open("./"), atlas = await pack.atlas();
let level = read() ?? new Level(9, 7);
let tool = "WW", colour = "y", cursor = null, world = null, record = null, playing = false, reward = 0;

function read() {
  try {
    return Level.read(decodeURIComponent(escape(atob(location.hash.slice(1)))));
  } catch {
    return null;
  }
}

async function showLevel() {
  world?.close();
  const about = { name: "Level-v0", actions: ACTIONS, view_size: VIEW_SIZE, options: {} };
  world = await World.ofStates(pack, about, { at: start, mission: () => level.mission });
  $("words").value = level.mission;
  [$("columns").value, $("rows").value] = [level.width, level.height];
  update();
}

const start = () => ({ row: level.row(), words: new BigUint64Array(6), view_size: VIEW_SIZE });

function update() {
  if (!playing) world.reset();
  $("file").textContent = level.file;
  history.replaceState(null, "", `#${btoa(unescape(encodeURIComponent(level.file)))}`);
  if (!playing) $("outcome").textContent = level.problem;
  draw();
}

function draw() {
  void world.draw($("whole"), { view: "full", lit: playing }); // grids are drawn at once
  $("view").hidden = !playing;
  if (playing) return void world.draw($("view"));
  const px = atlas.tile_px, context = $("whole").getContext("2d");
  if (!level.cells.flat().some((cell) => AGENTS.includes(cell))) hideAgent(context, px);
  context.strokeStyle = "#ffd24a";
  context.lineWidth = 3;
  if (cursor) context.strokeRect(cursor[0] * px + 1.5, cursor[1] * px + 1.5, px - 3, px - 3);
}

/** Draw an empty cell over an agent that is placed at random, which is no part of the drawing. */
function hideAgent(context, px) {
  const [x, y] = world.state.row.slice(2, 4);
  const first = Number(atlas.number[codeOf("  ")]) * px * px * 3;
  const cell = context.createImageData(px, px);
  for (let pixel = 0; pixel < px * px; pixel++) {
    const at = first + 3 * pixel;
    cell.data.set([...atlas.tiles.subarray(at, at + 3), 255], 4 * pixel);
  }
  context.putImageData(cell, x * px, y * px);
}

function paint(x, y) {
  if (playing || x < 0 || y < 0 || x >= level.width || y >= level.height) return;
  const isPlain = tool.length === 2;
  const turned = AGENTS.indexOf(level.cells[y][x]);
  const cell = tool === ">>" ? AGENTS[(turned + 1) % 4] : isPlain ? tool : tool + (FIXED[tool] ?? colour);
  cursor = [x, y];
  level.put(x, y, cell);
  update();
}

function cellAt(event) {
  const box = $("whole").getBoundingClientRect();
  return [(event.clientX - box.left) / box.width * level.width, (event.clientY - box.top) / box.height * level.height].map(Math.floor);
}

function choose(kind, letter = colour) {
  [tool, colour] = [kind, letter];
  for (const [group, chosen] of [["kinds", tool], ["colours", colour]]) {
    for (const one of $(group).children) one.setAttribute("aria-checked", String(one.dataset.value === chosen));
  }
}

function option(value, text, pick) {
  const made = document.createElement("button");
  made.type = "button";
  made.setAttribute("role", "radio");
  [made.dataset.value, made.textContent] = [value, text];
  if (value in COLOURS) made.style.borderBottom = `.3rem solid ${text}`;
  made.addEventListener("click", pick);
  return made;
}

function play() {
  playing = !playing;
  reward = 0;
  $("play").textContent = playing ? "Draw" : "Play";
  $("play").setAttribute("aria-pressed", String(playing));
  $("palette").hidden = playing;
  $("keys").replaceChildren(...(playing ? actionButtons(level.actions, act) : []));
  $("outcome").textContent = playing ? level.mission : "";
  world.reset();
  $("play").blur(); // Space is an action now
  update();
  world.options = level.options;
  record = playing && level.isFixed ? new EpisodeRecord(world, { view: "full", key_map: keyMapOf(level.actions) }) : null;
  $("keep").disabled = true;
}

function act(action, key, event, button) {
  if (!playing || world.ended || !level.actions.includes(action)) return;
  const number = ACTIONS.indexOf(action), done = world.step(number);
  record?.add(key, number, done, event.timeStamp, { button, trusted: event.isTrusted });
  $("keep").disabled = record === null; // where the agent is placed at random, no seed of Python's says where
  reward += done.reward;
  $("outcome").textContent = outcomeOf(done, reward, world.steps) || level.mission;
  draw();
}

function resize() {
  const [width, height] = [$("columns"), $("rows")].map((field) => Math.min(25, Math.max(3, Math.round(field.valueAsNumber) || 3)));
  if (playing) play();
  level = level.resized(width, height);
  showLevel();
}

$("kinds").append(...Object.entries(KINDS).map(([kind, word]) => option(kind, word, () => choose(kind))));
$("colours").append(...Object.entries(COLOURS).map(([letter, word]) => option(letter, word, () => choose(tool, letter))));
$("whole").addEventListener("pointerdown", (event) => {
  $("whole").setPointerCapture(event.pointerId);
  paint(...cellAt(event));
});
$("whole").addEventListener("pointermove", (event) => {
  const [x, y] = cellAt(event);
  if (event.buttons && (x !== cursor?.[0] || y !== cursor?.[1])) paint(x, y);
});
$("whole").addEventListener("keydown", (event) => {
  const moved = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (playing || (!moved && event.key !== " ")) return;
  event.preventDefault();
  const [x, y] = cursor ?? [0, 0];
  if (!moved) return paint(x, y);
  cursor = [Math.min(level.width - 1, Math.max(0, x + moved[0])), Math.min(level.height - 1, Math.max(0, y + moved[1]))];
  draw();
});
for (const id of ["columns", "rows"]) $(id).addEventListener("change", resize);
$("words").addEventListener("input", () => { level.mission = $("words").value; update(); });
$("play").addEventListener("click", play);
$("save").addEventListener("click", () => saveFile(level.file, "level.toml", "text/plain"));
$("share").addEventListener("click", () => copyLink($("share")));
$("keep").addEventListener("click", () => saveFile(writeGame([record.columns]), "game.json", "application/json"));
$("open").addEventListener("change", async () => {
  const found = Level.read(await $("open").files[0].text());
  if (!found) $("outcome").textContent = "This file is not a level; open one that was saved here.";
  else [level, cursor] = [found, null], showLevel();
});
onActionKeys(act, () => level.actions);
releaseClickedButtons();
choose("WW");
await showLevel();
document.body.dataset.ready = "true";
