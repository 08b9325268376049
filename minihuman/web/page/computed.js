// Episodes that the page computes: scenes that are stepped and drawn here, by the server's own compiled rules, the moment
// a key asks for them. The server compares every step by its digest, and says where it is if that is elsewhere.

import { GridWorld, Kernels } from "./world.js";

/** @import { AtlasMessage, GridState } from "./messages" */
/** @import { Atlas } from "./world.js" */
/** @typedef {{ ready: Atlas | null, unpacked: Promise<Atlas> }} Tiles */

const FOLDER = "/static/worlds";
const TERMINATED = 1, TRUNCATED = 2;

/** What episodes are computed with: the grid's kernels, worlds by their size, and tiles. */
export class GridComputer {
  /** @type {Map<string, GridWorld>} the memory of one is never given back */ #worlds = new Map();
  /** @type {Map<string, Tiles>} */ #tiles = new Map();

  /** @param {Kernels} kernels */
  constructor(kernels) { this.kernels = kernels; }

  /** Null where this browser or the connection gives none: the server sends scenes then. */
  static async load() {
    try { return new GridComputer(await Kernels.load(FOLDER, "grid")); } catch { return null; }
  }

  /** @param {AtlasMessage} m */
  learnTiles(m) {
    /** @type {Tiles} */ const tiles = { ready: null, unpacked: unpackAtlas(m) };
    tiles.unpacked.then((atlas) => { tiles.ready = atlas; });
    this.#tiles.set(m.name, tiles);
  }

  /** The scenes of an episode. @param {GridState} state the first @param {number} mostSteps */
  open(state, mostSteps) {
    const [tiles, row, rngState] = [this.#tiles.get(state.atlas), decodeRow(state.row), decodeWords(state.rng_state)];
    if (!tiles) throw new Error(`the tiles ${state.atlas} did not come`);
    const key = [row.length, row[0], row[1], state.view_size, state.in_view].join(" ");
    const world = this.#worlds.get(key) ??
      new GridWorld(this.kernels, { row, words: rngState, view_size: state.view_size, in_view: state.in_view });
    this.#worlds.set(key, world);
    return new ComputedScenes(world, tiles, mostSteps, state);
  }
}

/**
 * A state that was come to, and what it leads to. @typedef {object} ComputedScene
 * @property {Int32Array} row @property {BigUint64Array} words
 * @property {number} step
 * @property {string} digest of the step that led to it
 * @property {number} picture none of the server's
 * @property {{ get(action: number | null | undefined): [scene: number, ends: boolean] | undefined, has(): boolean }} edges
 */

/** The scenes of an episode, as a graph whose edges are computed when they are asked for. */
export class ComputedScenes {
  /** @type {Map<number, ComputedScene>} */ #scenes = new Map();
  #next = 0;
  start = { step: 0, scene: 0 }; // where the server said that it was

  /** @param {GridWorld} world @param {Tiles} tiles @param {number} mostSteps @param {GridState} state */
  constructor(world, tiles, mostSteps, state) {
    this.world = world;
    this.tiles = tiles;
    this.mostSteps = mostSteps;
    /** @type {import("./world.js").View} */ this.view = state.full ? "full" : "partial";
    this.place(state);
  }

  /** Go on from where the server is. @param {GridState} state */
  place(state) {
    this.start = { step: state.step, scene: this.#add(decodeRow(state.row), decodeWords(state.rng_state), state.step, "") };
  }

  /** @param {number} name */
  has(name) { return this.#scenes.has(name); }
  /** @param {number} name */
  get(name) { return this.#scenes.get(name); }

  /** Let go of scenes before this one, to which nothing leads back. @param {number} name */
  forget(name) {
    for (const known of this.#scenes.keys()) if (known < name && known !== this.start.scene) this.#scenes.delete(known);
  }

  /** The picture of a scene, as long as no other is drawn; null until its tiles are unpacked. @param {number} name */
  draw(name) {
    const scene = this.#scenes.get(name);
    if (!scene || !this.tiles.ready) return null;
    this.#restore(scene);
    return this.world.draw(this.view, this.tiles.ready);
  }

  /** @param {Int32Array} row @param {BigUint64Array} words @param {number} step @param {string} digest */
  #add(row, words, step, digest) {
    const name = this.#next++;
    /** @type {Map<number, [number, boolean]>} */ const found = new Map();
    /** @type {ComputedScene} */
    const scene = { row, words, step, digest, picture: -1, edges: {
      get: (action) => {
        if (typeof action !== "number") return undefined;
        const edge = found.get(action) ?? this.#step(scene, action);
        if (edge) found.set(action, edge);
        return edge;
      },
      has: () => true,
    } };
    this.#scenes.set(name, scene);
    return name;
  }

  /** @param {ComputedScene} scene */
  #restore({ row, words }) {
    this.world.row.data.set(row);
    this.world.words.data.set(words);
  }

  /** @param {ComputedScene} scene @param {number} action @returns {[scene: number, ends: boolean] | undefined} */
  #step(scene, action) {
    this.#restore(scene);
    const { world } = this;
    const { status, reward } = world.step(action);
    if (status < 0) return undefined;
    const step = scene.step + 1;
    const isTruncated = status & TRUNCATED || step >= this.mostSteps;
    const ends = status & TERMINATED ? TERMINATED : isTruncated ? TRUNCATED : 0;
    return [this.#add(world.row.data.slice(), world.words.data.slice(), step, world.digest(reward, ends)), ends > 0];
  }
}

/** @param {number[]} runs numbers, and how often each comes */
function decodeRow(runs) {
  const row = new Int32Array(runs.reduce((sum, count, i) => (i % 2 ? sum + count : sum), 0));
  for (let i = 0, at = 0; i < runs.length; i += 2) row.fill(runs[i], at, at += runs[i + 1]);
  return row;
}

/** @param {string[]} words */
const decodeWords = (words) => BigUint64Array.from(words, BigInt);

/** @param {AtlasMessage} m @returns {Promise<Atlas>} */
async function unpackAtlas({ name, tile_px, small_px, sizes, packed }) {
  const bytes = Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
  const content = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  let at = 0;
  const [number, under, tiles, agents, carried] = sizes.map((size) => content.slice(at, at += size));
  return {
    name, tile_px, small_px, number: new BigInt64Array(number), under: new BigInt64Array(under),
    tiles: new Uint8Array(tiles), agents: new Uint8Array(agents), carried: new Uint8Array(carried),
  };
}
