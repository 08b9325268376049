// The episode that is played: the scenes that keys lead to, the one that the session will be in, and its picture.
// What is shown in advance is compared with what the server says at each step; the server's word counts.

import { ComputedScenes } from "./computed.js";
import { capOf, el, fit, paint, words } from "./elements.js";
import { HeldInputs } from "./held.js";
import { isFlat } from "./pictures.js";
import { UNTIMED } from "./stream.js";

/** @import { EpisodeComputer } from "./computed.js" */
/** @import { AgentControl, EpisodeRules, EpisodeState, LookAheadUpdate, PageMessage, PlayValues, StateCorrection, Texts } from "./messages" */
/** @import { FlipReporter, ImageCache, Picture } from "./pictures.js" */
/** @import { Outbox } from "./stream.js" */
/** @typedef {number | number[] | null | undefined} Action a number, or a vector; null: none; undefined: one that is not known */
/** @typedef {{ get(action: Action): [scene: number, ends: boolean] | undefined, has(action: Action): boolean }} Edges */
/** @typedef {{ picture: number, edges: Edges }} Scene */
/** @typedef {{ picture: number, edges: Map<Action, [scene: number, ends: boolean]> }} SentScene */
/** @typedef {{ has(name: number): boolean, get(name: number): Scene | undefined }} Scenes */
/** @typedef {{ rules: EpisodeRules | null, scenes: Map<number, SentScene> | ComputedScenes }} Graph an episode's, sent or computed */
/** @typedef {{ n: number, action: Action, who?: string }} Press a step that message n stands for */
/** @typedef {{ step: number, scene: number, who?: string, action?: number, limit?: number | null }} Confirmed */
/** @typedef {{ step: number, scene: number, who?: string, ended: boolean, known: boolean }} Predicted */
/**
 * @typedef {object} PlayState
 * @property {number} number
 * @property {EpisodeRules} rules
 * @property {Confirmed | null} confirmed
 * @property {Press[]} trail what the server has not heard of
 * @property {number[]} asked the messages that it makes a step at and has not told of
 * @property {number} pace ns that a step takes it
 * @property {number} frozen a message whose effect is not known; 0 for none
 * @property {number | null} nextTick
 * @property {Action} queued
 * @property {string} drawn
 * @property {AgentControl | undefined} agent
 * @property {number | null} agentDue
 * @property {number | null} flipped
 */
/** @typedef {PlayState & Predicted} Play */

export const RESERVED = new Set(["escape", "f8", "f9", "f12"]);
const UNPACKED_STEPS = 2;
const PRESS_MS = 120;
const FRAME_MS = 1000 / 60;
const TELLS_TIME = new Set(["tick", "key", "axis", "motion", "focus", "asked"]); // before these the session makes the step that is due

/**
 * Where the session will be once it has heard of everything: the confirmed scene, and what was pressed since.
 * @param {Scenes} scenes @param {number} mostSteps @param {Confirmed} confirmed @param {Press[]} trail
 * @returns {Predicted}
 */
export function predict(scenes, mostSteps, confirmed, trail) {
  let { step, scene, who } = confirmed;
  let ended = step >= mostSteps;
  let known = scenes.has(scene);
  for (const press of trail) {
    who = press.who ?? who;
    if (press.action === null || ended || !known) continue;
    const edge = scenes.get(scene)?.edges.get(press.action);
    if (!edge) { known = false; continue; }
    step += 1;
    scene = edge[0];
    ended = edge[1] || step >= mostSteps;
    known = scenes.has(scene);
  }
  return { step, scene, ended, known, who };
}

/**
 * What was pressed and is in no step yet: in a team's turn one action, shown before the others' are known.
 * @param {{ rules: { team?: string }, confirmed: Confirmed | null, trail: Press[] }} play
 * @returns {Press[]}
 */
export function trailOf({ rules, confirmed, trail }) {
  if (!rules.team) return trail;
  const heard = confirmed?.action ?? -1;
  return heard >= 0 ? [{ n: 0, action: heard }] : trail.slice(0, 1);
}

