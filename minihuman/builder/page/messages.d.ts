// What the builder's page and its server send each other. Generated: edit minihuman/builder/messages.py, then run
// `python -m minihuman.builder.message_types`.

export type FromPage = EditRequest | VersionRequest | NewStudyRequest | TableRequest | QueryRequest | AnnotationRequest | ExportRequest | DepartureRequest | TrustRequest | ShowRequest;
export type ToPage = Studies | Document | FieldForm | Kinds | CheckReport | Media | StimulusTable | Differences | EditRefusal | RecordedData | SessionDetails | CopiedFile | TrustQuestion | EpisodeReplay | Departure | QueryAnswer | DataExport | Preview | PageInfo | WorldInfo | SimulationRun;

/** Edits of the version of a file that the page shows. */
export interface EditRequest {
  version: string;
  edits: Edit[];
}

/** A change of the file. Edits of one request are made together or not at all, in order. */
export interface Edit {
  op: "set" | "remove" | "insert" | "move" | "duplicate" | "rename" | "replace_text";
  path: (string | number)[];
  value?: unknown;
  to?: number;
}

/** A step back or forth in the file's history, from the version that the page shows. */
export interface VersionRequest {
  version: string;
}

/** A new study from a template, or from a study of the folder. */
export interface NewStudyRequest {
  name: string;
  template?: string;
  source_key?: string;
  language?: string;
}

/** The whole content of a table, or rows as a spreadsheet copies them. */
export interface TableRequest {
  name: string;
  version?: string;
  columns?: string[];
  rows?: string[][];
  pasted?: string;
}

/** A query of a study's tables. */
export interface QueryRequest {
  sql: string;
}

/** An annotation of a session or an episode, or its revocation. */
export interface AnnotationRequest {
  log: string;
  tag: string;
  note: string;
  episode?: number | null;
  take_back?: boolean;
}

/** An export of a study into a new folder. */
export interface ExportRequest {
  format: string;
}

/** A participant who leaves the study: withdrawn, with their data erased, or replaced, with their data kept. */
export interface DepartureRequest {
  participant: string;
  kind: "withdraw" | "replace";
  reason: string;
  experimenter?: string;
}

/** The user's trust in a study whose code they have seen. */
export interface TrustRequest {
  sha256: string;
}

/** The session that the page asks for; the fields are those of `PreviewRequest`. */
export interface ShowRequest {
  part?: string;
  group?: string;
  session?: number;
  language?: string;
  onward?: boolean;
  kind?: "preview" | "trial";
}

/** The studies of the desk's folder. */
export interface Studies {
  folder: string;
  studies: StudyCard[];
  templates: Template[];
}

/** A study of the folder, as the first view shows it. */
export interface StudyCard {
  key: string;
  name: string;
  title: string;
  language: string;
  groups: string[];
  parts: Part[];
  lanes: Lane[];
  minutes: [number, number] | null;
  participants: number;
  enrolled: number;
  sessions: Record<string, number>;
  mistakes: number;
  problem: string;
  has_protocol: boolean;
}

/** A part of a study: something that a session can contain. */
export interface Part {
  name: string;
  kind: string;
  path: (string | number)[];
  title: string;
  used_in: string[];
  line: number;
}

/** The parts of one group in one session, in order, as the file lists them. */
export interface Lane {
  group: string;
  session: string;
  parts: string[];
  path: (string | number)[];
  replaced: Record<string, string>;
}

/** A study that can be copied. */
export interface Template {
  name: string;
  title: string;
  summary: string;
  language: string;
  minutes: [number, number] | null;
  files: string[];
  group: "start" | "example" | "trials";
  citation: string;
  topics: string[];
}

/** A protocol file that is open in the builder. */
export interface Document {
  key: string;
  name: string;
  version: string;
  text: string;
  tree: Record<string, unknown>;
  lines: Record<string, number>;
  parts: Part[];
  lanes: Lane[];
  mistakes: Mistake[];
  restrictions: Restrictions;
  durations: Duration[];
  pay: Pay | null;
  can_undo: boolean;
  can_redo: boolean;
  trusted: boolean;
  read_only: Mistake[];
}

/** An error that `check` reports, at its field. */
export interface Mistake {
  path: (string | number)[];
  line: number;
  message: string;
}

/** The fields that may not change after the first enrolment, and what to do instead. */
export interface Restrictions {
  enrolled: number;
  fields: Restriction[];
  message: string;
}

/** A field that must not change, because participants have enrolled. */
export interface Restriction {
  path: (string | number)[];
  reason: string;
}

/** An estimate of how long a session of a group takes, from the plan of one participant. */
export interface Duration {
  group: string;
  session: string;
  least_min: number;
  most_min: number;
  parts: Record<string, [number, number]>;
}

/** What a participant is paid. */
export interface Pay {
  currency: string;
  base: number;
  per_point: number;
  most: number | null;
}

/** The form of a table. */
export interface FieldForm {
  table: string;
  heading: string;
  summary: string;
  fields: FormField[];
}

/** A field of a table, as a form shows it. */
export interface FormField {
  name: string;
  type: "string" | "text" | "integer" | "number" | "boolean" | "choice" | "list" | "pair" | "table" | "tables" | "map" | "any";
  item: string;
  alternatives: string[];
  required: boolean;
  default: unknown;
  sentence: string;
  example: unknown;
  unit: string;
  choices: Choice[];
  references: "" | "part" | "block" | "group" | "world" | "key" | "action" | "file" | "session";
  table: string;
  common: boolean;
}

