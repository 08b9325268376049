// The page: it stamps and numbers what a person does, shows what the server says, and goes ahead of it in an episode.
// It decides nothing: the session is the server's, and what is shown here in advance is compared with it at each step.

import { AppearanceWatch } from "./appearance.js";
import { collectBrowserFacts } from "./browser.js";
import { EpisodeComputer } from "./computed.js";
import { Connection } from "./connection.js";
import { EpisodePlayer, RESERVED } from "./episode.js";
import { GamepadReader } from "./gamepad.js";
import { Keyboard, listenToFocus, listenToPointer } from "./input.js";
import { MouseLook } from "./mouse.js";
import { FilmViewer, FlipReporter, ImageCache } from "./pictures.js";
import { ScreenPrefetch } from "./prefetch.js";
import { TextEntry } from "./questions.js";
import { ScreenView } from "./screens.js";
import { SoundPlayer } from "./sounds.js";
import { ThumbSticks } from "./sticks.js";
import { MessageStore, openTabStorage, Outbox, randomBytes, UNTIMED } from "./stream.js";
import { TouchKeys } from "./touch.js";
import { watchForWelcome } from "./unreachable.js";

/** @import { PageMessage, ScreenMessage, ServerMessage } from "./messages" */
/** @import { Link } from "./connection.js" */
/** @import { Point } from "./input.js" */

// For so long messages that can wait do. Where the page computes and no time is due, nobody waits for them: the server
// takes several keys together for little more than one.
const WAIT_MS = 100, COMPUTED_WAIT_MS = 2000;

const SETTLING = new Set(["key", "pointer", "focus", "axis", "motion"]);

