// What the page and the server send each other. Generated: edit minihuman/web/messages.py or screen_types.py, then run
// `python -m minihuman.web.page_types`.

export type BrowserFacts = Record<string, boolean | number | string>;
export type Texts = Record<string, string>;
export type PageMessage = KeyMessage | DisplayedMessage | TickMessage | TextMessage | PointerMessage | AxisMessage | GamepadMessage | FocusMessage | RoundTripMessage | CommandEcho | LateInputMessage;
export type FromPage = Hello | NumberedMessage | PageAck | Ping | Farewell;
export type UnnumberedMessage = Welcome | Refusal | ServerAck | Pong;
export type ServerMessage = ScreenMessage | FilmFrame | ArraysMessage | EpisodeRules | StateCorrection | AgentControl | EpisodeState | LookAheadUpdate | ScreenPrefetch | CommandMessage | SessionOver;
export type WorldState = GridState | FirstPersonState;
export type WorldPosition = GridPosition | FirstPersonPosition;
export type ScreenValues = TextValues | BlankValues | PlayValues | PageValues | QuestionValues | ActivityValues;
export type AnswerWidget = ({ form: "OptionList" } & OptionList) | ({ form: "RatingScale" } & RatingScale) | ({ form: "RatingMatrix" } & RatingMatrix) | ({ form: "Slider" } & Slider) | ({ form: "TextField" } & TextField) | ({ form: "ShapeCanvas" } & ShapeCanvas);

/** A key went down or came up at ``stamp``, by the event's own time. */
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

/** A screen, or in an episode a step's picture, reached the display. */
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

/** The time came at which the session asked for a tick. */
export interface TickMessage {
  t: "tick";
  digest?: string;
}

/** The keyboard's layout or the input method made text. */
export interface TextMessage {
  t: "typed";
  text: string;
}

/** Mouse or finger, at ``stamp``, by the event's own time. */
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

/** An axis of a gamepad moved, at ``stamp``, by the gamepad's own time. */
export interface AxisMessage {
  t: "axis";
  axis: "pad_left_x" | "pad_left_y" | "pad_right_x" | "pad_right_y" | "pad_left_trigger" | "pad_right_trigger";
  value: number;
  stamp?: number;
}

/** A gamepad was seen for the first time. */
export interface GamepadMessage {
  t: "pad";
  id: string;
  axes: number;
  buttons: number;
}

/** The page lost or found the keyboard, or was hidden or seen again. */
export interface FocusMessage {
  t: "focus";
  focused: boolean;
}

/** The quickest of the latest messages there and back: its ends by the page's clock, in between the server's. */
export interface RoundTripMessage {
  t: "link";
  sent: number;
  received: number;
  answered: number;
  back: number;
  latest: number;
}

/** The experimenter's command reached the page, at the message's time. */
export interface CommandEcho {
  t: "asked";
  number: number;
}

/** Inputs of a segment that had ended before the server received them. */
export interface LateInputMessage {
  t: "unheard";
  text: string;
}

/** The first message on every socket. */
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

/** A message of the page's stream. */
export interface NumberedMessage {
  t: "n";
  n: number;
  at: number;
  what: PageMessage;
}

/** The page has all of the server's messages up to this. */
export interface PageAck {
  t: "heard";
  n: number;
}

/** Ask for the server's time. */
export interface Ping {
  t: "ping";
  sent: number;
}

/** The page is being closed, or gives way to another one in its place. */
export interface Farewell {
  t: "bye";
  left: boolean;
}

/** The answer to a hello: whose turn it is in both streams, and the session's time. */
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
}

/** The server refuses the page, which does not come again by itself. */
export interface Refusal {
  t: "refused";
  reason: string;
  words: string;
  leave: string;
  url: string;
}

/** All of the page's messages up to this are on the disk. */
export interface ServerAck {
  t: "acked";
  through: number;
}

/** The answer to a ping, by the server's clock. */
export interface Pong {
  t: "pong";
  sent: number;
  received: number;
  answered: number;
}

/** A screen, as `drawn` makes it. */
export interface ScreenMessage {
  t: "screen";
  id: number;
  through: number;
  at: number;
  tick: number | null;
  screen: ScreenValues;
  name: number;
}

/** A picture of the film on the screen, drawn since the screen was sent. */
export interface FilmFrame {
  t: "frame";
  name: number;
  side: number;
  place: number;
  picture: number;
}

