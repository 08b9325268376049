// Where a session is, in a page without a server: it follows the graph of screens that the real session machine made,
// by the same messages that a server would get, and says what a server would say. Python runs the messages again.

import { judgeText } from "./answers.js";
import { digestText } from "./blake2.js";
import { fillField, isSlider, moveThumb, pointThumb } from "./fields.js";
import { fillTemplate } from "./templates.js";

/** @import { AnswerField, FieldAnswer } from "./fields.js" */
/** @import { EpisodeComputer, ComputedScenes } from "./computed.js" */
/** @import { Message } from "./stream.js" */
/** @import { EpisodeRules, FieldMessage, KeyMessage, PageMessage, PointerMessage, ServerMessage, SessionOver } from "./messages" */
/** @import { PageRun, PageRunModule } from "./page_tools" */
/** @import { Picture } from "./pictures.js" */
/** @typedef {[to: number, early: boolean, agrees: boolean]} Edge */
/**
 * @typedef {{ name: number, screen: any, due_ns: number | null, due_from: "entered" | "shown", edges: Record<string, Edge>,
 * part: number, group: string, returns: number, answer_field: AnswerField | null,
 * judged: Record<string, number>, repeats: boolean, template: string, looks: string, episode: number, ends: Record<string, number>, keeps_picture: boolean,
 * run: { module: string, values: any } | null, resumed: number,
 * overlays: Record<string, number>, reason: string, over?: SessionOver }} ScreenNode
 * @typedef {{ build: string, slot: number, start: number, agreed: boolean, nodes: ScreenNode[],
 * episodes: Record<string, { rules: EpisodeRules, arrays: string[] }>, pictures: any[], keys: Record<string, string>,
 * touch: Record<string, string>, sounds: string[], words: any }} SlotScript
 * @typedef {{ kind: "unfocused" | "paused" | "quit", node: number, escape: number | null }} Overlay
 * @typedef {{ number: number, rules: EpisodeRules, scenes: ComputedScenes, scene: number, steps: number, reward: number }} FollowedEpisode
 * @typedef {{ message(m: ServerMessage): void, picture(picture: Picture): void, agreed(): void, settled(): void }} Listener
 * `settled`: an episode or a part is over
 */

const BODY = JSON.stringify("\0body\0");
const NAME_BITS = (1n << 52n) - 1n; // of a screen's digest: what a page's numbers hold
const HOLD_TO_END_NS = 2_000_000_000;
const ENTER = new Set(["enter", "kp_enter"]);
const NOT_REPEATED = new Set(["enter", "kp_enter", "tab", "page_up", "space"]); // of the keys of a question
const UNTIMED = new Set(["shown", "link", "unheard", "altered", "sound", "pointer", "typed", "field"]); // before these nothing that is due is done
const LIMITED = 2; // how a scene ended
const NO_PICTURE = 1_000_000_000; // pictures of the page's own have numbers from here on

export class Follower {
  /** @type {ScreenNode | null} none before the first message */ #node = null;
  #entered = 0;
  /** @type {number | null} when the screen was there */ #flip = null;
  /** @type {Overlay[]} screens over it, the topmost last */ #overlays = [];
  /** @type {Map<string, number>} the node in which a question was left */ #answers = new Map();
  /** @type {Map<string, FieldAnswer>} what is in each field, and where each thumb is */ #fields = new Map();
  #isFocused = true;
  #pointerActs = true; // what it is down with is a press of this window
  /** @type {FollowedEpisode | null} the present or last one */ #play = null;
  /** @type {PageRun | null} what runs on the present screen by itself */ #run = null;
  /** @type {Record<string, any>} of the runs of the present part */ #runState = {};
  /** @type {number | null} when it goes on, as the page knows it */ #saidDue = null;
  #screenId = 0;
  #pictures = NO_PICTURE;
  #through = 0;
  #at = 0;
  #isSilent = false;
  agreed = false;
  differences = 0; // steps that the page computed otherwise than this

