// Worlds in the page: the server's own rules and pictures, compiled to WebAssembly, on an episode's first state.
// Knows no network and, but for `paint`, no document; `worlds/manifest.json` says what the modules' functions take.

import { DIRECTION, HEIGHT, NUMBERS_REWARD, PHASE, PLAYING, WIDTH } from "./row.js";

/** @typedef {Int32Array | BigInt64Array | BigUint64Array | Uint8Array | Uint32Array | Float64Array} Numbers */
/** @typedef {{ name: string, kind: string, dimensions: number }} Argument */
/** @typedef {{ arguments: Argument[], results: string[] }} Signature */
/** @typedef {{ files: { file: string, simd: boolean }[], functions: Record<string, Signature> }} ModuleEntry */
/** @typedef {{ sources: string, modules: Record<string, ModuleEntry> }} Manifest */
/** @typedef {"partial" | "full"} View */
/**
 * Tiles of one size; lists have the extents of the server's arrays. Those of one world differ in size or in name.
 * @typedef {{ name?: string, number: BigInt64Array, under: BigInt64Array, tiles: Uint8Array, agents: Uint8Array, carried: Uint8Array,
 * tile_px: number, small_px: number }} Atlas
 */
/**
 * An episode's first state. @typedef {{ row: Int32Array, words: BigUint64Array, view_size: number, in_view?: boolean,
 * first_row?: Int32Array }} Start the first observation may be of another row, before the agent takes what it carries
 */

const TYPES = {
  int32: Int32Array, int64: BigInt64Array, uint64: BigUint64Array, uint8: Uint8Array, uint32: Uint32Array,
  float64: Float64Array,
};
const WORD_BYTES = 8;
const PAGE_BYTES = 65536;

/** An array in a module's memory, which may move when the memory grows. */
export class Block {
  /** @param {WebAssembly.Memory} memory @param {keyof TYPES} kind @param {number} at @param {number[]} shape */
  constructor(memory, kind, at, shape) {
    this.memory = memory;
    this.kind = kind;
    this.at = at;
    this.shape = shape;
    this.length = shape.reduce((a, b) => a * b, 1);
    /** @type {any} */ this.view = null;
  }

  /** The numbers, to read and to write. @returns {any} */
  get data() {
    if (this.view?.buffer !== this.memory.buffer) {
      this.view = new TYPES[this.kind](this.memory.buffer, this.at, this.length);
    }
    return this.view;
  }
}

/** The file of a module for this browser. @param {ModuleEntry | undefined} entry @param {string} name */
export function chooseModule(entry, name) {
  if (!entry) throw new Error(`there is no module ${name}`);
  const simd = WebAssembly.validate(SIMD_PROBE);
  const file = entry.files.find((candidate) => candidate.simd && simd) ?? entry.files.find((candidate) => !candidate.simd);
  if (!file) throw new Error(`there is no module ${name} for this browser`);
  return file;
}

/** A module of kernels, with a memory of its own. */
export class Kernels {
  /** @param {WebAssembly.Instance} instance @param {Record<string, Signature>} signatures */
  constructor(instance, signatures) {
    const exported = /** @type {any} */ (instance.exports);
    this.exported = exported;
    this.signatures = signatures;
    this.sources = ""; // the digest of what they were compiled from
    /** @type {WebAssembly.Memory} */ this.memory = exported.memory;
    this.free = this.base = Number(exported.__heap_base.value);
    /** @type {WebAssembly.Module | null} */ this.module = null;
  }

  /** The same code with a memory of its own. */
  async again() {
    if (!this.module) throw new Error("these kernels were not compiled here");
    const copy = new Kernels(await WebAssembly.instantiate(this.module, {}), this.signatures);
    copy.module = this.module;
    copy.sources = this.sources;
    return copy;
  }

  /** @param {BufferSource} code @param {ModuleEntry} entry */
  static async compile(code, entry) {
    const { instance, module } = await WebAssembly.instantiate(code, {});
    const kernels = new Kernels(instance, entry.functions);
    kernels.module = module;
    return kernels;
  }

