// Pictures that the server sent: kept, unpacked ahead of use, shown as films, and reported when the display has them.

import { el, fit, paint } from "./elements.js";

/** @import { FilmFrame, PageMessage, ScreenMessage } from "./messages" */
/** @import { FilmSettings } from "./page_tools" */
/**
 * @typedef {{ number: number, encoding: number, width: number, height: number, bytes: Uint8Array<ArrayBuffer>,
 * tiles: (Picture | undefined)[], bitmap: Promise<ImageBitmap> | null, ready: ImageBitmap | null }} Picture
 */
/** @typedef {(flip: number) => void} FlipCallback */
/**
 * @typedef {{ screen?: number, name?: number, episode?: number, step?: number, node?: number, then?: FlipCallback }} Shown
 */

const MAX_BITMAPS = 160;
const JPEG = 1, TILED = 2;

/** Whether a picture is drawn of few colours, and exact. @param {{ encoding: number }} picture */
export const isFlat = ({ encoding }) => encoding !== JPEG;

export class ImageCache {
  /** @type {Map<number, Picture>} */ #pictures = new Map();
  /** @type {Map<number, Picture>} with a bitmap, the latest last */ #unpacked = new Map();

  get size() { return this.#pictures.size; }
  clear() { this.#pictures.clear(); }
  /** @param {number} number */
  get(number) { return this.#pictures.get(number); }
  /** @param {Picture} picture */
  add(picture) {
    this.#pictures.set(picture.number, picture);
    if (picture.encoding === TILED) picture.tiles = Array.from(new Uint32Array(picture.bytes.buffer), (tile) => this.#pictures.get(tile));
  }

  /**
   * Let go of pictures of episodes that are over; the server would send them again. @param {number} before
   * @param {Set<number>} used
   */
  drop(before, used) {
    for (const number of this.#pictures.keys()) {
      if (number >= before || used.has(number)) continue;
      this.#pictures.delete(number);
      this.#unpacked.delete(number);
    }
  }

  /** @param {Picture} picture @returns {Promise<ImageBitmap>} */
  unpack(picture) {
    this.#unpacked.delete(picture.number);
    this.#unpacked.set(picture.number, picture);
    for (const [number, oldest] of this.#unpacked) {
      if (this.#unpacked.size <= MAX_BITMAPS) break;
      this.#unpacked.delete(number);
      oldest.bitmap = oldest.ready = null;
    }
    return picture.bitmap ??= (picture.encoding === TILED ? this.#join(picture) : decode(picture)).then((bitmap) => (picture.ready = bitmap));
  }

  // A picture of which a tile is missing is never shown. The server sends tiles before what they are in.
  /** @param {Picture} picture of tiles */
  async #join({ number, width, height, tiles }) {
    const canvas = new OffscreenCanvas(width, height), context = canvas.getContext("2d", { alpha: false });
    const bitmaps = await Promise.all(tiles.map((tile) => tile ? this.unpack(tile) : Promise.reject(new Error(`picture ${number} lacks a tile`))));
    bitmaps.forEach((bitmap, at) => context?.drawImage(bitmap, (at * bitmap.width) % width, Math.floor((at * bitmap.width) / width) * bitmap.height));
    return canvas.transferToImageBitmap();
  }
}

/** @param {Picture} picture */
async function decode({ encoding, width, height, bytes }) {
  if (encoding === JPEG) return createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
  const packed = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const rgb = new Uint8Array(await new Response(packed).arrayBuffer());
  const rgba = new Uint8ClampedArray(width * height * 4);
  for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) {
    rgba[to] = rgb[from];
    rgba[to + 1] = rgb[from + 1];
    rgba[to + 2] = rgb[from + 2];
    rgba[to + 3] = 255;
  }
  return createImageBitmap(new ImageData(rgba, width, height));
}

/** Reports when a picture was there: in a task posted from the frame that was drawn. */
export class FlipReporter {
  #channel = new MessageChannel();
  /** @type {Shown & { submit: number } | null} */ #pending = null;
  /** @type {{ episode?: number, step?: number, flip: number } | null} the last report */ #last = null;

  /** @param {() => number} now @param {(what: PageMessage) => void} send */
  constructor(now, send) {
    this.now = now;
    this.#channel.port1.onmessage = () => {
      const pending = this.#pending;
      this.#pending = null;
      if (!pending || document.hidden) return;
      const flip = now();
      const { then, ...what } = pending;
      then?.(flip);
      this.#last = { ...what, flip };
      send({ t: "shown", ...what, flip });
    };
  }

  /** @param {Shown} picture */
  report(picture) {
    const waits = this.#pending !== null;
    this.#pending = { submit: this.now(), ...picture };
    if (!waits) requestAnimationFrame(() => this.#channel.port2.postMessage(0));
  }

  // A step's picture that was the last thing reported is not there anew when the server's word of it comes.
  /** @param {number} episode @param {number} step @returns {number | null} when it was there */
  takeStep(episode, step) {
    const last = this.#pending ? null : this.#last;
    this.#last = null;
    return last && last.episode === episode && last.step === step ? last.flip : null;
  }

  cancel() { this.#pending = this.#last = null; }
}

/**
 * @typedef {object} Film
 * @property {FilmSettings} settings @property {ScreenMessage} message
 * @property {HTMLCanvasElement[]} canvases @property {HTMLProgressElement} bar
 * @property {number} step @property {number} length @property {number | null} due
 */

/** The films on the screen, side by side: they run by themselves, or keys go through them. */
export class FilmViewer {
  /** @type {Film | null} */ #film = null;
  /** @type {FilmFrame[]} of one screen, which came before its films were opened: its module was still on its way */ #early = [];
  /** @type {WeakMap<number[], Map<number, ((picture: Picture) => void)[]>>} */ #wanted = new WeakMap();

  /** @param {ImageCache} images @param {FlipReporter} flips @param {() => void} schedule */
  constructor(images, flips, schedule) {
    this.images = images;
    this.flips = flips;
    this.schedule = schedule;
  }

  get due() { return this.#film?.due ?? null; }
  get isOpen() { return this.#film !== null; }
  close() { this.#film = null; }
  fit() { for (const canvas of this.#film?.canvases ?? []) fit(canvas, ...this.#film?.settings.room ?? [1]); }

  /** Make the elements of a screen's films. @param {ScreenMessage} message @param {FilmSettings} settings */
  open(message, settings) {
    const canvases = settings.labels.map((label) => el("canvas", { role: "img", "aria-label": label }));
    const bar = el("progress", { max: 1, value: 0, "aria-hidden": "true" });
    const length = Math.max(...settings.sides.map((side) => side.length));
    this.#film = { settings, message, canvases, bar, step: 0, length, due: null };
    for (const frame of this.#early) this.add(frame);
    this.#early = [];
    return [el("div", { class: "films" }, canvases), bar];
  }

  /** Show the step that the session is at. */
  async start() {
    const film = this.#film;
    await film?.settings.ready;
    if (film && this.#film === film) this.#turn(film, film.settings.step);
  }

  /** @param {FilmFrame} frame */
  add(frame) {
    const { name, side, place, picture: number } = frame;
    if (this.#film?.message.name !== name) {
      if (this.#early[0]?.name !== name) this.#early = [];
      this.#early.push(frame);
      return;
    }
    const numbers = this.#film.settings.sides[side];
    const wanted = this.#wanted.get(numbers);
    const picture = this.images.get(number);
    numbers[place] = number;
    for (const resolve of wanted?.get(place) ?? []) if (picture) resolve(picture);
    wanted?.delete(place);
  }

  /** @param {string} key @param {boolean} isRepeat */
  press(key, isRepeat) {
    const film = this.#film;
    const step = film?.settings.stepOf(key, isRepeat, film.step) ?? null;
    if (film && step !== null) this.#turn(film, step);
  }

  /** @param {number} at */
  passTime(at) {
    const film = this.#film;
    if (film && film.due !== null && at >= film.due) this.#turn(film, film.step + 1 > film.length ? 0 : film.step + 1);
  }

  // Both at a step; the session counts the same by the same times.
  /** @param {Film} film @param {number} step */
  async #turn(film, step) {
    Object.assign(film, { step, due: null });
    const { settings: { sides, room, period, dueAfter }, message: { id: screen, name } } = film;
    const pictures = await Promise.all(sides.map((side) => this.#pictureAt(side, Math.min(step, side.length - 1))));
    const bitmaps = await Promise.all(pictures.map((picture) => this.images.unpack(picture)));
    const isCurrent = () => this.#film === film && film.step === step;
    if (!isCurrent()) return;
    bitmaps.forEach((bitmap, side) => {
      const canvas = film.canvases[side];
      if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
        Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
        canvas.classList.toggle("flat", isFlat(pictures[side]));
        fit(canvas, ...room);
      }
      paint(canvas, bitmap);
    });
    film.bar.value = Math.min(1, step / Math.max(1, film.length - 1));
    if (period !== null || dueAfter) {
      this.flips.report({ screen, name, then: (flip) => {
        if (isCurrent()) film.due ??= dueAfter ? dueAfter(step, flip) : flip + (period ?? 0);
        this.schedule();
      } });
      if (!dueAfter) return;
    } else this.flips.report({ screen, name });
    for (const number of sides[0].slice(step + 1, step + 9)) {
      const picture = this.images.get(number);
      if (picture) this.images.unpack(picture);
    }
  }

  // A picture of a film, once it is there: the server draws one after the other.
  /** @param {number[]} numbers @param {number} place @returns {Promise<Picture>} */
  #pictureAt(numbers, place) {
    const picture = numbers[place] >= 0 ? this.images.get(numbers[place]) : undefined;
    if (picture) return Promise.resolve(picture);
    return new Promise((resolve) => {
      const wanted = this.#wanted.get(numbers) ?? new Map();
      this.#wanted.set(numbers, wanted.set(place, [...(wanted.get(place) ?? []), resolve]));
    });
  }
}