export class EpisodePlayer {
  /** @type {Play | null} */ play = null;
  /** @type {Map<number, Graph>} */ #graphs = new Map();
  /** @type {Map<number, AgentControl>} the agent beside the person, by episode; of the latest */ #agents = new Map();
  #ratedAt = -Infinity;
  /** @type {{ play: Play, step: number, saved: any } | null} the scene that was drawn last */ #drawn = null;
  /** @type {EpisodeComputer | null} */ computer = null;
  held = new HeldInputs();

  /**
   * @param {Outbox} outbox @param {ImageCache} images @param {FlipReporter} flips @param {() => void} schedule
   * @param {() => number} taken by the session, of what is not acknowledged @param {() => number} least round trip, ns
   */
  constructor(outbox, images, flips, schedule, taken, least) {
    this.outbox = outbox;
    this.images = images;
    this.flips = flips;
    this.schedule = schedule;
    this.taken = taken;
    this.least = least;
    this.view = new EpisodeView(() => this.play?.agent?.controller_texts, () => this.#reportAgain());
  }

  clear() {
    this.#graphs.clear();
    this.play = null;
  }

  /** @param {number} number */
  #graphOf(number) {
    const graph = this.#graphs.get(number) ?? { rules: null, scenes: new Map() };
    this.#graphs.set(number, graph);
    return graph;
  }