  /** Fetch a module from the folder of the manifest. @param {string} folder @param {string} name */
  static async load(folder, name) {
    /** @type {Manifest} */ const manifest = await (await fetch(`${folder}/manifest.json`)).json();
    const entry = manifest.modules[name];
    const { file } = chooseModule(entry, name);
    const kernels = await Kernels.compile(await (await fetch(`${folder}/${file}`)).arrayBuffer(), entry);
    kernels.sources = manifest.sources;
    return kernels;
  }

  /** An array of zeros, or of these numbers. @param {keyof TYPES} kind @param {number[]} shape @param {Numbers} [from] */
  array(kind, shape, from) {
    const at = Math.ceil(this.free / 16) * 16;
    const block = new Block(this.memory, kind, at, shape);
    this.free = at + block.length * TYPES[kind].BYTES_PER_ELEMENT;
    const missing = this.free - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / PAGE_BYTES));
    block.data.fill(/^u?int64$/.test(kind) ? 0n : 0);
    if (from) block.data.set(from);
    return block;
  }

  /**
   * A function that calls a kernel with these arguments, in order, and one more number; what it gives is the first
   * result. @param {string} name @param {(Block | number)[]} args
   */
  bind(name, ...args) {
    const { arguments: parameters, results } = this.signatures[name] ?? { arguments: [], results: [] };
    if (parameters.length !== args.length) throw new Error(`${name} takes ${parameters.length} arguments, not ${args.length}`);
    /** @type {bigint[]} */ const words = [];
    parameters.forEach((parameter, at) => {
      const argument = args[at];
      if (!(argument instanceof Block)) return words.push(BigInt(/** @type {number} */ (argument)));
      if (argument.kind !== parameter.kind || argument.shape.length !== parameter.dimensions) {
        throw new Error(`${name}: ${parameter.name} is ${parameter.kind} of ${parameter.dimensions} dimensions`);
      }
      return words.push(BigInt(argument.at), ...argument.shape.map(BigInt));
    });
    const table = this.array("int64", [words.length + results.length]);
    table.data.set(words);
    const call = this.exported[name];
    return {
      /** @param {number} [number] @returns {number} */
      call: (number = 0) => call(table.at, number),
      /** A result that is a fraction. @param {number} at */
      real: (at) => new DataView(this.memory.buffer).getFloat64(table.at + WORD_BYTES * (words.length + at), true),
      /** A result that is a whole number of 64 bits. @param {number} at @returns {bigint} */
      word: (at) => BigInt.asUintN(64, table.data[words.length + at]),
    };
  }
}

/** A grid world in an episode. */
export class GridWorld {
  /** @param {Kernels} kernels @param {Start} start */
  constructor(kernels, start) {
    this.kernels = kernels;
    this.size = start.view_size;
    this.inView = start.in_view ?? false;
    this.row = kernels.array("int32", [start.row.length]);
    this.words = kernels.array("uint64", [start.words.length]);
    this.image = kernels.array("uint8", [this.size, this.size, 3]);
    this.stepped = kernels.bind("step", this.row, this.words, this.image);
    this.see = kernels.bind("see", this.row, this.image);
    this.outcome = kernels.array("uint64", [2]);
    this.digested = kernels.bind("digest_step", this.row, this.image, this.outcome);
    /** @type {Map<string, Picture>} */ this.pictures = new Map();
    this.begin(start);
  }

  save() { return { row: this.row.data.slice(), words: this.words.data.slice() }; }

  /** @param {{ row: Int32Array, words: BigUint64Array }} saved */
  restore({ row, words }) {
    this.row.data.set(row);
    this.words.data.set(words);
  }

  /** Begin an episode in a world of the same size. @param {Start} start */
  begin(start) {
    this.restore(start);
    this.see.call();
  }

  get playing() { return this.row.data[PHASE] === PLAYING; }
  get direction() { return /** @type {number} */ (this.row.data[DIRECTION]); }

  /** The status, bit 0 for an end and bit 1 for the step limit; below 0 nothing was done. @param {number} action */
  step(action) {
    const status = this.stepped.call(action);
    return { status, reward: status < 0 ? 0 : this.stepped.real(2), direction: this.direction };
  }

