// A study as a line of parts: a lane for each group or session. Parts are ordered by dragging and by buttons.
/** @import { Edit, Lane, Part } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useState } from "./vendor/preact.js";
import { AddPart } from "./add_part.js";
import { LaneSettings, LineButtons, describeInterval } from "./lane_settings.js";
import { countNoun, formatMinutes, nameKind } from "./words.js";

/** @typedef {{ part: string, lane: Lane | null, place: number }} Dragged */
/** @typedef {{ lane: string, place: number }} Spot where the selected part stands; a lane may have a part twice */

/** @param {Lane | null} lane */
const laneKey = (lane) => (lane ? `${lane.group} ${lane.session}` : "");

/**
 * The edits that put a part into a lane. A group that lists blocks alone lists parts from then on, and so do the others.
 * @param {OpenStudy} study @param {Lane} lane @param {number} place @param {string} part @param {string} kind "block" if it is one @returns {Edit[]}
 */
export function buildEntryEdits(study, lane, place, part, kind) {
  const listsBlocks = lane.path.at(-1) === "blocks";
  if (!listsBlocks || kind === "block") return [{ op: "insert", path: [...lane.path, place], value: part }];
  /** @type {Edit[]} */
  const edits = [];
  for (const other of study.document?.lanes ?? []) {
    const parts = other.path.join() === lane.path.join() ? other.parts.toSpliced(place, 0, part) : other.parts;
    const group = other.path.slice(0, -1);
    if (study.read([...group, "blocks"])) edits.push({ op: "remove", path: [...group, "blocks"] });
    edits.push({ op: "set", path: [...group, "parts"], value: parts });
  }
  return edits;
}

/** The edits that take a part out of a lane, wherever it is. @param {Lane} lane @param {string} part @returns {Edit[]} */
export const buildLeaveEdits = (lane, part) => lane.parts.flatMap((name, place) => (name === part ? [place] : []))
  .toReversed().map((place) => ({ op: "remove", path: [...lane.path, place] }));

/** The edit that moves a part before another. @param {Lane} lane @param {number} from @param {number} before @returns {Edit[]} none if it is there */
export function buildMoveEdits(lane, from, before) {
  const to = before > from ? before - 1 : before;
  return to === from ? [] : [{ op: "move", path: [...lane.path, from], to }];
}

/** @param {{ study: OpenStudy, selected: string, select: (name: string) => void }} properties */
export function Lanes({ study, selected, select }) {
  const [dragged, setDragged] = useState(/** @type {Dragged | null} */ (null));
  const [adding, setAdding] = useState(/** @type {Lane | null} */ (null));
  const [changing, setChanging] = useState(/** @type {Lane | null} */ (null));
  const [spot, setSpot] = useState(/** @type {Spot} */ ({ lane: "", place: -1 }));
  const lanes = study.document?.lanes ?? [];
  const parts = study.document?.parts ?? [];
  const listed = new Set(lanes.flatMap((lane) => [...lane.parts, ...Object.values(lane.replaced)]));
  const inOrders = new Set(parts.filter((part) => part.kind === "order").flatMap((part) => (study.read([...part.path, "parts"]) ?? []).flat()));
  const unused = parts.filter((part) => !listed.has(part.name) && !inOrders.has(part.name));
  const choose = (/** @type {string} */ name, /** @type {Lane | null} */ lane, /** @type {number} */ place) => {
    const isSame = spot.lane === laneKey(lane) && spot.place === place;
    setSpot({ lane: laneKey(lane), place });
    if (name !== selected || isSame) select(name);
  };
  const shared = { study, selected, choose, dragged, setDragged, spot, setSpot };
  const behind = adding && laneKey(adding) === spot.lane && adding.parts[spot.place] === selected ? spot.place + 1 : adding?.parts.length ?? 0;
  const drop = (/** @type {Lane} */ lane, /** @type {number} */ place) => {
    if (!dragged) return;
    const isMove = dragged.lane?.path.join() === lane.path.join();
    const isBlock = parts.some((part) => part.name === dragged.part && part.path[0] === "blocks");
    const edits = isMove ? buildMoveEdits(lane, dragged.place, place) : buildEntryEdits(study, lane, place, dragged.part, isBlock ? "block" : "");
    if (edits.length) study.edit(edits);
    setSpot({ lane: "", place: -1 });
    setDragged(null);
  };
  return html`<section class="line" aria-label="Parts in order">
    ${lanes.map((lane) => html`<${LaneRow} key=${`${lane.session} ${lane.group}`} lane=${lane} ...${shared} drop=${drop} add=${() => setAdding(lane)} change=${() => setChanging(lane)} />`)}
    <${LineButtons} study=${study} />
    ${unused.length > 0 && html`<div class="lane unused"><h2>Not in use</h2><ol>${unused.map((part) => html`
      <${Chip} key=${part.name} part=${part} name=${part.name} lane=${null} place=${0} ...${shared} />`)}</ol></div>`}
    ${changing && html`<${LaneSettings} study=${study} lane=${changing} close=${() => setChanging(null)} />`}
    ${adding && html`<${AddPart} study=${study} lane=${adding} place=${behind} close=${() => setAdding(null)}
      select=${(/** @type {string} */ name) => choose(name, adding, behind)} />`}
  </section>`;
}

