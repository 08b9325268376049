// Keys, the pointer and the window's focus, stamped and handed on; what they mean is not decided here.

import { isSessionKey } from "./field.js";

const REPEAT_DELAY_MS = 500;
const REPEAT_PERIOD_MS = 33;
// Firefox under X11 calls the system's repetition of a key that was down before the focus came a press. It comes by
// FRESH_MS after the focus, and the next one by DOUBT_MS after it: of a finger's press, none comes so soon.
const FRESH_MS = 1000, DOUBT_MS = 150;
const LEFT_TO_BROWSER = new Set(["F5", "F11"]);
const MODIFIERS = /^(Control|Alt|Meta|OS|Shift)(Left|Right)$|^(CapsLock|NumLock)$/;

/** @import { NativeField } from "./field.js" */
/** @typedef {"finger" | "held_before_focus" | "shortcut"} PressCause as minihuman/experiment/machine/inputs.py has it */

/**
 * @typedef {object} KeyListener
 * @property {() => boolean} isActive
 * @property {() => boolean} isTyping whether letters go into a field
 * @property {() => boolean} isChatting whether that field is for words to a partner
 * @property {() => NativeField | null} nativeField that keys go into and the browser edits
 * @property {() => boolean} isScrollable whether arrows up and down are the browser's
 * @property {() => number} now
 * @property {(ms: number) => number} timeOf
 * @property {(key: string, symbol: string, stamp: number, isTrusted: boolean, isRepeat: boolean, cause: PressCause) => void} press
 * @property {(key: string, stamp: number, isTrusted: boolean, cause: "finger" | "focus_loss") => void} release
 */

/** Keys by their place on the keyboard, with a repetition of our own: the same on every system. */
export class Keyboard {
  /** @type {Record<string, string>} the session's names */ codes = {};
  /** @type {Set<string>} */ #down = new Set();
  /** @type {Set<string>} that are down and were not handed on: their releases are not either */ #passedOver = new Set();
  /** @type {Set<string>} that were pressed since the focus came */ #pressed = new Set();
  /** @type {Map<string, { symbol: string, ms: number, isTrusted: boolean, timer: ReturnType<typeof setTimeout> }>} presses of which is not known yet whether a finger made them, in their order */
  #doubtful = new Map();
  #cameMs = performance.now(); // when the focus came
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;

