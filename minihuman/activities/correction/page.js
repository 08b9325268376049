// An episode that is reviewed in the page: one film, which keys go through.

/** @import { ActivityValues, ScreenMessage } from "../../web/page/messages" */
/** @import { PageTools } from "../../web/page/page_tools" */
/** @typedef {ActivityValues & { films: number[][], step: number, back: string, forward: string }} FilmScreen */

/** @param {FilmScreen} s @param {ScreenMessage} message @param {PageTools} page */
export const draw = (s, message, { films, words }) => [
  ...films.open(message, {
    sides: s.films, labels: [s.progress], room: [0.74], step: s.step, period: null,
    stepOf: (key, isRepeat, step) => {
      if (key !== s.back && key !== s.forward) return null;
      const to = Math.min(Math.max(0, step + (key === s.forward ? 1 : -1)), s.films[0].length - 1);
      return to === step ? null : to;
    },
  }),
  words("p", "prompt", s.prompt),
  words("p", "progress", s.progress),
];
