// What the study has recorded: sessions with their paths, queries, exports; each with the command that does the same.
/** @import { DataExport, Departure, GivenAnswer, QueryAnswer, RecordedData, RecordedSession, SessionDetails, SessionNote } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { Command, quoteWord } from "./command.js";
import { DepartureForm } from "./departure.js";
import { Replay } from "./replay.js";
import { annotateSession, exportStudy, pathsAddress, queryData, readData, readSession } from "./requests.js";
import { RECORD } from "./settings.js";
import { countNoun } from "./words.js";

const EXCLUDE = "exclude"; // the tag that every output obeys
const N_COLUMNS = 8; // of the table of sessions

/** @param {{ study: OpenStudy }} properties */
export function DataView({ study }) {
  const [recorded, setRecorded] = useState(/** @type {RecordedData | null} */ (null));
  const [problem, setProblem] = useState("");
  const [open, setOpen] = useState(""); // the log whose details are shown
  const [departure, setDeparture] = useState(/** @type {Departure | null} */ (null)); // the latest
  const refresh = () => readData(study.key).then(setRecorded, (error) => setProblem(error.message));
  useEffect(() => { refresh(); }, [study.key]);
  const finish = (/** @type {Departure} */ left) => {
    setDeparture(left);
    setOpen("");
    setRecorded(left.recorded);
  };
  if (!recorded) return html`<p role="status">${problem || "Reading the sessions …"}</p>`;
  const farewell = departure && html`<div class="notice" role="status">${departure.lines.map((line) => html`<p>${line}</p>`)}<${Command} about="The same as" line=${departure.command} /></div>`;
  if (recorded.sessions.length === 0) {
    return html`${farewell}<section class="recorded" aria-label="Data"><h2>Sessions</h2><p class="quiet">Nothing is recorded yet. <b>Run it</b> starts sessions; those of
      <b>Try the study</b> and <b>Simulate 20 people</b> are no data.</p><button type="button" class="small" onClick=${refresh}>Look again</button><${RecordLink} study=${study} /></section>`;
  }
  return html`${farewell}<section class="recorded" aria-label="Sessions"><header><h2>Sessions <small>${recorded.sessions.length}, in ${recorded.folder}</small></h2>
      <button type="button" class="small" onClick=${refresh}>Look again</button></header>
      <div class="listing" tabindex="0" role="group" aria-label="Table of sessions"><table><thead><tr>${["participant", "group", "session", "state", "started", "episodes", "minutes", "notes"].map((name) => html`
        <th scope="col">${name}</th>`)}</tr></thead>
      <tbody>${recorded.sessions.map((session) => html`<${SessionRows} key=${session.log} study=${study} session=${session} isOpen=${open === session.log}
        toggle=${() => setOpen(open === session.log ? "" : session.log)} folder=${recorded.folder} update=${setRecorded} finish=${finish} />`)}</tbody></table></div></section>
    <${Query} study=${study} recorded=${recorded} />
    <${Export} study=${study} recorded=${recorded} /><${RecordLink} study=${study} />`;
}

/** @param {{ study: OpenStudy }} properties */
function RecordLink({ study }) {
  const address = `#/study/${encodeURIComponent(study.key)}/settings/${RECORD}`;
  return html`<p class="quiet">What the study records, and why, on one page for the data protection officer: <a href=${address}>Record of processing</a></p>`;
}

/** @param {SessionNote} note */
const formatNote = ({ tag, episode, note }) => `${tag}${episode === null ? "" : ` (episode ${episode})`}${note ? `: ${note}` : ""}`;

/**
 * @typedef {object} SessionProperties
 * @property {OpenStudy} study
 * @property {RecordedSession} session
 * @property {string} folder of the study's data
 * @property {(answer: RecordedData) => void} update
 * @property {(left: Departure) => void} finish
 */

