// The builder: which view is shown, by the address behind the #, and what every view of a study has around it.
/** @import { Document, Mistake } from "./messages" */
import { html, render, useEffect, useState } from "./vendor/preact.js";
import { DataView } from "./data.js";
import { TrustNotice } from "./import.js";
import { Lanes } from "./lanes.js";
import { MediaView } from "./media.js";
import { OpenStudy, formatPath } from "./open_study.js";
import { PartForm } from "./part.js";
import { PreviewPane, findPart } from "./preview.js";
import { Settings, SourceView } from "./settings.js";
import { StudyCards } from "./studies.js";
import { Texts } from "./texts.js";
import { TrialTab, TryButtons } from "./trial.js";
import { useKinds } from "./add_part.js";
import { countNoun } from "./words.js";

const VIEWS = { parts: "Parts", texts: "Texts", media: "Tables and media", data: "Data", settings: "Settings", file: "File" };
const THEMES = ["auto", "light", "dark"];

/** @returns {string[]} the parts of the address behind the # */
const readAddress = () => location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);

/** @param {string} key @param {string} view @param {string} part */
const go = (key, view = "parts", part = "") => { location.hash = `#/study/${[key, view, part].map(encodeURIComponent).join("/")}`; };

function useAddress() {
  const [address, setAddress] = useState(readAddress);
  useEffect(() => {
    const follow = () => setAddress(readAddress());
    addEventListener("hashchange", follow);
    follow(); // the address may have changed between the first drawing and now
    return () => removeEventListener("hashchange", follow);
  }, []);
  return address;
}

function App() {
  const [place, key, view, part] = useAddress();
  const session = Number(part) || 1;
  const languages = useKinds()?.languages ?? ["en"];
  if (place === "trial") return html`<${TrialTab} studyKey=${key} part=${view ?? ""} session=${session} />`;
  if (place === "study") return html`<${StudyPage} key=${key} studyKey=${key} view=${view || "parts"} selected=${part ?? ""} languages=${languages} />`;
  return html`<${TopBar} /><${StudyCards} open=${(/** @type {string} */ chosen) => go(chosen)} languages=${languages} />`;
}

/** @param {{ children?: unknown }} properties */
function TopBar({ children }) {
  const [theme, setTheme] = useState(() => localStorage.getItem("theme") ?? "auto");
  useEffect(() => {
    document.documentElement.dataset.theme = theme;
    localStorage.setItem("theme", theme);
  }, [theme]);
  const next = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];
  return html`<header class="top"><a class="brand" href="#/">Studies</a>${children}
    <button type="button" class="quiet theme" aria-label=${`Colours: ${theme}; change to ${next}`} onClick=${() => setTheme(next)}>${{ auto: "◐", light: "☀", dark: "☾" }[theme]}</button></header>`;
}

/** @param {string} key @returns {{ study: OpenStudy, problem: string }} */
function useStudy(key) {
  const [, redraw] = useState(0);
  const [study] = useState(() => new OpenStudy(key, () => redraw((count) => count + 1)));
  const [problem, setProblem] = useState("");
  useEffect(() => {
    study.open().catch((error) => setProblem(error.message));
    return () => study.close();
  }, [study]);
  return { study, problem };
}

/** @param {{ studyKey: string, view: string, selected: string, languages: string[] }} properties */
function StudyPage({ studyKey, view, selected, languages }) {
  const { study, problem } = useStudy(studyKey);
  const content = study.document;
  useEffect(() => { document.title = `${content?.name ?? studyKey} · minihuman`; }, [content?.name]);
  if (!content) return html`<${TopBar} /><main><p role="status">${problem || "Opening the study …"}</p></main>`;
  return html`<${TopBar}><h1 dir="auto">${content.name}</h1><${SaveState} study=${study} />
      <span class="history"><button type="button" class="icon" aria-label="Undo" disabled=${!content.can_undo} onClick=${() => study.step("undo")}>↶</button>
        <button type="button" class="icon" aria-label="Redo" disabled=${!content.can_redo} onClick=${() => study.step("redo")}>↷</button></span>
      <${TryButtons} study=${study} part=${view === "parts" ? selected : ""} /></${TopBar}>
    <nav class="views" aria-label="Views of the study">${Object.entries(VIEWS).map(([name, words]) => html`
      <a key=${name} href=${`#/study/${encodeURIComponent(studyKey)}/${name}`} aria-current=${name === view ? "page" : undefined}>${words}</a>`)}</nav>
    <main class=${`view-${view}`} inert=${study.isUnforeseen}><${Notices} study=${study} content=${content} />
      ${view === "parts" && html`<${PartsView} study=${study} selected=${selected} languages=${languages} />`}
      ${view === "texts" && html`<${Texts} study=${study} languages=${languages} open=${(/** @type {string} */ key) => go(key, "texts")} />`}
      ${view === "media" && html`<${MediaView} study=${study} />`}
      ${view === "data" && html`<${DataView} study=${study} />`}
      ${view === "settings" && html`<${Settings} key=${selected} study=${study} selected=${selected} />`}
      ${view === "file" && html`<${SourceView} study=${study} />`}</main>`;
}

