// Keys, the pointer and the window's focus, stamped and handed on; what they mean is not decided here.

const REPEAT_DELAY_MS = 500;
const REPEAT_PERIOD_MS = 33;
const LEFT_TO_BROWSER = new Set(["F5", "F11"]);

/**
 * @typedef {object} KeyListener
 * @property {() => boolean} isActive
 * @property {() => boolean} isTyping whether letters go into a field
 * @property {() => boolean} isChatting whether that field is for words to a partner
 * @property {() => boolean} isScrollable whether arrows up and down are the browser's
 * @property {() => number} now
 * @property {(ms: number) => number} timeOf
 * @property {(key: string, symbol: string, stamp: number, isTrusted: boolean, isRepeat: boolean) => void} press
 * @property {(key: string, stamp: number, isTrusted: boolean) => void} release
 */

/** Keys by their place on the keyboard, with a repetition of our own: the same on every system. */
export class Keyboard {
  /** @type {Record<string, string>} the session's names */ codes = {};
  /** @type {Set<string>} */ #down = new Set();
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;

  /** @param {EventTarget} target @param {KeyListener} listener */
  constructor(target, listener) {
    this.listener = listener;
    target.addEventListener("keydown", (event) => this.#press(/** @type {KeyboardEvent} */ (event)), { capture: true });
    target.addEventListener("keyup", (event) => this.#release(/** @type {KeyboardEvent} */ (event)), { capture: true });
  }

  /** Forget what is held down: the window that lost the focus is not told of keys that come up. */
  clear() {
    this.#down.clear();
    clearTimeout(this.#timer);
  }

  /** @param {string} code */
  #nameOf(code) { return this.codes[code] ?? `code_${code.replace(/[^A-Za-z0-9]/g, "").slice(0, 24)}`; }

  /** @param {KeyboardEvent} event */
  #press(event) {
    if (!this.listener.isActive()) return;
    const key = this.#nameOf(event.code);
    const isTyping = this.listener.isTyping();
    const isShortcut = event.ctrlKey || event.metaKey || event.altKey;
    const composes = event.isComposing || (isTyping && event.keyCode === 229); // Safari: the Enter that ends it, too
    const isLetter = isTyping && event.key.length === 1;
    const scrolls = (event.code === "ArrowUp" || event.code === "ArrowDown") && this.listener.isScrollable();
    if (!isShortcut && !scrolls && !LEFT_TO_BROWSER.has(event.code) && !isLetter && !composes) event.preventDefault();
    if (event.repeat || composes || (isLetter && this.listener.isChatting())) return; // what is said is no key of the game's
    this.press(key, event.key.length === 1 ? event.key : "", event.timeStamp, event.isTrusted);
  }

  /** A key went down, or a button that stands for it. @param {string} key @param {string} symbol @param {number} ms @param {boolean} isTrusted */
  press(key, symbol, ms, isTrusted) {
    if (!this.listener.isActive() || this.#down.has(key)) return;
    this.#down.add(key);
    this.listener.press(key, symbol, this.listener.timeOf(ms), isTrusted, false);
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#repeat(key, symbol), REPEAT_DELAY_MS);
  }

  /** It came up. @param {string} key @param {number} ms @param {boolean} isTrusted */
  release(key, ms, isTrusted) {
    if (!this.listener.isActive() || !this.#down.delete(key)) return;
    clearTimeout(this.#timer);
    this.listener.release(key, this.listener.timeOf(ms), isTrusted);
  }

  /** @param {string} key @param {string} symbol */
  #repeat(key, symbol) {
    if (!this.#down.has(key)) return;
    this.#timer = setTimeout(() => this.#repeat(key, symbol), REPEAT_PERIOD_MS);
    this.listener.press(key, symbol, this.listener.now(), true, true);
  }

  /** @param {KeyboardEvent} event */
  #release(event) {
    const key = this.#nameOf(event.code);
    if (!this.listener.isActive() || !this.#down.has(key)) return;
    const up = event.key === "Meta" ? [...this.#down] : [key]; // a Mac says nothing of keys that come up beside Command
    for (const one of up) this.release(one, event.timeStamp, event.isTrusted);
  }
}

/** @typedef {{ what: "pressed" | "moved" | "released", target: string | undefined, along: number, x: number, y: number, ms: number }} Point */

/**
 * Hand on what the pointer does to elements that have a `data-target`. @param {HTMLElement} main
 * @param {{ isActive(): boolean, point(point: Point): void }} listener
 */
export function listenToPointer(main, listener) {
  /** @type {HTMLElement | null} */ let pressed = null;
  const unit = (/** @type {number} */ value) => Math.min(1, Math.max(0, value));

  /** @param {Point["what"]} what @param {MouseEvent} event @param {HTMLElement} element */
  const point = (what, event, element) => {
    const box = element.getBoundingClientRect();
    const along = box.width ? unit((event.clientX - box.left) / box.width) : 0;
    const { direction } = getComputedStyle(element);
    listener.point({
      what, ms: event.timeStamp, target: element.dataset.target, along: direction === "rtl" ? 1 - along : along,
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
  const release = (/** @type {PointerEvent} */ event) => {
    if (pressed) point("released", event, drawn(pressed) ?? pressed);
    pressed = null;
  };

  addEventListener("pointerdown", (event) => {
    const element = targetOf(event);
    if (!element || pressed || event.button !== 0 || !listener.isActive()) return;
    pressed = element;
    element.setPointerCapture?.(event.pointerId);
    point("pressed", event, element);
  });
  addEventListener("pointermove", (event) => {
    const element = pressed?.dataset.drag !== undefined ? drawn(pressed) : null;
    if (element) point("moved", event, element);
  });
  addEventListener("pointerup", release);
  addEventListener("pointercancel", release);
  addEventListener("click", (event) => { // that no pointer made is a screen reader's
    const element = targetOf(event);
    if (!element || event.detail !== 0 || pressed || !listener.isActive()) return;
    point("pressed", event, element);
    point("released", event, element);
  });
}

/**
 * Hand on whenever the page may have gained or lost the focus. @param {(hasFocus: boolean) => void} listener
 * @returns {() => void} looks at once
 */
export function listenToFocus(listener) {
  const look = () => listener(document.hasFocus() && !document.hidden);
  addEventListener("focus", look);
  addEventListener("blur", look);
  document.addEventListener("visibilitychange", look);
  return look;
}