/** @param {SessionProperties & { isOpen: boolean, toggle: () => void }} properties */
function SessionRows({ isOpen, toggle, ...shared }) {
  const { session } = shared;
  const name = `${session.participant}, session ${session.session}`;
  if (session.problem) return html`<tr><th scope="row">${session.participant}</th><td colspan=${N_COLUMNS - 1} class="mistake">cannot be read: ${session.problem}</td></tr>`;
  return html`<tr><th scope="row"><button type="button" class="link" aria-expanded=${isOpen} aria-label=${`Details of ${name}`} onClick=${toggle}>${session.participant}</button></th>
      <td>${session.group}</td><td>${session.session}</td><td>${session.state}</td><td>${session.started_at.slice(0, 16).replace("T", " ")}</td>
      <td>${session.episodes_completed} of ${session.episodes_planned}</td><td>${session.minutes.toFixed(1)}</td>
      <td>${session.notes.map((note) => html`<div dir="auto">${formatNote(note)}</div>`)}</td></tr>
    ${isOpen && html`<tr class="details"><td colspan=${N_COLUMNS}><${Details} ...${shared} name=${name} /></td></tr>`}`;
}

/** @param {SessionProperties & { name: string }} properties */
function Details({ study, session, folder, name, update, finish }) {
  const [isDrawn, setDrawn] = useState(true);
  const [details, setDetails] = useState(/** @type {SessionDetails | null} */ (null));
  const [problem, setProblem] = useState("");
  useEffect(() => { readSession(study.key, session.log).then(setDetails, (error) => setProblem(error.message)); }, [study.key, session.log]);
  return html`<div class="details-box"><div>
      ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
      ${details && html`<${Replay} studyKey=${study.key} log=${session.log} episodes=${details.episodes} name=${name} filmCommand=${session.film_command} />`}
      <${Command} about="Replay it" line=${session.replay_command} />
      <h3>All paths</h3><figure>${isDrawn ? html`<img src=${pathsAddress(study.key, session.log)} alt=${`Paths of ${name}`} onError=${() => setDrawn(false)} />`
        : html`<p class="quiet">This session has no paths to draw.</p>`}</figure></div>
    <div>${details && html`<${Answers} answers=${details.answers} />`}
      <${Annotate} study=${study} session=${session} name=${name} update=${update} />
      <${DepartureForm} studyKey=${study.key} participant=${session.participant} folder=${folder} finish=${finish} /></div></div>`;
}

/** @param {{ answers: GivenAnswer[] }} properties */
function Answers({ answers }) {
  if (!answers.length) return html`<h3>Answers</h3><p class="quiet">No question was answered.</p>`;
  const judge = (/** @type {GivenAnswer} */ { right }) => new Map([[true, "right"], [false, "wrong"]]).get(/** @type {boolean} */ (right)) ?? "";
  return html`<h3>Answers</h3><table class="answers"><thead><tr><th scope="col">question</th><th scope="col">answer</th><th scope="col"></th></tr></thead>
    <tbody>${answers.map((given) => html`<tr><th scope="row">${given.part} · ${given.question}${given.attempt > 1 ? ` (try ${given.attempt})` : ""}</th>
      <td dir="auto">${given.answer || html`<span class="quiet">left out</span>`}</td><td>${judge(given)}</td></tr>`)}</tbody></table>`;
}

/** @param {{ study: OpenStudy, session: RecordedSession, name: string, update: (answer: RecordedData) => void }} properties */
function Annotate({ study, session, name, update }) {
  const [tag, setTag] = useState(EXCLUDE);
  const [episode, setEpisode] = useState("");
  const [note, setNote] = useState("");
  const [problem, setProblem] = useState("");
  const take = (/** @type {(text: string) => void} */ set) => (/** @type {any} */ event) => set(event.target.value);
  const send = (/** @type {any} */ request) => annotateSession(study.key, { log: session.log, ...request }).then(
    (answer) => { setNote(""); setProblem(""); update(answer); }, (error) => setProblem(error.message));
  const submit = (/** @type {Event} */ event) => {
    event.preventDefault();
    send({ tag, note, episode: episode === "" ? null : Number(episode) });
  };
  const words = [...(episode === "" ? [] : [`--episode=${episode}`]), `--tag=${tag}`, `--note=${note || "REASON"}`];
  return html`<form class="annotate" aria-label=${`Annotate ${name}`} onSubmit=${submit}><h3>Exclude or annotate</h3>
    <p class="quiet">What is tagged <code>exclude</code> stays in the log and leaves tables, figures and reports.</p>
    <div class="row"><label>Tag <input type="text" required pattern="[a-z][a-z0-9_\\-]*" value=${tag} onInput=${take(setTag)} /></label>
      <label>Episode <input type="number" min="1" placeholder="all" value=${episode} onInput=${take(setEpisode)} /></label>
      <label class="wide">Reason <input type="text" required dir="auto" value=${note} onInput=${take(setNote)} /></label>
      <button class="main">${tag === EXCLUDE ? "Exclude" : "Annotate"}</button></div>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    <${Command} about="The same as" line=${`${session.annotate_command} ${words.map(quoteWord).join(" ")}`} />
    ${session.notes.map((other) => html`<p><span dir="auto">${formatNote(other)}</span> <button type="button" class="small"
      onClick=${() => send({ tag: other.tag, episode: other.episode, note: note || "taken back", take_back: true })}>Take it back</button></p>`)}</form>`;
}

