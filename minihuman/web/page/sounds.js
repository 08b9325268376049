// Sounds: fetched and decoded before they are needed, and begun at times of the session by the sound device's own clock.

/** @import { PageMessage } from "./messages" */
/** @import { SoundCue } from "./page_tools" */
/** @typedef {{ source: AudioBufferSourceNode, gain: GainNode, timer: ReturnType<typeof setTimeout> | undefined }} Voice */

const RATE_HZ = 48000; // at which the server sends sounds
const SAMPLING_MS = 10; // between looks at the device's clock, which Chromium moves on every 11.6 ms
const WINDOW = 800; // moves to which it is fitted: some 9 s
const LEAST_WINDOW = 86; // a second
const STEP_NS = 3e6; // by so much does the latest second differ after an interruption, which moves the clock by a buffer
const STEP_INTERVAL = 10; // looks between tests for a step
const LEAST_UNCERTAINTY_NS = 1e6; // the browser rounds the times that it tells
const SPREAD_TO_UNCERTAINTY = 3; // of the robust standard deviation of the median of what was seen
const DEPENDENT = 10; // looks that follow each other are alike: so many count as one
const MARGIN_S = 0.01; // a sound that is told later than this before its time begins late
const FADE_S = 0.005;
const RETRY_MS = 1000;
const PATIENCE_MS = 5000; // for which a device may take to open before the participant is told
const GESTURES = ["keydown", "pointerdown"];

/** @param {number[]} numbers */
const median = (numbers) => [...numbers].sort((a, b) => a - b)[numbers.length >> 1];

/** Tells the session's time at which the device plays a moment of its own clock. */
export class DeviceClock {
  /** @type {number[]} session time in ns minus the device's, by each look */ #offsets = [];
  #looks = 0;

