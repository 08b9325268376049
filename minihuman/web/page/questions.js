// The widgets of answers, and the field for answers in words: typed letter by letter, or by an input method.

import { el, words } from "./elements.js";
import { NativeField } from "./field.js";

/** @import { FieldMessage } from "./messages" */
/** @import { AnswerWidget, CanvasShape, OptionList, RatingMatrix, RatingScale, ScreenMessage, ShapeCanvas, Slider, TextField } from "./messages" */

const MAX_LETTERS = 1000; // in a message

/**
 * @param {string} label @param {number} index @param {{ chosen: boolean, at: boolean, many: boolean }} state
 * @param {HTMLElement | null} [extra]
 */
const optionOf = (label, index, { chosen, at, many }, extra) => el("div", {
  class: `option${chosen ? " chosen" : ""}${at ? " at" : ""}`, role: many ? "checkbox" : "radio",
  "aria-checked": String(chosen), "data-target": `option:${index}`, tabindex: "-1",
}, el("span", { class: many ? "box many" : "box" }), el("span", { text: label }), extra);

/** @param {{ low: string, high: string }} item */
const endsOf = ({ low, high }) => el("div", { class: "ends" }, el("span", { text: low }), el("span", { text: high }));

const percent = (/** @type {number} */ share) => `${100 * share}%`;
/** Black or white, whichever has the higher contrast on a colour (WCAG). @param {string} fill "#rrggbb" */
const inkOn = (fill) => {
  const [red, green, blue] = [1, 3, 5].map((from) => parseInt(fill.slice(from, from + 2), 16) / 255)
    .map((channel) => (channel <= 0.04045 ? channel / 12.92 : ((channel + 0.055) / 1.055) ** 2.4));
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.179 ? "#000" : "#fff";
};
/** @param {CanvasShape} shape */
const shapeOf = ({ x, y, width, height, label, target, chosen, is_round: isRound, fill, accessible_name: name, has_box: hasBox }) => el("div", {
  class: ["shape", chosen && "chosen", isRound && "round", fill && hasBox && "filled", !hasBox && "bare"].filter(Boolean).join(" "),
  tabindex: target ? "-1" : null, "data-target": target || null,
  role: target ? "radio" : null, "aria-checked": target ? String(chosen) : null,
  "aria-label": target ? name || label || target : null, text: label,
  style: {
    left: percent(x), top: percent(y), width: percent(width), height: percent(height),
    ...(fill && hasBox ? { background: fill, color: inkOn(fill) } : {}),
  },
});

/** One function per form. */
const widgets = {
  OptionList: (/** @type {OptionList} */ item) => el("div",
    { class: "options", role: item.many ? "group" : "radiogroup", "aria-labelledby": "ask" },
    item.options.map((label, index) => optionOf(label, index,
      { chosen: item.chosen.includes(index), at: index === item.cursor, many: item.many },
      index < 9 ? el("span", { class: "number", "aria-hidden": "true", translate: "no", text: index + 1 }) : null))),
  RatingScale: (/** @type {RatingScale} */ item) => el("div", { class: "scale" },
    el("div", { class: "points", role: "radiogroup", "aria-labelledby": "ask" }, item.points.map((label, index) =>
      optionOf(label, index, { chosen: index === item.chosen, at: false, many: false }))),
    endsOf(item)),
  RatingMatrix: (/** @type {RatingMatrix} */ item) => el("div", { class: "scale matrix" },
    item.rows.map((statement, row) => el("div", { class: row === item.cursor ? "row at" : "row" },
      el("p", { id: `row${row}`, text: statement }),
      el("div", { class: "points", role: "radiogroup", "aria-labelledby": `row${row}` }, item.points.map((label, point) =>
        optionOf(label, row * item.points.length + point, { chosen: point === item.chosen[row], at: false, many: false }))))),
    endsOf(item)),
  Slider: (/** @type {Slider} */ item) => el("div", { class: "scale" },
    el("div", {
      class: "slider", "data-target": "slider", "data-drag": true, role: "slider", tabindex: "-1", "aria-labelledby": "ask",
      "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": Math.round((item.position ?? 0.5) * 100),
      "aria-valuetext": item.value || (item.position === null ? "–" : `${Math.round(item.position * 100)} %`),
    }, el("div", { class: "track" }),
    Array.from({ length: item.ticks + 1 }, (_, tick) =>
      el("div", { class: "tick", style: { insetInlineStart: percent(tick / item.ticks) } })),
    item.position === null ? null : el("div", { class: "thumb", style: { insetInlineStart: percent(item.position) } })),
    el("p", { class: "value", text: item.value }),
    endsOf(item)),
  ShapeCanvas: (/** @type {ShapeCanvas} */ item) => el("div",
    { class: "shapes", role: "radiogroup", "aria-labelledby": "ask",
      style: { aspectRatio: String(item.aspect), width: `calc(min(50vh, 24rem) * ${item.aspect})` } },
    item.shapes.map(shapeOf)),
  TextField: (/** @type {TextField} */ item, /** @type {TextEntry} */ entry) =>
    el("div", { class: "entry" }, entry.open(item), words("span", "unit", item.unit), entry.limitNote),
};