  /** The pictures of every scene that is known. */
  get pictures() {
    return [...this.#graphs.values()].flatMap(({ scenes }) => (scenes instanceof Map ? [...scenes.values()].map((s) => s.picture) : []));
  }

  get isComputed() { return this.play !== null && this.#computed(this.play) !== null; }

  /** Whether the picture of every key is here. */
  get isReady() {
    const scene = this.play && this.#graphs.get(this.play.number)?.scenes.get(this.play.scene);
    return Boolean(scene && this.play?.known && Object.values(this.play.rules.actions).every((action) => scene.edges.has(action)));
  }

  // ---- what the server says

  /** @param {EpisodeRules} m */
  learnRules(m) {
    for (const number of [...this.#graphs.keys()]) if (number < m.episode) this.#graphs.delete(number);
    const graph = this.#graphOf(m.episode);
    graph.rules = m;
    if (m.computed && this.computer) graph.scenes = this.computer.open(m.computed, m.most_steps, m.vectors);
    this.#agents.clear(); // whether one plays is told when it begins
  }

  /** @param {LookAheadUpdate} m */
  learnScenes(m) {
    const { scenes } = this.#graphOf(m.episode);
    if (!(scenes instanceof Map)) return;
    for (const [name, picture] of m.nodes) {
      const known = scenes.get(name);
      if (known) known.picture = picture;
      else scenes.set(name, { picture, edges: new Map() });
    }
    for (const [from, action, to, ends] of m.edges) scenes.get(from)?.edges.set(action, [to, ends]);
    if (this.play?.number === m.episode) this.#follow(this.play);
    else if (m.nodes.length && this.#graphs.size) this.#unpackAround(m.episode, m.nodes[0][0]); // before it begins
  }

  /** Where the server is in an episode that is computed here. @param {StateCorrection} m */
  correct(m) {
    const { scenes } = this.#graphOf(m.episode);
    if (scenes instanceof Map) return;
    scenes.place(m.state);
    if (m.inputs) {
      this.held.restore(m.inputs);
      for (const { n, what } of this.outbox.list()) if (n > m.through) this.held.take(what);
    }
    if (this.play?.number !== m.episode) return;
    this.play.confirmed = { ...scenes.start };
    this.play.trail = this.play.trail.filter((press) => press.n > m.through);
    this.#follow(this.play);
  }

  /** The server has heard of everything up to a message, and has said so if it went elsewhere. @param {number} through */
  acknowledge(through) {
    if (this.play) this.#confirmComputed(this.play, through);
  }

  /** @param {Play} play @param {number} through @returns {boolean} whether it is computed */
  #confirmComputed(play, through) {
    const { scenes } = this.#graphOf(play.number);
    if (scenes instanceof Map) return false;
    const heard = play.trail.filter((press) => press.n <= through);
    const { step, scene } = predict(scenes, play.rules.most_steps, play.confirmed ?? scenes.start, heard);
    play.confirmed = { step, scene };
    play.trail = play.trail.filter((press) => press.n > through);
    scenes.forget(scene);
    return true;
  }

  /** @param {AgentControl} m */
  learnAgent(m) {
    this.#agents.clear();
    this.#agents.set(m.episode, m);
    if (this.play?.number === m.episode) this.play.agent = m;
  }

  /** @param {EpisodeState} m */
  confirm(m) {
    if (m.step < 0) return;
    const { rules } = this.#graphOf(m.episode);
    if (!rules) return;
    const play = this.play?.number === m.episode ? this.play : this.#begin(m.episode, rules, m.through);
    play.asked = play.asked.filter((n) => n > m.through);
    play.pace = m.pace;
    if (!this.#confirmComputed(play, m.through)) {
      play.confirmed = { step: m.step, scene: m.node, who: m.who, action: m.action, limit: m.limit };
      play.trail = play.trail.filter((press) => press.n > m.through);
    }
    if (play.frozen && m.through >= play.frozen) play.frozen = 0;
    this.#follow(play);
  }

  /**
   * Begin an episode that the input of message n leads to. @param {number} number @param {number} scene
   * @param {number} n @param {boolean} isFrozen
   */
  enter(number, scene, n, isFrozen) {
    const { rules, scenes } = this.#graphOf(number);
    if (!rules) return;
    const play = this.#begin(number, rules, n);
    play.confirmed = scenes instanceof Map ? { step: 0, scene } : { ...scenes.start };
    if (isFrozen) play.frozen = n;
    this.#follow(play);
  }

  // What was pressed and is not in what the server says, before a reload too, is still to come.
  /** @param {number} number @param {EpisodeRules} rules @param {number} through */
  #begin(number, rules, through) {
    /** @type {Play} */
    const play = {
      number, rules, confirmed: null, trail: [], asked: [], pace: 0, step: -1, scene: -1, ended: false, known: false, frozen: 0,
      nextTick: null, queued: null, drawn: "", agent: this.#agents.get(number), who: "", agentDue: null, flipped: null,
    };
    this.held.drop();
    for (const message of this.outbox.list()) if (message.n > through && message.at > this.taken()) this.#learnSent(play, message);
    return this.play = play;
  }

  // What was sent before the page knew of the episode: what it did there, if that is known.
  /** @param {Play} play @param {import("./stream.js").Message} message */
  #learnSent(play, { n, at, what }) {
    const { rules } = play;
    const key = what.t === "key" && what.down && !what.cause ? what : null; // a press with another cause does nothing
    const isStepUnknown = rules.real_time && (what.t === "tick" || (TELLS_TIME.has(what.t) && this.#isTickDue(play, at)));
    if (isStepUnknown) this.#takeTick(play, at);
    if (play.agent) { // whose steps lay between, nobody knows any more
      if (!UNTIMED.has(what.t)) play.frozen = n;
    } else if (what.t === "focus" || isStepUnknown || (key && RESERVED.has(key.key))) {
      Object.assign(play, { frozen: n, queued: null });
    }
    if (what.t === "focus") play.nextTick = null;
    if (what.t === "shown" && what.episode === play.number && rules.real_time) play.nextTick ??= what.flip + rules.period;
    if (key && !play.agent && rules.team !== "ticks") this.#learnPress(play, n, key);
  }

  // Where time makes the steps, a press waits for the next one.
  /** @param {Play} play @param {number} n @param {import("./messages").KeyMessage} press */
  #learnPress(play, n, { key, repeat }) {
    const { rules } = play, action = rules.actions[key];
    if (action === undefined) return;
    if (rules.real_time) { if (!repeat) this.#queue(play, key, action); }
    else if (!play.frozen && (!repeat || rules.auto_repeat)) play.trail.push({ n, action });
  }

  /** @param {Play} play @param {string} key @param {number} action */
  #queue(play, key, action) {
    if (play.rules.combines) this.held.press(key);
    else play.queued = action;
  }

  // ---- the picture

  /** @param {Play} play */
  #follow(play) {
    if (!play.confirmed) return;
    const { scenes } = this.#graphOf(play.number);
    Object.assign(play, predict(scenes, play.rules.most_steps, play.confirmed, trailOf(play)));
    if (scenes.has(play.scene)) {
      this.#paint(play);
      this.#unpackAround(play.number, play.scene);
    }
    this.schedule();
  }

  // Unpack what the next keys may lead to, from where we are; what is further away can wait.
  /** @param {number} number @param {number} scene */
  #unpackAround(number, scene) {
    const { scenes } = this.#graphOf(number);
    if (!(scenes instanceof Map)) return;
    let level = [scene];
    for (let steps = 0; steps <= UNPACKED_STEPS; steps++) {
      const following = [];
      for (const name of level) {
        const known = scenes.get(name);
        const picture = known && this.images.get(known.picture);
        if (!picture) continue;
        if (!picture.ready) this.images.unpack(picture);
        for (const [to] of known.edges.values()) following.push(to);
      }
      level = following;
    }
  }

  /** @param {Play} play */
  #paint(play) {
    const { scene, step, who } = play;
    const what = `${scene} ${step} ${who}`;
    this.view.putFrame(who ?? undefined, play.agent?.controller_texts[who ?? ""]);
    if (play.drawn === what) return;
    const hasPicture = play.drawn === `${scene} ${step} undefined`; // who steers was told since
    play.agentDue = null;
    if (hasPicture) {
      play.drawn = what;
      if (play.flipped !== null) this.#startAgent(play, scene, step, play.flipped);
      return;
    }
    play.flipped = null;
    const { scenes } = this.#graphOf(play.number);
    if (!this.view.canvas) return;
    if (!(scenes instanceof Map)) {
      if (!this.#move(play, scenes, what)) { scenes.artist.unpacked.then(() => { if (this.play === play) this.#paint(play); }); return; }
      this.#reportStep(play, undefined, step);
      return;
    }
    const picture = this.images.get(scenes.get(scene)?.picture ?? -1);
    if (!picture) return;
    play.drawn = what;
    const put = () => {
      this.view.putPicture(picture);
      this.#reportStep(play, scene, step);
    };
    if (picture.ready) put();
    else this.images.unpack(picture).then(() => { if (this.play === play && play.drawn === what) put(); });
  }

  // Draw a scene, or where `motion` asks for it the way there, frame by frame: it counts as seen when that begins.
  /** @param {Play} play @param {ComputedScenes} scenes @param {string} what @returns {boolean} whether it could be drawn */
  #move(play, scenes, what) {
    const { scene, step, rules: { motion } } = play, { isFlat } = scenes.artist, before = this.#drawn, since = performance.now();
    const from = motion && !isFlat && before?.play === play && before.step === step - 1 ? before.saved : null;
    const draw = () => {
      const share = from ? (performance.now() - since + FRAME_MS) / motion : 1;
      const drawn = scenes.draw(scene, from, share);
      if (drawn) this.view.putDrawn(drawn, isFlat);
      if (drawn && share < 1) requestAnimationFrame(() => { if (this.play === play && play.drawn === what) draw(); });
      return drawn !== null;
    };
    if (!draw()) return false;
    play.drawn = what;
    this.#drawn = { play, step, saved: scenes.get(scene)?.saved };
    return true;
  }

