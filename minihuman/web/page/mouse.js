// The mouse as two axes: while an episode that is steered by it plays, its motion in pixels, some 60 times a second. The
// browser hides and keeps the pointer (Pointer Lock) from a click on the picture until Escape, or until another screen.

/** @import { PageMessage, ScreenValues } from "./messages" */
/** @typedef {"mouse_x" | "mouse_y"} MouseAxis */

const MOST_PX = 4096; // of one message, as minihuman/web/messages.py has it
const LEAST_MS = 15; // between messages of an axis: a mouse may tell of a thousand motions a second, and keys share the line

export class MouseLook {
  /** @type {Record<string, string>} what the page says beside the session's words */ texts = {};
  /** @type {MouseAxis[]} that the screen is steered by */ #axes = [];
  /** @type {Map<MouseAxis, number>} not sent yet, px */ #moved = new Map();
  #ms = 0; // when it moved last
  #sent_ms = -Infinity; // when its motion was sent last
  #isAwaited = false; // the frame in which to send what moved since
  #isKept = false; // captured again at the next screen that wants it: the participant has not pressed Escape
  #isReleased = false; // by the page, for another screen

  // Whether motion waits for the next step is asked of `isBehind`, as with a gamepad's sticks.
  /** @param {HTMLElement} main @param {(what: PageMessage, ms: number) => void} send @param {() => boolean} isBehind */
  constructor(main, send, isBehind) {
    this.main = main;
    this.send = send;
    this.isBehind = isBehind;
    addEventListener("click", (event) => {
      if (this.#axes.length && event.target instanceof HTMLCanvasElement) this.#capture();
    });
    addEventListener("mousemove", (event) => this.#move(event));
    document.addEventListener("pointerlockchange", () => {
      this.#isKept = this.#isCaptured || this.#isReleased;
      this.#isReleased = false;
      this.#moved.clear();
      this.say();
    });
  }

  get #isCaptured() { return document.pointerLockElement === this.main; }

  /** What a screen is steered by. @param {ScreenValues} screen */
  show(screen) {
    const axes = (screen.kind === "play" && screen.axes) || [];
    this.#axes = /** @type {MouseAxis[]} */ (axes.filter((axis) => axis.startsWith("mouse_")));
    if (this.#axes.length && this.#isKept && !this.#isCaptured) this.#capture();
    if (this.#axes.length || !this.#isCaptured) return;
    this.#isReleased = true;
    document.exitPointerLock();
    this.#moved.clear();
  }

  /** Say below the picture how to begin, until that is done. */
  say() {
    const line = this.main.querySelector(".look");
    const isAsked = this.#axes.length && !this.#isCaptured && matchMedia("(any-pointer: fine)").matches;
    if (line) line.textContent = isAsked ? this.texts.mouse_look : "";
  }

  #capture() {
    // Refused where nobody has clicked, or right after Escape: the line below the picture stays.
    const asked = /** @type {Promise<void> | undefined} */ (/** @type {unknown} */ (this.main.requestPointerLock()));
    asked?.catch(() => {});
  }

  /** @param {MouseEvent} event */
  #move({ movementX, movementY, timeStamp }) {
    if (!this.#isCaptured) return;
    for (const [axis, px] of /** @type {[MouseAxis, number][]} */ ([["mouse_x", movementX], ["mouse_y", movementY]])) {
      if (this.#axes.includes(axis)) this.#moved.set(axis, (this.#moved.get(axis) ?? 0) + px);
    }
    this.#ms = timeStamp;
    this.#sendInTime(timeStamp);
  }

  /** Send the motion, unless some was sent just before: then in a frame to come. @param {number} now_ms */
  #sendInTime(now_ms) {
    if (now_ms - this.#sent_ms >= LEAST_MS) {
      this.#sent_ms = now_ms;
      if (!this.isBehind()) this.sendMotion();
    } else if (!this.#isAwaited) {
      this.#isAwaited = true;
      requestAnimationFrame((frame_ms) => {
        this.#isAwaited = false;
        this.#sendInTime(frame_ms);
      });
    }
  }

  /** Send what waited for a step: it was sent just now. */
  sendMotion() {
    for (const [axis, px] of this.#moved) {
      const pixels = Math.max(-MOST_PX, Math.min(MOST_PX, Math.trunc(px)));
      this.#moved.set(axis, px - Math.trunc(px)); // less than a pixel stays
      if (pixels) this.send({ t: "motion", axis, pixels }, this.#ms);
    }
  }
}