  /** @param {number} deviceS @param {number} sessionNs */
  add(deviceS, sessionNs) {
    this.#offsets.push(sessionNs - deviceS * 1e9);
    if (this.#offsets.length > WINDOW) this.#offsets.shift();
    this.#looks += 1;
    if (!this.isReady || this.#looks % STEP_INTERVAL) return;
    const latest = this.#offsets.slice(-LEAST_WINDOW);
    if (Math.abs(median(latest) - this.offset) > STEP_NS) this.#offsets = latest;
  }

  get isReady() { return this.#offsets.length >= LEAST_WINDOW; }

  /** The median: single looks jitter by milliseconds. */
  get offset() { return median(this.#offsets); }

  /** Below which 99 % of the errors are, but for a constant delay. */
  get uncertainty() {
    const { offset } = this;
    const spread = 1.4826 * median(this.#offsets.map((other) => Math.abs(other - offset)));
    const count = Math.max(1, this.#offsets.length / DEPENDENT);
    return Math.round(Math.max(LEAST_UNCERTAINTY_NS, (SPREAD_TO_UNCERTAINTY * 1.2533 * spread) / Math.sqrt(count)));
  }

  /** @param {number} deviceS */
  sessionTime(deviceS) { return Math.round(deviceS * 1e9 + this.offset); }

  /** @param {number} sessionNs */
  deviceTime(sessionNs) { return (sessionNs - this.offset) / 1e9; }
}

export class SoundPlayer {
  /** @type {AudioContext | null} */ #context = null;
  /** @type {Map<string, AudioBuffer>} */ #buffers = new Map();
  /** @type {Map<string, Promise<void>>} */ #loading = new Map();
  /** @type {Map<number, Voice>} */ #voices = new Map();
  #clock = new DeviceClock();
  #lastS = 0; // of the device, at the last look
  /** @type {ReturnType<typeof setInterval> | undefined} */ #sampling;
  /** @type {(() => void)[]} what waits for the device */ #waiting = [];

  /**
   * @param {(ms: number) => number} timeOf the session's time of a time of the page
   * @param {(what: PageMessage) => void} send
   * @param {(isMissing: boolean) => void} tell the participant that the device does not open, or that it has
   */
  constructor(timeOf, send, tell) {
    this.timeOf = timeOf;
    this.send = send;
    this.tell = tell;
  }

  /** Fetch and decode a session's sounds, and open the device at what the participant does next. @param {string[]} digests */
  prepare(digests) {
    if (!digests.length) return;
    for (const gesture of GESTURES) addEventListener(gesture, () => this.#open(), { capture: true });
    for (const digest of digests) this.#load(digest);
  }

  /** Wait until sounds are decoded and the device runs. @param {string[]} digests */
  async ready(digests) {
    if (!digests.length) return;
    await Promise.all(digests.map((digest) => this.#load(digest)));
    if (navigator.userActivation?.hasBeenActive) this.#open();
    if (this.#isOpen) return;
    let isMissing = false;
    const patience = setTimeout(() => this.tell(isMissing = true), PATIENCE_MS);
    await new Promise((resolve) => { this.#waiting.push(() => resolve(null)); });
    clearTimeout(patience);
    if (isMissing) this.tell(false);
  }

  /** Begin a sound at a time of the session, and report when it began. @param {SoundCue} cue @param {number} due */
  play({ cue, digest }, due) {
    const buffer = this.#buffers.get(digest);
    if (!this.#context || !this.#isOpen || !buffer || this.#voices.has(cue)) return;
    const source = new AudioBufferSourceNode(this.#context, { buffer });
    const gain = new GainNode(this.#context);
    source.connect(gain).connect(this.#context.destination);
    const beginS = Math.max(this.#clock.deviceTime(due), this.#context.currentTime + MARGIN_S);
    source.start(beginS);
    const timer = setTimeout(() => this.#report(cue, due, beginS), this.#msUntil(this.#clock.sessionTime(beginS)));
    this.#voices.set(cue, { source, gain, timer });
  }

  /** Stop all sounds but these. @param {Set<number>} cues */
  keep(cues) {
    for (const [cue, voice] of this.#voices) {
      if (cues.has(cue)) continue;
      this.#voices.delete(cue);
      clearTimeout(voice.timer);
      const nowS = this.#context?.currentTime ?? 0;
      voice.gain.gain.setValueAtTime(1, nowS);
      voice.gain.gain.linearRampToValueAtTime(0, nowS + FADE_S);
      voice.source.stop(nowS + FADE_S);
    }
  }

  get #isOpen() { return this.#context?.state === "running" && this.#clock.isReady; }

  /** @param {number} sessionNs */
  #msUntil(sessionNs) { return Math.max(0, (sessionNs - this.timeOf(performance.now())) / 1e6); }

  // The session takes no report of what is still to come.
  /** @param {number} cue @param {number} scheduled @param {number} beginS */
  #report(cue, scheduled, beginS) {
    const onset = this.#clock.sessionTime(beginS);
    const left = this.#msUntil(onset);
    const voice = this.#voices.get(cue);
    if (voice && left > 1) voice.timer = setTimeout(() => this.#report(cue, scheduled, beginS), left);
    else if (voice) this.send({ t: "sound", cue, scheduled: Math.round(scheduled), onset, uncertainty: this.#clock.uncertainty });
  }

  #open() {
    this.#context ??= new AudioContext({ sampleRate: RATE_HZ, latencyHint: "interactive" });
    void this.#context.resume();
    this.#sampling ??= setInterval(() => this.#sample(), SAMPLING_MS);
  }

  #sample() {
    const context = this.#context;
    if (context?.state !== "running") return;
    const { contextTime = 0, performanceTime = 0 } = context.getOutputTimestamp();
    if (contextTime === this.#lastS || performanceTime === 0) return; // 0: nothing has been played yet
    this.#lastS = contextTime;
    this.#clock.add(contextTime, this.timeOf(performanceTime));
    if (!this.#isOpen) return;
    for (const resolve of this.#waiting.splice(0)) resolve();
  }

  /** @param {string} digest */
  #load(digest) {
    const loading = this.#loading.get(digest) ?? this.#fetch(digest);
    this.#loading.set(digest, loading);
    return loading;
  }

  // The network may be gone for a moment. A context that plays nothing decodes, too, and needs no gesture.
  /** @param {string} digest */
  async #fetch(digest) {
    for (;;) {
      const answer = await fetch(new URL(`../sounds/${digest}`, import.meta.url)).catch(() => null);
      if (answer?.ok) {
        const decoder = new OfflineAudioContext(1, 1, RATE_HZ);
        this.#buffers.set(digest, await decoder.decodeAudioData(await answer.arrayBuffer()));
        return;
      }
      await new Promise((resolve) => { setTimeout(resolve, RETRY_MS); });
    }
  }
}
