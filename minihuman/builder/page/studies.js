// The first view: the folder's studies as cards, and a gallery of studies to copy.
/** @import { Lane, Studies, StudyCard, Template } from "./messages" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { Dialog } from "./dialog.js";
import { LANGUAGES } from "./preview.js";
import { ImportFolder } from "./import.js";
import { buildAddress, listStudies, makeStudy } from "./requests.js";
import { nameLane } from "./lanes.js";
import { countNoun, formatMinutes, nameKind, stripMarks } from "./words.js";

const GALLERY = [["start", "Begin with"], ["trials", "Trials to copy"], ["example", "Studies to copy"]];

/** @param {string} title */
const capitalize = (title) => title.charAt(0).toUpperCase() + title.slice(1);

/** @param {{ open: (key: string) => void, languages: string[] }} properties */
export function StudyCards({ open, languages }) {
  const [studies, setStudies] = useState(/** @type {Studies | null} */ (null));
  const [problem, setProblem] = useState("");
  const [source, setSource] = useState(/** @type {Template | StudyCard | null} */ (null)); // that is to be copied
  const [topic, setTopic] = useState(""); // of the studies to copy that are shown; "" shows all
  const refresh = () => listStudies().then(setStudies, (error) => setProblem(error.message));
  useEffect(() => { refresh(); }, []);
  if (!studies) return html`<main><p role="status">${problem || "Opening the studies …"}</p></main>`;
  return html`<main class="home"><header><h1>Studies</h1><p class="quiet">in the folder ${studies.folder}</p>
      <${ImportFolder} taken=${studies.studies.map((card) => card.key.split("/")[0])} finish=${(/** @type {string} */ refused) => { setProblem(refused); refresh(); }} /></header>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${studies.studies.length === 0 && html`<p class="empty">There is no study here yet. Begin with one of those below: a copy of it is yours to change.</p>`}
    <ul class="cards">${studies.studies.map((card) => html`<${Card} key=${card.key} card=${card} open=${open} copy=${() => setSource(card)} />`)}</ul>
    <div class="segments topics" role="group" aria-label="Studies to copy by topic"><button type="button" aria-pressed=${topic === ""} onClick=${() => setTopic("")}>All ${studies.templates.length}</button>
      ${listTopics(studies.templates).map((name) => html`<button type="button" key=${name} aria-pressed=${topic === name} onClick=${() => setTopic(topic === name ? "" : name)}>${name}</button>`)}</div>
    ${GALLERY.filter(([group]) => pickTemplates(studies.templates, group, topic).length).map(([group, name]) => html`<section class="gallery" key=${group} aria-label=${name}><h2>${name}</h2>
      <ul class="cards">${pickTemplates(studies.templates, group, topic).map((template) => html`
        <${TemplateCard} key=${template.name} template=${template} copy=${() => setSource(template)} />`)}</ul></section>`)}
    ${source && html`<${CopyDialog} source=${source} close=${() => setSource(null)} open=${open} languages=${languages} />`}
  </main>`;
}

/** @param {Template[]} templates @returns {string[]} the topics that studies have, in the order in which they come up */
const listTopics = (templates) => [...new Set(templates.flatMap((template) => template.topics))];

/** @param {Template[]} templates @param {string} group @param {string} topic "" for every topic */
const pickTemplates = (templates, group, topic) => templates.filter((template) => template.group === group && (!topic || template.topics.includes(topic)));

