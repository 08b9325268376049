// The screen as the participant will see it: the real page of a disposable session, in a frame beside the form.
/** @import { Document, Part, Preview } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useEffect, useLayoutEffect, useRef, useState } from "./vendor/preact.js";
import { showPreview } from "./requests.js";
import { spellName } from "./words.js";

/** @type {Record<string, [number, number]>} */
const SIZES = { desk: [1920, 1080], browser: [1280, 720], phone: [390, 844] };
export const LANGUAGES = { en: "English", de: "Deutsch", fr: "Français", es: "Español", zh: "中文", ja: "日本語", ar: "العربية", he: "עברית" };

/** @param {{ study: OpenStudy, part: Part | null, selected: string, languages: string[] }} properties */
export function PreviewPane({ study, part, selected, languages }) {
  const [size, setSize] = useState("browser");
  const [language, setLanguage] = useState("");
  const [group, setGroup] = useState("");
  const [round, setRound] = useState(0); // of pressing "again"
  const shown = usePreview(study, selected, part, { language, group, round });
  const groups = (study.document?.lanes ?? []).map((lane) => lane.group).filter((name, place, all) => name && all.indexOf(name) === place);
  return html`<section class="preview" aria-label="Preview">
    <div class="preview-bar">
      <div class="segments" role="group" aria-label="Size of the screen">${Object.keys(SIZES).map((name) => html`
        <button type="button" aria-pressed=${size === name} onClick=${() => setSize(name)}>${spellName(name)}</button>`)}</div>
      <select aria-label="Language of the interface" value=${language} onChange=${(/** @type {any} */ event) => setLanguage(event.target.value)}>
        <option value="">Own language</option>${languages.map((code) => html`<option value=${code}>${/** @type {any} */ (LANGUAGES)[code] ?? code}</option>`)}</select>
      ${groups.length > 1 && html`<select aria-label="Group of the participant" value=${group} onChange=${(/** @type {any} */ event) => setGroup(event.target.value)}>
        <option value="">Any group</option>${groups.map((name) => html`<option value=${name}>${name}</option>`)}</select>`}
      <button type="button" class="small" onClick=${() => setRound(round + 1)}>Again</button>
    </div>
    <${Frame} preview=${shown.preview} size=${SIZES[size]} name=${size} />
    <p class="preview-note" role="status">${shown.problem || describePreview(shown.preview, selected)}</p>
  </section>`;
}

/** @param {Preview | null} preview @param {string} selected */
function describePreview(preview, selected) {
  if (!preview) return "The preview opens.";
  const whose = `as ${preview.participant} of ${preview.group} sees it`;
  return `${selected || "The whole session"}, ${whose}. Nothing that you do in it is recorded.`;
}

/**
 * Serve the selected part again after each change of the file that has no mistakes.
 * @param {OpenStudy} study @param {string} selected @param {Part | null} part @param {{ language: string, group: string, round: number }} wanted
 */
function usePreview(study, selected, part, wanted) {
  const [preview, setPreview] = useState(/** @type {Preview | null} */ (null));
  const [problem, setProblem] = useState("");
  const newest = useRef(0);
  const version = study.document?.version ?? "";
  useEffect(() => {
    const mistakes = study.document?.mistakes.length ?? 0;
    if (mistakes) return setProblem(`The preview waits until ${mistakes === 1 ? "the mistake is" : "the mistakes are"} put right.`);
    const turn = (newest.current += 1);
    const name = part?.kind === "order" ? "" : selected;
    const session = findSession(study.document, name);
    showPreview(study.key, { part: name, group: wanted.group, language: wanted.language, session }).then((answer) => {
      if (turn !== newest.current) return;
      setProblem("");
      setPreview(answer);
    }, (error) => turn === newest.current && setProblem(error.message));
  }, [version, study.document?.trusted, selected, wanted.language, wanted.group, wanted.round]);
  return { preview, problem };
}

/**
 * Whether the preview takes part: while the pointer is on it, until a key is pressed in the form. A page that is shown
 * takes the focus, so that keys reach it, and would take it from the field in which somebody writes.
 */
function useLiveness() {
  const [isLive, setLive] = useState(false);
  useEffect(() => {
    const rest = () => setLive(false);
    addEventListener("keydown", rest, true);
    addEventListener("focusin", rest, true);
    return () => {
      removeEventListener("keydown", rest, true);
      removeEventListener("focusin", rest, true);
    };
  }, []);
  return { isLive, setLive };
}

/** @param {{ preview: Preview | null, size: [number, number], name: string }} properties */
function Frame({ preview, size, name }) {
  const box = useRef(/** @type {any} */ (null));
  const [scale, setScale] = useState(0.5);
  const [width, height] = size;
  useLayoutEffect(() => {
    const fit = () => setScale(Math.min(1, box.current.clientWidth / width, Math.max(320, innerHeight * 0.62) / height));
    const observer = new ResizeObserver(fit);
    observer.observe(box.current);
    fit();
    return () => observer.disconnect();
  }, [width, height]);
  const { isLive, setLive } = useLiveness();
  const [loaded, setLoaded] = useState(""); // the address of the frame that is shown until the next has loaded
  const urls = [...new Set([loaded, preview?.url ?? ""])].filter(Boolean);
  const style = { transform: `scale(${scale})`, marginLeft: `${-(width * scale) / 2}px` };
  const play = () => {
    setLive(true);
    requestAnimationFrame(() => box.current?.querySelector("iframe")?.focus());
  };
  return html`<div class=${`screen ${name}`} ref=${box} style=${{ height: `${Math.ceil(height * scale)}px` }} onPointerMove=${() => setLive(true)}>
    ${!isLive && html`<button type="button" class="unseen" onClick=${play}>Play in the preview</button>`}
    ${urls.map((url) => html`<iframe key=${url} src=${url} class=${url === loaded ? "" : "coming"} style=${style} width=${width} height=${height}
      inert=${!isLive || url !== loaded} title=${url === preview?.url ? "Preview of the participant's screen" : "Preview before the change"} onLoad=${() => setLoaded(url)}></iframe>`)}
  </div>`;
}

/** @param {Document | null} study @param {string} name of a part @returns {number} the first session that has the part, from 1 */
export function findSession(study, name) {
  const tree = /** @type {any} */ (study?.tree ?? {});
  const orders = (tree.orders ?? []).filter((/** @type {any} */ order) => order.parts.flat().includes(name));
  const names = new Set([name, ...orders.map((/** @type {any} */ order) => order.name)]);
  const place = (tree.sessions ?? []).findIndex((/** @type {any} */ session) => session.parts.some((/** @type {string} */ part) => names.has(part)));
  return Math.max(place, 0) + 1;
}

/** @param {Document | null} study @param {string} name @returns {Part | null} */
export const findPart = (study, name) => study?.parts.find((part) => part.name === name) ?? null;
