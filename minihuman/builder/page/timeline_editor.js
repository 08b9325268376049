// The time course of a trial: stimuli as bars, dragged or moved by arrow keys, each with its form below.
/** @import { Bar, Stimulus } from "./timeline.js" */
/** @import { FieldPath, OpenStudy } from "./open_study.js" */
import { html, useRef, useState } from "./vendor/preact.js";
import { TableButtons, TableForm, insertTable } from "./form.js";
import { buildLengthEdits, buildStartEdits, describeTimes, layOutTrial } from "./timeline.js";
import { makeName } from "./words.js";

const KEY_STEPS_MS = /** @type {Record<string, number>} */ ({ ArrowLeft: -10, ArrowRight: 10, ArrowDown: -10, ArrowUp: 10, PageDown: -100, PageUp: 100 });
const NEW = /** @type {[string, Record<string, unknown>][]} */ ([
  ["text", { text: "X", duration_ms: 500 }], ["shape", { shape: "circle", duration_ms: 500 }],
  ["image", { image: "", duration_ms: 500 }], ["sound", { sound: "tone", duration_ms: 200 }],
]);
const BEGINNING = [{ name: "fixation", text: "+", size: 0.08, duration_ms: 500 }, { name: "target", text: "X", until: "response" }];
const ESSENTIAL = ["text", "duration_ms", "until", "onset_ms", "since", "after", "x", "y", "size", "colour"];

/** @param {{ study: OpenStudy, path: FieldPath }} properties of a block of trials */
export function TimelineEditor({ study, path }) {
  const [open, setOpen] = useState(-1);
  const block = study.read(path);
  const stimuli = /** @type {Stimulus[]} */ (block.timeline?.stimuli ?? []);
  const list = [...path, "timeline", "stimuli"];
  const isFixed = study.restrictionAt(list) !== "";
  if (!block.timeline) {
    const begin = () => study.edit([{ op: "set", path: [...path, "timeline"], value: { stimuli: BEGINNING } }]);
    return html`<section class="timeline" aria-label="Time course of a trial"><h3>Time course of a trial</h3>
      <p class="quiet">One picture stays until the response. With a time course, stimuli come and go by the clock.</p>
      ${!isFixed && html`<button type="button" onClick=${begin}>Give the trials a time course</button>`}</section>`;
  }
  const add = (/** @type {string} */ kind, /** @type {Record<string, unknown>} */ fields) => {
    insertTable(study, list, stimuli.length, { name: makeName(kind, stimuli.map((stimulus) => stimulus.name)), ...fields });
    setOpen(stimuli.length);
  };
  return html`<section class="timeline" aria-label="Time course of a trial"><h3>Time course of a trial</h3>
    <${Chart} study=${study} stimuli=${stimuli} list=${list} deadline_ms=${block.response_deadline_ms ?? 0} open=${open} choose=${setOpen} isFixed=${isFixed} />
    ${!isFixed && html`<div class="buttons"><span class="quiet">Add a stimulus:</span>${NEW.map(([kind, fields]) => html`
      <button type="button" class="small" key=${kind} aria-label=${`Add a ${kind}`} onClick=${() => add(kind, fields)}>${kind}</button>`)}</div>`}
    ${stimuli[open] && html`<fieldset key=${open}><legend>${stimuli[open].name}</legend>
      <${TableForm} study=${study} path=${[...list, open]} table="blocks.timeline.stimuli" essential=${ESSENTIAL} />
      ${!isFixed && html`<${TableButtons} study=${study} path=${list} place=${open} count=${stimuli.length} name=${stimuli[open].name} />`}</fieldset>`}
    <details><summary>Responses and rhythm</summary><${TableForm} study=${study} path=${[...path, "timeline"]} table="blocks.timeline" hidden=${["stimuli"]}
      essential=${["target", "ends", "soa_ms", "opens_ms", "responses"]} /></details></section>`;
}

/** @param {number} length_ms @returns {number[]} where the axis has its marks */
function listMarks(length_ms) {
  const step = [50, 100, 200, 250, 500, 1000, 2000, 5000].find((ms) => length_ms / ms <= 7) ?? 10_000;
  return Array.from({ length: Math.floor(length_ms / step) + 1 }, (_, number) => number * step);
}

