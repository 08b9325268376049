// Two sticks on a touch screen, for two thumbs: each moves axes as a gamepad's stick does, and rests without a finger.

import { el } from "./elements.js";
import { levelOf } from "./gamepad.js";

/** @import { AxisMessage, PageMessage } from "./messages" */
/** @typedef {AxisMessage["axis"]} Axis */

const SIDES = ["left", "right"];
const REACH = 0.36; // of the drawn circle's width: how far a thumb goes for the whole of a component

export class ThumbSticks {
  /** @type {Axis[]} that the screen is steered by */ #axes = [];
  /** @type {Map<Axis, number>} where each is */ #levels = new Map();
  /** @type {Map<Axis, number>} as the session knows them */ #sent = new Map();
  /** @type {Map<number, HTMLElement>} which finger is on which stick */ #fingers = new Map();
  #ms = 0; // of the latest movement

  // Whether a movement waits for the next step is asked of `isBehind`, as with a gamepad's sticks.
  /** @param {(what: PageMessage, ms: number) => void} send @param {() => boolean} isBehind */
  constructor(send, isBehind) {
    this.send = send;
    this.isBehind = isBehind;
  }

  /** The sticks for some axes, those of before at rest. @param {string[]} axes @returns {HTMLElement[]} none if no axis is a stick's */
  draw(axes) {
    this.release(performance.now());
    this.#axes = /** @type {Axis[]} */ (axes.filter((axis) => axis.startsWith("touch_")));
    if (!this.#axes.length) return [];
    return [el("div", { class: "sticks" }, SIDES.map((side) => this.#side(side)))];
  }

  /** @param {string} side */
  #side(side) {
    const half = el("div", { class: "half", "data-side": side });
    if (!this.#axes.some((axis) => axis.startsWith(`touch_${side}_`))) return half;
    half.append(el("div", { class: "stick" }, el("div", { class: "knob" })));
    half.addEventListener("pointerdown", (event) => {
      event.preventDefault(); // the focus stays where it is
      if ([...this.#fingers.values()].includes(half)) return;
      this.#fingers.set(event.pointerId, half);
      half.setPointerCapture(event.pointerId);
      this.#follow(half, event);
    });
    half.addEventListener("pointermove", (event) => { if (this.#fingers.get(event.pointerId) === half) this.#follow(half, event); });
    for (const kind of /** @type {const} */ (["pointerup", "pointercancel"])) {
      half.addEventListener(kind, (event) => { if (this.#fingers.delete(event.pointerId)) this.#put(half, 0, 0, event.timeStamp); });
    }
    return half;
  }

  /** @param {HTMLElement} half @param {PointerEvent} event */
  #follow(half, { clientX, clientY, timeStamp }) {
    const box = /** @type {Element} */ (half.firstElementChild).getBoundingClientRect();
    const reach = REACH * box.width;
    const x = (clientX - box.left - box.width / 2) / reach, y = (clientY - box.top - box.height / 2) / reach;
    const far = Math.max(1, Math.hypot(x, y));
    this.#put(half, x / far, y / far, timeStamp);
  }

  /** @param {HTMLElement} half @param {number} x -1 to 1 @param {number} y @param {number} ms */
  #put(half, x, y, ms) {
    half.style.setProperty("--x", String(x * REACH));
    half.style.setProperty("--y", String(y * REACH));
    for (const axis of this.#axes) {
      if (axis === `touch_${half.dataset.side}_x`) this.#levels.set(axis, levelOf(x));
      if (axis === `touch_${half.dataset.side}_y`) this.#levels.set(axis, levelOf(y));
    }
    this.#ms = ms;
    if (!this.isBehind()) this.sendLevels();
  }

  /** No finger is on them any more, or none that counts: the focus goes, or another screen comes. @param {number} ms */
  release(ms) {
    for (const half of this.#fingers.values()) this.#put(half, 0, 0, ms);
    this.#fingers.clear();
    this.sendLevels();
  }

  /** Send what waited for a step: it was sent just now. */
  sendLevels() {
    for (const [axis, value] of this.#levels) {
      if (value === (this.#sent.get(axis) ?? 0)) continue;
      this.#sent.set(axis, value);
      this.send({ t: "axis", axis, value }, this.#ms);
    }
  }
}
