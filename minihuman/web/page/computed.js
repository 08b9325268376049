// Episodes that the page computes: scenes that are stepped and drawn here, by the server's own compiled rules, the moment
// a key asks for them. The server compares every step by its digest, and says where it is if that is elsewhere.

import { combineElements } from "./held.js";
import { FirstPersonWorld, GridWorld, Kernels, Scene } from "./world.js";

/** @import { ArraysMessage, FirstPersonState, GridState, VectorRules, WorldPosition, WorldState } from "./messages" */
/** @typedef {Record<string, any>} Arrays by name */
/**
 * What a state looks like: nothing until what it is drawn with is unpacked.
 * @typedef {{ width: number, height: number, paint(canvas: HTMLCanvasElement): void }} Drawn
 * @typedef {{ unpacked: Promise<unknown>, isFlat: boolean, draw(): Drawn | null }} Artist
 */
/** @typedef {GridWorld | FirstPersonWorld} World */
/** @typedef {ReturnType<GridWorld["save"]> | ReturnType<FirstPersonWorld["save"]>} Saved */

const FOLDER = new URL("worlds", import.meta.url).href;
const TERMINATED = 1, TRUNCATED = 2;
const AGENT = 1, CARRIED = 2, COLUMNS = 9, MOVING = 4; // of a first-person state: rows, and what of one moves
/** @type {Record<string, any>} by NumPy's names */
const TYPES = {
  int32: Int32Array, int64: BigInt64Array, uint8: Uint8Array, uint32: Uint32Array, float64: Float64Array,
};

/** What episodes are computed with: kernels, grid worlds by their size, a scene, and the arrays that the server sent. */
export class EpisodeComputer {
  /** @type {Map<string, GridWorld>} the memory of one is never given back */ #worlds = new Map();
  /** @type {Map<string, Promise<Arrays>>} by name */ #arrays = new Map();
  /** @type {{ name: string, textures: string, scene: Promise<Scene> } | null} the latest */ #scene = null;

  /** @param {Kernels} grid @param {Kernels} firstPerson */
  constructor(grid, firstPerson) {
    this.grid = grid;
    this.firstPerson = firstPerson;
  }

  /** Null where this browser or the connection gives none: the server sends scenes then. */
  static async load() {
    try {
      const [grid, firstPerson] = await Promise.all(["grid", "first_person"].map((name) => Kernels.load(FOLDER, name)));
      return new EpisodeComputer(grid, firstPerson);
    } catch { return null; }
  }

  /** @param {ArraysMessage} m */
  learnArrays(m) { this.#arrays.set(m.name, unpack(m)); }

  /** @param {string} name @returns {Promise<Arrays>} */
  #arraysOf(name) {
    const arrays = this.#arrays.get(name);
    if (!arrays) throw new Error(`the arrays ${name} did not come`);
    return arrays;
  }

  /**
   * The scenes of an episode. @param {WorldState} state the first @param {number} mostSteps
   * @param {VectorRules | null} [vectors] where actions are vectors
   */
  open(state, mostSteps, vectors = null) {
    const [world, artist] = state.world === "grid" ? this.#openGrid(state) : this.#openFirstPerson(state);
    return new ComputedScenes(world, artist, mostSteps, state, vectors);
  }

  /** @param {GridState} state @returns {[GridWorld, Artist]} */
  #openGrid(state) {
    const { row, words } = decodeState(state), unpacked = this.#arraysOf(state.atlas);
    const key = [row.length, row[0], row[1], state.view_size, state.in_view].join(" ");
    const world = this.#worlds.get(key) ??
      new GridWorld(this.grid, { row, words, view_size: state.view_size, in_view: state.in_view });
    this.#worlds.set(key, world);
    /** @type {any} */ let atlas = null;
    unpacked.then((arrays) => { atlas = { ...arrays, name: state.atlas, tile_px: arrays.px[0], small_px: arrays.px[1] }; });
    const view = state.full ? "full" : "partial";
    return [world, { unpacked, isFlat: true, draw: () => atlas && world.draw(view, atlas) }];
  }

  /** @param {FirstPersonState} state @returns {[FirstPersonWorld, Artist]} */
  #openFirstPerson(state) {
    const { looks, n_actions, uses } = state, [walls, rooms, edges] = [state.walls, state.rooms, state.edges].map(decodeFloats);
    const world = new FirstPersonWorld(this.firstPerson, { ...decodeState(state), walls, rooms, edges, looks, n_actions, uses });
    const unpacked = this.#sceneOf(state);
    /** @type {Scene | null} */ let scene = null;
    unpacked.then((built) => { scene = built; });
    const [width, height] = state.size;
    return [world, { unpacked, isFlat: false, draw: () => {
      if (!scene) return null;
      Object.assign(scene, { width, height });
      world.look(scene);
      return scene.draw(world.view.data, world.places.data);
    } }];
  }

  /** A state's scene, in a memory with its textures, which the next one may share. @param {FirstPersonState} state */
  async #sceneOf({ scene: name, textures }) {
    const before = this.#scene, [tables, ...pixels] = await Promise.all([name, ...textures].map((texture) => this.#arraysOf(texture)));
    if (before?.name === name) return before.scene;
    const shares = before?.textures === textures.join(" ");
    const building = (async () => {
      const last = shares ? await before.scene : null;
      if (last) return new Scene(last.kernels, tables, last.texels);
      const kernels = await this.firstPerson.again();
      return new Scene(kernels, tables, Scene.unpackTextures(kernels, tables, pixels.map((texture) => texture.pixels)));
    })();
    this.#scene = { name, textures: textures.join(" "), scene: building };
    return building;
  }
}

