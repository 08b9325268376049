// Requests to the builder's server, and what it refuses. Knows no element.
/** @import { Document, FieldForm, Kinds, Media, PageInfo, Preview, EditRefusal, ShowRequest, Studies, StimulusTable, SimulationRun } from "./messages" */
/** @import { Departure, DepartureRequest, EpisodeReplay, SessionDetails } from "./messages" */
/** @import { CopiedFile, TrustQuestion } from "./messages" */
/** @import { AnnotationRequest, DataExport, QueryAnswer, RecordedData } from "./messages" */
/** @import { CheckReport, Edit, NewStudyRequest, TableRequest, WorldInfo } from "./messages" */

/** A request that the server refused. */
export class RefusedError extends Error {
  /** @param {EditRefusal} refusal @param {number} status */
  constructor(refusal, status) {
    super(refusal.message);
    this.refusal = refusal;
    this.status = status;
  }
}

/** @param {string} path @param {Record<string, string>} query */
export function buildAddress(path, query = {}) {
  const parameters = new URLSearchParams(query).toString();
  return parameters ? `${path}?${parameters}` : path;
}

/** @param {Response} answer @returns {Promise<any>} */
async function readAnswer(answer) {
  if (answer.status === 204) return null;
  const content = await answer.json().catch(() => ({ message: `the server answered ${answer.status}; reload the page` }));
  if (!answer.ok) throw new RefusedError(content, answer.status);
  return content;
}

/** @param {string} path @param {Record<string, string>} [query] */
async function get(path, query) {
  return readAnswer(await fetch(buildAddress(path, query)));
}

/** @param {string} path @param {Record<string, string>} query @param {unknown} content */
async function post(path, query, content) {
  const headers = { "content-type": "application/json" };
  return readAnswer(await fetch(buildAddress(path, query), { method: "POST", headers, body: JSON.stringify(content) }));
}

/** @returns {Promise<Studies>} */
export const listStudies = () => get("api/studies");
/** @returns {Promise<Kinds>} */
export const listKinds = () => get("api/kinds");
/** @returns {Promise<PageInfo>} */
export const describePage = () => get("api/page");
/** @param {string} key @param {string} [version] @returns {Promise<Document | null>} */
export const readStudy = (key, version = "") => get("api/study", version ? { key, version } : { key });
/** @param {string} table @param {string} kind @returns {Promise<FieldForm>} */
export const readForm = (table, kind) => get("api/form", kind ? { table, kind } : { table });
/** @param {string} key @returns {Promise<CheckReport>} */
export const checkStudy = (key) => get("api/check", { key });
/** @param {string} key @param {string} version @param {Edit[]} edits @returns {Promise<Document>} */
export const editStudy = (key, version, edits) => post("api/edit", { key }, { version, edits });
/** @param {string} key @param {string} version @param {"undo" | "redo"} way @returns {Promise<Document>} */
export const stepHistory = (key, version, way) => post(`api/${way}`, { key }, { version });
/** @param {NewStudyRequest} request @returns {Promise<Document>} */
export const makeStudy = (request) => post("api/new", {}, request);
/** @param {string} key @returns {Promise<TrustQuestion>} */
export const askTrust = (key) => get("api/trust", { key });
/** @param {string} key @param {string} sha256 of the code that was shown @returns {Promise<Document>} */
export const trustStudy = (key, sha256) => post("api/trust", { key }, { sha256 });
/** @param {string} key @returns {Promise<Media>} */
export const listMedia = (key) => get("api/media", { key });
/** @param {string} key @param {string} name */
export const mediaAddress = (key, name) => buildAddress("api/media/file", { key, name });
/** @param {string} key @param {string} name @returns {Promise<StimulusTable>} */
export const readTable = (key, name) => get("api/table", { key, name });
/** @param {string} key @param {TableRequest} table @returns {Promise<StimulusTable>} */
export const writeTable = (key, table) => post("api/table", { key }, table);
/** @param {string} key @param {ShowRequest} request @returns {Promise<Preview>} */
export const showPreview = (key, request) => post("api/preview", { key }, request);
/** @param {string} key @returns {Promise<SimulationRun>} */
export const simulateStudy = (key) => post("api/simulate", { key }, {});
/** @param {number} number @returns {Promise<SimulationRun>} */
export const readSimulation = (number) => get("api/simulate", { number: String(number) });
/** @param {string} id @returns {Promise<WorldInfo>} */
export const describeWorld = (id) => get("api/world", { id });

/** @param {string} key @returns {Promise<RecordedData>} */
export const readData = (key) => get("api/data", { key });
/** @param {string} key @param {string} log */
export const pathsAddress = (key, log) => buildAddress("api/data/paths.png", { key, log });
/** @param {string} key @param {string} log @returns {Promise<SessionDetails>} */
export const readSession = (key, log) => get("api/data/session", { key, log });
/** @param {string} key @param {string} log @param {number} episode @returns {Promise<EpisodeReplay>} */
export const readEpisode = (key, log, episode) => get("api/data/episode", { key, log, episode: String(episode) });
/** @param {string} key @param {string} log @param {number} episode @param {number} step */
export const frameAddress = (key, log, episode, step) => buildAddress("api/data/frame.png", { key, log, episode: String(episode), step: String(step) });
/** @param {string} key @param {DepartureRequest} request @returns {Promise<Departure>} */
export const departParticipant = (key, request) => post("api/data/departure", { key }, request);
/** @param {string} key @param {string} sql @returns {Promise<QueryAnswer>} */
export const queryData = (key, sql) => post("api/data/query", { key }, { sql });
/** @param {string} key @param {AnnotationRequest} request @returns {Promise<RecordedData>} */
export const annotateSession = (key, request) => post("api/data/annotate", { key }, request);
/** @param {string} key @param {string} format @returns {Promise<DataExport>} */
export const exportStudy = (key, format) => post("api/data/export", { key }, { format });

/**
 * Send a file of a folder that is imported.
 * @param {string} folder its name @param {string} path of the file in it @param {File} file @returns {Promise<CopiedFile>}
 */
export async function importFile(folder, path, file) {
  const headers = { "content-type": "application/octet-stream" };
  return readAnswer(await fetch(buildAddress("api/import", { folder, path }), { method: "POST", headers, body: file }));
}

/**
 * Send a file into the study's folder.
 * @param {string} key @param {File} file @param {boolean} replaces @returns {Promise<Media>}
 */
export async function sendFile(key, file, replaces = false) {
  const query = { key, name: file.name, ...(replaces ? { replace: "1" } : {}) };
  const headers = { "content-type": "application/octet-stream" };
  return readAnswer(await fetch(buildAddress("api/media/file", query), { method: "POST", headers, body: file }));
}
