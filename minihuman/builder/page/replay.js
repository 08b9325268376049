// A recorded episode, replayed: what the participant saw, the way on the floor plan, and each step with its key.
/** @import { EpisodeReplay, EpisodeSummary, ReplayMap, ReplayStep } from "./messages" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { Command } from "./command.js";
import { frameAddress, readEpisode } from "./requests.js";

const SPEEDS = [1, 2, 4, 8];
const MOST_WAIT_MS = 4000; // between two steps, at any speed
const LISTED = 6; // steps beside the picture

/** @param {ReplayStep[]} steps @param {number} step @param {number} speed @returns {number} how long a step is shown, in ms */
export function findWait(steps, step, speed) {
  const next = steps[step + 1];
  return next ? Math.min(MOST_WAIT_MS, Math.max(40, (next.t_ms - steps[step].t_ms) / speed)) : 0;
}

/** @param {ReplayStep[]} steps @param {number} step @returns {string} the way up to a step, as the points of an SVG line */
export const listPoints = (steps, step) => steps.slice(0, step + 1).flatMap(({ place }) => (place ? [place.join(",")] : [])).join(" ");

/**
 * @param {{ studyKey: string, log: string, episodes: EpisodeSummary[], name: string, filmCommand: string }} properties
 */
export function Replay({ studyKey, log, episodes, name, filmCommand }) {
  const [number, setNumber] = useState(episodes[0]?.number ?? 0);
  const [episode, setEpisode] = useState(/** @type {EpisodeReplay | null} */ (null));
  const [step, setStep] = useState(0);
  const [isPlaying, setPlaying] = useState(false);
  const [speed, setSpeed] = useState(1);
  const [problem, setProblem] = useState("");
  useEffect(() => {
    setEpisode(null);
    setStep(0);
    setPlaying(false);
    setProblem("");
    if (number) readEpisode(studyKey, log, number).then(setEpisode, (error) => setProblem(error.message));
  }, [studyKey, log, number]);
  const last = (episode?.steps.length ?? 1) - 1;
  useEffect(() => {
    if (!isPlaying || !episode) return undefined;
    if (step >= last) return setPlaying(false);
    const timer = setTimeout(() => setStep(step + 1), findWait(episode.steps, step, speed));
    return () => clearTimeout(timer);
  }, [isPlaying, step, speed, episode]);
  const play = () => {
    if (step >= last) setStep(0);
    setPlaying(!isPlaying);
  };
  if (!episodes.length) return html`<p class="quiet">This session has no episodes.</p>`;
  return html`<section class="replay" aria-label=${`Replay of ${name}`}><h3>Replay</h3>
    <div class="row"><label>Episode <select value=${number} onChange=${(/** @type {any} */ event) => setNumber(Number(event.target.value))}>
        ${episodes.map((row) => html`<option key=${row.number} value=${row.number}>${row.number}: ${row.block}, ${row.outcome}, ${row.steps} steps</option>`)}</select></label>
      <button type="button" class="main" disabled=${!episode} onClick=${play}>${isPlaying ? "Pause" : "Play"}</button>
      <div class="segments" role="group" aria-label="Speed">${SPEEDS.map((factor) => html`
        <button type="button" key=${factor} aria-pressed=${factor === speed} onClick=${() => setSpeed(factor)}>${factor}×</button>`)}</div></div>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${episode && html`<input type="range" aria-label="Step" min="0" max=${last} value=${step} onInput=${(/** @type {any} */ event) => { setPlaying(false); setStep(Number(event.target.value)); }} />
      <div class="replay-views"><${Picture} key=${number} address=${frameAddress(studyKey, log, number, step)} step=${step} />
        ${episode.floor && html`<${FloorView} floor=${episode.floor} steps=${episode.steps} step=${step} />`}</div>
      <p class="quiet" dir="auto">${episode.mission}</p><${Steps} episode=${episode} step=${step} />
      <${Command} about="A film of it" line=${`${filmCommand} --episode=${number} --out=episode-${number}.mp4`} />`}</section>`;
}

/** @param {{ address: string, step: number }} properties */
function Picture({ address, step }) {
  const [problem, setProblem] = useState("");
  const fail = () => fetch(address).then((answer) => answer.json()).then((refusal) => setProblem(refusal.message), () => setProblem("The picture cannot be drawn."));
  if (problem) return html`<p class="mistake" role="alert">${problem}</p>`;
  return html`<img class="seen" src=${address} alt=${`What the participant saw after step ${step}`} onError=${fail} />`;
}

/** @param {{ floor: ReplayMap, steps: ReplayStep[], step: number }} properties */
function FloorView({ floor, steps, step }) {
  const [left, top, right, bottom] = floor.bounds;
  const margin = 0.04 * Math.max(right - left, bottom - top);
  const line = Math.max(right - left, bottom - top) / 130;
  const { place, yaw_rad } = steps[step];
  return html`<svg class="floor" role="img" aria-label=${`The way up to step ${step}, from above`} viewBox=${`${left - margin} ${top - margin} ${right - left + 2 * margin} ${bottom - top + 2 * margin}`}>
    <rect class="ground" x=${left} y=${top} width=${right - left} height=${bottom - top} />
    ${floor.things.map((thing) => html`<circle cx=${thing.x} cy=${thing.z} r=${thing.radius} fill=${thing.colour}><title>${thing.name}</title></circle>`)}
    ${floor.walls.map(([x0, z0, x1, z1]) => html`<line class="wall" x1=${x0} y1=${z0} x2=${x1} y2=${z1} stroke-width=${line} />`)}
    <polyline class="way" points=${listPoints(steps, steps.length - 1)} stroke-width=${line} opacity="0.25" />
    <polyline class="way" points=${listPoints(steps, step)} stroke-width=${1.6 * line} />
    ${place && html`<path class="walker" transform=${`translate(${place[0]} ${place[1]}) rotate(${(-180 / Math.PI) * (yaw_rad ?? 0)}) scale(${line * 3.2})`} d="M1.4 0 L-1 1 L-.5 0 L-1 -1 Z" />`}</svg>`;
}

/** @param {{ episode: EpisodeReplay, step: number }} properties */
function Steps({ episode, step }) {
  const first = Math.max(0, Math.min(step - LISTED + 1, episode.steps.length - LISTED));
  const rows = episode.steps.map((row, number) => ({ row, number })).slice(first, first + LISTED);
  return html`<table class="steps"><thead><tr>${["step", "time in s", "key", "action", "reaction in ms", "reward"].map((word) => html`<th scope="col">${word}</th>`)}</tr></thead>
    <tbody>${rows.map(({ row, number }) => html`<tr key=${number} class=${number === step ? "now" : ""}><th scope="row">${number || "reset"}</th><td>${(row.t_ms / 1000).toFixed(2)}</td>
      <td>${row.key}</td><td>${row.action}</td><td>${row.reaction_ms === null ? "" : Math.round(row.reaction_ms)}</td><td>${row.reward ? row.reward.toFixed(2) : ""}</td></tr>`)}</tbody></table>`;
}