  /** @param {Play} play @param {number | undefined} scene a name that the server knows @param {number} step */
  #reportStep(play, scene, step) {
    const then = (/** @type {number} */ flip) => {
      play.nextTick ??= play.rules.real_time ? flip + play.rules.period : null;
      play.flipped ??= flip;
      if (scene !== undefined) this.#startAgent(play, scene, step, flip);
      this.schedule();
    };
    this.flips.report({ episode: play.number, step, node: scene, then });
  }

  // Where an agent steers, its next step comes a period after its picture was there.
  /** @param {Play} play @param {number} scene @param {number} step @param {number} flip */
  #startAgent(play, scene, step, flip) {
    if (play.agent && play.drawn === `${scene} ${step} agent` && !play.ended && !play.frozen) {
      play.agentDue ??= flip + play.agent.period;
    }
  }

  // ---- what the person does, and time

  // Word of a step's picture goes with what is said next, if that is soon, and where the page computes, so do its keys:
  // nobody waits for them before an episode's end.
  /** @param {PageMessage} what */
  canWait(what) {
    const play = this.play;
    if (!play || play.ended || play.agent) return false;
    if (what.t === "key") return !what.down && !play.frozen && this.#computed(play) !== null;
    return what.t === "shown" && (what.step ?? 0) > 0 && play.number === what.episode;
  }

  // What was due by a message's time the session does before the message is looked at.
  /** @param {number} n @param {number} at @param {string} kind @param {number | null} due when the screen ends by the clock */
  passTime(n, at, kind, due) {
    const play = this.play;
    if (!play || play.ended) return;
    const isDue = this.#isTickDue(play, at) && TELLS_TIME.has(kind);
    if (play.frozen) { // the session may be elsewhere; if it is not, it makes a step, and what waited for that is done
      if (!isDue) return;
      this.#takeTick(play, at);
      play.trail.push({ n, action: undefined });
      return;
    }
    if (isDue) {
      if (due !== null && at >= due && this.#computed(play)) return this.freeze(n); // the session ends the episode
      if (!this.#computed(play)) play.asked.push(n);
      const action = this.#takeTick(play, at);
      if (action !== null) this.#step(play, { n, action });
    }
    if (play.agentDue === null || at < play.agentDue) return;
    play.trail.push({ n, action: this.#knowsAgent(play) ? play.confirmed?.action : undefined });
    play.agentDue = null;
    this.#follow(play);
  }

  /** @param {Play} play @param {number} at */
  #isTickDue({ nextTick }, at) { return nextTick !== null && at >= nextTick; }

  // Periods that were missed altogether are skipped, as by the session.
  /** @param {Play} play @param {number} at @returns {number | number[] | null} */
  #takeTick(play, at) {
    const { rules: { period }, nextTick } = play, action = this.#tickAction(play);
    if (nextTick !== null) play.nextTick = nextTick + period * (Math.floor((at - nextTick) / period) + 1);
    play.queued = null;
    if (play.rules.combines) this.held.drop();
    return action;
  }

  /** What the step does that time makes next. @param {Play} play @returns {number | number[] | null} */
  #tickAction({ rules, queued }) { return rules.combines ? this.held.combine(rules) : queued ?? rules.noop; }

  /** @param {Play} play */
  #computed(play) {
    const { scenes } = this.#graphOf(play.number);
    return scenes instanceof Map ? null : scenes;
  }

  /**
   * The step that time makes by now, where the page computes it: its digest goes with word of the time.
   * @param {number} now @param {number | null} due
   */
  computeTick(now, due) {
    const play = this.play;
    if (!play?.confirmed || play.frozen || play.ended || !this.#isTickDue(play, now)) return undefined;
    const scenes = this.#computed(play), action = this.#tickAction(play);
    if (!scenes || (due !== null && now >= due)) return undefined;
    if (action === null) {
      this.#takeTick(play, now); // no step, so that nobody need be told
      return undefined;
    }
    return this.#stepOf(scenes, play, action);
  }

  /** @param {ComputedScenes} scenes @param {Play} play @param {Action} action */
  #stepOf(scenes, play, action) {
    if (!play.known) return undefined; // the scene is one before
    const edge = scenes.get(play.scene)?.edges.get(action);
    return edge && { digest: scenes.get(edge[0])?.digest, ends: edge[1] };
  }

  // Whether the agent's next action is known: the session has said what it makes of where we are.
  /** @param {Play} play */
  #knowsAgent({ known, step, confirmed }) {
    return known && step === confirmed?.step && (confirmed.action ?? -1) >= 0;
  }

  // Whether the server has more steps to make than a round trip holds: time, and what repeats itself, waits for it, so
  // that a world slower than its period slows down, as in a window, and does not fall behind.
  get isBehind() {
    const play = this.play;
    if (!play || play.nextTick === null || play.frozen || play.ended) return false;
    return play.asked.length > 1 + this.least() / Math.max(play.rules.period, play.pace);
  }

  /** @param {number | null} time the earliest so far that the session wants to be told of */
  nextTime(time) {
    const play = this.play;
    if (!play) return time;
    if (this.isBehind) return null;
    if (play.nextTick !== null && !play.frozen) time = time === null ? play.nextTick : Math.min(time, play.nextTick);
    if (play.agentDue !== null && this.#knowsAgent(play)) time = time === null ? play.agentDue : Math.min(time, play.agentDue);
    return time;
  }

  /** @param {Play} play @param {Press} press */
  #step(play, press) {
    play.trail.push(press);
    this.#follow(play);
  }

  /** @param {number} n a message that the session stops for */
  freeze(n) {
    if (this.play) Object.assign(this.play, { frozen: n, nextTick: null, queued: null, agentDue: null });
    this.held.drop();
  }

  /**
   * A key while an episode is played, without an agent or one that an agent leaves to it. @param {string} key
   * @param {number} n @param {number} stamp @param {boolean} isRepeat
   * @param {number | null} due when the screen ends by the clock
   */
  press(key, n, stamp, isRepeat, due) {
    const play = this.play;
    if (!play?.confirmed) return;
    if (RESERVED.has(key)) { if (!isRepeat) play.frozen = n; return; }
    const action = this.#actionOf(play, key, stamp, isRepeat, due);
    if (action === undefined) return;
    const { team } = play.rules;
    if (team && (isRepeat || (team === "turns" && trailOf(play).length))) return;
    if (team) this.view.acknowledgePress();
    if (team === "ticks") return; // the server's step shows it
    if (play.rules.real_time) this.#queue(play, key, action);
    else this.#step(play, { n, action });
  }

  /** @param {Play} play @param {string} key @param {number} stamp @param {boolean} isRepeat @param {number | null} due */
  #actionOf({ rules, frozen, ended }, key, stamp, isRepeat, due) {
    if (frozen || ended || (due !== null && !rules.real_time && stamp >= due)) return undefined;
    return isRepeat && (rules.real_time || !rules.auto_repeat) ? undefined : rules.actions[key];
  }

  /**
   * The step that a key makes, where the page computes it: its digest goes with the key, before anything is shown.
   * @param {string} key @param {number} stamp @param {boolean} isRepeat @param {number | null} due
   */
  computeStep(key, stamp, isRepeat, due) {
    const play = this.play, scenes = play && this.#computed(play);
    if (!play?.confirmed || !scenes || play.rules.real_time || RESERVED.has(key)) return undefined;
    return this.#stepOf(scenes, play, this.#actionOf(play, key, stamp, isRepeat, due));
  }

  /**
   * A key while an agent plays, or while its last picture is held; whether it is done with. @param {string} key
   * @param {number} n @param {number} stamp @param {boolean} isRepeat @param {boolean} isHeld
   */
  pressBesideAgent(key, n, stamp, isRepeat, isHeld) {
    const play = this.play;
    const agent = play?.agent ?? (isHeld ? [...this.#agents.values()][0] : null);
    if (!agent) return false;
    if (agent.good && (key === agent.good || key === agent.bad) && !(play && (play.frozen || !play.confirmed))) {
      if (isRepeat && stamp < this.#ratedAt + agent.apart) return true;
      this.#ratedAt = stamp;
      this.view.flash(key === agent.good ? "good" : "bad", agent.flash);
      return true;
    }
    if (!play?.confirmed || play.frozen || play.ended) return false;
    if (key === agent.hand_back) {
      if (!isRepeat && play.who === "person") this.#step(play, { n, action: null, who: "agent" });
      return true;
    }
    const action = agent.takes_over ? play.rules.actions[key] : undefined;
    const { limit } = play.confirmed;
    const isOver = limit !== undefined && limit !== null && stamp >= limit;
    if (action !== undefined && !isOver && (!isRepeat || play.rules.auto_repeat)) this.#step(play, { n, action, who: "person" });
    return !RESERVED.has(key);
  }

  #reportAgain() { // an agent's frame changed: its episodes are the server's
    if (this.play) this.#reportStep(this.play, this.play.scene, this.play.step);
    else this.view.reportHeld?.();
  }
}

const FRAMES = ["agent", "person", "good", "bad"];
const MARKS = { good: "✓", bad: "✗", neutral: "–" };

// A cell that somebody of a team marked, in a picture of the whole world.
/** @param {number} x @param {number} z @param {boolean} isOwn @param {import("./messages").PlayMessages["bounds"]} bounds */
function drawCell(x, z, isOwn, [left = 0, top = 0, right = 1, bottom = 1]) {
  const width = 100 / (right - left), height = 100 / (bottom - top);
  return el("div", { class: isOwn ? "cell own" : "cell", style: {
    left: `${(x - 0.5 - left) * width}%`, top: `${(z - 0.5 - top) * height}%`, width: `${width}%`, height: `${height}%`,
  } });
}

const ONE_COLUMN = 5; // paragraphs, the word above the rules among them

/** @param {string[]} rules */
function columnsOf(rules) {
  const half = rules.length > ONE_COLUMN ? Math.ceil(rules.length / 2) : rules.length;
  const columns = [rules.slice(0, half), rules.slice(half)].filter((column) => column.length);
  return columns.map((column) => el("div", { class: "rules" }, column.map((text) => el("p", { text }))));
}

/** The picture of an episode, its frame, and the line below that says who steers. */
export class EpisodeView {
  /** @type {HTMLCanvasElement | null} */ canvas = null;
  /** @type {(() => void) | null} reports again that a picture that is held was seen */ reportHeld = null;
  /** @type {HTMLElement[]} */ #frames = [];
  /** @type {HTMLElement[]} */ #lines = [];
  #framed = { who: "", text: "" };
  #share = 0.74; // of the window's height, for the picture; words of a team stand below it
  #flash = "";
  /** @type {HTMLElement | null} */ #press = null;
  #lineSays = "";
  #isScheduled = false;
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #pressTimer;

  /**
   * @param {() => Texts | undefined} agentTexts
   * @param {() => void} reportAgain that the picture was seen, with another frame
   */
  constructor(agentTexts, reportAgain) {
    this.agentTexts = agentTexts;
    this.reportAgain = reportAgain;
  }

  /** @param {PlayValues} s */
  draw(s) {
    this.canvas ??= el("canvas", { role: "img" });
    this.#share = s.messages ? 0.52 : 0.74;
    this.canvas.setAttribute("aria-label", s.mission || s.progress);
    if (s.pointer && !s.mark) this.canvas.dataset.target = "picture";
    else delete this.canvas.dataset.target;
    this.#press ??= el("div", { class: "press" });
    // Every frame is laid out beforehand, so that a change of hands only shows another.
    this.#frames = s.controller ? FRAMES.map((of) => el("div", { class: `frame ${of}`, "data-of": of })) : [];
    this.#lines = s.controller ? FRAMES.map((of) => el("span", { class: of, "data-of": of })) : [];
    const [heading, ...rules] = s.paragraphs ?? [s.mission];
    const picture =
      el("div", { class: s.controller ? "picture framed" : "picture" }, this.canvas, this.#frames, this.#press,
        s.messages?.cells.map(([x, z, isOwn]) => drawCell(x, z, isOwn, s.messages?.bounds ?? [])),
        s.mark ? el("div", { class: `mark ${s.mark}` }, el("span", { text: `${MARKS[s.mark]} ${s.score_text}` })) : null);
    return [
      words("h1", "", heading) ?? el("h1"),
      rules.length ? el("div", { class: "beside" }, columnsOf(rules), picture) : picture,
      s.axes?.some((axis) => axis.startsWith("mouse_")) ? el("p", { class: "look", role: "status" }) : null,
      s.controller ? el("p", { class: "steers", role: "status" }, this.#lines) : null,
      s.legend.length ? el("ul", { class: "legend" }, s.legend.map(([cap, above, action]) =>
        el("li", {}, capOf(cap, above), el("span", { text: action })))) : null,
      words("p", "progress", s.progress),
    ];
  }

  fit() {
    if (this.canvas) fit(this.canvas, this.#share - (this.#framed.who ? 0.04 : 0)); // below a frame stands who steers
  }

  /** @param {Picture} picture */
  putPicture(picture) {
    if (!this.canvas || !picture.ready) return;
    this.#size(this.canvas, picture.width, picture.height, isFlat(picture));
    paint(this.canvas, picture.ready);
  }

  /** @param {import("./computed.js").Drawn} picture that the page drew @param {boolean} isFlat */
  putDrawn(picture, isFlat) {
    if (!this.canvas) return;
    this.#size(this.canvas, picture.width, picture.height, isFlat);
    picture.paint(this.canvas);
  }

  /** @param {HTMLCanvasElement} canvas @param {number} width @param {number} height @param {boolean} isFlat */
  #size(canvas, width, height, isFlat) {
    if (canvas.width === width && canvas.height === height) return;
    Object.assign(canvas, { width, height });
    canvas.classList.toggle("flat", isFlat);
    this.fit();
  }

  /** @param {string} what @param {number} lasts ns */
  flash(what, lasts) {
    this.#flash = what;
    clearTimeout(this.#timer);
    if (what) this.#timer = setTimeout(() => this.flash("", 0), lasts / 1e6);
    if (!this.canvas) return;
    this.putFrame();
    this.reportAgain();
  }

  /** A line below the picture: a press was heard, whatever it comes to. */
  acknowledgePress() {
    this.#press?.classList.add("on");
    clearTimeout(this.#pressTimer);
    this.#pressTimer = setTimeout(() => this.#press?.classList.remove("on"), PRESS_MS);
  }

  /** The line says who steers a frame later: painting words would hold up the picture that the key leads to. */
  putFrame(who = this.#framed.who, text = this.#framed.text) {
    this.#framed = { who, text };
    if (!this.canvas || !who) return;
    const now = this.#flash || who;
    for (const frame of this.#frames) frame.classList.toggle("on", frame.dataset.of === now);
    if (this.#isScheduled || this.#lineSays === JSON.stringify(this.#line())) return;
    this.#isScheduled = true;
    requestAnimationFrame(() => setTimeout(() => this.sayWhoSteers()));
  }

  #line() {
    const { who, text } = this.#framed;
    /** @type {Texts} */ const texts = { good: "+", bad: "−", ...this.agentTexts(), [who]: text };
    return { now: this.#flash || who, texts };
  }

  sayWhoSteers() {
    this.#isScheduled = false;
    if (!this.canvas || !this.#framed.who) return;
    const { now, texts } = this.#line();
    this.#lineSays = JSON.stringify({ now, texts });
    for (const line of this.#lines) {
      const text = texts[line.dataset.of ?? ""] ?? "";
      line.classList.toggle("on", line.dataset.of === now);
      if (line.textContent !== text) line.textContent = text;
    }
  }
}