/** @param {{ study: OpenStudy, selected: string, languages: string[] }} properties */
function PartsView({ study, selected, languages }) {
  const part = findPart(study.document, selected);
  const select = (/** @type {string} */ name) => go(study.key, "parts", name === selected ? "" : name);
  return html`<${Lanes} study=${study} selected=${selected} select=${select} />
    <div class="panes"><div class="pane">${part ? html`<${PartForm} key=${selected} study=${study} part=${part} deselect=${() => go(study.key)} />`
        : html`<${Overview} study=${study} />`}</div>
      <div class="pane"><${PreviewPane} study=${study} part=${part} selected=${part ? selected : ""} languages=${languages} /></div></div>`;
}

/** What a participant's session comes to, while no part is selected. @param {{ study: OpenStudy }} properties */
function Overview({ study }) {
  const { durations, pay } = /** @type {Document} */ (study.document);
  return html`<article class="overview"><h2>One participant</h2>
    <p class="quiet">Choose a part above to change it; drag parts to order them, or use the arrows of the chosen part. What comes by itself (keyboard check,
      last words) is in the preview.</p>
    ${durations.length > 0 && html`<table><thead><tr><th scope="col">group</th><th scope="col">session</th><th scope="col">minutes</th></tr></thead><tbody>
      ${durations.map((row) => html`<tr><th scope="row">${row.group}</th><td>${row.session || "1"}</td><td>${Math.round(row.least_min)} to ${Math.round(row.most_min)}</td></tr>`)}</tbody></table>`}
    ${pay && html`<p>Pay: ${pay.base} ${pay.currency}${pay.per_point ? `, and ${pay.per_point} per point` : ""}${pay.most === null ? "" : `, at most ${pay.most}`}</p>`}
  </article>`;
}

/** @param {{ study: OpenStudy }} properties */
function SaveState({ study }) {
  const count = study.document?.mistakes.length ?? 0;
  const words = study.unsaved ? "Saving …" : count ? countNoun(count, "mistake") : "Saved";
  return html`<span class=${`save-state ${count ? "wrong" : ""}`} role="status">${words}</span>`;
}

/** @param {{ study: OpenStudy, content: Document }} properties */
function Notices({ study, content }) {
  const { failure } = study;
  return html`<div class="notices">
    ${failure && html`<div class="notice wrong" role="alert"><p>${failure.message}</p>
      ${failure.edits.length > 0 && html`<p class="quiet">Not saved: ${failure.edits.map((edit) => formatPath(edit.path)).join(", ")}</p>`}
      ${failure.edits.filter((edit) => typeof edit.value === "string").map((edit) => html`<pre class="unsaved" dir="auto">${edit.value}</pre>`)}
      <div class="buttons">${failure.edits.length > 0 && html`<button type="button" onClick=${() => study.retry()}>Make this change again</button>`}
        <button type="button" onClick=${() => study.dismiss()}>Leave it</button></div></div>`}
    ${study.wasEditedElsewhere && html`<div class="notice" role="status"><p>The file was edited elsewhere; this page shows it as it is now.</p>
      <button type="button" class="small" onClick=${() => study.dismiss()}>Good</button></div>`}
    ${content.restrictions.message && html`<div class="notice"><p>${content.restrictions.message}</p></div>`}
    ${!content.trusted && html`<${TrustNotice} study=${study} />`}
    ${content.mistakes.length > 0 && html`<section class="notice wrong" aria-label="Mistakes"><h2>To put right</h2>
      <ul>${content.mistakes.map((mistake) => html`<${MistakeRow} key=${mistake.message} mistake=${mistake} content=${content} />`)}</ul></section>`}
  </div>`;
}

/** @param {{ mistake: Mistake, content: Document }} properties */
function MistakeRow({ mistake, content }) {
  const part = content.parts.find((other) => other.path.every((step, place) => mistake.path[place] === step));
  const where = formatPath(mistake.path) || "file";
  const show = () => (part ? go(content.key, "parts", part.name) : go(content.key, mistake.path.length ? "settings" : "file"));
  return html`<li><button type="button" class="link" onClick=${show}>${part ? part.name : where}</button> ${mistake.path.length > 0 && html`<code>${mistake.path.at(-1)}</code>`} ${mistake.message}
    <span class="quiet">(line ${mistake.line})</span></li>`;
}

const root = /** @type {Element} */ (document.getElementById("app"));
root.replaceChildren();
render(html`<${App} />`, root);
