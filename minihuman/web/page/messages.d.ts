// What the page and the server send each other. Generated: edit minihuman/web/messages.py or screen_types.py, then run
// `python -m minihuman.web.page_types`.

export type BrowserFacts = Record<string, boolean | number | string>;
export type Texts = Record<string, string>;
export type PageMessage = KeyMessage | DisplayedMessage | TickMessage | TextMessage | FieldMessage | PointerMessage | AxisMessage | MouseMotionMessage | GamepadMessage | FocusMessage | RoundTripMessage | SoundMessage | CommandEcho | LateInputMessage | PageAlteration;
export type FromPage = Hello | NumberedMessage | PageAck | Ping | Farewell;
export type UnnumberedMessage = Welcome | Refusal | ServerAck | Pong;
export type ServerMessage = ScreenMessage | FilmFrame | ArraysMessage | EpisodeRules | StateCorrection | AgentControl | EpisodeState | LookAheadUpdate | ScreenPrefetch | CommandMessage | SessionOver;
export type WorldState = GridState | FirstPersonState;
export type WorldPosition = GridPosition | FirstPersonPosition;
export type ScreenValues = TextValues | BlankValues | PlayValues | PageValues | QuestionValues | ActivityValues;
export type AnswerWidget = ({ form: "OptionList" } & OptionList) | ({ form: "RatingScale" } & RatingScale) | ({ form: "RatingMatrix" } & RatingMatrix) | ({ form: "Slider" } & Slider) | ({ form: "TextField" } & TextField) | ({ form: "ShapeCanvas" } & ShapeCanvas);

/** A press or release of a key, with the event's own time as ``stamp``. */
export interface KeyMessage {
  t: "key";
  key: string;
  down: boolean;
  stamp: number;
  symbol?: string;
  repeat?: boolean;
  trusted?: boolean;
  digest?: string;
  cause?: "finger" | "held_before_focus" | "shortcut" | "focus_loss";
}

/** The report that a screen, or the picture of an episode's step, reached the display. */
export interface DisplayedMessage {
  t: "shown";
  submit: number;
  flip: number;
  screen?: number;
  name?: number;
  episode?: number;
  step?: number;
  node?: number;
}

/** A tick at the time that the session asked for. */
export interface TickMessage {
  t: "tick";
  digest?: string;
}

/** Text produced by the keyboard layout or the input method. */
export interface TextMessage {
  t: "typed";
  text: string;
}

/** The whole text of a field, after changes that began at ``began``. */
export interface FieldMessage {
  t: "field";
  text: string;
  name: string;
  changes?: ("typed" | "pasted" | "dropped" | "composed" | "replaced" | "undone" | "script")[];
  keys?: number;
  began?: number;
}

/** A press, movement or release of the mouse or a finger, with the event's own time as ``stamp``. */
export interface PointerMessage {
  t: "pointer";
  what: "pressed" | "moved" | "released";
  x: number;
  y: number;
  target?: string;
  along?: number;
  stamp?: number;
  cause?: "finger" | "held_before_focus" | "cancelled";
}

/** A movement of an axis of a gamepad or of a stick on the screen, with its own time as ``stamp``. */
export interface AxisMessage {
  t: "axis";
  axis: "pad_left_x" | "pad_left_y" | "pad_right_x" | "pad_right_y" | "pad_left_trigger" | "pad_right_trigger" | "touch_left_x" | "touch_left_y" | "touch_right_x" | "touch_right_y";
  value: number;
  stamp?: number;
}

/** A motion of the captured mouse, in whole pixels to the right or down, with the event's own time as ``stamp``. */
export interface MouseMotionMessage {
  t: "motion";
  axis: "mouse_x" | "mouse_y";
  pixels: number;
  stamp?: number;
}

/** The report that a gamepad was detected for the first time. */
export interface GamepadMessage {
  t: "pad";
  id: string;
  axes: number;
  buttons: number;
}

/** The report that the page lost or gained the keyboard focus, or was hidden or shown again. */
export interface FocusMessage {
  t: "focus";
  focused: boolean;
}

/** The fastest of the latest round trips: its ends by the page's clock, the times in between by the server's. */
export interface RoundTripMessage {
  t: "link";
  sent: number;
  received: number;
  answered: number;
  back: number;
  latest: number;
}

/** The report that a sound began, by the sound device's clock. */
export interface SoundMessage {
  t: "sound";
  cue: number;
  scheduled: number;
  onset: number;
  uncertainty: number;
}

/** The report that the experimenter's command reached the page, at the message's time. */
export interface CommandEcho {
  t: "asked";
  number: number;
}

/** Inputs of a segment that had ended before the server received them. */
export interface LateInputMessage {
  t: "unheard";
  text: string;
}

/** The report that a browser, an extension or a setting changed what the page shows, or how it is used. */
export interface PageAlteration {
  t: "altered";
  what: "translation" | "text" | "zoom" | "forced_colors" | "font_size" | "pointer";
  detail?: string;
}

