// A field that the browser edits, caret, selection, undo, input methods and all. The page only says what is in it: the
// whole text, once it settled, and how it came there.

import { el } from "./elements.js";

/** @import { FieldMessage, TextField } from "./messages" */
/** @typedef {NonNullable<FieldMessage["changes"]>[number]} TextChange */
/** @typedef {HTMLTextAreaElement} FieldElement */

const SETTLE_MS = 500; // after the last change
const LOOK_MS = 500; // between looks for changes that no event tells of
const MAX_CHARACTERS = 4000; // of a message
/** @type {TextChange[]} */ const ORDER = ["typed", "pasted", "dropped", "composed", "replaced", "undone", "script"];
/** @type {Record<string, TextChange>} */ const CHANGES = {
  insertFromPaste: "pasted", insertFromPasteAsQuotation: "pasted", insertFromDrop: "dropped", deleteByDrag: "dropped",
  insertCompositionText: "composed", insertFromComposition: "composed", deleteCompositionText: "composed",
  deleteByComposition: "composed", insertReplacementText: "replaced", historyUndo: "undone", historyRedo: "undone",
};

/** A text without what no log holds: control characters but line feed and tab, and halves of letters. @param {string} text */
export const cleanText = (text) => text.replace(/[\0-\x08\x0b-\x1f\x7f]/g, "").replace(/\p{Surrogate}/gu, "\ufffd");

/** Whether the session, not the field, is meant by a key. @param {string} key our name of it @param {boolean} isLong */
export const isSessionKey = (key, isLong) =>
  ["tab", "escape", "f8", "f9", "f12"].includes(key) || (!isLong && ["enter", "kp_enter", "page_up"].includes(key));

export class NativeField {
  /** @type {Set<TextChange>} */ #changes = new Set();
  #keys = 0;
  #acted = false;
  #beganMs = 0; // performance time of the first change that is not reported
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;
  /** @type {ReturnType<typeof setInterval> | undefined} */ #looks;
  /** @type {FieldElement} */ element;

  /**
   * @param {TextField} item
   * @param {{ isCurrent(): boolean, send(what: Omit<FieldMessage, "t" | "began">, beganMs: number): void, composed(): void }} listener
   */
  constructor(item, listener) {
    this.item = item;
    this.listener = listener;
    this.reported = item.text; // what the session has
    this.#seen = item.text;
    this.isComposing = false;
    this.note = el("p", { class: "note limit", role: "alert", hidden: true, text: item.limit_note });
    this.element = el("textarea", {
      "data-target": "field", "aria-labelledby": "ask", autocomplete: "off", dir: "auto",
      class: item.long ? null : "line", rows: item.long ? null : 1,
    });
    this.element.value = item.text;
    this.#lookAtLength([...item.text].length);
    this.element.addEventListener("beforeinput", (event) => this.#refuseBreak(/** @type {InputEvent} */ (event)));
    this.element.addEventListener("input", (event) => this.#input(/** @type {InputEvent} */ (event)));
    this.element.addEventListener("compositionstart", () => { this.isComposing = true; });
    this.element.addEventListener("compositionend", () => {
      this.isComposing = false;
      this.listener.composed();
    });
    this.element.addEventListener("blur", () => this.settle());
  }

  /** It is on the page now, or again. */
  watch() {
    requestAnimationFrame(() => this.#grow()); // it has a width now
    clearInterval(this.#looks);
    this.#looks = setInterval(() => this.#look(), LOOK_MS);
  }

  #seen; // the text after the last change

  countKey() {
    this.#keys += 1;
    this.#acted = true;
  }

  /** Whether something was typed since this was asked last: it may settle much later. */
  takeActed() {
    const acted = this.#acted;
    this.#acted = false;
    return acted;
  }

  /** Take over what the session has, where nothing was changed here. @param {string} text */
  accept(text) {
    if (this.#beganMs || this.isComposing || this.element.value !== this.reported || text === this.reported) return;
    this.element.value = this.#seen = this.reported = text;
  }

  /** A text of one line has no line breaks, and is shown in as many lines as it needs. @param {InputEvent} event */
  #refuseBreak(event) {
    if (!this.item.long && /^insert(LineBreak|Paragraph)$/.test(event.inputType)) event.preventDefault();
  }

  /** @param {InputEvent} event */
  #input({ isTrusted, inputType }) {
    this.#changed(isTrusted ? CHANGES[inputType] ?? "typed" : "script");
  }

  // A program may set the text without an event, as some spelling tools do.
  #look() {
    if (!this.element.isConnected) clearInterval(this.#looks);
    else if (this.element.value !== this.#seen) this.#changed("script");
  }

  /** @param {TextChange} how */
  #changed(how) {
    this.#beganMs ||= performance.now();
    this.#changes.add(how);
    if (!this.isComposing) this.#clean();
    this.#grow();
    this.#seen = this.element.value;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.settle(), SETTLE_MS);
  }

  // What the log cannot hold does not stay on the screen, either.
  #clean() {
    const { element } = this, cleaned = cleanText(element.value);
    const text = this.item.long ? cleaned : cleaned.replace(/\n/g, " "), letters = [...text];
    const kept = letters.length > MAX_CHARACTERS ? letters.slice(0, MAX_CHARACTERS).join("") : text;
    if (kept !== element.value) {
      const { selectionEnd } = element;
      element.value = kept;
      element.setSelectionRange(selectionEnd, selectionEnd);
    }
    this.#lookAtLength(letters.length);
  }

  /** Show the whole of a line that is longer than the field, where the style sheet cannot. */
  #grow() {
    if (this.item.long || globalThis.CSS?.supports("field-sizing", "content")) return;
    const { style, offsetHeight, clientHeight } = this.element;
    style.height = "auto";
    style.height = `${this.element.scrollHeight + offsetHeight - clientHeight}px`;
  }

  /** @param {number} count */
  #lookAtLength(count) { this.note.hidden = !(this.item.longest && count > this.item.longest); }

  /** Report what changed since the last report, if the input method is done. @returns {boolean} whether there was something */
  settle() {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    if (this.isComposing || !this.listener.isCurrent()) return false;
    if (this.element.value !== this.#seen) this.#changed("script");
    clearTimeout(this.#timer);
    const beganMs = this.#beganMs, changes = ORDER.filter((how) => this.#changes.has(how)), keys = this.#keys;
    this.#beganMs = 0;
    this.#changes.clear();
    if (this.element.value === this.reported) return false; // taken back
    this.#keys = 0;
    this.reported = this.element.value;
    this.listener.send({ text: this.reported, name: this.item.name, changes, keys }, beganMs || performance.now());
    return true;
  }
}