/** A value that a field can have. */
export interface Choice {
  value: unknown;
  label: string;
}

/** What can be added to a study. */
export interface Kinds {
  parts: PartKind[];
  questions: PartKind[];
  languages: string[];
  worlds: Choice[];
  consents: Record<string, Record<string, unknown>>;
}

/** A kind of part that can be added, or a kind of question. */
export interface PartKind {
  kind: string;
  table: string;
  summary: string;
  new: Record<string, unknown>;
}

/** What `minihuman check` says of a version. */
export interface CheckReport {
  version: string;
  mistakes: Mistake[];
  notices: string[];
  plan: string[];
}

/** The files beside a protocol: pictures, sounds, tables of stimuli. */
export interface Media {
  files: MediaFile[];
}

/** A file beside the protocol. */
export interface MediaFile {
  name: string;
  bytes: number;
  media_type: string;
  used_at: ((string | number)[])[];
}

/** A table of stimuli: a CSV file beside the protocol. */
export interface StimulusTable {
  name: string;
  version: string;
  columns: string[];
  rows: string[][];
}

/** What differs between a study and another: a new version and the one from which it was made. */
export interface Differences {
  key: string;
  other: string;
  differences: FieldDifference[];
}

/** A field in which two protocols differ. */
export interface FieldDifference {
  path: (string | number)[];
  before: unknown;
  after: unknown;
}

/** Why a request was not carried out. The file is as before. */
export interface EditRefusal {
  error: "conflict" | "restricted" | "not_editable" | "not_valid" | "not_there" | "exists" | "not_trusted";
  message: string;
  path: (string | number)[];
  line: number;
  document: Document | null;
}

/** What a study has recorded, and what can be asked of it. */
export interface RecordedData {
  folder: string;
  sessions: RecordedSession[];
  examples: QueryExample[];
  formats: string[];
}

/** A recorded session of a study. */
export interface RecordedSession {
  log: string;
  participant: string;
  group: string;
  session: number;
  state: string;
  started_at: string;
  episodes_completed: number;
  episodes_planned: number;
  minutes: number;
  notes: SessionNote[];
  problem: string;
  replay_command: string;
  annotate_command: string;
  film_command: string;
}

/** An annotation that is in force. */
export interface SessionNote {
  tag: string;
  episode: number | null;
  note: string;
}

/** A query to begin with. */
export interface QueryExample {
  about: string;
  sql: string;
}

/** What a session contains. */
export interface SessionDetails {
  episodes: EpisodeSummary[];
  answers: GivenAnswer[];
}

/** A recorded episode: the last attempt at it. */
export interface EpisodeSummary {
  number: number;
  block: string;
  world: string;
  outcome: string;
  steps: number;
  reward: number;
}

/** An answer to a question. */
export interface GivenAnswer {
  part: string;
  question: string;
  kind: string;
  answer: string;
  attempt: number;
  right: boolean | null;
}

/** A file of an imported folder, as it has been written. */
export interface CopiedFile {
  path: string;
  bytes: number;
}

/** What a study would run or read if it were trusted. */
export interface TrustQuestion {
  untrusted: string;
  files: CodeFile[];
  sha256: string;
}

/** A Python file beside a protocol. */
export interface CodeFile {
  name: string;
  text: string;
}

/** A recorded episode, step by step. */
export interface EpisodeReplay {
  number: number;
  mission: string;
  outcome: string;
  steps: ReplayStep[];
  floor: ReplayMap | null;
}

/** A step of an episode; the first one is the reset. */
export interface ReplayStep {
  t_ms: number;
  key: string;
  action: string;
  reward: number;
  reaction_ms: number | null;
  place: [number, number] | null;
  yaw_rad: number | null;
}

/** A world seen from above: x to the right, z down the page. */
export interface ReplayMap {
  unit: string;
  bounds: [number, number, number, number];
  walls: [number, number, number, number][];
  things: ReplayThing[];
}

/** An object on a floor plan, in the plan's units. */
export interface ReplayThing {
  name: string;
  x: number;
  z: number;
  radius: number;
  colour: string;
}

/** What came of a departure. */
export interface Departure {
  lines: string[];
  command: string;
  recorded: RecordedData;
}

/** The result of a query. */
export interface QueryAnswer {
  columns: string[];
  rows: string[][];
  n_rows: number;
  notes: string[];
  command: string;
}

/** A folder into which a study was exported. */
export interface DataExport {
  folder: string;
  command: string;
}

/** A session that is served. */
export interface Preview {
  url: string;
  parts: string[];
  part: string;
  kind: string;
  participant: string;
  group: string;
}

/** Where the desk's other pages are. */
export interface PageInfo {
  reports: string;
  desk: string;
}

/** A world as a block needs it. */
export interface WorldInfo {
  id: string;
  actions: string[];
  usual_actions: string[];
  default_keys: Record<string, string>;
  max_steps: number;
}

/** The state of a simulation. */
export interface SimulationRun {
  number: number;
  state: "running" | "done" | "failed";
  step: string;
  progress: number;
  output: string;
  commands: string[];
  report: string;
}
