// What the page lends to the modules of kinds of activity, and what such a module has.

import type { ActivityValues, ScreenMessage } from "./messages";

/** How films are shown. */
export interface FilmSettings {
  /** the numbers of their pictures; -1 is still to come */ sides: number[][];
  /** what each is, for whoever does not see it */ labels: string[];
  /** how much of the window is theirs: of its height, and each one's of its width */ room: [share: number, across?: number];
  /** at which they begin */ step: number;
  /** what the first picture waits for */ ready?: Promise<void>;
  /** ns from a step on the display to the next; null where keys alone go on */ period: number | null;
  /** when the next step is due, in ns of the session, if not after a period; null where it is not by the clock */
  dueAfter?: (step: number, flip: number) => number | null;
  /** the step that a key leads to; null for none */ stepOf: (key: string, isRepeat: boolean, step: number) => number | null;
}

/** A sound that a screen plays: its number in the session, and the digest of its samples. */
export interface SoundCue { cue: number; digest: string }

/** What the page lends to the module of a kind of activity. */
export interface PageTools {
  el: typeof import("./elements.js").el;
  words: typeof import("./elements.js").words;
  prose: typeof import("./elements.js").prose;
  films: { open(message: ScreenMessage, settings: FilmSettings): HTMLElement[] };
  sounds: {
    ready(digests: string[]): Promise<void>;
    play(cue: SoundCue, due: number): void;
    keep(cues: Set<number>): void;
  };
}

/** What such a module has. */
export interface ActivityModule {
  draw(screen: ActivityValues, message: ScreenMessage, page: PageTools): unknown;
}

/** What a page without a server runs by itself on a screen, from its beginning to one of its ends. Times are ns. */
export interface PageRun {
  /** when it goes on by the clock; null where it does not */ readonly due: number | null;
  /** how it ended; null as long as it has not */ readonly end: string | null;
  passTime(at: number): void;
  takeFlip(flip: number): void;
  takeSound(cue: number, onset: number): void;
  press(key: string, stamp: number, isRepeat: boolean, at: number): void;
  /** another screen covers it */ interrupt(): void;
  fillLooks(looks: string): string;
  describe(screen: ActivityValues): ActivityValues;
}

/** The module of such a run; `state` lasts as long as the part of the session. */
export interface PageRunModule {
  PageRun: new (values: any, state: Record<string, any>, at: number) => PageRun;
}
