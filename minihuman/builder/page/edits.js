// What edits make of a file's values, so that the page shows them before the server has answered, and each edit that
// follows is addressed to what those before it leave. The server alone writes the file, and its answer is what counts.
/** @import { Document, Edit, Lane } from "./messages" */
/** @import { FieldPath } from "./open_study.js" */

/** @param {any} tree @param {FieldPath} path @returns {any} */
export const readAt = (tree, path) => path.reduce((branch, step) => branch?.[step], tree);

/** @param {FieldPath} path @param {FieldPath} above */
export const isBelow = (path, above) => above.every((step, place) => path[place] === step);

/** @param {any} branch */
const isBranch = (branch) => typeof branch === "object" && branch !== null;

/** @param {any} tree @param {FieldPath} path @returns {any} the table or list that contains a path, made where it is missing */
function ensureParent(tree, path) {
  let branch = tree;
  for (const [place, step] of path.slice(0, -1).entries()) {
    if (!isBranch(branch)) return undefined;
    branch[step] ??= typeof path[place + 1] === "number" ? [] : {};
    branch = branch[step];
  }
  return branch;
}

/** Make an edit in place; one that is not possible changes nothing, and the server says why. @param {any} tree @param {Edit} edit */
export function applyEdit(tree, edit) {
  const parent = edit.path.length ? ensureParent(tree, edit.path) : undefined;
  if (!isBranch(parent)) return;
  const step = /** @type {any} */ (edit.path.at(-1));
  const value = /** @type {any} */ (structuredClone(edit.value));
  if (edit.op === "set") parent[step] = value;
  if (edit.op === "rename" && isBranch(parent[step])) parent[step].name = value;
  if (edit.op === "remove" && !Array.isArray(parent)) delete parent[step];
  if (!Array.isArray(parent)) return;
  if (edit.op === "remove") parent.splice(step, 1);
  if (edit.op === "insert") parent.splice(step, 0, value);
  if (edit.op === "move") parent.splice(edit.to ?? 0, 0, ...parent.splice(step, 1));
  if (edit.op === "duplicate") parent.splice(step + 1, 0, { ...structuredClone(parent[step]), ...value });
}

/** @param {number} number of an element @param {number} from @param {number} to @returns {number} its number when another has moved */
function shiftByMove(number, from, to) {
  if (number === from) return to;
  if (from < number && number <= to) return number - 1;
  return to <= number && number < from ? number + 1 : number;
}

/** @param {FieldPath} path @param {Edit} edit @returns {FieldPath | null} where the field is after an edit; null if it is gone */
export function followPath(path, edit) {
  if (edit.op === "remove" && isBelow(path, edit.path)) return null;
  const depth = edit.path.length - 1;
  const place = edit.path[depth];
  const number = path[depth];
  if (typeof place !== "number" || typeof number !== "number" || !isBelow(path, edit.path.slice(0, depth))) return path;
  if (edit.op === "insert" && number >= place) return path.with(depth, number + 1);
  if (edit.op === "duplicate" && number > place) return path.with(depth, number + 1);
  if (edit.op === "remove" && number > place) return path.with(depth, number - 1);
  return edit.op === "move" ? path.with(depth, shiftByMove(number, place, edit.to ?? 0)) : path;
}

/** @param {any} tree @param {Lane} lane whose path is that of its table @returns {Lane} */
function readLane(tree, lane) {
  const table = readAt(tree, lane.path);
  const field = ["parts", "blocks"].find((name) => Array.isArray(table?.[name])) ?? "parts";
  return { ...lane, path: [...lane.path, field], parts: table?.[field] ?? lane.parts };
}

/**
 * A study as it is once edits have been made: its values, and where its parts, lanes, mistakes and restrictions are.
 * @param {Document} document as the server sent it @param {Edit[]} edits @returns {Document}
 */
export function showEdits(document, edits) {
  if (!edits.length) return document;
  const tree = structuredClone(document.tree);
  for (const edit of edits) applyEdit(tree, edit);
  /** @template {{ path: FieldPath }} Row @param {Row[]} rows @returns {Row[]} */
  const follow = (rows) => rows.flatMap((row) => {
    const path = edits.reduce((/** @type {FieldPath | null} */ moved, edit) => moved && followPath(moved, edit), row.path);
    return path ? [{ ...row, path }] : [];
  });
  const tables = follow(document.lanes.map((lane) => ({ ...lane, path: lane.path.slice(0, -1) })));
  const restrictions = { ...document.restrictions, fields: follow(document.restrictions.fields) };
  return { ...document, tree, restrictions, parts: follow(document.parts), mistakes: follow(document.mistakes), lanes: tables.map((lane) => readLane(tree, lane)) };
}

/**
 * The edits that change one member of a list or a map: the member alone, or the whole where the file lacks it.
 * @param {FieldPath} path of the list or map @param {any} content undefined if the file lacks it @param {any} usual what it is then
 * @param {Edit} edit whose path begins at the list or map @returns {Edit[]}
 */
export function buildMemberEdits(path, content, usual, edit) {
  if (content !== undefined) return [{ ...edit, path: [...path, ...edit.path] }];
  const whole = { members: usual };
  const changed = structuredClone(whole);
  applyEdit(changed, { ...edit, path: ["members", ...edit.path] });
  return [{ op: "set", path, value: changed.members }];
}