  /**
   * @param {SlotScript} script @param {EpisodeComputer} computer @param {Listener} listener
   * @param {Map<string, PageRunModule>} modules of runs, by address
   */
  constructor(script, computer, listener, modules) {
    this.script = script;
    this.computer = computer;
    this.listener = listener;
    this.modules = modules;
    this.agreed = script.agreed;
  }

  /** How the session ended; null as long as it has not. @returns {SessionOver | null} */
  get over() { return this.#node?.over ?? null; }

  /** Follow messages of before, without a word. @param {Message[]} messages */
  restore(messages) {
    this.#isSilent = true;
    for (const message of messages) this.receive(message);
    this.#isSilent = false;
  }

  /** Say everything that a page has to know. */
  repeat() {
    if (this.#node) this.#show();
  }

  /** @param {Message} message */
  receive({ n, at, what }) {
    this.#through = n;
    this.#at = at;
    if (!this.#node) this.#enter(this.script.start, at);
    if (this.over) return;
    if (!UNTIMED.has(what.t) && this.#passTime(at)) return;
    if (what.t === "shown") this.#takeFlip(what, at);
    else if (what.t === "sound") this.#takeSound(what, at);
    else if (what.t === "focus") this.#changeFocus(what.focused);
    else if (what.t === "field") this.#takeText(what);
    else if (what.t === "key" && (what.cause ?? "finger") === "finger") (what.down ? this.#press(what) : this.#release(what.key));
    else if (what.t === "pointer") this.#point(what);
    if (this.#run && this.#due !== this.#saidDue) this.#sayPosition();
  }

  // ---- time

  /** @returns {number | null} when the session goes on by itself */
  get #due() {
    const overlay = this.#overlays.at(-1);
    if (overlay) return overlay.escape === null ? null : overlay.escape + HOLD_TO_END_NS;
    const node = this.#node;
    if (this.#run) return this.#run.due;
    if (!node || node.due_ns === null) return null;
    return (node.due_from === "shown" ? this.#flip ?? this.#entered : this.#entered) + node.due_ns;
  }

  /** @param {number} at @returns {boolean} whether the session is over by now */
  #passTime(at) {
    if (this.#run) {
      this.#run.passTime(at);
      return this.#endRun();
    }
    const due = this.#due, node = this.#node;
    if (due === null || at < due || !node) return false;
    if (this.#overlays.length) {
      this.#overlays = [];
      this.#enter(node.overlays.ending, at);
      return true;
    }
    const edge = node.edges.tick;
    if (edge) this.#enter(edge[0], node.due_from === "entered" ? due : at);
    return this.over !== null;
  }

  /** Go on from a run that has ended. @returns {boolean} whether the session is over by now */
  #endRun() {
    const end = this.#run?.end ?? null, node = this.#node;
    if (end !== null && node) this.#enter(node.ends[end], this.#at);
    return this.over !== null;
  }

  /** @param {Extract<PageMessage, { t: "sound" }>} what @param {number} at */
  #takeSound({ cue, onset }, at) { this.#run?.takeSound(cue, Math.min(onset, at)); }

  /** @param {Extract<PageMessage, { t: "shown" }>} what @param {number} at */
  #takeFlip(what, at) {
    const node = this.#node, flip = Math.min(what.flip, at);
    if (!node || this.#overlays.length) return;
    const isStep = (what.step ?? -1) >= 0;
    const isPresent = isStep ? node.keeps_picture && what.step === this.#play?.steps : what.name === this.#describe(node).name;
    if (!isPresent) return;
    this.#run?.takeFlip(flip);
    this.#flip = flip;
    if (node.due_ns !== null && node.due_from === "shown") this.#sayPosition();
  }

  // ---- inputs

  /** @param {KeyMessage} press */
  #press({ key, stamp, repeat = false, digest = "" }) {
    const overlay = this.#overlays.at(-1), t = Math.min(stamp, this.#at);
    if (key === "escape" && !repeat) {
      if (overlay?.kind === "quit") overlay.escape = t;
      else this.#cover("quit");
      this.#sayPosition();
    } else if (key === "f8" && !repeat && (overlay?.kind === "paused" || (!overlay && this.#canPause))) {
      if (overlay) this.#uncover();
      else this.#cover("paused");
    } else if (overlay) {
      if (!repeat && ENTER.has(key)) this.#uncover();
    } else if (this.#run) {
      this.#run.press(key, t, repeat, this.#at);
      this.#endRun();
    } else if (this.#isPlaying) {
      this.#step(key, repeat, digest);
    } else if (this.#slider && moveThumb(this.#slider.rules, this.#slider.step, key) !== null) {
      this.#setThumb(moveThumb(this.#slider.rules, this.#slider.step, key));
    } else if (!repeat || this.#takesRepeated(key)) {
      this.#follow(`key:${key}`, t);
    }
  }

  /** Whether a held key acts again: on the pages of a text, and in most of a question. @param {string} key */
  #takesRepeated(key) {
    const node = this.#node;
    return node?.repeats || (node?.screen.kind === "question" && !NOT_REPEATED.has(key));
  }

  /** @param {string} key */
  #release(key) {
    const overlay = this.#overlays.at(-1);
    if (key === "escape" && overlay?.kind === "quit" && overlay.escape !== null) this.#uncover();
  }

  /** @param {boolean} focused */
  #changeFocus(focused) {
    const overlay = this.#overlays.at(-1);
    this.#isFocused = focused;
    if (!focused && !overlay) this.#cover("unfocused");
    else if (!focused && overlay) overlay.escape = null;
    else if (focused && overlay?.kind === "unfocused") this.#uncover();
  }

  get #canPause() { return this.#node?.overlays.paused !== undefined; }

  /** @param {Overlay["kind"]} kind */
  #cover(kind) {
    const node = this.#node?.overlays[kind];
    if (node === undefined) return;
    if (this.#run) this.#interruptRun();
    this.#overlays.push({ kind, node, escape: null });
    this.#show();
  }

  /** What follows a run that is covered is its part's to say: a trial is void, and comes again. */
  #interruptRun() {
    this.#run?.interrupt();
    this.#run = null;
    this.#node = this.script.nodes[/** @type {ScreenNode} */ (this.#node).resumed];
    this.#entered = this.#at;
    this.#flip = null;
  }

  #uncover() {
    this.#overlays.pop();
    if (this.#isFocused && this.#overlays.at(-1)?.kind === "unfocused") this.#overlays.pop(); // found while a question was in front
    const node = this.#node;
    if (!this.#overlays.length && node?.due_ns !== null && node?.due_from === "shown") {
      this.#entered = this.#at;
      this.#flip = null;
    }
    this.#show();
  }

  /** @param {string} input @param {number} t when it was made */
  #follow(input, t) {
    const edge = this.#overlays.length ? undefined : this.#node?.edges[input];
    if (!edge) return;
    const [to, isEarly, agrees] = edge;
    if (!isEarly && (this.#flip === null || t < this.#flip)) return;
    if (agrees && !this.agreed) {
      this.agreed = true;
      if (!this.#isSilent) this.listener.agreed();
    }
    this.#enter(to, this.#at);
  }

  /** @param {PointerMessage} what */
  #point({ what: use, target = "", along = 0, cause = "finger" }) {
    if (use === "pressed") this.#pointerActs = cause === "finger";
    const isTimed = this.#pointerActs && cause !== "cancelled" && !this.#overlays.length;
    if (isTimed && this.#passTime(this.#at)) return;
    if (!this.#pointerActs || use === "released") return;
    if (this.#slider && target === "slider") this.#setThumb(pointThumb(this.#slider.rules, along));
    else if (use === "pressed") this.#follow(`point:${target}`, this.#at);
  }

  /** The present question's slider, if nothing is over it. */
  get #slider() {
    const field = this.#overlays.length ? null : this.#node?.answer_field;
    return field && isSlider(field.rules) ? { rules: field.rules, step: this.#fields.get(field.key) ?? null } : null;
  }

  /** @param {number | null} step */
  #setThumb(step) {
    const node = this.#node, field = node?.answer_field;
    if (!field || step === (this.#fields.get(field.key) ?? null)) return;
    this.#fields.set(field.key, step);
    this.#enter(node.judged.fine, this.#at);
  }

  /** @param {FieldMessage} what */
  #takeText({ text, name }) {
    const node = this.#node, field = node?.answer_field;
    if (!field || isSlider(field.rules) || this.#overlays.length || (name && name !== node.screen.item.name)) return;
    const judgement = judgeText(field.rules, text), to = node.judged[judgement];
    const isSame = text === (this.#fields.get(field.key) ?? "") && judgement !== "note.too_long"; // its note stays
    if (to === undefined || isSame) return;
    this.#fields.set(field.key, text);
    this.#enter(to, this.#at);
  }

  // ---- where it goes

  /** @param {number} number @param {number} at */
  #enter(number, at) {
    const { group, part } = this.script.nodes[number], isOver = this.#isPlaying || part !== this.#node?.part;
    if (part !== this.#node?.part) { // who comes to a part again finds it new
      this.#answers.clear();
      this.#runState = {};
    }
    const isReturn = group && group !== this.#node?.group;
    const to = isReturn ? this.#answers.get(group) ?? number : number;
    const node = this.#node = this.script.nodes[to];
    if (group && (!node.screen.note || node.returns >= 0)) this.#answers.set(group, node.screen.note ? node.returns : to);
    if (node.answer_field?.judgement === "empty") this.#fields.delete(node.answer_field.key);
    this.#entered = at;
    this.#flip = null;
    this.#run = node.run ? this.#beginRun(node.run) : null;
    if (node.episode >= 0) this.#begin(node.episode);
    this.#show();
    if (isOver && !this.#isSilent) this.listener.settled();
  }

  /** @param {{ module: string, values: any }} run */
  #beginRun({ module, values }) {
    const loaded = this.modules.get(module);
    if (!loaded) throw new Error(`module ${module} is not loaded`);
    return new loaded.PageRun(values, this.#runState, this.#at);
  }

  get #isPlaying() { return (this.#node?.episode ?? -1) >= 0; }

  /** @param {number} number */
  #begin(number) {
    const { rules } = this.script.episodes[number];
    if (!rules.computed) throw new Error(`episode ${number} has no state to compute from`);
    const scenes = this.computer.open(rules.computed, rules.most_steps);
    this.#play = { number, rules, scenes, scene: scenes.start.scene, steps: 0, reward: 0 };
  }

  /** @param {string} key @param {boolean} repeat @param {string} digest of the page's step */
  #step(key, repeat, digest) {
    const play = this.#play, action = play?.rules.actions[key];
    if (!play || action === undefined || (repeat && !play.rules.auto_repeat)) return;
    const edge = play.scenes.get(play.scene)?.edges.get(action), scene = edge && play.scenes.get(edge[0]);
    if (!edge || !scene) return;
    play.scene = edge[0];
    play.steps += 1;
    play.reward += scene.reward;
    play.scenes.forget(play.scene);
    if (digest && digest !== scene.digest) this.differences += 1;
    if (scene.ends) this.#enter(/** @type {ScreenNode} */ (this.#node).ends[scene.ends === LIMITED ? "timeout" : scene.reward > 0 ? "goal" : "failure"], this.#at);
    else if (digest !== scene.digest) this.#show(); // the page did not know where it was
  }

  // ---- what is said

  /** A screen, with what an episode led to filled in. @param {ScreenNode} node @returns {{ name: number, screen: any }} */
  #describe(node) {
    if (this.#run && node.run) {
      return { name: Number(digestText(this.#run.fillLooks(node.looks)) & NAME_BITS), screen: this.#run.describe(node.screen) };
    }
    if (node.answer_field) {
      const { looks, screen } = fillField(node, node.answer_field.rules, this.#fields.get(node.answer_field.key) ?? null);
      return { name: Number(digestText(looks) & NAME_BITS), screen };
    }
    if (!node.template || !this.#play) return node;
    const { steps, reward } = this.#play, body = fillTemplate(node.template, { steps, reward }, node.screen.rtl);
    const looks = node.looks.replace(BODY, () => JSON.stringify(body));
    return { name: Number(digestText(looks) & NAME_BITS), screen: { ...node.screen, body } };
  }

  #show() {
    const overlay = this.#overlays.at(-1);
    if (this.#isSilent || !this.#node) return;
    const node = overlay ? this.script.nodes[overlay.node] : this.#node;
    const { name, screen } = this.#describe(node);
    const isKept = node.keeps_picture && this.#play !== null;
    const shown = isKept ? { ...screen, step: this.#play?.steps, picture: this.#drawPicture() } : screen;
    if (!overlay && this.#isPlaying && this.#play) this.#say(this.#play.rules);
    this.#say({ t: "screen", id: ++this.#screenId, through: this.#through, at: this.#at, tick: this.#due, screen: shown, name, sounds: [] });
    if (!overlay && this.#isPlaying && this.#play) this.#say({ t: "state", through: this.#through, episode: this.#play.number, state: this.#encodeState(this.#play), inputs: null });
    this.#sayPosition();
    if (node.over) this.#say(node.over);
  }

  #sayPosition() {
    this.#saidDue = this.#due;
    const isIn = !this.#overlays.length && this.#isPlaying && this.#play !== null;
    this.#say({
      t: "now", through: this.#through, tick: this.#due, episode: isIn ? this.#play?.number ?? -1 : -1, step: isIn ? this.#play?.steps ?? -1 : -1,
      node: -1, who: "", action: -1, limit: null, pace: 0,
    });
  }

  /** @param {ServerMessage} m */
  #say(m) {
    if (!this.#isSilent) this.listener.message(m);
  }

  /** The position in an episode, as a server says it. @param {FollowedEpisode} play @returns {any} */
  #encodeState(play) {
    const saved = play.scenes.get(play.scene)?.saved, rng_state = Array.from(saved.words, String);
    if (play.rules.computed?.world === "grid") return { world: "grid", step: play.steps, row: encodeRow(saved.row), rng_state };
    return { world: "first_person", step: play.steps, things: encodeFloats(saved.things), numbers: encodeFloats(saved.numbers), rng_state };
  }

  /** The last picture of an episode, which stays. @returns {number} */
  #drawPicture() {
    const play = /** @type {FollowedEpisode} */ (this.#play), drawn = play.scenes.draw(play.scene);
    const canvas = new OffscreenCanvas(drawn?.width ?? 1, drawn?.height ?? 1);
    canvas.getContext("2d", { alpha: false });
    drawn?.paint(/** @type {any} */ (canvas));
    const number = this.#pictures++, { width, height } = canvas, bitmap = canvas.transferToImageBitmap();
    const encoding = play.scenes.artist.isFlat ? 0 : 1;
    this.listener.picture({ number, encoding, width, height, bytes: new Uint8Array(0), tiles: [], bitmap: Promise.resolve(bitmap), ready: bitmap });
    return number;
  }
}

/** @param {Int32Array} row @returns {number[]} numbers, and how often each comes */
function encodeRow(row) {
  /** @type {number[]} */ const runs = [];
  for (const number of row) {
    if (runs.length && runs[runs.length - 2] === number) runs[runs.length - 1] += 1;
    else runs.push(number, 1);
  }
  return runs;
}

/** @param {Float64Array} floats */
const encodeFloats = (floats) => btoa(Array.from(new Uint8Array(floats.buffer, floats.byteOffset, floats.byteLength), (byte) => String.fromCharCode(byte)).join(""));
