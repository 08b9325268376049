// Worlds from a folder that `minihuman pack` wrote, in a page or in Node: reset to a seed, stepped and drawn by the rules
// that Python runs. Each step has the digest that Python has for it.

import { DrawnRows } from "./layouts.js";
import { MAX_STEPS, STEP } from "./row.js";
import { FirstPersonWorld, GridWorld, Kernels, Scene, chooseModule } from "./world.js";

/** @import { LayoutTable } from "./layouts.js" */
/** @import { Atlas, Manifest, ModuleEntry, Start, View } from "./world.js" */
/**
 * @typedef {{ name: string, kind: string, title: string, actions: string[], first_seed: number, seeds: number,
 * options: Record<string, unknown>, row_length: number, view_size: number, size_px?: [number, number],
 * layouts?: string }} PackedEntry whose first states are drawn from any seed by a module of layouts, or packed for some
 * @typedef {{ version: number, worlds: PackedEntry[], manifest: Manifest, atlas: { tile_px: number, small_px: number,
 * arrays: Record<string, { at: number, bytes: number, kind: string }> } }} PackIndex
 * @typedef {{ image: Uint8Array, shape: [number, number, number], direction: number, mission: string }} GridObservation
 * @typedef {{ mission: string }} FirstPersonObservation what the agent sees is drawn, by `draw`
 * @typedef {GridObservation | FirstPersonObservation} Observation
 * @typedef {{ observation: Observation, reward: number, terminated: boolean, truncated: boolean, digest: string }} StepResult
 * @typedef {{ view?: View, lit?: boolean, size?: [number, number] }} DrawOptions what of a grid, and whether with what the agent
 * sees in a lighter shade; in first person the size in pixels
 * @typedef {{ state: any, steps: number, ended: boolean, digest: string, mission: string, seed: number }} SavedWorld
 */

const INDEX_VERSION = 2;
const WORDS = 6, WORDS_BYTES = 48, ROW_BYTES = 4;
const TERMINATED_BIT = 1, TRUNCATED_BIT = 2;
const TERMINATED = 1, TRUNCATED = 2; // in a digest
/** @type {Record<string, any>} by NumPy's names */
const TYPES = {
  float64: Float64Array, int32: Int32Array, int64: BigInt64Array, uint8: Uint8Array, uint32: Uint32Array,
  uint64: BigUint64Array,
};

