// A trial while it runs, in a page without a server: the rules of Python's `TrialRun` and `TrialsActivity`, message by message.

/** @import { ActivityValues } from "../../web/page/messages" */
/** @import { PageRun as Run } from "../../web/page/page_tools" */
/** @import { TrialScreen } from "./page.js" */
/**
 * @typedef {{ changes: number[], target: number, target_sound: number | null, opens: number, closes: number | null, end: number | null,
 * responses: number, ends_at_response: boolean, has_early_sound: boolean, n_sounds: number, preparation_ns: number,
 * sound_lead_ns: number, actions: Record<string, number>, soa_ns: number, place: number, first_cue: number, cues_per_trial: number
 * }} TrialValues as `trial_page_run.py` describes a trial
 * @typedef {{ runs?: number, rhythm?: { place: number, flip: number } | null }} BlockState what lasts from trial to trial
 */

const BEFORE_FIRST = -1; // the screen is empty until the first picture is due
const NO_RESPONSE = "none";
const START = JSON.stringify("\0start\0");

/** @implements {Run} */
export class PageRun {
  /** @type {string | null} its name, once there is one */ end = null;
  /** @type {number[]} the actions of the responses */ #responses = [];
  /** @type {number | null} */ #firstFlip = null;
  /** @type {number | null} the flip of a picture, or the onset of a sound */ #targetOnset = null;
  /** @type {number | null} when the first picture is due */ #start = null;
  /** @type {number | null} in a block with a rhythm */ #rhythmStart = null;
  #frame = 0;
  #seenFrame = BEFORE_FIRST;
  #hasLead = false;

  /** @param {TrialValues} values @param {BlockState} block @param {number} at when it begins, ns */
  constructor(values, block, at) {
    this.values = values;
    this.block = block;
    block.runs = (block.runs ?? 0) + 1;
    this.firstCue = values.first_cue + block.runs * values.cues_per_trial;
    if (values.soa_ns && block.rhythm) this.#rhythmStart = block.rhythm.flip + (values.place - block.rhythm.place) * values.soa_ns;
    this.#start = this.#rhythmStart;
    this.#hasLead = this.#start === null && values.has_early_sound;
    if (this.#start !== null || this.#hasLead) this.#frame = BEFORE_FIRST;
    this.#turn(at);
  }

  // ---- time

  /** When the next picture has to be prepared or the trial ends. */
  get due() {
    const times = [this.#nextPreparation, this.#ends].filter((time) => time !== null);
    return times.length ? Math.min(...times) : null;
  }

  /** @param {number} frame @returns {number | null} when a picture is due; null: at once, or not known yet */
  #dueOf(frame) {
    if (frame <= 0) return this.#start;
    return this.#firstFlip === null ? null : this.#firstFlip + this.values.changes[frame];
  }

  get #ends() {
    const { end } = this.values;
    return this.#firstFlip === null || end === null ? null : this.#firstFlip + end;
  }

  get #nextPreparation() {
    const { changes, preparation_ns } = this.values;
    if (this.#seenFrame !== this.#frame || this.#frame + 1 >= changes.length) return null;
    const due = this.#dueOf(this.#frame + 1);
    return due === null ? null : due - preparation_ns;
  }

  /** @param {number} at */
  #turn(at) {
    const preparation = this.#nextPreparation;
    if (preparation !== null && at >= preparation) this.#frame += 1;
  }

  /** @param {number} at */
  passTime(at) {
    this.#turn(at);
    this.#finish(at);
  }

  /** @param {number} at */
  #finish(at) {
    const { ends_at_response, responses } = this.values, ends = this.#ends;
    const isOver = (ends_at_response && this.#responses.length >= responses) || (ends !== null && at >= ends);
    if (isOver) this.end = String(this.#responses.at(-1) ?? NO_RESPONSE);
  }

  // ---- what was shown, heard and pressed

  /** @param {number} flip */
  takeFlip(flip) {
    const { values, block } = this;
    if (this.#frame < 0) {
      if (this.#hasLead && this.#start === null) this.#start = flip + values.sound_lead_ns;
      return;
    }
    this.#firstFlip ??= flip;
    if (values.changes[this.#frame] === values.target && values.target_sound === null) this.#targetOnset ??= flip;
    this.#seenFrame = this.#frame;
    block.rhythm ??= { place: values.place, flip };
  }

  /** @param {number} cue @param {number} onset */
  takeSound(cue, onset) {
    const place = cue - this.firstCue, base = this.#firstFlip ?? this.#start;
    if (place < 0 || place >= this.values.n_sounds || base === null) return;
    if (place === this.values.target_sound) this.#targetOnset ??= onset;
  }

  /** @param {string} key @param {number} stamp @param {boolean} isRepeat @param {number} at */
  press(key, stamp, isRepeat, at) {
    const action = this.values.actions[key];
    if (isRepeat || action === undefined || !this.#takes(stamp)) return;
    this.#responses.push(action);
    this.#finish(at);
  }

  /** @param {number} stamp */
  #takes(stamp) {
    const { responses, opens, closes, target } = this.values;
    if (this.#firstFlip === null || this.#targetOnset === null || this.#responses.length >= responses) return false;
    return stamp >= this.#targetOnset + opens - target && (closes === null || stamp < this.#firstFlip + closes);
  }

  /** A screen covers the trial, which is void: the block's rhythm begins anew. */
  interrupt() { this.block.rhythm = null; }

  // ---- what is on the screen

  /** @param {string} looks what the screen's digest is of, with a mark */
  fillLooks(looks) { return looks.replace(START, String(this.#rhythmStart)); }

  /** @param {ActivityValues} screen @returns {ActivityValues} */
  describe(screen) {
    const { sounds } = /** @type {TrialScreen} */ (screen), { length } = this.values.changes;
    const present = { step: this.#frame + 1 + (this.#responses.length ? length : 0), start: this.#rhythmStart, first: this.#firstFlip };
    return Object.assign({}, screen, present, { sounds: sounds.map((sound, place) => ({ ...sound, cue: this.firstCue + place })) });
  }
}