  /** @param {EventTarget} target @param {KeyListener} listener @param {string} [browser] its user agent */
  constructor(target, listener, browser = "") {
    this.listener = listener;
    this.hasDoubts = /X11.*Firefox/.test(browser);
    target.addEventListener("keydown", (event) => this.#press(/** @type {KeyboardEvent} */ (event)), { capture: true });
    target.addEventListener("keyup", (event) => this.#release(/** @type {KeyboardEvent} */ (event)), { capture: true });
  }

  /** The focus comes. @param {number} ms when, by the event's own time */
  come(ms) { this.#cameMs = ms; }

  /** The focus goes: keys that are down come up in another window, which alone is told. */
  releaseAll() {
    clearTimeout(this.#timer);
    for (const { timer } of this.#doubtful.values()) clearTimeout(timer);
    this.#doubtful.clear();
    this.#passedOver.clear();
    this.#pressed.clear();
    const keys = [...this.#down];
    this.#down.clear();
    for (const key of keys) this.listener.release(key, this.listener.now(), true, "focus_loss");
  }

  /** @param {string} code */
  #nameOf(code) { return this.codes[code] ?? `code_${code.replace(/[^A-Za-z0-9]/g, "").slice(0, 24)}`; }

  /** A keyboard on a screen has no places of keys, but its Enter is one. @param {KeyboardEvent} event */
  #nameIn({ code, key }) { return this.#nameOf(code === "" && key === "Enter" ? key : code); }

  /** @param {KeyboardEvent} event */
  #press(event) {
    const key = this.#nameIn(event);
    if (!this.listener.isActive()) { this.#passedOver.add(key); return; }
    const isTyping = this.listener.isTyping();
    const field = this.listener.nativeField();
    if (field && this.#isFieldKey(event, key, field)) {
      this.#passedOver.add(key);
      if (event.isTrusted) field.countKey();
      return;
    }
    const isChord = (event.ctrlKey || event.metaKey || event.altKey) && !event.getModifierState("AltGraph");
    const isShortcut = isChord && !MODIFIERS.test(event.code);
    const composes = event.isComposing || (isTyping && event.keyCode === 229); // Safari: the Enter that ends it, too
    const isLetter = isTyping && event.key.length === 1;
    const scrolls = (event.code === "ArrowUp" || event.code === "ArrowDown") && this.listener.isScrollable();
    if (!isChord && !scrolls && !LEFT_TO_BROWSER.has(event.code) && !isLetter && !composes) event.preventDefault();
    if (composes || (isLetter && this.listener.isChatting())) { // what is said is no key of the game's
      this.#passedOver.add(key);
      return;
    }
    const doubted = this.#doubtful.get(key);
    if (doubted) {
      this.#judge(key, event.timeStamp - doubted.ms < DOUBT_MS ? "held_before_focus" : "finger");
      return;
    }
    // A repeat of a key that nobody pressed here: it was down when the focus came.
    if (event.repeat && (this.#down.has(key) || this.#passedOver.has(key))) return;
    const cause = event.repeat ? "held_before_focus" : isShortcut ? "shortcut" : "finger";
    const symbol = event.key.length === 1 ? event.key : "";
    const isFresh = this.hasDoubts && event.timeStamp - this.#cameMs < FRESH_MS && !this.#pressed.has(key);
    if (isFresh && cause === "finger" && !this.#down.has(key)) {
      const timer = setTimeout(() => this.#judge(key, "finger"), DOUBT_MS);
      this.#doubtful.set(key, { symbol, ms: event.timeStamp, isTrusted: event.isTrusted, timer });
    } else {
      this.#believe();
      this.press(key, symbol, event.timeStamp, event.isTrusted, cause);
    }
  }

  /** It is known what made a press; those before it were a finger's. @param {string} key @param {PressCause} cause */
  #judge(key, cause) {
    this.#believe(key);
    const press = this.#doubtful.get(key);
    if (!press) return;
    clearTimeout(press.timer);
    this.#doubtful.delete(key);
    this.press(key, press.symbol, press.ms, press.isTrusted, cause);
  }

  /** Presses before another were a finger's. @param {string} [before] */
  #believe(before) {
    for (const key of [...this.#doubtful.keys()]) {
      if (key === before) return;
      this.#judge(key, "finger");
    }
  }

  // The browser's alone, and not in the log: with them, what was typed and taken back would be.
  /** @param {KeyboardEvent} event @param {string} key @param {NativeField} field */
  #isFieldKey(event, key, { item }) {
    const isChord = event.ctrlKey || event.metaKey || event.altKey;
    return isChord || event.isComposing || event.keyCode === 229 || !isSessionKey(key, item.long);
  }

  /**
   * A key went down, or a button that stands for it. @param {string} key @param {string} symbol @param {number} ms
   * @param {boolean} isTrusted @param {PressCause} cause
   */
  press(key, symbol, ms, isTrusted, cause = "finger") {
    if (!this.listener.isActive() || this.#down.has(key)) return;
    this.#down.add(key);
    this.#pressed.add(key);
    this.listener.press(key, symbol, this.listener.timeOf(ms), isTrusted, false, cause);
    clearTimeout(this.#timer);
    if (cause === "finger") this.#timer = setTimeout(() => this.#repeat(key, symbol), REPEAT_DELAY_MS);
  }

  /** It came up. @param {string} key @param {number} ms @param {boolean} isTrusted */
  release(key, ms, isTrusted) {
    if (!this.listener.isActive() || !this.#down.delete(key)) return;
    clearTimeout(this.#timer);
    this.listener.release(key, this.listener.timeOf(ms), isTrusted, "finger");
  }

  /** @param {string} key @param {string} symbol */
  #repeat(key, symbol) {
    if (!this.#down.has(key)) return;
    this.#timer = setTimeout(() => this.#repeat(key, symbol), REPEAT_PERIOD_MS);
    this.listener.press(key, symbol, this.listener.now(), true, true, "finger");
  }

  /** @param {KeyboardEvent} event */
  #release(event) {
    const key = this.#nameIn(event);
    if (this.#passedOver.delete(key) || !this.listener.isActive()) return;
    this.#judge(key, "finger"); // it came up before it was repeated
    // Only its release is seen: it was down when the focus came.
    if (!this.#down.has(key) && !this.#pressed.has(key)) this.press(key, "", event.timeStamp, event.isTrusted, "held_before_focus");
    const names = event.key === "Meta" ? [...this.#down] : [key]; // a Mac says nothing of keys that come up beside Command
    for (const name of names) this.release(name, event.timeStamp, event.isTrusted);
  }
}

/**
 * @typedef {{ what: "pressed" | "moved" | "released", target: string | undefined, along: number, x: number, y: number,
 * ms: number, cause?: "held_before_focus" | "cancelled" }} Point
 */

/**
 * Hand on what the pointer does to elements that have a `data-target`. @param {HTMLElement} main
 * @param {{ isActive(): boolean, isBeforeFocus(ms: number): boolean, point(point: Point): void }} listener
 * @returns {() => void} ends a press that is under way: the focus goes
 */
export function listenToPointer(main, listener) {
  /** @type {HTMLElement | null} */ let pressed = null;
  /** @type {MouseEvent | null} */ let last = null; // of that press
  const unit = (/** @type {number} */ value) => Math.min(1, Math.max(0, value));

  /** @param {Point["what"]} what @param {MouseEvent} event @param {HTMLElement} element @param {Point["cause"]} [cause] */
  const point = (what, event, element, cause) => {
    const box = element.getBoundingClientRect();
    const along = box.width ? unit((event.clientX - box.left) / box.width) : 0;
    const { direction } = getComputedStyle(element);
    listener.point({
      what, cause, ms: event.timeStamp, target: element.dataset.target, along: direction === "rtl" ? 1 - along : along,
      ...(element.dataset.target === "picture" // where in the world's picture, not in the window
        ? { x: unit((event.clientX - box.left) / box.width), y: unit((event.clientY - box.top) / box.height) }
        : { x: unit(event.clientX / innerWidth), y: unit(event.clientY / innerHeight) }),
    });
  };
  /** @returns {HTMLElement | null} */
  const targetOf = (/** @type {Event} */ { target }) => (target instanceof Element ? target.closest("[data-target]") : null);
  /** @returns {HTMLElement | null} an answer draws the screen anew: what was pressed has another element then */
  const drawn = (/** @type {HTMLElement} */ element) =>
    (element.isConnected ? element : main.querySelector(`[data-target="${element.dataset.target}"]`));
  /** @param {MouseEvent} event @param {Point["cause"]} [cause] */
  const release = (event, cause) => {
    if (pressed) point("released", event, drawn(pressed) ?? pressed, cause);
    pressed = last = null;
  };

  addEventListener("pointerdown", (event) => {
    const element = targetOf(event);
    if (!element || pressed || event.button !== 0 || !listener.isActive()) return;
    pressed = element;
    last = event;
    element.setPointerCapture?.(event.pointerId);
    // Pressed before the window had the focus: it is the click that brought it.
    point("pressed", event, element, listener.isBeforeFocus(event.timeStamp) ? "held_before_focus" : undefined);
  });
  addEventListener("pointermove", (event) => {
    const element = pressed?.dataset.drag !== undefined ? drawn(pressed) : null;
    if (pressed) last = event;
    if (element) point("moved", event, element);
  });
  addEventListener("pointerup", (event) => release(event));
  addEventListener("pointercancel", (event) => release(event, "cancelled")); // the browser scrolls, say
  addEventListener("click", (event) => { // that no pointer made is a screen reader's
    const element = targetOf(event);
    if (!element || event.detail !== 0 || pressed || !listener.isActive()) return;
    point("pressed", event, element);
    point("released", event, element);
  });
  return () => { if (last) release(last, "cancelled"); };
}

/**
 * Hand on whenever the page may have gained or lost the focus, and when. @param {(hasFocus: boolean, ms: number) => void} listener
 * @returns {() => void} looks at once
 */
export function listenToFocus(listener) {
  const look = (/** @type {Event} */ event) => listener(document.hasFocus() && !document.hidden, event.timeStamp);
  addEventListener("focus", look);
  addEventListener("blur", look);
  document.addEventListener("visibilitychange", look);
  return () => listener(document.hasFocus() && !document.hidden, performance.now());
}