/** @param {URL} url @returns {Promise<ArrayBuffer>} */
async function read(url) {
  if (url.protocol === "file:") {
    const { readFile } = await import(/* @vite-ignore */ /* webpackIgnore: true */ String("node:fs/promises"));
    return new Uint8Array(await readFile(url)).buffer;
  }
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url} is not there (${response.status}); pack the world with: minihuman pack`);
  return response.arrayBuffer();
}

/** @param {ArrayBuffer} packed @returns {Promise<ArrayBuffer>} */
async function inflate(packed) {
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}

/** @param {ArrayBuffer} bytes */
const parse = (bytes) => JSON.parse(new TextDecoder().decode(bytes));

/** A folder that `minihuman pack` wrote: what is read of it is read once. */
export class WorldPack {
  /** @type {Map<string, Promise<WorldPack>>} by address */ static #packs = new Map();
  /** @type {Map<string, Promise<Kernels>>} by name of module */ #modules = new Map();
  /** @type {Map<string, Promise<any>>} by path */ #files = new Map();
  /** @type {Map<string, Kernels[]>} modules whose world was closed, by name */ #idle = new Map();
  /** @type {Promise<Atlas> | null} */ #atlas = null;
  /** @type {Promise<LayoutTable> | null} */ #layouts = null;

  /** @param {URL | string} folder @param {PackIndex} index @param {(path: string) => Promise<ArrayBuffer>} readFile */
  constructor(folder, index, readFile) {
    this.folder = folder;
    this.index = index;
    this.manifest = index.manifest;
    this.readFile = readFile;
  }

  /** @param {Map<string, ArrayBuffer>} files a packed folder's, by path, for pages that cannot fetch any @returns {Promise<WorldPack>} */
  static async ofFiles(files) {
    /** @param {string} path */
    const find = (path) => {
      const content = files.get(path);
      if (!content) throw new Error(`${path} is not among the pack's files`);
      return content;
    };
    return new WorldPack("the pack", parse(await inflate(find("index.z"))), async (path) => find(path));
  }

  /** @param {URL | string | WorldPack} folder its address; the page's own where it is relative @returns {Promise<WorldPack>} */
  static async open(folder) {
    if (folder instanceof WorldPack) return folder;
    const base = typeof document === "undefined" ? import.meta.url : document.baseURI;
    const address = new URL(String(folder).replace(/\/?$/, "/"), base);
    const known = WorldPack.#packs.get(address.href);
    if (known) return known;
    const opened = WorldPack.#open(address);
    WorldPack.#packs.set(address.href, opened);
    opened.catch(() => WorldPack.#packs.delete(address.href));
    return opened;
  }

  /** @param {URL} address */
  static async #open(address) {
    /** @type {PackIndex} */ const index = parse(await inflate(await read(new URL("index.z", address))));
    if (index.version !== INDEX_VERSION) throw new Error(`${address} is of pack version ${index.version}, not ${INDEX_VERSION}; pack it again`);
    return new WorldPack(address, index, (path) => read(new URL(path, address)));
  }

  /** @param {string} id with or without `minihuman/` @returns {PackedEntry} */
  find(id) {
    const name = id.replace(/^minihuman\//, "");
    const entry = this.index.worlds.find((world) => world.name === name);
    if (entry) return entry;
    throw new Error(`${name} is not in ${this.folder}; pack it with: minihuman pack ${name}`);
  }

  /** A module with a memory of its own. @param {string} name @returns {Promise<Kernels>} */
  async kernels(name) {
    const idle = this.#idle.get(name)?.pop();
    if (idle) return idle;
    let compiled = this.#modules.get(name);
    if (!compiled) {
      compiled = this.#compile(name);
      this.#modules.set(name, compiled);
    }
    return (await compiled).again();
  }

  /** @param {string} name */
  async #compile(name) {
    const entry = this.manifest.modules[name], { file } = chooseModule(entry, name);
    return Kernels.compile(await this.file(`worlds/${file}.z`), /** @type {ModuleEntry} */ (entry));
  }

  /** Keep a module for the next world. @param {string} name @param {Kernels} kernels */
  release(name, kernels) {
    kernels.free = kernels.base;
    this.#idle.set(name, [...this.#idle.get(name) ?? [], kernels]);
  }

  /** How grid worlds are laid out. @returns {Promise<LayoutTable>} */
  layouts() {
    this.#layouts ??= this.file("layouts.z").then(parse);
    return this.#layouts;
  }

  /** The tiles of grids. @returns {Promise<Atlas>} */
  atlas() {
    this.#atlas ??= this.file("atlas.z").then((packed) => {
      const { tile_px, small_px, arrays } = this.index.atlas;
      const tables = Object.entries(arrays).map(([name, { at, bytes, kind }]) =>
        [name, new TYPES[kind](packed.slice(at, at + bytes))]);
      return { tile_px, small_px, ...Object.fromEntries(tables) };
    });
    return this.#atlas;
  }

  /** A packed file's bytes. @param {string} path @returns {Promise<ArrayBuffer>} */
  file(path) {
    let content = this.#files.get(path);
    if (!content) {
      content = this.readFile(path).then(inflate);
      this.#files.set(path, content);
    }
    return content;
  }
}

/**
 * @typedef {{ at(place: number): Start, mission(place: number): string }} FirstStates of a grid world, by place of the seed: a
 * mission is asked for after its state
 */

/** A grid world's packed first states. */
class PackedRows {
  /** @param {PackedEntry} entry @param {ArrayBuffer} content */
  constructor(entry, content) {
    const rowsEnd = entry.seeds * (WORDS_BYTES + entry.row_length * ROW_BYTES);
    this.entry = entry;
    this.words = new BigUint64Array(content.slice(0, entry.seeds * WORDS_BYTES));
    this.rows = new Int32Array(content.slice(entry.seeds * WORDS_BYTES, rowsEnd));
    /** @type {string[]} one where all are the same */ this.missions = parse(content.slice(rowsEnd));
  }

  /** @param {number} place of the seed @returns {Start} */
  at(place) {
    const { row_length, view_size } = this.entry;
    const row = this.rows.subarray(place * row_length, (place + 1) * row_length);
    return { row, words: this.words.subarray(place * WORDS, (place + 1) * WORDS), view_size };
  }