/** @param {AnswerWidget} item @param {TextEntry} entry @returns {HTMLElement} */
export const drawWidget = (item, entry) => /** @type {any} */ (widgets)[item.form](item, entry);

/** A text and a caret in it, as a key leaves them. @typedef {{ text: string, caret: number }} Draft */
/**
 * @param {Draft} draft @param {string} key @param {{ rtl: boolean, long: boolean }} field
 * @returns {Draft | null} null for a key that edits nothing
 */
export function editDraft({ text, caret }, key, { rtl, long }) {
  const before = text.slice(0, caret);
  const after = text.slice(caret);
  const last = [...before].pop() ?? "";
  const following = [...after][0] ?? "";
  switch (key) {
    case "backspace": return { text: before.slice(0, before.length - last.length) + after, caret: caret - last.length };
    case "delete": return { text: before + after.slice(following.length), caret };
    case "left":
    case "right": {
      const by = (key === "right" ? 1 : -1) * (rtl ? -1 : 1);
      const to = caret + by * ((by > 0 ? following : last).length || 1);
      return { text, caret: Math.min(text.length, Math.max(0, to)) };
    }
    case "home": return { text, caret: 0 };
    case "end": return { text, caret: text.length };
    case "enter":
    case "kp_enter": return long ? { text: `${before}\n${after}`, caret: caret + 1 } : null;
    default: return null;
  }
}

/** The field that is typed into, and what is in it before the server has said so. */
export class TextEntry {
  /** @type {HTMLInputElement | HTMLTextAreaElement | null} */ #field = null;
  /** @type {HTMLInputElement | HTMLTextAreaElement | null} in which an input method is at work */ #composed = null;
  /** @type {ScreenMessage | null} drawn once that is done: taken off the page for a moment, the field would lose its work */
  #late = null;
  /** @type {Draft} */ #draft = { text: "", caret: 0 };
  #drawn = "";
  /** @type {NativeField | null} where the browser edits */ #native = null;
  #nativeEntry = ""; // for which question

  /**
   * @param {() => ScreenMessage | null} current @param {(text: string) => void} type
   * @param {(what: Omit<FieldMessage, "t" | "began">, beganMs: number) => void} send
   * @param {(m: ScreenMessage) => void} show
   */
  constructor(current, type, send, show) {
    this.current = current;
    this.type = type;
    this.send = send;
    this.show = show;
  }

