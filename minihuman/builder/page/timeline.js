// When each stimulus of a trial comes and goes, as far as the file says it, and the edits that move one. Knows no element.
/** @import { Edit } from "./messages" */
/** @import { FieldPath } from "./open_study.js" */

const UNKNOWN_MS = 300; // is drawn for a time that comes from a table
const OPEN_MS = 800; // is drawn for a response without a deadline
const UNKNOWN_WORDS = 6; // of a text that comes from a table
const SNAP_MS = 10;

/** @typedef {{ name: string, text?: string, onset_ms?: any, after?: string, since?: string, duration_ms?: any, each_ms?: any, until?: string, feedback?: string }} Stimulus */
/**
 * @typedef {object} Bar
 * @property {number} place of the stimulus in the file
 * @property {string} name
 * @property {number} start_ms
 * @property {number} end_ms
 * @property {boolean} isOpen it ends with the response or the trial
 * @property {boolean} isKnown no time of it comes from a table or is drawn from a range
 */

/** @param {any} time @returns {number | null} a time as a bar shows it: a range's middle; null if the file does not say it */
function readTime(time) {
  if (Array.isArray(time)) return (time[0] + time[1]) / 2;
  return typeof time === "number" ? time : null;
}

/** @param {Stimulus} stimulus @returns {number | null} how long it lasts; null if it ends with the response or the trial */
function findLength(stimulus) {
  if (stimulus.duration_ms !== undefined) return readTime(stimulus.duration_ms) ?? UNKNOWN_MS;
  if (stimulus.each_ms === undefined) return stimulus.until ? null : UNKNOWN_MS;
  const words = (stimulus.text ?? "").includes("{") ? UNKNOWN_WORDS : (stimulus.text ?? "").split(/\s+/).filter(Boolean).length;
  return (readTime(stimulus.each_ms) ?? UNKNOWN_MS / UNKNOWN_WORDS) * words;
}

/** @param {Stimulus} stimulus */
const isKnown = (stimulus) => [stimulus.onset_ms, stimulus.duration_ms, stimulus.each_ms].every((time) => time === undefined || typeof time === "number");

/**
 * Lay out the stimuli of a trial in time; those that come with the feedback are left out.
 * @param {Stimulus[]} stimuli @param {number} deadline_ms of the response; 0 if there is none @returns {{ bars: Bar[], length_ms: number }}
 */
export function layOutTrial(stimuli, deadline_ms) {
  /** @type {Bar[]} */
  const bars = [];
  const shown = stimuli.map((stimulus, place) => ({ stimulus, place })).filter(({ stimulus }) => !stimulus.feedback);
  for (const { stimulus, place } of shown) {
    const start_ms = findStart(stimulus, bars);
    const length = findLength(stimulus);
    bars.push({ place, name: stimulus.name, start_ms, end_ms: start_ms + (length ?? 0), isOpen: length === null, isKnown: isKnown(stimulus) });
  }
  const last_ms = Math.max(0, ...bars.map((bar) => (bar.isOpen ? bar.start_ms + (deadline_ms || OPEN_MS) : bar.end_ms)));
  for (const bar of bars) {
    if (bar.isOpen) bar.end_ms = last_ms;
  }
  return { bars, length_ms: last_ms };
}

/** @param {Stimulus} stimulus @param {Bar[]} bars those before it @returns {number} */
function findStart(stimulus, bars) {
  const onset_ms = readTime(stimulus.onset_ms) ?? (stimulus.onset_ms === undefined ? 0 : UNKNOWN_MS);
  const since = bars.find((bar) => bar.name === stimulus.since);
  if (since) return since.start_ms + onset_ms;
  const after = bars.find((bar) => bar.name === stimulus.after);
  if (after) return after.end_ms + onset_ms;
  return stimulus.onset_ms === undefined ? bars.at(-1)?.end_ms ?? 0 : onset_ms;
}

/**
 * The edits that give a stimulus another start. One that follows the stimulus before it gets a gap, or an overlap, from
 * that one, so that it stays with it where its time is drawn anew in each trial.
 * @param {Stimulus[]} stimuli @param {number} place @param {number} start_ms @param {FieldPath} path of the stimuli @param {number} deadline_ms @returns {Edit[]}
 */
export function buildStartEdits(stimuli, place, start_ms, path, deadline_ms) {
  const { bars } = layOutTrial(stimuli, deadline_ms);
  const number = bars.findIndex((bar) => bar.place === place);
  const stimulus = stimuli[place];
  const wanted_ms = Math.max(0, Math.round(start_ms / SNAP_MS) * SNAP_MS);
  const set = (/** @type {string} */ field, /** @type {unknown} */ value) => /** @type {Edit} */ ({ op: "set", path: [...path, place, field], value });
  const before = bars[number - 1];
  if (stimulus.onset_ms === undefined && before) {
    if (wanted_ms === before.end_ms) return [];
    const follows = wanted_ms > before.end_ms && !before.isOpen;
    return follows ? [set("after", before.name), set("onset_ms", wanted_ms - before.end_ms)]
      : [set("since", before.name), set("onset_ms", Math.max(0, wanted_ms - before.start_ms))];
  }
  if (stimulus.onset_ms !== undefined && typeof stimulus.onset_ms !== "number") return []; // it comes from a table, or is drawn
  const own_ms = bars[number].start_ms - (stimulus.onset_ms ?? 0); // of what it counts from
  const onset_ms = Math.max(0, wanted_ms - own_ms);
  if (onset_ms === 0 && stimulus.after && stimulus.after === before?.name) {
    return ["after", "onset_ms"].map((field) => /** @type {Edit} */ ({ op: "remove", path: [...path, place, field] }));
  }
  return onset_ms === (stimulus.onset_ms ?? 0) ? [] : [set("onset_ms", onset_ms)];
}

/**
 * The edits that give a stimulus another length; none if it ends with the response, or its length is not one number.
 * @param {Stimulus} stimulus @param {number} place @param {number} length_ms @param {FieldPath} path of the stimuli @returns {Edit[]}
 */
export function buildLengthEdits(stimulus, place, length_ms, path) {
  if (typeof stimulus.duration_ms !== "number") return [];
  const value = Math.max(SNAP_MS, Math.round(length_ms / SNAP_MS) * SNAP_MS);
  return value === stimulus.duration_ms ? [] : [{ op: "set", path: [...path, place, "duration_ms"], value }];
}

/** @param {Stimulus} stimulus @returns {string} when it comes and goes, in words */
export function describeTimes(stimulus) {
  const spell = (/** @type {any} */ time) => (Array.isArray(time) ? `${time[0]} to ${time[1]} ms` : typeof time === "number" ? `${time} ms` : String(time));
  const words = [];
  if (stimulus.feedback) return `with the feedback after ${stimulus.feedback}`;
  if (stimulus.since) words.push(`${spell(stimulus.onset_ms ?? 0)} after the onset of ${stimulus.since}`);
  else if (stimulus.after) words.push(`${spell(stimulus.onset_ms ?? 0)} after the end of ${stimulus.after}`);
  else words.push(stimulus.onset_ms === undefined ? "then" : `from ${spell(stimulus.onset_ms)}`);
  if (stimulus.each_ms !== undefined) words.push(`${spell(stimulus.each_ms)} a word`);
  if (stimulus.duration_ms !== undefined) words.push(`for ${spell(stimulus.duration_ms)}`);
  if (stimulus.until) words.push(`until the ${stimulus.until === "end" ? "end of the trial" : "response"}`);
  return words.join(", ");
}