/**
 * A state that was come to, and what it leads to. @typedef {object} ComputedScene
 * @property {any} saved
 * @property {number} step
 * @property {string} digest of the step that led to it
 * @property {number} reward of that step
 * @property {number} ends whether the episode is over: 1 where the world ended it, 2 where a limit did
 * @property {number} picture none of the server's
 * @property {{ get(action: number | number[] | null | undefined): [scene: number, ends: boolean] | undefined, has(): boolean }} edges
 */

/** The scenes of an episode, as a graph whose edges are computed when they are asked for. */
export class ComputedScenes {
  /** @type {Map<number, ComputedScene>} */ #scenes = new Map();
  #next = 0;
  start = { step: 0, scene: 0 }; // where the server said that it was

  /**
   * @param {World} world @param {Artist} artist @param {number} mostSteps @param {WorldState} state
   * @param {VectorRules | null} [vectors] where actions are vectors
   */
  constructor(world, artist, mostSteps, state, vectors = null) {
    this.world = world;
    this.vectors = vectors;
    this.artist = artist;
    this.mostSteps = mostSteps;
    this.place(state);
  }

  /** Go on from where the server is. @param {WorldPosition} state */
  place(state) {
    this.start = { step: state.step, scene: this.#add(decodeState(state), state.step, { digest: "", reward: 0, ends: 0 }) };
  }

  /** @param {number} name */
  has(name) { return this.#scenes.has(name); }
  /** @param {number} name */
  get(name) { return this.#scenes.get(name); }

  /** Let go of scenes before this one, to which nothing leads back. @param {number} name */
  forget(name) {
    for (const known of this.#scenes.keys()) if (known < name && known !== this.start.scene) this.#scenes.delete(known);
  }

  // The picture of a scene, or a share of the way to it, as long as no other is drawn; null until it can be drawn.
  /** @param {number} name @param {any} [from] what was saved of the scene before @param {number} [share] */
  draw(name, from, share = 1) {
    const scene = this.#scenes.get(name);
    if (!scene) return null;
    this.world.restore(from && share < 1 ? between(from, scene.saved, share) : scene.saved);
    return this.artist.draw();
  }

  /** @param {any} saved @param {number} step @param {{ digest: string, reward: number, ends: number }} outcome */
  #add(saved, step, outcome) {
    const name = this.#next++;
    /** @type {Map<string, [number, boolean]>} */ const edges = new Map();
    /** @type {ComputedScene} */
    const scene = { saved, step, ...outcome, picture: -1, edges: {
      get: (action) => {
        if (action === null || action === undefined) return undefined;
        const taken = this.vectors && typeof action === "number" ? combineElements(this.vectors, [action]) : action;
        const edge = edges.get(`${taken}`) ?? this.#step(scene, taken);
        if (edge) edges.set(`${taken}`, edge);
        return edge;
      },
      has: () => true,
    } };
    this.#scenes.set(name, scene);
    return name;
  }

  /** @param {ComputedScene} scene @param {number | number[]} action @returns {[scene: number, ends: boolean] | undefined} */
  #step(scene, action) {
    const { world } = this;
    world.restore(scene.saved);
    const { status, reward } = world.step(/** @type {any} */ (action));
    if (status < 0) return undefined;
    const step = scene.step + 1;
    const isTruncated = status & TRUNCATED || step >= this.mostSteps;
    const ends = status & TERMINATED ? TERMINATED : isTruncated ? TRUNCATED : 0;
    const outcome = { digest: world.digest(reward, ends), reward, ends };
    return [this.#add(world.save(), step, outcome), ends > 0];
  }
}

/** A first-person state, its agent and what it carries a share of the way from another. @param {any} from @param {any} to @param {number} share */
function between(from, to, share) {
  const things = to.things.slice();
  for (const whose of [AGENT, CARRIED]) {
    const row = to.numbers[whose] * COLUMNS;
    if (row < 0 || from.numbers[whose] !== to.numbers[whose]) continue;
    for (let at = row; at < row + MOVING; at++) things[at] = from.things[at] + share * (to.things[at] - from.things[at]);
  }
  return { ...to, things };
}

/** What a world is restored from. @param {WorldPosition} state @returns {any} */
function decodeState(state) {
  const words = BigUint64Array.from(state.rng_state, BigInt);
  if (state.world === "grid") return { row: decodeRow(state.row), words };
  return { things: decodeFloats(state.things), numbers: decodeFloats(state.numbers), words };
}

/** @param {number[]} runs numbers, and how often each comes */
function decodeRow(runs) {
  const row = new Int32Array(runs.reduce((sum, count, i) => (i % 2 ? sum + count : sum), 0));
  for (let i = 0, at = 0; i < runs.length; i += 2) row.fill(runs[i], at, at += runs[i + 1]);
  return row;
}

const decodeBytes = (/** @type {string} */ text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const decodeFloats = (/** @type {string} */ text) => new Float64Array(decodeBytes(text).buffer);

/** @param {ArraysMessage} m @returns {Promise<Arrays>} */
async function unpack({ arrays, packed }) {
  const stream = new Blob([decodeBytes(packed)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const content = await new Response(stream).arrayBuffer();
  let at = 0;
  return Object.fromEntries(arrays.map(([name, kind, size]) => [name, new TYPES[kind](content.slice(at, at += size))]));
}
