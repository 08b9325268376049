// Elements of the document, made and sized.

/** @typedef {Node | string | null | undefined} Leaf */
/** @typedef {Leaf | Leaf[] | (Leaf | Leaf[])[]} Child */
/** @typedef {Record<string, string | number | boolean | null | undefined | Record<string, string>>} Attributes */

/** @template {keyof HTMLElementTagNameMap} T @param {T} tag @param {Attributes} attributes @param {Child[]} children */
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "style") Object.assign(element.style, value);
    else if (name === "text") element.textContent = String(value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...flatten(children));
  return element;
}

/** @param {Child[]} children @returns {(Node | string)[]} */
export function flatten(children) {
  return /** @type {any[]} */ (children.flat(Infinity)).filter((child) => child !== null && child !== undefined);
}

/** @param {keyof HTMLElementTagNameMap} tag @param {string} name @param {string | undefined} text */
export const words = (tag, name, text) => (text ? el(tag, { class: name, text }) : null);

const EMPHASIS = /(?<![\p{L}\p{N}_*])\*(?=[^\s*])((?:[^*\n]|\n(?!\n))*[^\s*])\*(?![\p{L}\p{N}_*])/u;
const LIST_ITEM = /^( *)[-*] (?=\S)/gm;

/** A paragraph of running text: "*so*" is emphasised, "- " begins an item. @param {Attributes} attributes @param {string} text */
export const prose = (attributes, text) => (text ? el("p", attributes, text.replace(LIST_ITEM, "$1• ").split(EMPHASIS)
  .map((piece, number) => (number % 2 ? el("em", { text: piece }) : piece))) : null);

/** @param {string} cap @param {string} above */
export const capOf = (cap, above, pressed = false) => el("span", { class: pressed ? "cap pressed" : "cap", translate: "no" },
  above ? el("small", { text: above }) : null, el("span", { text: cap }));

/** @param {import("./messages").ButtonValues[]} buttons */
export const buttonsOf = (buttons) => el("div", { class: "buttons" }, buttons.map((button) =>
  el("button", { type: "button", tabindex: "-1", "data-target": button.name, disabled: !button.enabled, text: button.label })));

/**
 * As large as there is room for; a picture of flat colours by a whole number where one fits.
 * @param {HTMLCanvasElement} canvas @param {number} share of the window's height
 */
export function fit(canvas, share, across = 0.94) {
  const width = Math.min(innerWidth, document.documentElement.clientWidth); // a phone widens the first for what overflows
  const room = Math.min((width * across) / canvas.width, (innerHeight * share) / canvas.height);
  const scale = room >= 1 && canvas.classList.contains("flat") ? Math.floor(room) : room;
  canvas.style.width = `${Math.round(canvas.width * scale)}px`;
  canvas.style.height = `${Math.round(canvas.height * scale)}px`;
}

/**
 * The first call decides whether the canvas is transparent. @param {HTMLCanvasElement} canvas
 * @param {CanvasImageSource} bitmap
 */
export function paint(canvas, bitmap, alpha = false) {
  canvas.getContext("2d", { alpha })?.drawImage(bitmap, 0, 0);
}