/** The page's first message on every socket. */
export interface Hello {
  t: "hello";
  version: number;
  token?: string;
  platform?: Record<string, string>;
  stream?: string;
  first?: number;
  life?: string;
  heard?: number;
  segment?: string;
  last?: number;
  kernels?: string;
  facts?: BrowserFacts;
}

/** A numbered message of the page's stream. */
export interface NumberedMessage {
  t: "n";
  n: number;
  at: number;
  what: PageMessage;
}

/** The acknowledgement that the page has all of the server's messages up to ``n``. */
export interface PageAck {
  t: "heard";
  n: number;
}

/** A request for the server's time. */
export interface Ping {
  t: "ping";
  sent: number;
  acted?: boolean;
}

/** The report that the page is being closed, or gives way to another page. */
export interface Farewell {
  t: "bye";
  left: boolean;
}

/** The answer to a hello: where both message streams stand, and the session's time. */
export interface Welcome {
  t: "welcome";
  segment: string;
  life: string;
  again: boolean;
  heard: number;
  now: number;
  keys: Texts;
  touch: Texts;
  token: string;
  words: Texts;
  taken: number;
  gamepad: boolean;
  sign_ms: number;
  sounds: string[];
}

/** The server's refusal of a page, which does not reconnect by itself. */
export interface Refusal {
  t: "refused";
  reason: string;
  words: string;
  leave: string;
  url: string;
}

/** The acknowledgement that all of the page's messages up to ``through`` are on the disk. */
export interface ServerAck {
  t: "acked";
  through: number;
}

/** The answer to a ping, with times by the server's clock. */
export interface Pong {
  t: "pong";
  sent: number;
  received: number;
  answered: number;
}

/** A screen of the session, as values for the page. */
export interface ScreenMessage {
  t: "screen";
  id: number;
  through: number;
  at: number;
  tick: number | null;
  screen: ScreenValues;
  name: number;
  sounds: ScreenSound[];
}

/** A sound that begins with a screen. */
export interface ScreenSound {
  cue: number;
  digest: string;
}

/** A picture of a film on the screen, drawn after the screen was sent. */
export interface FilmFrame {
  t: "frame";
  name: number;
  side: number;
  place: number;
  picture: number;
}

/** Arrays that the page keeps under a name, their digest: grid tiles, a first-person scene or a texture. */
export interface ArraysMessage {
  t: "arrays";
  name: string;
  arrays: [string, string, number][];
  packed: string;
}

/** The effects of keys and time in the current episode, which let the page go ahead of the session. */
export interface EpisodeRules {
  t: "rules";
  episode: number;
  actions: Record<string, number>;
  real_time: boolean;
  period: number;
  noop: number | null;
  auto_repeat: boolean;
  most_steps: number;
  held: boolean;
  keep: number;
  computed: GridState | FirstPersonState | null;
  motion: number;
  team: "" | "turns" | "ticks";
  vectors: VectorRules | null;
  combines: HeldRules | null;
}

/** A grid world's state, from which the page computes the steps that follow. */
export interface GridState {
  world: "grid";
  step: number;
  row: number[];
  rng_state: string[];
  view_size: number;
  full: boolean;
  in_view: boolean;
  atlas: string;
}

/** A first-person world's state, from which the page computes the steps that follow. */
export interface FirstPersonState {
  world: "first_person";
  step: number;
  things: string;
  numbers: string;
  rng_state: string[];
  walls: string;
  rooms: string;
  edges: string;
  looks: number;
  scene: string;
  textures: string[];
  size: [number, number];
  n_actions: number;
  uses: number[];
}

/** How named actions and axes make a vector, as `VectorActions` does. */
export interface VectorRules {
  elements: [number, number][];
  rest: number[];
  low: number[];
  high: number[];
  adds: boolean[];
  whole: boolean[];
}

/** How keys that are held and axes combine in the step that time makes. */
export interface HeldRules {
  axes: Record<string, [number, number]>;
  chords: [number[], number][];
}

/** The session's position in an episode that the page computes, from which the page may have diverged. */
export interface StateCorrection {
  t: "state";
  through: number;
  episode: number;
  state: WorldPosition;
  inputs: HeldInputs | null;
}

/** The keys and axes that the session takes for held. */
export interface HeldInputs {
  down: string[];
  pressed: string[];
  axes: Record<string, number>;
}

/** The controls of an episode that an agent plays: the effects of keys and time, and the texts below the picture. */
export interface AgentControl {
  t: "beside";
  episode: number;
  period: number;
  takes_over: boolean;
  hand_back: string;
  good: string;
  bad: string;
  flash: number;
  apart: number;
  controller_texts: Texts;
}

/** The session's current state in an episode. */
export interface EpisodeState {
  t: "now";
  through: number;
  tick: number | null;
  episode: number;
  step: number;
  node: number;
  who: string;
  action: number;
  limit: number | null;
  pace: number;
}