/** @param {Lane} lane */
export const nameLane = (lane) => [lane.session, lane.group].filter(Boolean).join(" · ") || "everyone";

/** @param {any} properties */
function LaneRow({ study, lane, drop, add, change, ...shared }) {
  const { dragged, selected, spot } = shared;
  const duration = (study.document?.durations ?? []).find((/** @type {any} */ other) => other.group === lane.group && other.session === lane.session);
  const byName = new Map((study.document?.parts ?? []).map((/** @type {Part} */ part) => [part.name, part]));
  const isFixed = study.restrictionAt(lane.path) !== "";
  const allow = (/** @type {DragEvent} */ event) => dragged && !isFixed && event.preventDefault();
  const length = duration ? formatMinutes([duration.least_min, duration.most_min]) : countNoun(lane.parts.length, "part");
  return html`<div class="lane">
    <h2>${nameLane(lane)}<small>${[length, describeInterval(lane, study)].filter(Boolean).join(", ")}
      <button type="button" class="quiet small" aria-label=${`Change ${nameLane(lane)}`} onClick=${change}>Change</button></small></h2>
    <ol aria-label=${`Parts of ${nameLane(lane)}`} onDragOver=${allow} onDrop=${() => drop(lane, lane.parts.length)}>
      ${lane.parts.map((/** @type {string} */ listed, /** @type {number} */ place) => ({ listed, place, name: lane.replaced[listed] ?? listed })).map((/** @type {{ listed: string, place: number, name: string }} */ { listed, place, name }) => html`
        <${Chip} key=${`${listed} ${place}`} part=${byName.get(name)} name=${name} instead=${name === listed ? "" : listed} lane=${lane} place=${place} study=${study} ...${shared}
          drop=${drop} isFixed=${isFixed} />`)}
      ${!isFixed && html`<li class="add"><button type="button" class="dashed" aria-label=${`Add a part to ${nameLane(lane)}`} onClick=${add}>
        + Add${spot.lane === laneKey(lane) && lane.parts[spot.place] === selected ? ` behind ${selected}` : ""}</button></li>`}
    </ol>
    ${isFixed && html`<p class="fixed">Fixed: ${study.restrictionAt(lane.path)}</p>`}
  </div>`;
}

/** @param {any} properties */
function Chip({ study, part, name, instead = "", lane, place, selected, choose, dragged, setDragged, drop, isFixed, spot, setSpot }) {
  const isChosen = selected === name && spot.lane === laneKey(lane) && spot.place === place;
  const isSelected = selected === name;
  const mistakes = part ? study.mistakesAt(part.path).length : 0;
  const begin = (/** @type {DragEvent} */ event) => {
    event.dataTransfer?.setData("text/plain", name);
    setDragged({ part: instead || name, lane, place });
  };
  const over = (/** @type {DragEvent} */ event) => dragged && lane && !isFixed && event.preventDefault();
  const onDrop = (/** @type {DragEvent} */ event) => {
    event.stopPropagation();
    if (lane) drop(lane, place);
  };
  const label = (part?.title && part.title !== name ? part.title : name) || "left out";
  return html`<li class=${`chip kind-${part?.kind ?? "unknown"} ${isSelected ? "selected" : ""} ${mistakes ? "wrong" : ""}`} draggable=${!isFixed}
      onDragStart=${begin} onDragEnd=${() => setDragged(null)} onDragOver=${over} onDrop=${onDrop}>
    <button type="button" class="name" aria-current=${isSelected ? "true" : undefined} onClick=${() => choose(name, lane, place)}>
      <span class="kind">${part ? nameKind(part.kind) : "by itself"}${instead && ` instead of ${instead}`}</span> <span class="part" dir="auto">${label}</span>
      ${mistakes > 0 && html` <span class="badge" title="mistakes">${mistakes}</span>`}</button>
    ${isChosen && lane && !isFixed && html`<${MoveButtons} study=${study} lane=${lane} place=${place} name=${name} setSpot=${setSpot} />`}
  </li>`;
}

/** @param {{ study: OpenStudy, lane: Lane, place: number, name: string, setSpot: (spot: Spot) => void }} properties */
function MoveButtons({ study, lane, place, name, setSpot }) {
  const move = (/** @type {number} */ to) => {
    study.edit([{ op: "move", path: [...lane.path, place], to }]);
    setSpot({ lane: laneKey(lane), place: to });
  };
  const where = nameLane(lane);
  return html`<span class="moves">
    <button type="button" class="icon" disabled=${place === 0} aria-label=${`Move ${name} earlier in ${where}`} onClick=${() => move(place - 1)}>←</button>
    <button type="button" class="icon" disabled=${place === lane.parts.length - 1} aria-label=${`Move ${name} later in ${where}`} onClick=${() => move(place + 1)}>→</button>
    <button type="button" class="icon" aria-label=${`Take ${name} out of ${where}`}
      onClick=${() => study.edit([{ op: "remove", path: [...lane.path, place] }])}>×</button>
  </span>`;
}