/** @param {{ card: StudyCard, open: (key: string) => void, copy: () => void }} properties */
function Card({ card, open, copy }) {
  const counts = Object.entries(card.sessions).filter(([, count]) => count > 0);
  return html`<li class="card"><h2><button type="button" class="title" dir="auto" disabled=${!card.has_protocol} onClick=${() => open(card.key)}>${card.title}</button></h2>
    <p class="quiet">${[card.title === card.name ? "" : card.name, formatMinutes(card.minutes), countNoun(card.participants, "participant")].filter(Boolean).join(" · ")}</p>
    ${card.problem ? html`<p class="mistake">${card.problem}</p>` : html`<div class="strips">${card.lanes.slice(0, 4).map((lane) => html`<${Strip} lane=${lane} card=${card} />`)}</div>`}
    <p class="state">${card.mistakes > 0 && html`<span class="badge">${countNoun(card.mistakes, "mistake")}</span>`}
      ${counts.map(([state, count]) => html`<span>${count} ${state}</span>`)}
      ${counts.length === 0 && html`<span class="quiet">no sessions yet</span>`}</p>
    ${card.has_protocol && html`<div class="buttons"><button type="button" class="main" aria-label=${`Open ${card.title}`} onClick=${() => open(card.key)}>Open</button>
      <button type="button" aria-label=${`Copy ${card.title}`} onClick=${copy}>Copy</button></div>`}</li>`;
}

/** @param {{ lane: Lane, card: StudyCard }} properties */
function Strip({ lane, card }) {
  const kinds = new Map(card.parts.map((part) => [part.name, part.kind]));
  const words = lane.parts.map((name) => nameKind(kinds.get(name) ?? "by itself")).join(", ");
  return html`<div class="strip"><span>${nameLane(lane)}</span><span role="img" aria-label=${words || "no parts"} class="dots">
    ${lane.parts.map((name) => html`<i class=${`kind-${kinds.get(name) ?? "unknown"}`} title=${name}></i>`)}</span></div>`;
}

/** @param {{ template: Template, copy: () => void }} properties */
function TemplateCard({ template, copy }) {
  const address = buildAddress("api/template.png", { name: template.name });
  return html`<li class="card template"><img src=${address} alt="" loading="lazy" width="240" height="135" />
    <h3 dir="auto">${capitalize(template.title)}</h3><p class="summary" title=${template.summary}>${stripMarks(template.summary)}</p>
    <p class="quiet">${[formatMinutes(template.minutes), /** @type {any} */ (LANGUAGES)[template.language] ?? template.language].filter(Boolean).join(" · ")}</p>
    <p class="topics">${template.topics.map((name) => html`<span class="topic" key=${name}>${name}</span>`)}</p>
    ${template.citation && html`<p class="citation">${template.citation}</p>`}
    <div class="buttons"><button type="button" class="main" aria-label=${`Copy ${template.title}`} onClick=${copy}>Copy</button></div></li>`;
}

/** @param {{ source: Template | StudyCard, close: () => void, open: (key: string) => void, languages: string[] }} properties */
function CopyDialog({ source, close, open, languages }) {
  const isStudy = "key" in source;
  const isDraft = !isStudy && source.group === "start"; // which is written anew, in any language
  const [name, setName] = useState(isStudy ? `${source.name}-2` : source.name.replace(/^.*\//, ""));
  const [language, setLanguage] = useState(source.language || "en");
  const [problem, setProblem] = useState("");
  const make = async (/** @type {Event} */ event) => {
    event.preventDefault();
    const from = isStudy ? { source_key: source.key } : { template: source.name };
    await makeStudy({ name, language, ...from }).then((study) => open(study.key), (error) => setProblem(error.message));
  };
  return html`<${Dialog} title=${`A copy of ${source.title}`} close=${close}><form onSubmit=${make}>
    <label class="block">Name of your study <input type="text" value=${name} required onInput=${(/** @type {any} */ event) => setName(event.target.value)} /></label>
    ${isDraft && html`<label class="block">Language <select value=${language} onChange=${(/** @type {any} */ event) => setLanguage(event.target.value)}>
      ${languages.map((code) => html`<option value=${code}>${/** @type {any} */ (LANGUAGES)[code] ?? code}</option>`)}</select></label>`}
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    <div class="buttons"><button class="main">Make the study</button><button type="button" onClick=${close}>Cancel</button></div></form></${Dialog}>`;
}
