// The world picker: every built-in world with its picture; the preview beside the form plays the chosen one.
/** @import { Choice, Edit, WorldInfo } from "./messages" */
/** @import { ControlProperties } from "./fields.js" */
import { html, useEffect, useMemo, useState } from "./vendor/preact.js";
import { Dialog } from "./dialog.js";
import { Level, WORLD as LEVEL } from "./level.js";
import { buildAddress, describeWorld, listKinds } from "./requests.js";

const MOST_SHOWN = 60; // worlds at a time
const FAMILIES = /** @type {[string, RegExp][]} */ ([
  ["All", /./], ["From above", /MiniGrid|Grid/], ["In first person", /MiniWorld|Inside/], ["With instructions", /BabyAI/],
  ["Trials", /Stimulus|TwoStep/], ["Teams", /Team/],
]);

/** @typedef {{ value: string, label: string }} World a world's id, and what it is about */

/** @param {Choice} choice @returns {World} */
const readWorld = ({ value, label }) => ({ value: String(value), label });

/** @param {string} id */
export const worldPicture = (id) => buildAddress("api/world.png", { id });

/** @param {string} id @returns {string} the name without namespace and version */
export const nameWorld = (id) => id.replace(/^minihuman\//, "").replace(/-v\d+$/, "");

/** @param {ControlProperties} properties */
export function WorldButton({ study, path, id, describedBy, content, isFixed }) {
  const [isOpen, setOpen] = useState(false);
  const choose = async (/** @type {string} */ world) => {
    const facts = await describeWorld(world).catch(() => null); // the dialog stays meanwhile, so that nothing else is edited
    setOpen(false);
    study.edit(buildWorldEdits(study.read(path.slice(0, -1)), path, world, facts));
  };
  return html`<div class="world-button">
    ${content && html`<img src=${worldPicture(content)} alt="" width="96" height="72" />`}
    <button type="button" id=${id} aria-describedby=${describedBy} aria-label=${`World: ${content ? nameWorld(content) : "none"}, choose another`} disabled=${isFixed} onClick=${() => setOpen(true)}>
      ${content ? nameWorld(content) : "Choose a world"}</button>
    ${isOpen && html`<${WorldPicker} chosen=${content} choose=${choose} close=${() => setOpen(false)} />`}
  </div>`;
}

/**
 * The edits that put a block into a world: its actions and length follow where the block's do not fit.
 * @param {any} block @param {(string | number)[]} path @param {string} world @param {WorldInfo | null} facts @returns {Edit[]}
 */
export function buildWorldEdits(block, path, world, facts) {
  const table = path.slice(0, -1);
  /** @type {Edit[]} */
  const edits = [{ op: "set", path, value: world }];
  if (world === LEVEL) edits.push({ op: "set", path: [...table, "options"], value: Level.start().options });
  else if (block?.options) edits.push({ op: "remove", path: [...table, "options"] });
  if (!facts || !block?.actions) return edits;
  if (!block.actions.every((/** @type {string} */ action) => facts.actions.includes(action))) {
    edits.push({ op: "set", path: [...table, "actions"], value: facts.usual_actions });
    if (block.fixed_keys) edits.push({ op: "set", path: [...table, "fixed_keys"], value: facts.default_keys });
  }
  if (facts.max_steps && block.max_steps !== facts.max_steps) {
    edits.push({ op: "set", path: [...table, "max_steps"], value: facts.max_steps });
  }
  return edits;
}

/** @param {{ chosen?: string, choose: (world: string) => void, close: () => void }} properties */
export function WorldPicker({ chosen, choose, close }) {
  const [worlds, setWorlds] = useState(/** @type {World[]} */ ([]));
  const [wanted, setWanted] = useState("");
  const [family, setFamily] = useState(0);
  useEffect(() => { listKinds().then((kinds) => setWorlds(kinds.worlds.map(readWorld))); }, []);
  const matches = useMemo(() => {
    const words = wanted.toLowerCase().split(/\s+/).filter(Boolean);
    return worlds.filter(({ value, label }) => FAMILIES[family][1].test(value)
      && words.every((word) => `${value} ${label}`.toLowerCase().includes(word)));
  }, [worlds, wanted, family]);
  return html`<${Dialog} title="Choose a world" close=${close} isWide>
    <div class="picker-head">
      <input type="search" aria-label="Search worlds" placeholder="Search: four rooms, key, kitchen …" value=${wanted}
        onInput=${(/** @type {any} */ event) => setWanted(event.target.value)} />
      <div class="segments" role="group" aria-label="Kind of world">${FAMILIES.map(([name], place) => html`
        <button type="button" aria-pressed=${place === family} onClick=${() => setFamily(place)}>${name}</button>`)}</div>
    </div>
    <p><button type="button" onClick=${() => choose(LEVEL)}>Draw a level of your own</button></p>
    <p class="quiet" role="status">${matches.length} worlds${matches.length > MOST_SHOWN ? `, the first ${MOST_SHOWN} shown; search for others` : ""}</p>
    <ul class="worlds">${matches.slice(0, MOST_SHOWN).map(({ value, label }) => html`<li key=${value}>
      <button type="button" aria-pressed=${value === chosen} onClick=${() => choose(value)}>
        <img src=${worldPicture(value)} alt="" loading="lazy" width="160" height="120" />
        <strong>${nameWorld(value)}</strong><span>${label}</span></button></li>`)}</ul>
  </${Dialog}>`;
}