/** @param {any} properties */
function Chart({ study, stimuli, list, deadline_ms, open, choose, isFixed }) {
  const box = useRef(/** @type {any} */ (null));
  const [drag, setDrag] = useState(/** @type {{ place: number, isLength: boolean, from: number, by_ms: number } | null} */ (null));
  const { bars, length_ms } = layOutTrial(stimuli, deadline_ms);
  const span_ms = Math.max(100, length_ms * 1.08);
  const share = (/** @type {number} */ ms) => `${(100 * ms) / span_ms}%`;
  const change = (/** @type {Bar} */ bar, /** @type {boolean} */ isLength, /** @type {number} */ by_ms) => {
    if (isFixed) return;
    const edits = isLength ? buildLengthEdits(stimuli[bar.place], bar.place, bar.end_ms - bar.start_ms + by_ms, list)
      : buildStartEdits(stimuli, bar.place, bar.start_ms + by_ms, list, deadline_ms);
    if (edits.length) study.edit(edits);
  };
  const begin = (/** @type {any} */ event, /** @type {Bar} */ bar, /** @type {boolean} */ isLength) => {
    event.stopPropagation();
    event.currentTarget.setPointerCapture(event.pointerId);
    setDrag({ place: bar.place, isLength, from: event.clientX, by_ms: 0 });
  };
  const move = (/** @type {any} */ event) => drag && setDrag({ ...drag, by_ms: ((event.clientX - drag.from) / box.current.clientWidth) * span_ms });
  const end = (/** @type {Bar} */ bar) => {
    if (drag && Math.abs(drag.by_ms) > span_ms / 200) change(bar, drag.isLength, drag.by_ms);
    else choose(open === bar.place ? -1 : bar.place);
    setDrag(null);
  };
  const press = (/** @type {any} */ event, /** @type {Bar} */ bar, /** @type {boolean} */ isLength) => {
    const by_ms = KEY_STEPS_MS[event.key];
    if (event.key === "Enter" || event.key === " ") choose(open === bar.place ? -1 : bar.place);
    else if (by_ms !== undefined) change(bar, isLength, by_ms);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const shared = { drag, begin, move, end, press, share, open };
  return html`<div class="chart"><div class="tracks" ref=${box}>
      ${bars.map((bar) => html`<${Track} key=${bar.place} bar=${bar} stimulus=${stimuli[bar.place]} ...${shared} />`)}
      <div class="axis" aria-hidden="true">${listMarks(span_ms).map((ms) => html`<span key=${ms} style=${{ insetInlineStart: share(ms) }}>${ms}</span>`)}</div></div>
    ${stimuli.map((/** @type {Stimulus} */ stimulus, /** @type {number} */ place) => stimulus.feedback && html`<p key=${place} class="quiet"><button type="button" class="link"
      onClick=${() => choose(place)}>${stimulus.name}</button> ${describeTimes(stimulus)}</p>`)}
    <p class="quiet">Milliseconds. Drag a bar to move it, its end to make it longer; or use the arrow keys, Page Up and Page Down. Hatched: a time that differs between trials. A click opens its form.</p></div>`;
}

/** @param {any} properties */
function Track({ bar, stimulus, drag, begin, move, end, press, share, open }) {
  const own = drag?.place === bar.place ? drag : null;
  const start_ms = Math.max(0, bar.start_ms + (own && !own.isLength ? own.by_ms : 0));
  const length_ms = Math.max(0, bar.end_ms - bar.start_ms + (own?.isLength ? own.by_ms : 0));
  const canStretch = typeof stimulus.duration_ms === "number";
  const times = describeTimes(stimulus);
  const shared = { onPointerMove: move, onPointerUp: () => end(bar) };
  return html`<div class="track"><div class=${`bar ${bar.isOpen ? "open" : ""} ${bar.isKnown ? "" : "varied"} ${open === bar.place ? "chosen" : ""}`}
      style=${{ insetInlineStart: share(start_ms), width: share(length_ms) }}>
      <span class="grip" role="slider" tabindex="0" aria-label=${`Start of ${bar.name}`} aria-valuemin="0" aria-valuemax="60000" aria-valuenow=${Math.round(start_ms)} aria-valuetext=${`${bar.name}: ${times}`}
        onPointerDown=${(/** @type {any} */ event) => begin(event, bar, false)} ...${shared} onKeyDown=${(/** @type {any} */ event) => press(event, bar, false)}></span>
      ${canStretch && html`<span class="edge" role="slider" tabindex="0" aria-label=${`Length of ${bar.name}`} aria-valuemin="10" aria-valuemax="60000" aria-valuenow=${Math.round(length_ms)}
        aria-valuetext=${`${Math.round(length_ms)} ms`} onPointerDown=${(/** @type {any} */ event) => begin(event, bar, true)} ...${shared} onKeyDown=${(/** @type {any} */ event) => press(event, bar, true)}></span>`}</div>
    <span class="bar-name" style=${{ insetInlineStart: share(start_ms) }}><b dir="auto">${bar.name}</b> ${times}</span></div>`;
}