/** Tiles of grid worlds, a first-person scene or a texture, for the page to keep under their name, a digest. */
export interface ArraysMessage {
  t: "arrays";
  name: string;
  arrays: [string, string, number][];
  packed: string;
}

/** What keys and time do in the episode that is played: what the page needs to go ahead of the session. */
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
}

/** A grid world's state, for the page to compute the steps that follow it. */
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

/** A first-person world's state, for the page to compute the steps that follow it. */
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
}

/** Where the session is in an episode that the page computes, which may be elsewhere. */
export interface StateCorrection {
  t: "state";
  through: number;
  episode: number;
  state: WorldPosition;
}

/** An agent plays an episode: what keys and time do then, and the texts below the picture. */
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

/** Where the session stands in an episode. */
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

/** What would come: scenes with their pictures, and which action leads from one to another. */
export interface LookAheadUpdate {
  t: "ahead";
  episode: number;
  nodes: [number, number][];
  edges: [number, number, number, boolean][];
}

/** What would come outside of episodes: screens, and which input leads from one to another. */
export interface ScreenPrefetch {
  t: "onward";
  screens: PrefetchedScreen[];
  edges: [number, string, number][];
}

/** A screen that an input may lead to. */
export interface PrefetchedScreen {
  name: number;
  screen: ScreenValues;
  after: number | null;
  episode: number;
  scene: number;
}

/** The experimenter asks for something; the page says when that was. */
export interface CommandMessage {
  t: "ask";
  number: number;
}

/** The session's log is on the disk; where to go from here. */
export interface SessionOver {
  t: "over";
  end: string;
  words: string;
  your_code: string;
  code: string;
  leave: string;
  url: string;
}

/** Where a grid world is after a step. */
export interface GridPosition {
  world: "grid";
  step: number;
  row: number[];
  rng_state: string[];
}

/** Where a first-person world is after a step; arrays are little-endian. */
export interface FirstPersonPosition {
  world: "first_person";
  step: number;
  things: string;
  numbers: string;
  rng_state: string[];
}

/** A few words to read. */
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
}

/** A key of a drawn keyboard; lengths are in widths of a key. */
export interface KeyValues {
  x: number;
  y: number;
  width: number;
  cap: string;
  above: string;
  pressed: boolean;
}

/** Nothing, or a cross to look at. */
export interface BlankValues {
  language: string;
  rtl: boolean;
  theme?: "light";
  kind: "blank";
  cross: boolean;
}

/** What is around an episode's picture; the picture itself only where it is held, since scenes have theirs. */
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
  legend: [string, string, string][];
  pointer?: boolean;
  picture?: number;
  messages?: PlayMessages;
}

/** What people who play together write and mark, for a window that draws it. */
export interface PlayMessages {
  writes: boolean;
  hint: string;
  lines: [string, string][];
  entry: TextField | null;
  cells: [number, number, boolean][];
  bounds: [number, number, number, number] | [];
}

/** A field to type in; target "field". */
export interface TextField {
  text: string;
  caret: number;
  long: boolean;
  unit: string;
}

/** A page of a text, with a picture above it where it has one. */
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

/** A spot to click; ``name`` is the target of the pointer's messages. */
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

/** A screen of one kind of activity, which the module at that address draws; it has fields of its own. */
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

/** Options of which one or several are chosen; targets "option:0", "option:1", ... */
export interface OptionList {
  options: string[];
  chosen: number[];
  cursor: number;
  many: boolean;
}

/** Points in a row with words at the ends, or at each; targets "option:0", ... */
export interface RatingScale {
  points: string[];
  low: string;
  high: string;
  chosen: number | null;
}

/** Statements below each other on the same scale; targets "option:0", ..., row by row. */
export interface RatingMatrix {
  rows: string[];
  points: string[];
  low: string;
  high: string;
  chosen: (number | null)[];
  cursor: number;
}

/** A line with a thumb that can be moved; target "slider". */
export interface Slider {
  low: string;
  high: string;
  position: number | null;
  value: string;
  ticks: number;
}

/** Shapes on a canvas, later ones in front: what a question of a plug-in's kind shows, if no other widget does. */
export interface ShapeCanvas {
  shapes: CanvasShape[];
  aspect: number;
}

/** A box or an ellipse of a `ShapeCanvas`: lengths are 0..1 of the canvas, from its top left corner. */
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
}
