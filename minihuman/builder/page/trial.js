// Trials: the study or a part of it in a tab of its own, and twenty simulated people with their report.
/** @import { PageInfo, SimulationRun } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { Dialog } from "./dialog.js";
import { findSession } from "./preview.js";
import { buildAddress, describePage, readSimulation, showPreview, simulateStudy } from "./requests.js";

const LOOK_MS = 700;

/** @param {OpenStudy} study @param {string} part */
export function trialAddress(study, part) {
  const session = findSession(study.document, part);
  return `#/trial/${[study.key, part, String(session)].map(encodeURIComponent).join("/")}`;
}

/** The tab in which a study is tried. @param {{ studyKey: string, part: string, session: number }} properties */
export function TrialTab({ studyKey, part, session }) {
  const [url, setUrl] = useState("");
  const [problem, setProblem] = useState("");
  const [round, setRound] = useState(0);
  useEffect(() => {
    document.title = `Trial of ${studyKey}`;
    setUrl("");
    showPreview(studyKey, { part, session, kind: "trial" }).then((answer) => setUrl(answer.url), (error) => setProblem(error.message));
  }, [studyKey, part, session, round]);
  return html`<div class="trial"><header role="banner"><strong>Trial</strong> <span>${part ? `of the part ${part}` : "of the whole study"}: not data, nothing is kept</span>
      <button type="button" onClick=${() => setRound(round + 1)}>Again</button></header>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${url && html`<iframe key=${url} src=${url} title="Trial of the study" allow="fullscreen; gamepad"></iframe>`}</div>`;
}

/** @param {{ study: OpenStudy, close: () => void }} properties */
export function Simulation({ study, close }) {
  const [run, setRun] = useState(/** @type {SimulationRun | null} */ (null));
  const [place, setPlace] = useState(/** @type {PageInfo | null} */ (null));
  const [problem, setProblem] = useState("");
  useEffect(() => {
    let isOpen = true;
    const look = async (/** @type {SimulationRun} */ state) => {
      if (!isOpen) return;
      setRun(state);
      if (state.state !== "running") return;
      await new Promise((resolve) => setTimeout(resolve, LOOK_MS));
      await readSimulation(state.number).then(look);
    };
    describePage().then(setPlace, () => {});
    simulateStudy(study.key).then(look).catch((error) => setProblem(error.message));
    return () => { isOpen = false; };
  }, []);
  return html`<${Dialog} title="Twenty simulated people" close=${close}>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${run && html`<p role="status">${describeRun(run)}</p>
      <progress aria-label="Simulated participants" max="1" value=${run.state === "done" ? 1 : run.progress * 0.9}></progress>
      ${run.state === "failed" && html`<pre tabindex="0" aria-label="what the command printed">${run.output}</pre>`}
      ${run.report && place && html`<p><a class="button main" href=${`${place.reports}/${run.report}`} target="_blank" rel="noreferrer">Open the report</a></p>`}
      <p class="quiet">The same on the command line:</p>${run.commands.map((line) => html`<p><code>${line}</code></p>`)}`}
    <p class="quiet">Their sessions lie in a folder of their own, are marked as simulated, and are erased with the desk.</p></${Dialog}>`;
}

/** @param {SimulationRun} run */
function describeRun(run) {
  if (run.state === "done") return "The report is ready: it is the report that your data will have.";
  if (run.state === "failed") return `It stopped while ${run.step}:`;
  return `${run.step.charAt(0).toUpperCase()}${run.step.slice(1)} …`;
}

/** @param {{ study: OpenStudy, part: string }} properties */
export function TryButtons({ study, part }) {
  const [isSimulating, setSimulating] = useState(false);
  const [place, setPlace] = useState(/** @type {PageInfo | null} */ (null));
  useEffect(() => { describePage().then(setPlace, () => {}); }, []);
  return html`<div class="try" role="group" aria-label="Try it">
    <a class="button main" href=${trialAddress(study, "")} target="_blank">Try the study</a>
    ${part && html`<a class="button" href=${trialAddress(study, part)} target="_blank">Try this part</a>`}
    <button type="button" onClick=${() => setSimulating(true)}>Simulate 20 people</button>
    ${place && html`<form method="post" action=${`${place.desk}start`} target="_blank"><input type="hidden" name="study" value=${study.key} />
      <input type="hidden" name="action" value="doctor" /><button>Check this machine</button></form>
      <a class="button" href=${buildAddress(`${place.desk}study`, { key: study.key })}>Run it</a>`}
    ${isSimulating && html`<${Simulation} study=${study} close=${() => setSimulating(false)} />`}
  </div>`;
}