  /** @returns {{ title: string, question: string, rtl: boolean, item: TextField } | null} */
  get #screen() {
    const s = this.current()?.screen;
    if (s?.kind === "play" && s.messages?.entry) return { ...s, title: "", question: "chat", item: s.messages.entry };
    return s?.kind === "question" && s.item.form === "TextField" ? { ...s, item: s.item } : null;
  }
  get isActive() { return this.#screen !== null; }

  /**
   * The field that the browser edits, if it is on the screen and a key that goes down now goes into it. An open message
   * takes all keys, wherever a click has put the focus: none of them is the game's.
   */
  claimKeys() {
    const native = this.#screen?.item.native ? this.#native : null;
    if (!native) return null;
    if (this.current()?.screen.kind === "play") native.element.focus({ preventScroll: true });
    return document.activeElement === native.element ? native : null;
  }

  /** Whether something was typed since this was asked last. */
  takeActed() { return this.#native?.takeActed() ?? false; }

  get limitNote() { return this.#screen?.item.native ? this.#native?.note : null; }

  /** Report what was typed and has not settled. @returns {boolean} whether there was something */
  settle() {
    if (!this.#screen?.item.native || !this.#native?.element.isConnected) return false;
    return this.#native.settle();
  }

  /** One that another screen stood before goes on as it was. @param {TextField} item */
  #openNative(item) {
    if (!this.#native || this.#nativeEntry !== this.#entry || this.#native.reported !== item.text) {
      this.#native = new NativeField(item, {
        isCurrent: () => this.#entry === this.#nativeEntry,
        send: this.send,
        composed: () => {
          const late = this.#late;
          if (late === this.current() && late) this.show(late);
        },
      });
      this.#nativeEntry = this.#entry;
    }
    this.#native.watch();
    return this.#native.element;
  }

  get #entry() {
    const s = this.#screen;
    return s ? `${s.title}\n${s.question}\n${s.item.name}` : "";
  }

  /** @param {TextField} item */
  open(item) {
    if (item.native) return this.#openNative(item);
    const field = this.#field = el(item.long ? "textarea" : "input", {
      "data-target": "field", "aria-labelledby": "ask", autocomplete: "off", autocapitalize: "off", spellcheck: "false",
      type: item.long ? null : "text",
    });
    field.addEventListener("beforeinput", (event) => {
      const { isComposing, inputType, data, dataTransfer } = /** @type {InputEvent} */ (event);
      if (isComposing || inputType === "insertCompositionText") return;
      event.preventDefault();
      const text = data ?? dataTransfer?.getData("text/plain") ?? "";
      if (text && inputType.startsWith("insert")) this.#insert(text);
    });
    field.addEventListener("compositionstart", () => { this.#composed = field; });
    field.addEventListener("compositionend", (event) => {
      this.#composed = null;
      if (this.#field !== field) return; // another screen came
      const { data } = /** @type {CompositionEvent} */ (event);
      if (data) this.#insert(data);
      else this.#put();
      const late = this.#late;
      if (late === this.current() && late) this.show(late);
    });
    return field;
  }

  /**
   * Draw a screen around a field that is typed into, which stays the same element. @param {ScreenMessage} m
   * @param {() => boolean} isPending whether the server has not heard of what was typed last @param {() => void} draw
   * @param {() => void} update draws what else may be new around a field that the browser edits: taken off the page, it
   * would lose what can be undone
   * @returns {boolean} whether it was drawn; else it is, once the input method is done
   */
  redraw(m, isPending, draw, update) {
    const s = this.#screen;
    const entry = this.#entry;
    if (s?.item.native) return this.#redrawNative(m, s.item, isPending, draw, update);
    const field = entry && entry === this.#drawn ? this.#field : null;
    if (field && field === this.#composed) {
      this.#late = m;
      return false;
    }
    this.#late = null;
    this.#field = null;
    draw();
    this.#drawn = entry;
    if (!s) return true;
    if (!field || !isPending()) this.#draft = { text: s.item.text, caret: [...s.item.text].slice(0, s.item.caret).join("").length };
    if (field) { this.#opened()?.replaceWith(field); this.#field = field; }
    this.#put();
    this.#opened()?.focus();
    return true;
  }

  /**
   * @param {ScreenMessage} m @param {TextField} item @param {() => boolean} isPending @param {() => void} draw
   * @param {() => void} update
   */
  #redrawNative(m, item, isPending, draw, update) {
    const isSame = this.#nativeEntry === this.#entry && this.#native?.element.isConnected;
    if (isSame && this.#native?.isComposing) {
      this.#late = m;
      return false;
    }
    this.#late = null;
    this.#field = null;
    if (isSame && this.#drawn === this.#entry) {
      if (!isPending()) this.#native?.accept(item.text);
      update();
      return true;
    }
    draw();
    this.#drawn = this.#entry;
    this.#native?.element.focus();
    return true;
  }

  #opened() { return this.#field; }

  /** @param {string} input */
  #insert(input) {
    const text = input.replace(/\p{Surrogate}/gu, "\ufffd"); // half of a letter, which no log holds
    const letters = [...text];
    for (let from = 0; from < letters.length; from += MAX_LETTERS) this.type(letters.slice(from, from + MAX_LETTERS).join(""));
    const { text: before, caret } = this.#draft;
    this.#draft = { text: before.slice(0, caret) + text + before.slice(caret), caret: caret + text.length };
    if (this.isActive) this.#put();
  }

  /** @param {string} key */
  edit(key) {
    if (this.#screen?.item.native) return;
    const s = this.#screen;
    const edited = s && editDraft(this.#draft, key, { rtl: s.rtl, long: s.item.long });
    if (!edited) return;
    this.#draft = edited;
    this.#put();
  }

  #put() {
    if (!this.#field) return;
    const { text, caret } = this.#draft;
    if (this.#field.value !== text) this.#field.value = text;
    this.#field.setSelectionRange(caret, caret);
  }
}