  /**
   * The digest of the last step, as the server's. @param {number} reward
   * @param {number} ends 0: the episode goes on, 1: it is terminated, 2: truncated
   */
  digest(reward, ends) {
    return digest(this.outcome, this.digested, reward, ends);
  }

  /** Draw into a picture that is kept. @param {View} view @param {Atlas} atlas @param {boolean} [lit] */
  draw(view, atlas, lit = true) {
    const key = `${view} ${atlas.tile_px} ${atlas.name}`;
    let picture = this.pictures.get(key);
    if (!picture) this.pictures.set(key, (picture = new Picture(this, view, atlas)));
    return picture.draw(lit);
  }
}

/** What a grid world looks like, in one size. */
export class Picture {
  /** @param {GridWorld} world @param {View} view @param {Atlas} atlas */
  constructor(world, view, atlas) {
    const { kernels, row } = world, { tile_px: px, small_px: small } = atlas;
    const full = view === "full";
    const [columns, lines] = full ? [row.data[WIDTH], row.data[HEIGHT]] : [world.size, world.size];
    const looks = atlas.under.length / 4, tiles = atlas.tiles.length / (2 * px * px * 3);
    this.world = world;
    this.full = full;
    this.width = columns * px;
    this.height = lines * px;
    this.image = kernels.array("uint8", [world.size, world.size, 3]);
    this.rgb = kernels.array("uint8", [this.height, this.width * 3]);
    this.flat = new Block(kernels.memory, "uint8", this.rgb.at, [this.rgb.length]);
    this.rgba = kernels.array("uint8", [this.width * this.height * 4]);
    this.see = kernels.bind("see", row, this.image);
    this.drawn = kernels.bind(
      "draw_cells", row, this.image, Number(full), Number(world.inView), kernels.array("int64", [columns, lines]),
      kernels.array("int64", [looks], atlas.number), kernels.array("int64", [4, looks], atlas.under),
      kernels.array("uint8", [2, tiles, px, 3 * px], atlas.tiles), this.figures(kernels, atlas.agents, Math.sqrt(atlas.agents.length / 16)),
      this.figures(kernels, atlas.carried, small), this.rgb, this.rgb,
    );
    this.converted = kernels.bind("write_rgba", this.flat, this.rgba);
  }

  /** @param {Kernels} kernels @param {Uint8Array} from @param {number} px */
  figures(kernels, from, px) { return kernels.array("uint8", [from.length / (px * px * 4), px, px, 4], from); }

  /** @param {boolean} lit */
  draw(lit) {
    if (lit || !this.full) this.see.call();
    else this.image.data.fill(0);
    this.drawn.call();
    return this;
  }

  /** Put it onto a canvas of its size. @param {HTMLCanvasElement} canvas */
  paint(canvas) {
    this.converted.call();
    paintRgba(canvas, this.rgba, this.width, this.height);
  }

  get kernels() { return this.world.kernels; }
}


/**
 * A first-person episode's first state: the arrays of the server's `step`, and how many things its scene is made of.
 * @typedef {{ things: Float64Array, numbers: Float64Array, walls: Float64Array, words: BigUint64Array, rooms: Float64Array,
 * edges: Float64Array, looks: number, n_actions?: number, uses?: number[] }} FirstPersonStart of `n_actions` actions that `step` does;
 * what else there is are steps sideways, or vectors, whose last component may be which of `uses` the hands do
 */
/** @typedef {{ things: Float64Array, numbers: Float64Array, words: BigUint64Array }} FirstPersonSave */

const COLUMNS = 9, ROOM_COLUMNS = 7, EDGE_COLUMNS = 4, PLACE_COLUMNS = 6, THING_COLUMNS = 15;
const VIEW_SIZE = 40, MEMORY = 36, SPANS = 43;
const COMMAND = 3, RESOLUTION = 1024; // components of a command to the body, and the parts of 1 to which they are rounded

/** The nearest whole number, the even one of two, as NumPy has it. @param {number} value */
export function roundHalfEven(value) {
  const low = Math.floor(value), part = value - low;
  const rounded = part < 0.5 || (part === 0.5 && low % 2 === 0) ? low : low + 1;
  return rounded === 0 && (value < 0 || Object.is(value, -0)) ? -0 : rounded;
}

