// The gallery: worlds played in the page from packed first states, without a server.

import {
  $, actionButtons, loadIndex, MAX_STEPS, onActionKeys, outcomeOf, releaseClickedButtons, ROW_STEP, show, unpack,
} from "./common.js";
import { FirstPersonWorld, GridWorld, Kernels, Scene } from "./world.js";

const TYPES = { float64: Float64Array, int32: Int32Array, uint32: Uint32Array, uint64: BigUint64Array };
const STEPS_SHOWN = 4; // decimals of a first-person state
const { index, atlas } = await loadIndex();
let game, entry, seed = 0, reward = 0, choice = 0;

/** A grid world in its packed first states. */
class GridGame {
  static async load(entry) {
    const packed = await unpack(`starts/${entry.name}.z`), end = entry.seeds * (48 + entry.row_length * 4);
    const made = Object.assign(new GridGame(), {
      entry, words: new BigUint64Array(packed.slice(0, entry.seeds * 48)), rows: new Int32Array(packed.slice(entry.seeds * 48, end)),
      missions: JSON.parse(new TextDecoder().decode(packed.slice(end))),
    });
    made.world = new GridWorld(await Kernels.load("worlds", "grid"), made.start(0));
    return made;
  }

  start(seed) {
    const { entry: { row_length: length, view_size }, rows, words } = this;
    return { row: rows.subarray(seed * length, (seed + 1) * length), words: words.subarray(seed * 6, (seed + 1) * 6), view_size };
  }

  begin(seed) {
    this.world.begin(this.start(seed));
    return this.missions[seed] ?? this.missions[0];
  }

  get playing() { return this.world.playing; }
  get steps() { return this.world.row.data[ROW_STEP]; }
  get state() { return `step ${this.steps} of ${this.world.row.data[MAX_STEPS]}\nrow ${Array.from(this.world.row.data).join(" ")}`; }
  step(action) { return this.world.step(action); }

  draw() {
    $("whole").hidden = !$("full").checked;
    show(this.world.draw("partial", atlas), $("view"));
    if ($("full").checked) show(this.world.draw("full", atlas), $("whole"));
  }
}

/** A first-person world in its packed first states and scenes; its textures are files that scenes share. */
class FirstPersonGame {
  static textures = new Map();

  static async load(entry) {
    const [packed, kernels] = await Promise.all([unpack(`starts/${entry.name}.z`), Kernels.load("worlds", "first_person")]);
    const length = new DataView(packed).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(packed.slice(4, 4 + length)));
    let at = 4 + length;
    const arrays = head.arrays.map(([kind, bytes]) => new TYPES[kind](packed.slice(at, at += bytes)));
    return Object.assign(new FirstPersonGame(), { entry, kernels, starts: head.starts, arrays });
  }

  async begin(seed) {
    const { state, tables, textures, looks, mission } = this.starts[seed];
    const arraysOf = (names) => Object.fromEntries(Object.entries(names).map(([name, number]) => [name, this.arrays[number]]));
    const pixels = await Promise.all(textures.map((name) => {
      const known = FirstPersonGame.textures.get(name) ?? unpack(`textures/${name}.z`).then((packed) => new Uint8Array(packed));
      FirstPersonGame.textures.set(name, known);
      return known;
    }));
    this.world = new FirstPersonWorld(this.kernels, { ...arraysOf(state), looks });
    const shown = arraysOf(tables);
    if (this.shows !== textures.join()) {
      this.drawn = await this.kernels.again();
      this.texels = Scene.unpackTextures(this.drawn, shown, pixels);
      this.shows = textures.join();
    }
    this.scene = new Scene(this.drawn, shown, this.texels);
    [this.scene.width, this.scene.height] = this.entry.size_px;
    this.steps = 0;
    this.playing = true;
    return mission;
  }

  get state() {
    const rows = (data, columns) => Array.from(data, (value) => String(Number(value.toFixed(STEPS_SHOWN))))
      .reduce((text, value, i) => text + (i % columns ? " " : "\n") + value, "");
    return `step ${this.steps}\nthings${rows(this.world.things.data, 9)}\nnumbers${rows(this.world.numbers.data, 12)}`;
  }

  step(action) {
    const done = this.world.step(action);
    this.steps += 1;
    this.playing = done.status === 0;
    return done;
  }

  draw() {
    $("whole").hidden = true;
    this.world.look(this.scene);
    show(this.scene.draw(this.world.view.data, this.world.places.data), $("view"));
  }
}

async function choose(name) {
  const mine = choice += 1;
  entry = index.worlds.find((one) => one.name === name) ?? index.worlds[0];
  const isGrid = !entry.size_px;
  const loaded = await (isGrid ? GridGame : FirstPersonGame).load(entry);
  if (mine !== choice) return; // another was chosen meanwhile
  seed %= entry.seeds;
  game = loaded;
  $("world").value = entry.name;
  $("keys").replaceChildren(...actionButtons(entry.actions, act));
  $("full").parentElement.hidden = !isGrid;
  $("pictures").className = isGrid ? "grid" : "first-person";
  await begin();
}

async function begin() {
  const mine = game, mission = await game.begin(seed);
  if (mine !== game) return;
  reward = 0;
  $("mission").textContent = mission;
  $("outcome").textContent = "";
  location.hash = `${entry.name}/${seed}`;
  draw();
}

function act(action) {
  if (!game?.playing) return;
  const done = game.step(entry.actions.indexOf(action));
  reward += done.reward;
  $("outcome").textContent = outcomeOf(done, reward, game.steps);
  draw();
}

function draw() {
  game.draw();
  if ($("details").open) $("state").textContent = game.state;
}

for (const one of index.worlds) {
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
$("seed").addEventListener("click", () => { seed = (seed + 1) % entry.seeds; begin(); });
$("again").addEventListener("click", begin);
for (const id of ["full", "details"]) $(id).addEventListener(id === "full" ? "change" : "toggle", draw);
onActionKeys(act, () => entry.actions);
releaseClickedButtons();

const [name, number] = decodeURIComponent(location.hash.slice(1)).split("/");
seed = Math.max(0, Math.floor(Number(number) || 0));
await choose(name);
document.body.dataset.ready = "true";
