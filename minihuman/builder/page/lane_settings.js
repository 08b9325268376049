// Groups and days of the line of parts: what can be added, and the dialog in which one is named, spaced or removed.
/** @import { Edit, Lane } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useState } from "./vendor/preact.js";
import { Dialog } from "./dialog.js";
import { TableForm } from "./form.js";
import { TextInput } from "./text_input.js";
import { makeName } from "./words.js";

const DAYS_BETWEEN = [1, 3]; // to begin with

/** @param {any[]} tables @returns {string[]} */
const listNames = (tables) => tables.map((table) => table.name);

/** The edit that adds a group with the parts of the first one. @param {OpenStudy} study @returns {Edit[]} */
export function buildGroupEdits(study) {
  const groups = /** @type {any[]} */ (study.read(["groups"]) ?? []);
  const fresh = { name: makeName("group", listNames(groups)) };
  for (const field of ["blocks", "parts"]) {
    if (groups[0]?.[field]) Object.assign(fresh, { [field]: groups[0][field] });
  }
  return [{ op: "insert", path: ["groups", groups.length], value: fresh }];
}

/**
 * The edits that add a day. A study of one day gets two: what its groups list becomes the first, and the second has the same.
 * @param {OpenStudy} study @returns {Edit[]}
 */
export function buildDayEdits(study) {
  const sessions = /** @type {any[]} */ (study.read(["sessions"]) ?? []);
  const days = sessions.length ? sessions : [{ name: "day-1", parts: study.document?.lanes[0]?.parts ?? [] }];
  const pages = /** @type {any[]} */ (study.read(["pages"]) ?? []);
  const agreed = new Set(listNames(pages.filter((page) => page.asks_consent)));
  const parts = days[days.length - 1].parts.filter((/** @type {string} */ name) => !agreed.has(name));
  const fresh = { name: makeName(`day-${days.length + 1}`, listNames(days)), parts, days_after_previous: DAYS_BETWEEN };
  if (sessions.length) return [{ op: "insert", path: ["sessions", sessions.length], value: fresh }];
  const groups = /** @type {any[]} */ (study.read(["groups"]) ?? []);
  /** @type {Edit[]} */
  const edits = groups.flatMap((group, place) => ["blocks", "parts"].filter((field) => group[field])
    .map((field) => /** @type {const} */ ({ op: "remove", path: ["groups", place, field] })));
  return [...edits, { op: "set", path: ["sessions"], value: [days[0], fresh] }];
}

/** @param {OpenStudy} study @returns {string} why no day can be added; "" if one can */
export function findDayProblem(study) {
  if (study.read(["sessions"])?.length) return "";
  const lists = new Set((study.document?.lanes ?? []).map((lane) => lane.parts.join()));
  return lists.size > 1 ? "Days are the same for all groups, which list different parts now: give them the same parts, then let one have others instead." : "";
}

/** @param {{ study: OpenStudy }} properties */
export function LineButtons({ study }) {
  const problem = findDayProblem(study);
  const isFixed = study.restrictionAt(["groups"]) !== "" || study.restrictionAt(["sessions"]) !== "";
  if (isFixed) return null;
  return html`<div class="line-buttons"><button type="button" class="dashed" onClick=${() => study.edit(buildGroupEdits(study))}>+ Add a group</button>
    <button type="button" class="dashed" disabled=${problem !== ""} aria-describedby=${problem ? "no-day" : undefined}
      onClick=${() => study.edit(buildDayEdits(study))}>+ Add a day</button>
    ${problem && html`<span id="no-day" class="quiet">${problem}</span>`}</div>`;
}

/** @param {Lane} lane @param {OpenStudy} study @returns {string} the days between a lane's session and the one before; "" for the first */
export function describeInterval(lane, study) {
  const session = (study.read(["sessions"]) ?? []).find((/** @type {any} */ other) => other.name === lane.session);
  const [least, most] = session?.days_after_previous ?? [];
  if (least === undefined) return "";
  return least === most ? `${least} ${least === 1 ? "day" : "days"} later` : `${least} to ${most} days later`;
}

/** @param {{ study: OpenStudy, lane: Lane, close: () => void }} properties */
export function LaneSettings({ study, lane, close }) {
  const [group] = useState(() => findPlace(study, "groups", lane.group)); // a name may change in the dialog
  const [day] = useState(() => findPlace(study, "sessions", lane.session));
  const remove = (/** @type {string} */ table, /** @type {number} */ place) => {
    close();
    study.edit([{ op: "remove", path: [table, place] }]);
  };
  return html`<${Dialog} title=${[lane.session && "Day and group", "Group"].find(Boolean)} close=${close}>
    ${day >= 0 && html`<${Part} study=${study} table="sessions" noun="day" place=${day} hidden=${["parts"]} essential=${["days_after_previous"]} remove=${remove} />`}
    ${group >= 0 && html`<${Part} study=${study} table="groups" noun="group" place=${group} hidden=${["parts", "blocks"]} essential=${["allocation_ratio"]} remove=${remove} />`}
  </${Dialog}>`;
}

/** @param {OpenStudy} study @param {string} table @param {string} name */
const findPlace = (study, table, name) => (name ? listNames(study.read([table]) ?? []).indexOf(name) : -1);

/** @param {{ study: OpenStudy, table: string, noun: string, place: number, hidden: string[], essential: string[], remove: (table: string, place: number) => void }} properties */
function Part({ study, table, noun, place, hidden, essential, remove }) {
  const tables = /** @type {any[]} */ (study.read([table]) ?? []);
  const fields = tables[place];
  if (!fields) return null;
  const rename = (/** @type {string} */ text) => {
    const name = text.trim();
    if (name && name !== fields.name) study.edit([{ op: "rename", path: [table, place], value: name }]);
  };
  const isFixed = study.restrictionAt([table]) !== "";
  return html`<fieldset><legend>${noun === "day" ? "Day" : "Group"} ${place + 1}</legend>
    <label class="block">Name of the ${noun} <${TextInput} value=${fields.name} disabled=${isFixed} save=${rename} /></label>
    <${TableForm} study=${study} path=${[table, place]} table=${table} hidden=${["name", ...hidden]} essential=${essential} />
    ${tables.length > 1 && !isFixed && html`<button type="button" class="small danger" onClick=${() => remove(table, place)}>Remove this ${noun}</button>`}
  </fieldset>`;
}