/** A first-person world in an episode, without its pictures. The module's whole memory is its own. */
export class FirstPersonWorld {
  /** @param {Kernels} kernels @param {FirstPersonStart} start */
  constructor(kernels, start) {
    kernels.free = kernels.base;
    /** @param {Float64Array} rows @param {number} columns */
    const table = (rows, columns) => kernels.array("float64", [rows.length / columns, columns], rows);
    this.kernels = kernels;
    this.actionCount = start.n_actions ?? Infinity;
    this.uses = start.uses ?? [];
    this.things = table(start.things, COLUMNS);
    this.numbers = kernels.array("float64", [start.numbers.length], start.numbers);
    this.words = kernels.array("uint64", [start.words.length], start.words);
    this.places = kernels.array("float64", [start.looks, PLACE_COLUMNS]);
    this.view = kernels.array("float64", [VIEW_SIZE]);
    this.outcome = kernels.array("uint64", [2]);
    this.command = kernels.array("float64", [COMMAND]);
    const state = [this.things, this.numbers, table(start.walls, 4), this.words, table(start.rooms, ROOM_COLUMNS),
      table(start.edges, EDGE_COLUMNS)];
    this.stepped = kernels.bind("step", ...state);
    this.steppedFreely = kernels.bind("step_freely", ...state, this.command);
    this.digested = kernels.bind("digest_state", this.things, this.numbers, this.words, this.outcome);
  }

  /** @returns {FirstPersonSave} */
  save() {
    return { things: this.things.data.slice(), numbers: this.numbers.data.slice(), words: this.words.data.slice() };
  }

  /** @param {FirstPersonSave} saved */
  restore({ things, numbers, words }) {
    this.things.data.set(things);
    this.numbers.data.set(numbers);
    this.words.data.set(words);
  }

  /** The status, bit 0 for an end and bit 1 for the step limit. @param {number | number[]} action its number, or a vector */
  step(action) {
    const isKernels = typeof action === "number" && action < this.actionCount;
    const status = (isKernels ? this.stepped.call(action) : this.#stepFreely(action)) & 3;
    return { status, reward: /** @type {number} */ (this.numbers.data[NUMBERS_REWARD]) };
  }

  /** @param {number | number[]} action a step sideways, or speed, turn, perhaps strafe, and perhaps what the hands do */
  #stepFreely(action) {
    const vector = typeof action === "number" ? [0, 0, action === this.actionCount ? -1 : 1] : action;
    const moves = this.uses.length ? vector.slice(0, -1) : vector;
    this.command.data.fill(0);
    this.command.data.set(moves.map((component) => roundHalfEven(component * RESOLUTION) / RESOLUTION));
    const use = this.uses.length ? vector[vector.length - 1] : 0;
    return this.steppedFreely.call(use ? this.uses[use - 1] : -1);
  }

  /** As `GridWorld.digest`. @param {number} reward @param {number} ends */
  digest(reward, ends) { return digest(this.outcome, this.digested, reward, ends); }

  /** Where the eye and the things are, for a scene. @param {Scene} scene */
  look({ start, width, height }) {
    this.view.data.set(start);
    const { free } = this.kernels;
    this.kernels.bind("look", this.things, this.numbers, this.places, this.view, width, height).call();
    this.kernels.free = free;
  }
}

/** A first-person scene in one size, and its picture. */
export class Scene {
  /**
   * The tables go into the module's memory behind the texels, in the place of another scene's.
   * @param {Kernels} kernels @param {Record<string, any>} tables of the scene, by the names of the kernels' parameters
   * @param {Block} texels in all sizes
   */
  constructor(kernels, tables, texels) {
    /** @param {keyof TYPES} kind @param {string} name */
    const table = (kind, name) => kernels.array(kind, [tables[name].length], tables[name]);
    const things = tables.things.length / THING_COLUMNS;
    kernels.free = texels.at + texels.length * 4;
    this.kernels = kernels;
    this.limits = tables.limits;
    this.start = tables.view;
    this.view = table("float64", "view");
    this.places = kernels.array("float64", [things, PLACE_COLUMNS]);
    this.texels = texels;
    this.sizes = table("uint32", "table");
    this.rooms = [table("float64", "room_floats"), table("int32", "room_wholes")];
    this.library = [table("float64", "library_floats"), table("int32", "library_wholes")];
    this.things = kernels.array("float64", [things, THING_COLUMNS], tables.things);
    this.mark = kernels.free;
    this.width = this.height = 0; // of the picture that is drawn next
    this.sized = "";
  }

