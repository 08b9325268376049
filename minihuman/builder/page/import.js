// A colleague's folder: chosen on this computer, copied file by file; and the code of a study, shown before it is trusted.
/** @import { TrustQuestion } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { Dialog } from "./dialog.js";
import { askTrust, importFile, trustStudy } from "./requests.js";
import { countNoun, makeName } from "./words.js";

const WANTED = /\.(toml|csv|tsv|png|jpe?g|webp|wav|mp3|ogg|flac|py|npz|md|txt)$/i;
const HIDDEN = /(^|\/)[._]/; // and what programs leave behind
const MOST_PARTS = 3;

/** @param {string[]} paths of a chosen folder, each with the folder's name first @returns {{ folder: string, wanted: string[], left: string[] }} */
export function sortFiles(paths) {
  const inside = paths.map((path) => path.split("/").slice(1).join("/"));
  const isWanted = (/** @type {string} */ path) => WANTED.test(path) && !HIDDEN.test(path) && path.split("/").length <= MOST_PARTS;
  return { folder: makeName(paths[0]?.split("/")[0] ?? "", []), wanted: inside.filter(isWanted), left: inside.filter((path) => !isWanted(path)) };
}

/** @param {{ taken: string[], finish: (problem: string) => void }} properties taken: names of folders that exist */
export function ImportFolder({ taken, finish }) {
  const [progress, setProgress] = useState("");
  const take = async (/** @type {any} */ event) => {
    const files = /** @type {File[]} */ ([...event.target.files]);
    event.target.value = "";
    const byPath = new Map(files.map((file) => [file.webkitRelativePath.split("/").slice(1).join("/"), file]));
    const { folder, wanted, left } = sortFiles(files.map((file) => file.webkitRelativePath));
    const name = makeName(folder, taken);
    if (!wanted.some((path) => path.endsWith(".toml"))) return finish("This folder has no protocol (a .toml file).");
    /** @type {string[]} */
    const refused = [];
    for (const [place, path] of wanted.entries()) {
      setProgress(`Copying ${place + 1} of ${wanted.length} …`);
      await importFile(name, path, /** @type {File} */ (byPath.get(path))).catch((error) => refused.push(`${path}: ${error.message}`));
    }
    setProgress(`${countNoun(wanted.length - refused.length, "file")} copied into ${name}${left.length ? `; ${countNoun(left.length, "other file")} left out` : ""}.`);
    finish(refused.join("; "));
  };
  return html`<label class="button import">Import a colleague's folder <input type="file" webkitdirectory onChange=${take} aria-label="Import a colleague's folder" /></label>
    <span role="status" class="quiet">${progress}</span>`;
}

/** The code that a study would run, and the one question whether to trust it. @param {{ study: OpenStudy }} properties */
export function TrustNotice({ study }) {
  const [isOpen, setOpen] = useState(false);
  return html`<div class="notice wrong"><p>This study runs code of its folder, which you do not trust yet, so there is no preview.</p>
    <button type="button" onClick=${() => setOpen(true)}>Look at the code, then decide</button>
    ${isOpen && html`<${TrustDialog} study=${study} close=${() => setOpen(false)} />`}</div>`;
}

/** @param {{ study: OpenStudy, close: () => void }} properties */
function TrustDialog({ study, close }) {
  const [question, setQuestion] = useState(/** @type {TrustQuestion | null} */ (null));
  const [problem, setProblem] = useState("");
  const ask = () => askTrust(study.key).then(setQuestion, (error) => setProblem(error.message));
  useEffect(() => { ask(); }, [study.key]);
  const trust = () => trustStudy(study.key, question?.sha256 ?? "").then(() => { close(); study.reload(); }, (error) => { setProblem(error.message); ask(); });
  return html`<${Dialog} title="Do you trust this code?" close=${close} isWide>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${question && html`<p>The study runs Python or reads files from <code>${question.untrusted || "nowhere that you do not trust"}</code>. What runs here can do all that you can do on this computer:
        read it, or ask somebody who can. You are asked once.</p>
      ${question.files.map((file) => html`<details key=${file.name} open><summary>${file.name}</summary><pre tabindex="0" aria-label=${`Code of ${file.name}`}>${file.text}</pre></details>`)}
      <div class="buttons"><button type="button" class="main" onClick=${trust}>I trust this folder</button><button type="button" onClick=${close}>Not now</button></div>`}</${Dialog}>`;
}
