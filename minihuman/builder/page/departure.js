// A participant who leaves: withdrawn, with their data erased, or replaced, with their data kept; each with the reason.
/** @import { Departure } from "./messages" */
import { html, useState } from "./vendor/preact.js";
import { Command, quoteWord } from "./command.js";
import { departParticipant } from "./requests.js";

/** @param {string} kind @param {string} participant @param {string} folder @param {string} reason */
export function writeDeparture(kind, participant, folder, reason) {
  const words = [kind, participant, `--study=${folder}`, `--reason=${reason || "REASON"}`, ...(kind === "withdraw" ? ["--erase"] : [])];
  return ["minihuman", ...words.map(quoteWord)].join(" ");
}

/** @param {{ studyKey: string, participant: string, folder: string, finish: (departure: Departure) => void }} properties */
export function DepartureForm({ studyKey, participant, folder, finish }) {
  const [kind, setKind] = useState(/** @type {"withdraw" | "replace"} */ ("replace"));
  const [reason, setReason] = useState("");
  const [code, setCode] = useState("");
  const [problem, setProblem] = useState("");
  const isErasing = kind === "withdraw";
  const submit = (/** @type {Event} */ event) => {
    event.preventDefault();
    departParticipant(studyKey, { participant, kind, reason }).then(finish, (error) => setProblem(error.message));
  };
  return html`<form class="departure" aria-label=${`${participant} leaves the study`} onSubmit=${submit}><h3>${participant} leaves the study</h3>
    <fieldset><legend>What becomes of the data</legend>
      <label class="switch"><input type="radio" name=${`kind-${participant}`} checked=${!isErasing} onChange=${() => setKind("replace")} /> Replace: the data stay, the next participant gets the slot</label>
      <label class="switch"><input type="radio" name=${`kind-${participant}`} checked=${isErasing} onChange=${() => setKind("withdraw")} /> Withdraw: all data of ${participant} are erased</label></fieldset>
    <div class="row"><label class="wide">Reason of the departure <input type="text" required dir="auto" value=${reason} onInput=${(/** @type {any} */ event) => setReason(event.target.value)} /></label>
      ${isErasing && html`<label>Type ${participant} to erase <input type="text" required pattern=${participant} value=${code} onInput=${(/** @type {any} */ event) => setCode(event.target.value)} /></label>`}
      <button class=${isErasing ? "danger" : "main"} disabled=${isErasing && code !== participant}>${isErasing ? "Erase the data" : "Replace"}</button></div>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    <${Command} about="The same as" line=${writeDeparture(kind, participant, folder, reason)} /></form>`;
}