/** Scenes that may come next, with their pictures, and the actions that lead from one to another. */
export interface LookAheadUpdate {
  t: "ahead";
  episode: number;
  nodes: [number, number][];
  edges: [number, number, number, boolean][];
}

/** Screens outside of episodes that may come next, and the inputs that lead from one to another. */
export interface ScreenPrefetch {
  t: "onward";
  screens: PrefetchedScreen[];
  edges: [number, string, number][];
}

/** A screen to which an input may lead. */
export interface PrefetchedScreen {
  name: number;
  screen: ScreenValues;
  after: number | null;
  episode: number;
  scene: number;
}

/** The experimenter's command; the page answers with the time at which it arrived. */
export interface CommandMessage {
  t: "ask";
  number: number;
}

/** The end of a session whose log is on the disk, and the address to which the participant goes next. */
export interface SessionOver {
  t: "over";
  end: string;
  words: string;
  your_code: string;
  code: string;
  leave: string;
  url: string;
}

/** The position of a grid world after a step. */
export interface GridPosition {
  world: "grid";
  step: number;
  row: number[];
  rng_state: string[];
}

/** The position of a first-person world after a step; arrays are little-endian. */
export interface FirstPersonPosition {
  world: "first_person";
  step: number;
  things: string;
  numbers: string;
  rng_state: string[];
}

/** A short text to read, with the keys to try if it has any. */
export interface TextValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "text";
  title: string;
  body: string;
  prompt: string;
  progress: string;
  keys: KeyValues[];
  wide: number;
  high: number;
  waits: boolean;
}

/** A key of a drawn keyboard; lengths are multiples of one key's width. */
export interface KeyValues {
  x: number;
  y: number;
  width: number;
  cap: string;
  above: string;
  pressed: boolean;
}

/** A blank screen, or one with a fixation cross. */
export interface BlankValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "blank";
  cross: boolean;
}

/** The texts around an episode's picture, and the picture itself while it is held. */
export interface PlayValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "play";
  progress: string;
  episode: number;
  step: number;
  mark: "" | "good" | "bad" | "neutral";
  score_text: string;
  controller: "" | "person" | "agent";
  controller_text: string;
  mission: string;
  paragraphs?: string[];
  legend: [string, string, string][];
  pointer?: boolean;
  axes?: string[];
  picture?: number;
  messages?: PlayMessages;
}

/** The messages and marks of people who play together, for a window to draw. */
export interface PlayMessages {
  new_entry: TextField | null;
  hint: string;
  lines: [string, string][];
  entry: TextField | null;
  cells: [number, number, boolean][];
  bounds: [number, number, number, number] | [];
}

/** A field to type in; the target is "field". */
export interface TextField {
  text: string;
  caret: number;
  long: boolean;
  unit: string;
  native: boolean;
  name: string;
  longest: number;
  limit_note: string;
}

/** A page of a text, with its picture above it if it has one. */
export interface PageValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "page";
  title: string;
  body: string;
  page: number;
  prompt: string;
  progress: string;
  buttons: ButtonValues[];
  picture: number | null;
  marks: [number, number, string][];
}

/** A button; ``name`` is the target in the pointer's messages. */
export interface ButtonValues {
  name: string;
  label: string;
  enabled: boolean;
}

/** One question and its answer so far. */
export interface QuestionValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "question";
  title: string;
  question: string;
  prompt: string;
  progress: string;
  note: string;
  item: AnswerWidget;
  buttons: ButtonValues[];
}

/** A screen of one activity kind, drawn by the module at ``module``; the kind adds its own fields. */
export interface ActivityValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "activity";
  view: string;
  module: string;
  title: string;
  prompt: string;
  progress: string;
  films?: number[][];
}

/** A list of options of which one or several can be selected; targets are "option:0", "option:1", ... */
export interface OptionList {
  options: string[];
  chosen: number[];
  cursor: number;
  many: boolean;
}

/** A row of points with labels at the ends or at each point; targets are "option:0", "option:1", ... */
export interface RatingScale {
  points: string[];
  low: string;
  high: string;
  chosen: number | null;
}

/** A list of statements rated on the same scale; targets are "option:0", "option:1", ..., row by row. */
export interface RatingMatrix {
  rows: string[];
  points: string[];
  low: string;
  high: string;
  chosen: (number | null)[];
  cursor: number;
}

/** A line with a movable thumb; the target is "slider". */
export interface Slider {
  low: string;
  high: string;
  position: number | null;
  value: string;
  ticks: number;
}

/** A canvas of shapes, later ones in front, for questions that no other widget can show. */
export interface ShapeCanvas {
  shapes: CanvasShape[];
  aspect: number;
  is_tall: boolean;
}

/** A box or an ellipse on a `ShapeCanvas`; lengths are 0 to 1 of the canvas, from its top left corner. */
export interface CanvasShape {
  x: number;
  y: number;
  width: number;
  height: number;
  label: string;
  target: string;
  chosen: boolean;
  is_round: boolean;
  fill: string;
  accessible_name: string;
  has_box: boolean;
}
