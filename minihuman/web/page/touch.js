// Buttons on the screen that stand for keys, for hands without a keyboard: a tap is a press and a release, stamped as
// keys are, and named "touch" in the log. Where arrow keys are played with, a swipe over the picture presses one of them.

import { el } from "./elements.js";

/** @import { ScreenValues } from "./messages" */
/** @import { Keyboard } from "./input.js" */
/** @import { ThumbSticks } from "./sticks.js" */

const KEYS_OF = new Set(["play", "blank"]);
const SWIPE_PX = 24;
const ARROWS = new Set(["up", "left", "down", "right"]);
const OWN_BUTTONS = new Set(["page", "question", "activity"]);

export class TouchKeys {
  /** @type {Record<string, string>} what is printed on each key that the study is played with, Enter and Escape too */ caps = {};
  /** @type {Map<number, string>} which finger is on which key */ #fingers = new Map();
  /** @type {Record<string, string>} what the page says beside the session's words */ texts = {};
  /** @type {Map<number, PointerEvent>} where each finger began that is no press yet */ #origins = new Map();
  isTouched = matchMedia("(pointer: coarse)").matches;
  #looks = "";

  /** @param {HTMLElement} bar @param {Keyboard} keyboard @param {ThumbSticks} sticks @param {() => void} resized */
  constructor(bar, keyboard, sticks, resized) {
    this.bar = bar;
    this.keyboard = keyboard;
    this.sticks = sticks;
    this.resized = resized;
    bar.addEventListener("contextmenu", (event) => event.preventDefault());
    const release = (/** @type {PointerEvent} */ event) => this.#release(event);
    addEventListener("pointerdown", (event) => {
      if (event.target instanceof HTMLCanvasElement && !event.target.dataset.target) this.#origins.set(event.pointerId, event);
    });
    addEventListener("pointermove", (event) => this.#swipe(event));
    addEventListener("pointerup", release); // a press may lead to a screen with other buttons before the finger is up
    addEventListener("pointercancel", release);
  }

  /** The buttons that a screen needs. @param {ScreenValues} screen */
  show(screen) {
    if (!this.isTouched) return;
    document.documentElement.classList.add("touched");
    const axes = (screen.kind === "play" && screen.axes) || [];
    const names = this.#namesFor(screen);
    const labels = screen.kind === "play" ? new Map(screen.legend.map(([cap, , action]) => [cap, action])) : new Map();
    labels.set(this.caps.escape, screen.kind === "text" && screen.title === this.texts.quit_title ? this.texts.touch_hold : this.texts.touch_leave);
    const looks = JSON.stringify([names, [...labels], axes]);
    if (looks === this.#looks) return;
    this.#looks = looks;
    const arrows = names.filter((name) => ARROWS.has(name)), others = names.filter((name) => !ARROWS.has(name));
    const played = others.filter((name) => name !== "escape");
    this.bar.dataset.columns = String(played.length > 4 ? 3 : played.length || 1);
    const button = (/** @type {string} */ name) => this.#button(name, labels.get(this.caps[name]) ?? this.caps[name]);
    const sticks = this.sticks.draw(axes); // in place of arrows
    const pad = sticks.length ? sticks : arrows.length ? [el("div", { class: "arrows" }, arrows.map(button))] : []; // each where it points
    this.bar.replaceChildren(...pad, ...others.map(button));
    this.bar.hidden = !names.length;
    this.resized();
  }

  /** Take the buttons away: the session is over, and nothing is asked for any more. */
  end() {
    this.bar.hidden = true;
    this.#looks = "";
    this.resized();
  }

  /** @param {ScreenValues} screen @returns {string[]} */
  #namesFor(screen) {
    if (OWN_BUTTONS.has(screen.kind)) return [];
    const played = Object.keys(this.caps).filter((name) => name !== "enter" && name !== "escape");
    const isPlayed = KEYS_OF.has(screen.kind) || (screen.kind === "text" && (screen.keys.length > 0 || !screen.prompt));
    const writes = screen.kind === "play" && screen.messages?.new_entry;
    return [...(isPlayed ? played : ["enter"]), ...(writes ? ["enter"] : []), "escape"];
  }

  /** @param {string} name @param {string} label */
  #button(name, label) {
    const button = el("button", { type: "button", tabindex: "-1", class: name === "escape" ? "quit" : "", "data-key": name, translate: "no", text: label });
    button.addEventListener("pointerdown", (event) => {
      event.preventDefault(); // the focus stays where it is
      this.#fingers.set(event.pointerId, name);
      button.classList.add("down");
      this.keyboard.press(name, "touch", event.timeStamp, event.isTrusted);
    });
    button.addEventListener("click", (event) => { // that no pointer made is a screen reader's
      if (event.detail !== 0) return;
      this.keyboard.press(name, "touch", event.timeStamp, event.isTrusted);
      this.keyboard.release(name, event.timeStamp, event.isTrusted);
    });
    return button;
  }

  // It is a press from where its way is known until the finger is up.
  /** @param {PointerEvent} event */
  #swipe({ pointerId, clientX, clientY, timeStamp, isTrusted }) {
    const from = this.isTouched && this.#origins.get(pointerId);
    if (!from) return;
    const x = clientX - from.clientX, y = clientY - from.clientY;
    if (Math.hypot(x, y) < SWIPE_PX) return;
    this.#origins.delete(pointerId);
    const name = Math.abs(x) > Math.abs(y) ? (x < 0 ? "left" : "right") : (y < 0 ? "up" : "down");
    if (!this.caps[name]) return;
    this.#fingers.set(pointerId, name);
    this.keyboard.press(name, "touch", timeStamp, isTrusted);
  }

  /** @param {PointerEvent} event */
  #release(event) {
    this.#origins.delete(event.pointerId);
    const name = this.#fingers.get(event.pointerId);
    if (name === undefined) return;
    this.#fingers.delete(event.pointerId);
    this.bar.querySelector(`[data-key="${name}"]`)?.classList.remove("down");
    this.keyboard.release(name, event.timeStamp, event.isTrusted);
  }
}
