// The dialog that adds a part to a lane: one that the study has, or a new one.
/** @import { Edit, Kinds, Lane, PartKind } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { Dialog } from "./dialog.js";
import { buildEntryEdits, nameLane } from "./lanes.js";
import { listKinds } from "./requests.js";
import { describeKind, makeName, nameKind } from "./words.js";
import { WorldPicker, buildWorldEdits, nameWorld } from "./worlds.js";
import { describeWorld } from "./requests.js";

/** @returns {Kinds | null} */
export function useKinds() {
  const [kinds, setKinds] = useState(/** @type {Kinds | null} */ (null));
  useEffect(() => { listKinds().then(setKinds, () => {}); }, []);
  return kinds;
}

/** @param {{ study: OpenStudy, lane: Lane, place: number, close: () => void, select: (name: string) => void }} properties */
export function AddPart({ study, lane, place, close, select }) {
  const kinds = useKinds();
  const [world, setWorld] = useState(/** @type {PartKind | null} */ (null)); // whose world is to be chosen
  const parts = study.document?.parts ?? [];
  const enter = async (/** @type {string} */ name, /** @type {Edit[]} */ before, /** @type {string} */ kind, to = place) => {
    close();
    if (await study.edit([...before, ...buildEntryEdits(study, lane, to, name, kind)])) select(name);
  };
  const make = async (/** @type {PartKind} */ kind, /** @type {string} */ chosen = "") => {
    const name = makeName(chosen ? nameWorld(chosen).replace(/^Mini(Grid|World)-/, "") : kind.kind, study.listNames());
    const own = kind.kind === "consent" ? kinds?.consents[study.read(["study", "language"]) ?? "en"] : undefined; // in the study's language
    let fields = /** @type {any} */ ({ ...(own ?? kind.new), name });
    if (chosen) fields = await fitToWorld(fields, chosen);
    const count = (study.read([kind.table]) ?? []).length;
    const to = fields.asks_consent ? 0 : place; // nothing comes before the agreement
    enter(name, [{ op: "insert", path: [kind.table, count], value: fields }], kind.table === "blocks" ? "block" : "", to);
  };
  if (world) return html`<${WorldPicker} choose=${(/** @type {string} */ id) => make(world, id)} close=${close} />`;
  const others = parts.filter((part) => part.path[0] !== "blocks" || !lane.parts.includes(part.name)); // a block is played once
  return html`<${Dialog} title=${`Add to ${nameLane(lane)}`} close=${close}>
    <h3>New</h3>
    <ul class="choices">${(kinds?.parts ?? []).map((kind) => html`<li key=${kind.kind}>
      <button type="button" class=${`choice kind-${kind.kind}`} onClick=${() => (kind.kind === "play" ? setWorld(kind) : make(kind))}>
        <strong>${nameKind(kind.kind)}</strong><span>${describeKind(kind)}</span></button></li>`)}</ul>
    ${others.length > 0 && html`<h3>That the study has</h3>
      <ul class="choices">${others.map((part) => html`<li key=${part.name}><button type="button" class=${`choice kind-${part.kind}`}
        onClick=${() => enter(part.name, [], part.path[0] === "blocks" ? "block" : "")}>
        <strong>${part.title || part.name}</strong><span>${nameKind(part.kind)}</span></button></li>`)}</ul>`}
  </${Dialog}>`;
}

/** @param {any} fields of a new block @param {string} world @returns {Promise<any>} the fields in a world */
async function fitToWorld(fields, world) {
  const facts = await describeWorld(world).catch(() => null);
  const fitted = { ...fields, world };
  if (fields.world !== world) delete fitted.options;
  for (const edit of buildWorldEdits(fields, ["world"], world, facts)) {
    if (edit.op === "set") fitted[edit.path[0]] = edit.value;
  }
  return fitted;
}