  /** The sizes of textures, from their pixels. @param {Kernels} kernels @param {any} tables @param {Uint8Array[]} pixels */
  static unpackTextures(kernels, tables, pixels) {
    kernels.free = kernels.base;
    const texels = kernels.array("uint32", [tables.limits[3]]), { free } = kernels;
    const rowLength = tables.table.length / (pixels.length || 1);
    pixels.forEach((rgb, number) => {
      const sizes = tables.table.subarray(number * rowLength, (number + 1) * rowLength);
      const width = sizes[1] & 0xffff, height = sizes[1] >>> 16;
      kernels.bind("fill_sizes", kernels.array("uint8", [height, width, 3], rgb), kernels.array("uint32", [rowLength], sizes), texels)
        .call();
      kernels.free = free;
    });
    return texels;
  }

  /** Make room for its size. */
  resize(spans = SPANS) {
    const { kernels, width, height } = this, [faces, corners, rooms] = this.limits;
    kernels.free = this.mark;
    const count = kernels.bind("size_of", height, spans, faces, corners, rooms);
    count.call();
    const floats = kernels.array("float64", [Number(count.word(0))]), wholes = kernels.array("int32", [Number(count.word(1))]);
    this.sized = `${width} ${height}`;
    this.spans = spans;
    this.picture = kernels.array("uint8", [height, width, 3]);
    this.rgba = kernels.array("uint8", [height * width * 4]);
    this.covered = kernels.bind("cover", ...this.rooms, ...this.library, this.things, this.places, this.view, floats, wholes);
    this.coloured = kernels.bind("colour", this.texels, this.sizes, ...this.rooms, this.things, this.places, this.view, floats, wholes,
      this.picture);
    this.converted = kernels.bind(
      "write_rgba", new Block(kernels.memory, "uint8", this.picture.at, [this.picture.length]), this.rgba);
  }

  /** Draw what an eye sees, whose view is of the scene's size. @param {Numbers} view @param {Numbers} places */
  draw(view, places) {
    if (this.sized !== `${this.width} ${this.height}`) this.resize();
    for (;;) {
      this.view.data.set(view);
      this.view.data.set([this.spans, this.limits[0], this.limits[1]], MEMORY);
      this.places.data.set(places);
      if (this.covered?.call()) break;
      this.resize(2 * (this.spans ?? SPANS)); // a row has more spans than there was room for
    }
    this.coloured?.call();
    return this;
  }

  /** Put it onto a canvas of its size. @param {HTMLCanvasElement} canvas */
  paint(canvas) {
    this.converted?.call();
    if (this.rgba) paintRgba(canvas, this.rgba, this.width, this.height);
  }
}

/** @param {HTMLCanvasElement} canvas @param {Block} rgba @param {number} width @param {number} height */
function paintRgba(canvas, { memory, at, length }, width, height) {
  const pixels = new Uint8ClampedArray(/** @type {ArrayBuffer} */ (memory.buffer), at, length);
  canvas.getContext("2d", { alpha: false })?.putImageData(new ImageData(pixels, width, height), 0, 0);
}

/** @param {Block} outcome @param {{ call(): number, word(at: number): bigint }} digested @param {number} reward @param {number} ends */
function digest({ data }, digested, reward, ends) {
  new Float64Array(data.buffer, data.byteOffset, 1)[0] = reward;
  data[1] = BigInt(ends);
  digested.call();
  return digested.word(0).toString(16).padStart(16, "0");
}

// a function of one SIMD instruction: valid only where a browser has them
const SIMD_PROBE = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11,
]);
