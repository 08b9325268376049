// Screens: one function per kind makes its elements; the server's values, and nothing else, go in.

import { buttonsOf, capOf, el, fit, flatten, paint, prose, words } from "./elements.js";
import { drawWidget } from "./questions.js";

/** @import { ActivityValues, BlankValues, PageValues, PlayValues, QuestionValues, Refusal, ScreenMessage, SessionOver, TextValues } from "./messages" */
/** @import { ActivityModule } from "./page_tools" */
/** @import { EpisodeView } from "./episode.js" */
/** @import { FilmViewer, FlipReporter, ImageCache } from "./pictures.js" */
/** @import { SoundPlayer } from "./sounds.js" */
/** @import { TextEntry } from "./questions.js" */

const LEAVING_S = 5;
const RELOAD_MS = 1000;

/** The field says by itself that a text is too long, and at once. @param {QuestionValues} s */
const noteOf = ({ note, item }) => (item.form === "TextField" && note === item.limit_note ? "" : note);

/** @param {import("./messages").PlayMessages} messages */
const linesOf = ({ lines }) => lines.map(([author, text]) => el("p", {}, el("b", { text: author }), ` ${text}`));

/** A tick for a session that is complete, an exclamation mark for one that broke. @param {string} end */
const signOf = (end) => (end === "complete" || end === "broken" ? el("div", { class: `sign ${end}`, "aria-hidden": "true" }) : null);

export class ScreenView {
  /**
   * @param {HTMLElement} main
   * @param {{ images: ImageCache, flips: FlipReporter, films: FilmViewer, sounds: SoundPlayer, entry: TextEntry,
   * episode: EpisodeView }} parts
   * @param {object} page @param {() => ScreenMessage | null} page.current
   * @param {() => Record<string, string> | null} page.touchTexts what the page says instead of keys, where fingers play
   * @param {(through: number) => boolean} page.isPending whether something after a message is not acknowledged
   * @param {(m: ScreenMessage, lasts: number | null, flip: number) => void} page.entered
   * @param {(kind: string, language: string) => void} page.drew
   */
  constructor(main, parts, page) {
    this.main = main;
    this.parts = parts;
    this.page = page;
  }

