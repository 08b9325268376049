// What the browser, an extension or the participant's settings changed of the page, reported once each: a translation,
// other text than the server sent, zoom, forced colours, another font size, a second pointing device.

/** @import { PageAlteration } from "./messages" */
/** @typedef {PageAlteration["what"]} Alteration */

const USUAL_FONT_PX = 16;
const MAX_DETAIL = 60;
const TEXT_SCREENS = new Set(["text", "page", "question"]);

/**
 * The language into which a browser says that it translated a page; "" for none, "unknown" where the page has named its own
 * since. @param {HTMLElement} root @param {string} language the page's own
 */
export function findTranslation(root, language) {
  if (language !== "" && root.lang !== language) return root.lang || "unknown";
  return root.classList.contains("translated-ltr") || root.classList.contains("translated-rtl") ? "unknown" : "";
}

export class AppearanceWatch {
  #language = ""; // that the page gave itself
  #text = ""; // that it drew
  #isTextKnown = false;
  #isTranslated = false;
  /** @type {Set<string>} */ #reported = new Set();
  /** @type {PageAlteration[]} of before the session's time was known */ #early = [];
  #pixelRatio = devicePixelRatio;
  #pointer = "";

  /** @param {HTMLElement} main @param {(what: PageAlteration) => boolean} send false while the session's time is unknown */
  constructor(main, send) {
    this.main = main;
    this.send = send;
    const observer = new MutationObserver(() => this.#compare());
    observer.observe(document.documentElement, { attributeFilter: ["class", "lang"] });
    observer.observe(main, { childList: true, characterData: true, subtree: true });
    const forced = matchMedia("(forced-colors: active)");
    const lookAtColours = () => { if (forced.matches) this.#report("forced_colors", ""); };
    forced.addEventListener("change", lookAtColours);
    addEventListener("resize", () => this.#lookAtZoom());
    globalThis.visualViewport?.addEventListener("resize", () => this.#lookAtZoom());
    addEventListener("pointerdown", (event) => this.#lookAtPointer(event), { capture: true });
    lookAtColours();
    this.#lookAtZoom();
    const font = getComputedStyle(document.documentElement).fontSize;
    if (font !== `${USUAL_FONT_PX}px`) this.#report("font_size", font);
  }

  /** The page drew a screen. @param {string} kind @param {string} language */
  drew(kind, language) {
    this.#language = language;
    this.#isTextKnown = TEXT_SCREENS.has(kind);
    this.#text = this.main.textContent ?? "";
    this.#reported.delete("text");
    this.#compare();
  }

  /** Report what was seen before the session began. */
  catchUp() {
    const early = this.#early;
    this.#early = [];
    for (const what of early) if (!this.send(what)) this.#early.push(what);
  }

  #compare() {
    const translation = findTranslation(document.documentElement, this.#language);
    if (translation && (translation !== "unknown" || !this.#isTranslated)) {
      this.#isTranslated = true;
      this.#report("translation", translation);
    }
    if (this.#isTextKnown && this.main.textContent !== this.#text) this.#report("text", "", "text");
  }

  #lookAtZoom() {
    const scale = globalThis.visualViewport?.scale ?? 1, ratio = devicePixelRatio / this.#pixelRatio;
    if (Math.abs(scale - 1) > 0.01) this.#report("zoom", `pinched to ${scale.toFixed(2)}`, "pinch");
    if (Math.abs(ratio - 1) > 0.01) this.#report("zoom", `pixel ratio ${this.#pixelRatio.toFixed(2)} to ${devicePixelRatio.toFixed(2)}`);
  }

  /** @param {PointerEvent} event */
  #lookAtPointer({ pointerType, isTrusted }) {
    if (!isTrusted || !pointerType || pointerType === this.#pointer) return;
    if (this.#pointer) this.#report("pointer", `${pointerType} beside ${this.#pointer}`);
    else this.#pointer = pointerType;
  }

  /** @param {Alteration} what @param {string} detail @param {string} key what is reported once */
  #report(what, detail, key = `${what} ${detail}`) {
    if (this.#reported.has(key)) return;
    this.#reported.add(key);
    const alteration = /** @type {PageAlteration} */ ({ t: "altered", what, detail: detail.slice(0, MAX_DETAIL) });
    if (!this.send(alteration)) this.#early.push(alteration);
  }
}