/** @param {{ study: OpenStudy, recorded: RecordedData }} properties */
function Query({ study, recorded }) {
  const [sql, setSql] = useState(recorded.examples[0].sql);
  const [answer, setAnswer] = useState(/** @type {QueryAnswer | null} */ (null));
  const [problem, setProblem] = useState("");
  const [isRunning, setRunning] = useState(false);
  const run = (/** @type {string} */ text) => {
    setSql(text);
    setProblem("");
    setRunning(true);
    queryData(study.key, text).then(setAnswer, (error) => { setAnswer(null); setProblem(error.message); }).finally(() => setRunning(false));
  };
  const submit = (/** @type {Event} */ event) => { event.preventDefault(); run(sql); };
  return html`<section class="recorded" aria-label="Query"><h2>Query</h2>
    <p class="quiet">The tables are those of an export: episodes, participants, blocks, steps and others. A query reads and changes nothing.</p>
    <div class="buttons">${recorded.examples.map((example) => html`<button type="button" class="small" onClick=${() => run(example.sql)}>${example.about}</button>`)}</div>
    <form onSubmit=${submit}><label class="block">SQL <textarea rows="4" spellcheck="false" value=${sql} onInput=${(/** @type {any} */ event) => setSql(event.target.value)}></textarea></label>
      <button class="main" disabled=${isRunning}>${isRunning ? "Reading …" : "Run the query"}</button></form>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${answer && html`<${Result} answer=${answer} />`}</section>`;
}

/** @param {{ answer: QueryAnswer }} properties */
function Result({ answer }) {
  const hidden = answer.n_rows - answer.rows.length;
  return html`<div class="listing" tabindex="0" role="group" aria-label="Result of the query"><table><thead><tr>${answer.columns.map((column) => html`<th scope="col">${column}</th>`)}</tr></thead>
      <tbody>${answer.rows.map((row) => html`<tr>${row.map((cell) => html`<td dir="auto">${cell}</td>`)}</tr>`)}</tbody></table></div>
    <p class="quiet" role="status">${countNoun(answer.n_rows, "row")}${hidden > 0 ? `, the first ${answer.rows.length} shown` : ""}</p>
    ${answer.notes.map((note) => html`<p class="quiet">${note}</p>`)}
    <${Command} about="The same as" line=${answer.command} />`;
}

/** @param {{ study: OpenStudy, recorded: RecordedData }} properties */
function Export({ study, recorded }) {
  const [format, setFormat] = useState("csv");
  const [made, setMade] = useState(/** @type {DataExport | null} */ (null));
  const [problem, setProblem] = useState("");
  const [isRunning, setRunning] = useState(false);
  const submit = (/** @type {Event} */ event) => {
    event.preventDefault();
    setMade(null);
    setProblem("");
    setRunning(true);
    exportStudy(study.key, format).then(setMade, (error) => setProblem(error.message)).finally(() => setRunning(false));
  };
  return html`<section class="recorded" aria-label="Export"><h2>Export</h2>
    <form class="row" onSubmit=${submit}><label>Format <select value=${format} onChange=${(/** @type {any} */ event) => setFormat(event.target.value)}>
        ${recorded.formats.map((name) => html`<option value=${name}>${name}</option>`)}</select></label>
      <button class="main" disabled=${isRunning}>${isRunning ? "Exporting …" : "Export"}</button></form>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    ${made && html`<p role="status">Written to <code>${made.folder}</code></p><${Command} about="The same as" line=${made.command} />`}</section>`;
}