  #draw = {
    text: (/** @type {TextValues} */ s, _ = null, check = s.keys.length ? this.page.touchTexts() : null) => [
      words("h1", "", check?.touch_check_title ?? s.title),
      prose({ class: "body short" }, check?.touch_check_body ?? s.body),
      s.waits ? el("div", { class: "waits", "aria-hidden": "true" }, el("span"), el("span"), el("span")) : null,
      s.keys.length ? el("ul", { class: "keyboard", style: { width: `${s.wide * 3}rem`, height: `${s.high * 3}rem` } },
        s.keys.map((key) => el("li", {
          "aria-label": `${key.cap} ${key.above}${key.pressed ? " ✓" : ""}`,
          style: { left: `${key.x * 3}rem`, top: `${key.y * 3}rem`, width: `${key.width * 3}rem`, height: "3rem" },
        }, capOf(key.cap, key.above, key.pressed)))) : null,
      words("p", "prompt", s.prompt),
      words("p", "progress", s.progress),
    ],
    blank: (/** @type {BlankValues} */ s) => [s.cross ? el("div", { class: "cross", role: "img", "aria-label": "+" }) : null],
    play: (/** @type {PlayValues} */ s) => [...this.parts.episode.draw(s), s.messages && el("div", { class: "chat" },
      el("div", { role: "log", class: "lines" }, linesOf(s.messages)),
      s.messages.entry && el("div", { class: "entry" }, this.parts.entry.open(s.messages.entry), this.parts.entry.limitNote),
      el("p", { class: "prompt", id: "ask", text: s.messages.hint }))],
    activity: (/** @type {ActivityValues} */ s, /** @type {ScreenMessage} */ m) =>
      this.#modules.get(s.module)?.draw(s, m, { el, words, prose, films: this.parts.films, sounds: this.parts.sounds }),
    page: (/** @type {PageValues} */ s) => [
      words("h1", "", s.title),
      s.picture === null ? null : this.#drawExample(s, s.picture),
      prose({ class: s.body.length < 160 && !/^ *[-*] /m.test(s.body) && s.picture === null ? "body short" : "body" }, s.body),
      buttonsOf(s.buttons),
      words("p", "prompt", s.prompt),
      words("p", "progress", s.progress),
    ],
    question: (/** @type {QuestionValues} */ s) => [
      words("h1", "", s.title),
      prose({ class: "body", id: "ask" }, s.question),
      drawWidget(s.item, this.parts.entry),
      el("p", { class: "note", role: "alert", text: noteOf(s) }),
      buttonsOf(s.buttons),
      words("p", "prompt", s.prompt),
      words("p", "progress", s.progress),
    ],
  };

  /** @type {Map<string, ActivityModule>} of kinds of activity, by address */ #modules = new Map();

  /** @type {Set<string>} addresses */ #loading = new Set();

  /** Load a module, then show the screen that waits for it, if there still is one. @param {string} address */
  async #load(address) {
    if (this.#loading.has(address)) return;
    this.#loading.add(address);
    const module = await import(address).catch(() => null);
    if (module) this.#modules.set(address, module);
    else await new Promise((resolve) => { setTimeout(resolve, RELOAD_MS); }); // the network was gone for a moment
    this.#loading.delete(address);
    const current = this.page.current();
    if (current?.screen.kind === "activity" && current.screen.module === address) this.show(current);
  }

  /** @param {PageValues} s @param {number} number */
  #drawExample(s, number) {
    const picture = this.parts.images.get(number);
    const canvas = el("canvas", { role: "img", "aria-label": s.marks.map((mark) => mark[2]).join(", ") || s.title });
    if (picture) {
      Object.assign(canvas, { width: picture.width, height: picture.height });
      fit(canvas, 0.4, s.marks.length ? 0.5 : undefined); // the words stand beside it
      this.parts.images.unpack(picture).then((bitmap) => paint(canvas, bitmap, true));
    }
    return el("div", { class: "example" }, canvas, s.marks.map(([x, y, label]) => {
      const top = `${100 * y}%`, side = x >= 0.5 ? "right" : "left";
      const reach = `${100 * (x >= 0.5 ? 1 - x : x)}%`; // from the point to the picture's edge
      return [
        el("span", { class: "lead", style: { [side]: "-.5rem", width: `calc(${reach} + .5rem)`, top } }),
        el("span", { class: "point", style: { left: `${100 * x}%`, top } }),
        el("span", { class: `label ${side}`, text: label, style: { top } }),
      ];
    }));
  }

  /** @param {ScreenMessage} m */
  show(m) {
    const s = m.screen;
    const { images, flips, films, sounds, entry, episode } = this.parts;
    if (s.kind === "activity" && !this.#modules.has(s.module)) {
      this.#load(s.module);
      return;
    }
    document.documentElement.lang = s.language;
    document.documentElement.dir = s.rtl ? "rtl" : "ltr";
    document.documentElement.classList.toggle("light", s.theme === "light");
    this.main.className = s.kind === "activity" ? s.view : s.kind;
    this.main.classList.toggle("timed", m.tick !== null);
    const isDrawn = entry.redraw(m, () => this.page.isPending(m.through), () => {
      if (s.kind !== "play") episode.canvas = null;
      episode.reportHeld = null;
      films.close();
      if (s.kind !== "activity") sounds.keep(new Set(m.sounds.map(({ cue }) => cue)));
      this.main.replaceChildren(...flatten(/** @type {any} */ (this.#draw)[s.kind](s, m)).filter(Boolean));
    }, () => {
      if (s.kind === "play") this.#updatePlay(s);
      for (const [name, text] of Object.entries({ note: s.kind === "question" ? noteOf(s) : "", progress: "progress" in s ? s.progress : "" })) {
        const element = this.main.querySelector(`:scope > .${name}`);
        if (element && element.textContent !== text) element.textContent = text;
      }
    });
    if (!isDrawn) return;
    this.page.drew(s.kind, s.language);
    if (!entry.isActive && document.activeElement !== this.main) this.main.focus({ preventScroll: true });
    const lasts = m.tick === null ? null : m.tick - m.at;
    if (films.isOpen) films.start();
    else if (s.kind === "play") {
      if (s.controller) {
        episode.putFrame(s.controller, s.controller_text);
        episode.sayWhoSteers();
      }
      const picture = s.picture === undefined ? undefined : images.get(s.picture);
      if (!picture) return;
      images.unpack(picture).then(() => {
        if (this.page.current()?.name !== m.name) return;
        episode.putPicture(picture);
        episode.reportHeld = () =>
          flips.report({ episode: s.episode, step: s.step, then: (flip) => this.page.entered(m, lasts, flip) });
        const flip = flips.takeStep(s.episode, s.step);
        if (flip === null) episode.reportHeld();
        else this.page.entered(m, lasts, flip);
      });
    } else {
      const then = (/** @type {number} */ flip) => {
        for (const sound of m.sounds) sounds.play(sound, flip);
        this.page.entered(m, s.kind === "blank" ? lasts : null, flip);
      };
      flips.report({ screen: m.id, name: m.name, then });
    }
  }

  /** Draw everything anew but the field for a message, and what is around it. @param {PlayValues} s */
  #updatePlay(s) {
    this.parts.episode.reportHeld = null;
    const chat = this.main.querySelector(":scope > .chat");
    for (const child of [...this.main.children]) if (child !== chat) child.remove();
    chat?.before(...flatten(this.parts.episode.draw(s)).filter(Boolean));
    if (s.messages) chat?.querySelector(".lines")?.replaceChildren(...linesOf(s.messages));
  }

  /** Say what is wrong before the server has said anything. @param {import("./unreachable.js").Notice} notice */
  showNotice({ language, rtl, text }) {
    document.documentElement.lang = language;
    document.documentElement.dir = rtl ? "rtl" : "ltr";
    this.main.className = "text";
    this.main.replaceChildren(el("p", { class: "body short", role: "alert", id: "unwelcomed", text }));
  }

  hideNotice() { document.getElementById("unwelcomed")?.remove(); }

  /** @param {string} why @param {Refusal | null} refusal */
  showRefusal(why, refusal) {
    this.main.className = "text";
    this.main.replaceChildren(...flatten([
      el("p", { class: "body short", role: "alert", text: why }),
      refusal?.url ? el("p", { class: "short" }, el("a", { href: refusal.url, text: refusal.leave })) : null,
    ]));
  }

  /** @param {SessionOver} m @param {string} leaving */
  showEnd({ end, words: text, code, your_code, url, leave }, leaving) {
    const heading = this.main.querySelector("h1");
    this.main.className = "text";
    this.main.replaceChildren(...flatten([
      signOf(end),
      heading,
      el("p", { class: "body short", role: "status", text }),
      code ? el("p", { class: "short given" }, el("span", { text: `${your_code}: ` }), el("strong", { class: "code", translate: "no", text: code })) : null,
      url ? el("p", { class: "short" }, el("a", { href: url, text: leave })) : null,
      url ? el("p", { class: "prompt", text: leaving.replace("{seconds}", String(LEAVING_S)) }) : null,
    ]));
    if (url) setTimeout(() => { location.href = url; }, LEAVING_S * 1000);
  }
}
