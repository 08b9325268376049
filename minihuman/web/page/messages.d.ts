// What the page and the server send each other, as minihuman/web/messages.py and screen_values.py define it.

export type Input =
  | { t: "tick"; digest?: string }
  | { t: "key"; key: string; down: boolean; stamp: number; trusted?: boolean; symbol?: string; repeat?: boolean; digest?: string }
  | { t: "typed" | "unheard"; text: string }
  | { t: "focus"; focused: boolean }
  | { t: "axis"; axis: string; value: number; stamp?: number }
  | { t: "pad"; id: string; axes: number; buttons: number }
  | { t: "asked"; number: number }
  | { t: "link"; sent: number; received: number; answered: number; back: number; latest: number }
  | { t: "pointer"; what: string; target?: string; along: number; x: number; y: number; stamp?: number }
  | { t: "shown"; submit: number; flip: number; screen?: number; name?: number; episode?: number; step?: number; node?: number };
export type Facts = Record<string, string | number | boolean>;
export type Texts = Record<string, string>;

export interface Welcome {
  t: "welcome"; keys: Texts; touch: Texts; words: Texts; token: string; segment: string; now: number; taken: number; heard: number;
  again: boolean; life: string; gamepad: boolean;
}
export interface Pong { t: "pong"; sent: number; received: number; answered: number }
export interface Refusal { t: "refused"; reason: string; words: string; leave: string; url: string }
export type Control = Welcome | Pong | Refusal | { t: "acked"; through: number };

export interface Rules {
  t: "rules"; episode: number; keep: number; motion: number; actions: Record<string, number>; most_steps: number; real_time: boolean;
  period: number; noop: number | null; auto_repeat: boolean; computed: WorldState | null; team?: "" | "turns" | "ticks";
}
export interface GridPosition { world: "grid"; step: number; row: number[]; rng_state: string[] }
export interface GridState extends GridPosition { view_size: number; full: boolean; in_view: boolean; atlas: string }
export interface FirstPersonPosition { world: "first_person"; step: number; things: string; numbers: string; rng_state: string[] }
export interface FirstPersonState extends FirstPersonPosition {
  walls: string; rooms: string; edges: string; looks: number; scene: string; textures: string[]; size: [width: number, height: number];
}
export type WorldState = GridState | FirstPersonState;
export type WorldPosition = GridPosition | FirstPersonPosition;
export interface ArraysMessage { t: "arrays"; name: string; arrays: [name: string, kind: string, bytes: number][]; packed: string }
export interface StateCorrection { t: "state"; through: number; episode: number; state: WorldPosition }
export interface Ahead {
  t: "ahead"; episode: number; nodes: [scene: number, picture: number][];
  edges: [from: number, action: number, to: number, ends: boolean][];
}
export interface Agent {
  t: "beside"; episode: number; period: number; controller_texts: Texts; takes_over: boolean; hand_back: string; good: string;
  bad: string; apart: number; flash: number;
}
export interface Now {
  t: "now"; episode: number; step: number; node: number; tick: number | null; through: number; who?: string;
  action?: number; limit?: number | null; pace: number;
}
export interface NextScreens {
  t: "onward"; edges: [from: number, input: string, to: number][];
  screens: { name: number; screen: Screen; after: number | null; episode: number; scene: number }[];
}
export interface ScreenMessage {
  t?: "screen"; id: number; name: number; through: number; at: number; tick: number | null; screen: Screen;
}
export interface Frame { t: "frame"; name: number; side: number; place: number; picture: number }
export interface Over { t: "over"; words: string; code?: string; your_code?: string; url?: string; leave?: string }
export type Numbered =
  | Rules | ArraysMessage | StateCorrection | Ahead | Agent | Now | NextScreens | ScreenMessage & { t: "screen" } | Frame | Over | { t: "ask"; number: number };

interface Common { language: string; rtl: boolean; theme?: "light"; title: string; prompt: string; progress: string }
export interface Button { name: string; label: string; enabled: boolean }
export interface Key { cap: string; above: string; pressed: boolean; x: number; y: number; width: number }
export type TextScreen = Common & { kind: "text"; body: string; keys: Key[]; wide: number; high: number };
export type BlankScreen = Common & { kind: "blank"; cross: boolean };
export type PlayScreen = Common & {
  kind: "play"; mission: string; controller: string; controller_text?: string; mark: "" | "good" | "bad" | "neutral"; score_text: string;
  legend: [cap: string, above: string, action: string][]; picture?: number; episode: number; step: number;
  pointer?: boolean; messages?: TeamMessages;
};
export interface TeamMessages {
  writes: boolean; hint: string; lines: [author: string, text: string][]; entry: Omit<TextField, "form"> | null; bounds: [left: number, top: number, right: number, bottom: number];
  cells: [x: number, z: number, isOwn: boolean][];
}
/** A screen of one kind of activity, which the module at that address draws; it has fields of its own. */
export type ActivityScreen = Common & {
  kind: "activity"; view: string; module: string;
  /** the numbers of the pictures of its films; -1 is still to come */ films?: number[][];
};
export type PageScreen = Common & {
  kind: "page"; body: string; picture: number | null; marks: [x: number, y: number, label: string][]; buttons: Button[];
};
export type QuestionScreen = Common & { kind: "question"; question: string; note: string; item: AnswerWidget; buttons: Button[] };
export type Screen = TextScreen | BlankScreen | PlayScreen | ActivityScreen | PageScreen | QuestionScreen;

export type OptionList = { form: "OptionList"; many: boolean; options: string[]; chosen: number[]; cursor: number };
export type RatingScale = { form: "RatingScale"; points: string[]; chosen: number | null; low: string; high: string };
export type RatingMatrix = {
  form: "RatingMatrix"; rows: string[]; points: string[]; chosen: (number | null)[]; cursor: number; low: string; high: string;
};
export type Slider = {
  form: "Slider"; position: number | null; value: string; ticks: number; low: string; high: string;
};
export type TextField = { form: "TextField"; long: boolean; unit: string; text: string; caret: number };
export interface CanvasShape {
  x: number; y: number; width: number; height: number; label: string; target: string; chosen: boolean; is_round: boolean;
}
export type ShapeCanvas = { form: "ShapeCanvas"; shapes: CanvasShape[]; aspect: number };
export type AnswerWidget = OptionList | RatingScale | RatingMatrix | Slider | TextField | ShapeCanvas;

/** How films are shown. */
export interface FilmSettings {
  /** the numbers of their pictures; -1 is still to come */ sides: number[][];
  /** what each is, for whoever does not see it */ labels: string[];
  /** how much of the window is theirs: of its height, and each one's of its width */ room: [share: number, across?: number];
  /** at which they begin */ step: number;
  /** ns from a step on the display to the next; null where keys alone go on */ period: number | null;
  /** the step that a key leads to; null for none */ stepOf: (key: string, isRepeat: boolean, step: number) => number | null;
}
/** What the page lends to the module of a kind of activity. */
export interface PageTools {
  el: typeof import("./elements.js").el;
  words: typeof import("./elements.js").words;
  prose: typeof import("./elements.js").prose;
  films: { open(message: ScreenMessage, settings: FilmSettings): HTMLElement[] };
}
/** What such a module has. */
export interface ActivityModule {
  draw(screen: ActivityScreen, message: ScreenMessage, page: PageTools): unknown;
}