  /** @param {number} place */
  mission(place) { return this.missions[place] ?? this.missions[0] ?? ""; }
}

/** What is played of a grid world. */
class GridGame {
  /** @param {WorldPack} pack @param {FirstStates} starts @param {Kernels} kernels @param {number} maxSteps 0: the world's own @param {Atlas} atlas */
  constructor(pack, starts, kernels, maxSteps, atlas) {
    this.pack = pack;
    this.starts = starts;
    this.maxSteps = maxSteps;
    this.atlas = atlas;
    this.world = new GridWorld(kernels, this.#start(0));
  }

  /** @param {WorldPack} pack @param {PackedEntry} entry @param {number} maxSteps */
  static async load(pack, entry, maxSteps) {
    const states = entry.layouts ? GridGame.#draw(pack, entry, entry.layouts) : GridGame.#unpack(pack, entry);
    const [starts, kernels, atlas] = await Promise.all([states, pack.kernels("grid"), pack.atlas()]);
    return new GridGame(pack, starts, kernels, maxSteps, atlas);
  }

  /** @param {WorldPack} pack @param {PackedEntry} entry @returns {Promise<FirstStates>} */
  static async #unpack(pack, entry) { return new PackedRows(entry, await pack.file(`starts/${entry.name}.z`)); }

  /** @param {WorldPack} pack @param {PackedEntry} entry @param {string} module @returns {Promise<FirstStates>} */
  static async #draw(pack, entry, module) {
    const [kernels, table] = await Promise.all([pack.kernels(module), pack.layouts()]);
    return new DrawnRows(kernels, table, { ...entry, module });
  }

  /** @param {number} place */
  #start(place) {
    const start = this.starts.at(place);
    if (!this.maxSteps) return start;
    const row = start.row.slice();
    row[MAX_STEPS] = this.maxSteps;
    return { ...start, row };
  }

  /** @param {number} place @returns {string} the mission */
  reset(place) {
    const start = this.#start(place);
    this.world.begin({ ...start, row: start.first_row ?? start.row });
    this.world.restore(start);
    return this.starts.mission(place);
  }

  get steps() { return /** @type {number} */ (this.world.row.data[STEP]); }

  /** @param {string} mission @returns {Observation} */
  observe(mission) {
    const { image, size, direction } = this.world;
    return { image: image.data.slice(), shape: [size, size, 3], direction, mission };
  }

  /** @param {HTMLCanvasElement} canvas @param {DrawOptions} options */
  draw(canvas, { view = "partial", lit = true }) { paint(canvas, this.world.draw(view, this.atlas, lit)); }

  close() {
    this.pack.release("grid", this.world.kernels);
    if (this.starts instanceof DrawnRows) this.pack.release(this.starts.module, this.starts.kernels);
  }
}

/** @typedef {{ names: string, texels: any, kernels: Kernels }} UnpackedTextures */

/** What is played of a first-person world; its textures are files that worlds share. */
class FirstPersonGame {
  /** @type {FirstPersonWorld} */ world;
  /** @type {Scene | null} of the present episode, once its textures are there */ #scene = null;
  /** @type {UnpackedTextures | null} */ #unpacked = null;
  steps = 0;
  #place = 0;

  /** @param {WorldPack} pack @param {PackedEntry} entry @param {Kernels} kernels @param {any} starts @param {any[]} arrays */
  constructor(pack, entry, kernels, starts, arrays) {
    this.pack = pack;
    this.entry = entry;
    this.kernels = kernels;
    this.starts = starts;
    this.arrays = arrays;
    this.world = this.#begin(0);
  }

  /** @param {WorldPack} pack @param {PackedEntry} entry @param {number} maxSteps */
  static async load(pack, entry, maxSteps) {
    if (maxSteps) throw new Error(`${entry.name}: max_steps is for grid worlds; end the trial by max_steps of your own`);
    const [content, kernels] = await Promise.all([pack.file(`starts/${entry.name}.z`), pack.kernels("first_person")]);
    const length = new DataView(content).getUint32(0, true), head = parse(content.slice(4, 4 + length));
    let at = 4 + length;
    const arrays = head.arrays.map((/** @type {[string, number]} */ [kind, bytes]) => {
      const from = at;
      at += bytes;
      return new TYPES[kind](content.slice(from, at));
    });
    return new FirstPersonGame(pack, entry, kernels, head.starts, arrays);
  }