class Page {
  #main = /** @type {HTMLElement} */ (document.getElementById("screen"));
  #status = /** @type {HTMLElement} */ (document.getElementById("status"));
  #outbox = new Outbox(openTabStorage(), performance);
  #images = new ImageCache();
  #prefetch = new ScreenPrefetch(); // of the screens outside of episodes
  #flips = new FlipReporter(() => this.#outbox.now(), (what) => this.#send(what));
  #films = new FilmViewer(this.#images, this.#flips, () => this.#schedule());
  #sounds = new SoundPlayer((ms) => this.#outbox.timeOf(ms), (what) => this.#send(what), (isMissing) => {
    this.#status.textContent = isMissing ? this.#connection.words.no_sound : "";
  });
  #player = new EpisodePlayer(
    this.#outbox, this.#images, this.#flips, () => this.#schedule(), () => this.#connection.taken,
    () => this.#connection.latency.least);
  /** @type {ScreenMessage | null} what the server wants seen */ #screen = null;
  #entry = new TextEntry(
    () => this.#screen, (text) => this.#type(text), (what, beganMs) => this.#sendField(what, beganMs),
    (m) => this.#view.show(m));
  #appearance = new AppearanceWatch(this.#main, (what) => this.#isListening && this.#send(what) > 0);
  #view = new ScreenView(
    this.#main,
    { images: this.#images, flips: this.#flips, films: this.#films, sounds: this.#sounds, entry: this.#entry, episode: this.#player.view },
    {
      current: () => this.#screen,
      touchTexts: () => (this.#touch.isTouched ? this.#touch.texts : null),
      isPending: (through) => this.#outbox.hasAfter(through),
      entered: (m, lasts, flip) => this.#enter(m, lasts, flip),
      drew: (kind, language) => {
        this.#appearance.drew(kind, language);
        this.#mouse.say();
      },
    });
  #keyboard = new Keyboard(globalThis, {
    isActive: () => this.#isListening,
    isTyping: () => this.#entry.isActive,
    isChatting: () => this.#entry.isActive && this.#screen?.screen.kind === "play",
    nativeField: () => this.#entry.claimKeys(),
    isScrollable: () => /^(page|text)$/.test(this.#screen?.screen.kind ?? ""),
    now: () => this.#outbox.now(),
    timeOf: (ms) => this.#outbox.timeOf(ms),
    press: (key, symbol, stamp, trusted, isRepeat, cause) => {
      if (cause === "finger") this.#press(key, symbol, stamp, trusted, isRepeat);
      else this.#prefetch.unknown(this.#send({ t: "key", key, down: true, stamp, symbol: symbol || undefined, trusted: trusted && undefined, cause }));
    },
    release: (key, stamp, isTrusted, cause) => this.#send(
      { t: "key", key, down: false, stamp, trusted: isTrusted && undefined, cause: cause === "finger" ? undefined : cause }),
  }, navigator.userAgent);
  #sticks = new ThumbSticks((what, ms) => this.#sendMoved(what, ms), () => this.#player.isBehind);
  #touch = new TouchKeys(
    /** @type {HTMLElement} */ (document.getElementById("touch")), this.#keyboard, this.#sticks,
    () => { this.#player.view.fit(); this.#films.fit(); });
  #gamepad = new GamepadReader(this.#keyboard, () => this.#isListening && this.#focused !== false, (what, ms) => {
    this.#send(ms === undefined || what.t !== "axis" ? what : { ...what, stamp: this.#outbox.timeOf(ms) });
  }, () => this.#player.isBehind);
  #mouse = new MouseLook(this.#main, (what, ms) => this.#sendMoved(what, ms), () => this.#player.isBehind);
  #connection = new Connection(this.#outbox, readLink(this.#outbox), {
    welcome: (m) => {
      this.#keyboard.codes = this.#outbox.keys = m.keys;
      this.#touch.caps = m.touch;
      this.#touch.texts = this.#mouse.texts = m.words;
      this.#gamepad.want(m.gamepad);
      this.#sounds.prepare(m.sounds);
      if (this.#screen) this.#touch.show(this.#screen.screen);
      document.title = m.words.title;
      this.#view.hideNotice();
    },
    reset: () => {
      this.#player.clear();
      this.#images.clear();
      this.#prefetch.clear();
    },
    resume: (fresh) => {
      if (this.#outbox.state.last === 0) this.#send({ t: "tick" });
      if (fresh && this.#connection.taken > 0) this.#focused = null;
      this.#lookAtFocus();
      this.#appearance.catchUp();
    },
    message: (m) => this.#receive(m),
    picture: (picture) => this.#images.add(picture),
    acknowledged: (through) => {
      this.#player.acknowledge(through);
      if (this.#prefetch.acknowledge(through) && this.#prefetch.serverScreen) this.#put(this.#prefetch.serverScreen);
    },
    status: (text) => { this.#status.textContent = text; },
    leave: (why, refusal) => this.#view.showRefusal(why, refusal),
  });
  /** @type {boolean | null} as the session knows it; null: it may have been told otherwise, by this tab before or by another */
  #focused = true;
  #focusedMs = -Infinity; // when the page got the focus, by the event's own time
  #lookAtFocus = listenToFocus((hasFocus, ms) => this.#focus(hasFocus, ms));
  /** @type {() => void} ends a press of the pointer's */ #cancelPointer;
  /** @type {number | null} when the session wants to be told the time */ #due = null;
  /** @type {number | null} */ #reportedDue = null;
  /** @type {number | null} when a timed screen that was there ends */ #endsAt = null;
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;

  constructor() {
    this.#connection.latency.report = (what) => this.#send(what);
    this.#connection.latency.takeActed = () => this.#entry.takeActed();
    this.#keyboard.codes = this.#outbox.keys; // for what is pressed before the welcome, after the page was loaded again
    this.#cancelPointer = listenToPointer(this.#main, {
      isActive: () => !this.#connection.finished,
      isBeforeFocus: (ms) => ms < this.#focusedMs,
      point: (point) => this.#point(point),
    });
    addEventListener("resize", () => {
      this.#player.view.fit();
      this.#films.fit();
    });
    addEventListener("pagehide", (event) => {
      this.#entry.settle();
      this.#connection.bidFarewell(event.persisted);
    });
    // Another link was put into the address: another person, of whom nothing that is kept here is true.
    addEventListener("hashchange", () => {
      this.#connection.close();
      this.#outbox.discard();
      location.reload();
    });
  }

  async start() {
    void watchForWelcome(
      () => this.#connection.wasWelcomed || this.#connection.finished, () => this.#connection.failureCode,
      (notice) => this.#view.showNotice(notice));
    const loading = EpisodeComputer.load();
    await this.#outbox.recover(await MessageStore.open(this.#connection.seat));
    this.#outbox.state.facts ??= await collectBrowserFacts();
    this.#outbox.save();
    this.#player.computer = await loading;
    this.#connection.kernels = this.#player.computer?.grid.sources ?? "";
    this.#connection.open();
  }

  get #isListening() { return this.#outbox.hasTime && !this.#connection.finished; }

  /** @param {PageMessage} what @param {boolean} canWait @param {number} now @returns {number} the message's number */
  #send(what, canWait = this.#player.canWait(what), now = this.#outbox.nextTime()) {
    // What is in a field comes before what is done next.
    if (SETTLING.has(what.t) && this.#entry.settle()) return this.#send(what, canWait);
    const tick = what.t !== "tick" && !UNTIMED.has(what.t) && this.#outbox.hasTime ? this.#computeTick(now) : undefined;
    if (tick) { // a step that the session makes first; by then the next may be due
      this.#send({ t: "tick", digest: tick.digest }, !tick.ends, now);
      return this.#send(what, canWait);
    }
    const n = this.#outbox.add(what, canWait ? this.#player.isComputed && this.#due === null ? COMPUTED_WAIT_MS : WAIT_MS : 0, now);
    if (n) this.#player.held.take(what);
    if (n && !UNTIMED.has(what.t)) {
      const at = this.#outbox.state.last;
      this.#player.passTime(n, at, what.t, this.#due);
      this.#films.passTime(at);
    }
    return n;
  }

  /** @param {number} now the very time of the message that tells it */
  #computeTick(now) { return this.#player.computeTick(now, this.#due); }

  // ---- what the server says

  /** @param {ServerMessage} m */
  #receive(m) {
    switch (m.t) {
      case "rules":
        this.#player.learnRules(m);
        this.#images.drop(m.keep, this.#usedPictures());
        break;
      case "arrays": this.#player.computer?.learnArrays(m); break;
      case "state": this.#player.correct(m); break;
      case "ahead": this.#player.learnScenes(m); break;
      case "onward": this.#prefetch.learn(m); break;
      case "frame": this.#films.add(m); break;
      case "beside": this.#player.learnAgent(m); break;
      case "now":
        if (!this.#prefetch.ahead) this.#setDue(m.tick);
        this.#player.confirm(m);
        break;
      case "screen":
        if (this.#prefetch.tell(m)) this.#put(m);
        else if (!this.#prefetch.ahead) this.#screen = m;
        break;
      case "ask": this.#prefetch.unknown(this.#send({ t: "asked", number: m.number })); break;
      case "over":
        this.#connection.finished = true;
        this.#outbox.clear();
        this.#outbox.storage.removeItem("stream");
        this.#touch.end();
        this.#view.showEnd(m, this.#connection.words.leaving);
    }
  }

  #usedPictures() {
    const used = new Set(this.#player.pictures);
    for (const m of [this.#screen, this.#prefetch.serverScreen, ...this.#prefetch.screens.values()]) {
      const s = /** @type {{ picture?: number, films?: number[][] }} */ (/** @type {unknown} */ (m?.screen ?? {}));
      for (const number of [s.picture, s.films].flat(2)) if (number !== undefined) used.add(number);
    }
    return used;
  }

  /** @param {ScreenMessage} m */
  #put(m) {
    this.#screen = m;
    this.#endsAt = null;
    this.#setDue(m.tick);
    if (m.screen.kind !== "play" || m.screen.picture !== undefined) this.#player.play = null;
    this.#touch.show(m.screen);
    this.#mouse.show(m.screen);
    this.#view.show(m);
  }

  /** @param {ScreenMessage} m @param {number | null} lasts @param {number} flip */
  #enter(m, lasts, flip) {
    this.#prefetch.sawAt(m.name, flip);
    if (this.#screen?.name !== m.name || lasts === null) return;
    this.#endsAt = flip + lasts;
    this.#schedule();
  }

  // An input went to the server as message n: show what it leads to, if that is known.
  /** @param {number} n @param {string} input @param {number} at */
  #advance(n, input, at) {
    const to = this.#prefetch.took(n, input, at);
    if (!to) return;
    const { last } = this.#outbox.state;
    const tick = to.after === null ? null : last + to.after;
    this.#put({ t: "screen", id: 0, name: to.name, through: n, at: last, tick, screen: to.screen, sounds: [] });
    // Who steers is told when it has begun.
    if (to.episode >= 0) this.#player.enter(to.episode, to.scene, n, to.screen.kind === "play" && Boolean(to.screen.controller));
  }

  // ---- time

  /** @param {number | null} tick */
  #setDue(tick) {
    this.#due = tick;
    this.#schedule();
  }

  #nextTime() {
    let time = this.#due !== this.#reportedDue ? this.#due : null;
    if (this.#endsAt !== null && this.#endsAt > this.#outbox.state.last) time = this.#endsAt;
    return this.#films.due ?? this.#player.nextTime(time);
  }

  #schedule() {
    clearTimeout(this.#timer);
    const time = this.#nextTime();
    if (time === null || !this.#outbox.hasTime) return;
    this.#timer = setTimeout(() => this.#tick(), Math.max(0, (time - this.#outbox.now()) / 1e6));
  }

  #tick() {
    const time = this.#nextTime();
    if (time === null) return;
    const now = this.#outbox.nextTime();
    if (now < time) { this.#schedule(); return; }
    const tick = this.#computeTick(now);
    if (!tick && this.#nextTime() !== time) { this.#schedule(); return; } // a period without a step
    const n = this.#send({ t: "tick", digest: tick?.digest }, tick && !tick.ends, now);
    const at = this.#outbox.state.last;
    if (this.#due !== null && at >= this.#due) this.#reportedDue = this.#due;
    if (this.#endsAt !== null && at >= this.#endsAt) this.#endsAt = null;
    if (!this.#player.play) this.#advance(n, "tick", at);
    this.#gamepad.readSticks();
    this.#mouse.sendMotion();
    this.#sticks.sendLevels();
    this.#schedule();
  }

  // ---- what the person does

  /**
   * @param {string} key @param {string} symbol @param {number} stamp @param {boolean} trusted @param {boolean} isRepeat
   */
  #press(key, symbol, stamp, trusted, isRepeat) {
    if (isRepeat && this.#player.isBehind) return; // as a window that comes late, which makes one of those it missed
    const step = this.#player.computeStep(key, stamp, isRepeat, this.#due);
    const n = this.#send({ // what is as usual is left out
      t: "key", key, down: true, stamp, symbol: symbol || undefined, repeat: isRepeat || undefined,
      trusted: trusted && undefined, digest: step?.digest,
    }, step && !step.ends);
    if (this.#chat(key, isRepeat)) return;
    this.#entry.edit(key);
    this.#films.press(key, isRepeat);
    if (this.#player.pressBesideAgent(key, n, stamp, isRepeat, this.#screen?.screen.kind === "play")) return;
    if (this.#player.play) this.#player.press(key, n, stamp, isRepeat, this.#due);
    else if (isRepeat) this.#prefetch.unknown(n);
    else this.#advance(n, `key:${key}`, stamp);
  }

  // A line to write on opens at once, and closes when the server says so: it may be too soon for another message.
  /** @param {string} key @param {boolean} isRepeat @returns {boolean} whether the key is none of the game's */
  #chat(key, isRepeat) {
    const m = this.#screen, messages = m?.screen.kind === "play" && this.#player.play ? m.screen.messages : undefined;
    if (!m || !messages || RESERVED.has(key)) return false;
    if (messages.entry) this.#entry.edit(key);
    else if (key !== "enter" || isRepeat || !messages.new_entry) return false;
    else {
      messages.entry = messages.new_entry;
      this.#view.show(m);
    }
    return true;
  }

  /** @param {string} text */
  #type(text) { this.#prefetch.unknown(this.#send({ t: "typed", text })); }

  /** @param {Omit<import("./messages").FieldMessage, "t" | "began">} what @param {number} beganMs */
  #sendField(what, beganMs) { this.#prefetch.unknown(this.#send({ t: "field", ...what, began: this.#outbox.timeOf(beganMs) })); }

  /** @param {PageMessage} what @param {number} ms */
  #sendMoved(what, ms) {
    if (this.#isListening && (what.t === "motion" || what.t === "axis")) this.#send({ ...what, stamp: this.#outbox.timeOf(ms) });
  }

  /** @param {Point} point */
  #point({ ms, ...point }) {
    const n = this.#send({ t: "pointer", ...point, stamp: this.#outbox.timeOf(ms) });
    if (point.cause) this.#prefetch.unknown(n);
    if (point.cause || this.#player.play) return; // the server alone knows what a click in the picture does
    if (point.what === "pressed") this.#advance(n, `point:${point.target}`, this.#outbox.state.last);
    else if (point.what === "moved") this.#prefetch.unknown(n);
  }

  /** @param {boolean} focused @param {number} ms */
  #focus(focused, ms) {
    if (focused === this.#focused || !this.#isListening) return;
    if (focused && this.#focused === false) {
      this.#focusedMs = ms;
      this.#keyboard.come(ms);
    }
    this.#focused = focused;
    if (!focused) {
      this.#keyboard.releaseAll();
      this.#cancelPointer();
      this.#sticks.release(ms);
      this.#flips.cancel();
    }
    const n = this.#send({ t: "focus", focused });
    this.#prefetch.unknown(n);
    this.#player.freeze(n);
  }

  get #kind() {
    const s = this.#screen?.screen;
    return (s?.kind === "activity" ? s.view : s?.kind) ?? "";
  }

  /** For whoever tests or watches: what the page has done so far. */
  get state() {
    const { play } = this.#player;
    const prefetch = this.#prefetch;
    return {
      welcomed: this.#connection.welcomed, finished: this.#connection.finished, step: play?.step ?? -1, scene: play?.scene ?? -1,
      ended: play?.ended ?? false, pictures: this.#images.size, playing: play !== null, confirmed: play?.confirmed?.step ?? -1,
      ready: this.#player.isReady, known: play?.known ?? false, unsafe: this.#outbox.size,
      ways: prefetch.edges.get(prefetch.at)?.size ?? 0,
      foreseen: [...prefetch.edges.values()].reduce((sum, ways) => sum + ways.size, 0), ahead: prefetch.ahead,
      kind: this.#kind, now: this.#outbox.hasTime ? this.#outbox.now() : 0,
    };
  }
}

/** @param {Outbox} outbox @returns {Link} */
function readLink({ state }) {
  const fragment = new URLSearchParams(location.hash.slice(1));
  const parameters = [...new URLSearchParams(location.search), ...fragment]
    .filter(([name, value]) => name !== "t" && name.length <= 64 && value.length <= 200).slice(0, 12); // longer: no platform's
  const token = fragment.get("t") ?? "";
  const isMade = !token && !parameters.length; // whoever comes by no link brings one of their own, for studies that take anybody
  return { token: isMade ? (state.token ??= makeToken()) : token, platform: Object.fromEntries(parameters), made: isMade };
}

function makeToken() {
  return btoa(String.fromCharCode(...randomBytes(16))).replaceAll("+", "-").replaceAll("/", "_").slice(0, 22);
}

const page = new Page();
Object.assign(globalThis, { minihuman: page });
await page.start();
