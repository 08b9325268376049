// A comparison in the page: two films side by side, which run by themselves.

/** @import { ActivityValues, ScreenMessage } from "../../web/page/messages" */
/** @import { PageTools } from "../../web/page/page_tools" */
/** @typedef {ActivityValues & { films: number[][], step: number, period: number, replay_key: string }} PairScreen */

/** @param {PairScreen} s @param {ScreenMessage} message @param {PageTools} page */
export const draw = (s, message, { films, words }) => [
  words("h1", "", s.title),
  ...films.open(message, {
    sides: s.films, labels: [`${s.title} 1`, `${s.title} 2`], room: [0.62, 0.44], step: s.step, period: s.period,
    stepOf: (key, isRepeat) => (key === s.replay_key && !isRepeat ? 0 : null),
  }),
  words("p", "prompt", s.prompt),
  words("p", "progress", s.progress),
];