  /** @param {Record<string, number>} numbers @returns {any} */
  #tables(numbers) {
    return Object.fromEntries(Object.entries(numbers).map(([name, number]) => [name, this.arrays[number]]));
  }

  /** @param {number} place */
  #begin(place) {
    const { state, looks } = this.starts[place];
    return new FirstPersonWorld(this.kernels, { ...this.#tables(state), looks });
  }

  /** @param {number} place @returns {string} the mission */
  reset(place) {
    this.world = this.#begin(place);
    this.steps = 0;
    this.#place = place;
    this.#scene = null;
    return this.starts[place].mission;
  }

  /** @param {string} mission @returns {Observation} */
  observe(mission) { return { mission }; }

  /** @param {HTMLCanvasElement} canvas @param {DrawOptions} options */
  async draw(canvas, { size = this.entry.size_px }) {
    const place = this.#place;
    const scene = this.#scene ?? await this.#stage();
    if (place !== this.#place) return;
    [scene.width, scene.height] = size ?? [640, 480];
    this.world.look(scene);
    paint(canvas, scene.draw(this.world.view.data, this.world.places.data));
  }

  async #stage() {
    const { tables, textures } = this.starts[this.#place], place = this.#place;
    const pixels = await Promise.all(textures.map(async (/** @type {string} */ name) =>
      new Uint8Array(await this.pack.file(`textures/${name}.z`))));
    const arrays = this.#tables(tables), names = textures.join();
    const last = this.#unpacked, isUnpacked = last !== null && last.names === names;
    const unpacked = isUnpacked ? last : await this.#unpack(names, arrays, pixels);
    const scene = new Scene(unpacked.kernels, arrays, unpacked.texels);
    if (place === this.#place) this.#scene = scene;
    return scene;
  }

  /** @param {string} names @param {any} tables @param {Uint8Array[]} pixels @returns {Promise<UnpackedTextures>} */
  async #unpack(names, tables, pixels) {
    const kernels = await this.kernels.again();
    this.#unpacked = { names, kernels, texels: Scene.unpackTextures(kernels, tables, pixels) };
    return this.#unpacked;
  }

  close() { this.#scene = this.#unpacked = null; }
}

/** @param {HTMLCanvasElement} canvas @param {{ width: number, height: number, paint(canvas: HTMLCanvasElement): void }} picture */
function paint(canvas, picture) {
  const { width, height } = picture;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  picture.paint(canvas);
}

/** A world that is reset, stepped and drawn, as Gymnasium's are. */
export class World {
  /** the world's id, without `minihuman/` */ name;
  /** names of actions by number @type {string[]} */ actions;
  /** keyword arguments by which Python makes the same world @type {Record<string, unknown>} */ options;
  /** what the rules were compiled from: Python refuses episodes of others */ sources;
  mission = "";
  seed = 0;
  ended = true;
  /** of the last step */ digest = "";
  /** @type {GridGame | FirstPersonGame | null} */ #game;
  #entry;

  /** @param {PackedEntry} entry @param {GridGame | FirstPersonGame} game @param {string} sources @param {Record<string, unknown>} options */
  constructor(entry, game, sources, options) {
    this.#entry = entry;
    this.#game = game;
    this.name = entry.name;
    this.actions = entry.actions;
    this.sources = sources;
    this.options = options;
  }

  /**
   * Make a world that is in a pack.
   * @param {string} id as Gymnasium has it, `minihuman/` may be left out
   * @param {{ from?: URL | string | WorldPack, max_steps?: number }} [options] where `minihuman pack` wrote it; another step limit
   */
  static async make(id, { from = new URL("./", import.meta.url), max_steps = 0 } = {}) {
    if (!Number.isInteger(max_steps) || max_steps < 0) throw new Error(`max_steps is ${max_steps}; it is 1 or more`);
    const pack = await WorldPack.open(from), entry = pack.find(id);
    const game = await (entry.size_px ? FirstPersonGame : GridGame).load(pack, entry, max_steps);
    const options = max_steps ? { ...entry.options, max_steps } : { ...entry.options };
    return new World(entry, game, pack.manifest.sources, options);
  }

  /**
   * Make a grid world of states of one's own, such as a drawn level's.
   * @param {WorldPack} pack for rules and tiles
   * @param {{ name: string, actions: string[], options: Record<string, unknown>, view_size: number }} about
   * @param {FirstStates} starts of seed 0 alone
   */
  static async ofStates(pack, about, starts) {
    const game = new GridGame(pack, starts, await pack.kernels("grid"), 0, await pack.atlas());
    const entry = { ...about, kind: "Grid", title: about.name, first_seed: 0, seeds: 1, row_length: starts.at(0).row.length };
    return new World(entry, game, pack.manifest.sources, about.options);
  }

  get #running() {
    if (!this.#game) throw new Error(`${this.name} is closed; make another`);
    return this.#game;
  }

  get steps() { return this.#running.steps; }
  get isGrid() { return !this.#entry.size_px; }

  /** The seeds that it can be reset to, from the first up to, not including, the second. @returns {[number, number]} */
  get seeds() { return [this.#entry.first_seed, this.#entry.first_seed + this.#entry.seeds]; }

  /** Begin an episode, as Python's `reset` does. @param {{ seed?: number }} [options] @returns {Observation} */
  reset({ seed = this.#entry.first_seed } = {}) {
    const [first, end] = this.seeds;
    if (this.#entry.layouts && !(Number.isSafeInteger(seed) && seed >= 0)) {
      throw new Error(`${this.name}: seed ${seed} is no whole number from 0 to ${Number.MAX_SAFE_INTEGER}`);
    }
    if (!Number.isInteger(seed) || seed < first || seed >= end) {
      throw new Error(`${this.name}: seed ${seed} is not packed, ${first} to ${end - 1} are; pack others with: minihuman pack ${this.name} --seeds`);
    }
    this.mission = this.#running.reset(seed - first);
    this.seed = seed;
    this.ended = false;
    this.digest = "";
    return this.#running.observe(this.mission);
  }

  /** Do an action. @param {string | number} action its name or number @returns {StepResult} */
  step(action) {
    const number = typeof action === "string" ? this.actions.indexOf(action) : action;
    if (!Number.isInteger(number) || number < 0 || number >= this.actions.length) {
      throw new Error(`${this.name} has no action ${action}; it has ${this.actions.join(", ")}`);
    }
    if (this.ended) throw new Error(`${this.name}: the episode has ended, or none has begun; reset it`);
    const game = this.#running, { status, reward } = game.world.step(number);
    if (status < 0) throw new Error(`${this.name}: action ${action} was refused (${status})`);
    if (game instanceof FirstPersonGame) game.steps += 1;
    const terminated = (status & TERMINATED_BIT) !== 0, truncated = (status & TRUNCATED_BIT) !== 0;
    this.ended = terminated || truncated;
    this.digest = game.world.digest(reward, terminated ? TERMINATED : truncated ? TRUNCATED : 0);
    return { observation: game.observe(this.mission), reward, terminated, truncated, digest: this.digest };
  }

  /** What a step led to, by numbers: a grid's row, or things and numbers of a first-person world. @returns {any} */
  get state() { return this.#running.world.save(); }

  /** Draw what a person sees; the canvas takes the picture's size. @param {HTMLCanvasElement} canvas @param {DrawOptions} [options] */
  async draw(canvas, options = {}) { await this.#running.draw(canvas, options); }

  /** @returns {SavedWorld} */
  save() {
    const { steps, ended, digest, mission, seed } = this;
    return { state: this.state, steps, ended, digest, mission, seed };
  }

  /** Go back to a saved state of this world's. @param {SavedWorld} saved */
  restore({ state, steps, ended, digest, mission, seed }) {
    const game = this.#running;
    if (game instanceof FirstPersonGame) {
      if (seed !== this.seed) game.reset(seed - this.#entry.first_seed);
      game.world.restore(state);
      game.steps = steps;
    } else {
      game.world.begin({ ...state, view_size: this.#entry.view_size });
    }
    Object.assign(this, { ended, digest, mission, seed });
  }

  /** Give the memory back to the next world. */
  close() {
    this.#game?.close();
    this.#game = null;
  }
}
