// A gamepad, read once a frame: its buttons as keys, its sticks and triggers as axes, named as in minihuman/experiment/keys.py.

/** @import { Keyboard } from "./input.js" */
/** @import { PageMessage } from "./messages" */
const BUTTONS = [ // of the standard mapping (W3C Gamepad); two of them do what the session asks keys for
  "pad_south", "pad_east", "pad_west", "pad_north", "pad_left_shoulder", "pad_right_shoulder", "pad_left_trigger",
  "pad_right_trigger", "escape", "enter", "pad_left_stick", "pad_right_stick", "pad_up", "pad_down", "pad_left", "pad_right",
];
/** @type {import("./messages").AxisMessage["axis"][]} */ const AXES = [
  "pad_left_x", "pad_left_y", "pad_right_x", "pad_right_y", "pad_left_trigger", "pad_right_trigger",
];
const DEAD_ZONE = 0.1, LEVELS = 128;
/** @type {Record<string, [minus: string, plus: string]>} */
const WAYS = { pad_left_x: ["stick_left", "stick_right"], pad_left_y: ["stick_up", "stick_down"] };

const NONE = { id: "", axes: [], buttons: [] };

/** Whether one is there that the page can read: a browser shows none before a button of it is pressed. */
export const findGamepad = () => navigator.getGamepads().find((pad) => pad?.connected && pad.mapping === "standard");

/** An axis as it is logged: beyond the dead zone, in steps. @param {number} raw */
export const levelOf = (raw) => (Math.sign(raw) * Math.round(
  (Math.max(0, Math.min(1, Math.abs(raw)) - DEAD_ZONE) / (1 - DEAD_ZONE)) * LEVELS)) / LEVELS || 0;

/** @param {Pick<Gamepad, "axes" | "buttons">} pad @param {number} number of the axis */
const levelIn = (pad, number) => levelOf((number < 4 ? pad.axes[number] : pad.buttons[number + 2]?.value) ?? 0);

export class GamepadReader {
  isWanted = false; // by the study
  /** @type {Set<string>} */ #down = new Set();
  /** @type {Map<string, number>} */ #levels = new Map();
  /** @type {Set<string>} axes that were moved when the focus came: at rest, until they have been */ #heldAxes = new Set();
  #name = "";
  #seenName = ""; // of the pad that was there last
  #readMs = 0; // when it was read last
  #hadFocus = false; // at that reading

  // Whether sticks are read later is asked of `isBehind`: each move makes the step that is due.
  /** @param {Keyboard} keyboard @param {() => boolean} hasFocus @param {(what: PageMessage, ms?: number) => void} send @param {() => boolean} isBehind */
  constructor(keyboard, hasFocus, send, isBehind) {
    this.keyboard = keyboard;
    this.hasFocus = hasFocus;
    this.send = send;
    this.isBehind = isBehind;
  }

  /** Read it from now on, or never. @param {boolean} isWanted */
  want(isWanted) {
    if (isWanted && !this.isWanted) this.#read();
    this.isWanted = isWanted;
  }

  #read() {
    requestAnimationFrame(() => this.#read());
    const pad = findGamepad();
    const now = performance.now();
    // Unplugged: its buttons are up, its sticks at rest. Without the focus the session has let go of its presses.
    const hasFocus = this.hasFocus();
    if (!hasFocus) this.#down.clear();
    else if (pad ?? this.#name) this.#report(pad ?? NONE, this.#timeOf(pad, now));
    this.#readMs = now;
    this.#hadFocus = hasFocus;
  }

  /** When it changed: since it was read last. @param {Gamepad | null | undefined} pad @param {number} now */
  #timeOf(pad, now) { return Math.max(this.#readMs, Math.min(now, pad?.timestamp || now)); }

  /** Read the sticks that waited for a step: it was sent just now. */
  readSticks() {
    const pad = this.isWanted && this.hasFocus() && findGamepad();
    if (pad) this.#move(pad, this.#timeOf(pad, performance.now()));
  }

  /** @param {Pick<Gamepad, "id" | "axes" | "buttons">} pad @param {number} ms */
  #report(pad, ms) {
    if (pad.id !== this.#name) {
      this.#name = pad.id;
      if (pad.id) this.send({ t: "pad", id: pad.id.slice(0, 64), axes: pad.axes.length, buttons: pad.buttons.length });
    }
    // What is down at the first reading with the focus was pressed before. The button by which a browser first shows a
    // pad is no such one: it does so to the page in front alone.
    const isHeld = !this.#hadFocus && this.#readMs > 0 && pad.id === this.#seenName;
    this.#seenName = pad.id || this.#seenName;
    if (isHeld) AXES.forEach((axis, number) => { if (levelIn(pad, number)) this.#heldAxes.add(axis); });
    BUTTONS.forEach((name, number) => this.#hold(name, pad.buttons[number]?.pressed ?? false, ms, isHeld));
    if (isHeld || !this.isBehind()) this.#move(pad, ms);
  }

  /** @param {Pick<Gamepad, "axes" | "buttons">} pad @param {number} ms */
  #move(pad, ms) {
    AXES.forEach((axis, number) => {
      const level = levelIn(pad, number);
      if (!level) this.#heldAxes.delete(axis);
      const value = this.#heldAxes.has(axis) ? 0 : level;
      if (value !== (this.#levels.get(axis) ?? 0)) {
        this.#levels.set(axis, value);
        this.send({ t: "axis", axis, value }, ms);
      }
      (WAYS[axis] ?? []).forEach((way, side) => {
        const reach = side ? level : -level;
        this.#hold(way, reach > (this.#down.has(way) ? 0.4 : 0.5), ms, this.#heldAxes.has(axis));
      });
    });
  }

  /** @param {string | undefined} name @param {boolean} isDown @param {number} ms @param {boolean} isHeld before the focus */
  #hold(name, isDown, ms, isHeld = false) {
    if (!name || isDown === this.#down.has(name)) return;
    if (isDown) { this.#down.add(name); this.keyboard.press(name, "gamepad", ms, true, isHeld ? "held_before_focus" : "finger"); }
    else { this.#down.delete(name); this.keyboard.release(name, ms, true); }
  }
}
