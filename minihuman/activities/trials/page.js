// A trial in the page: its pictures come and go by the clock, and some of them go at the response.

/** @import { ActivityValues, ScreenMessage } from "../../web/page/messages" */
/** @import { PageTools } from "../../web/page/page_tools" */
/**
 * @typedef {ActivityValues & { pictures: number[], step: number, dues: number[], start: number | null, first: number | null,
 * keys: string[], target: number, foresees: boolean }} TrialScreen
 */

const PREPARATION_NS = 10e6; // a picture that is put into the page so long before it is due is seen at the nearest frame

/** @param {TrialScreen} s @param {ScreenMessage} message @param {PageTools} page */
export const draw = (s, message, { films, words }) => {
  const count = s.dues.length - 1; // of the pictures before the response, which those after it follow
  const frameOf = (/** @type {number} */ step) => (step > count ? step - count : step);
  let { first } = s;
  return [
    films.open(message, {
      sides: [s.pictures], labels: [""], room: [0.88, 0.98], step: s.step, period: null,
      dueAfter: (step, flip) => {
        const frame = frameOf(step);
        if (frame === 0) return s.start === null ? null : s.start - PREPARATION_NS;
        first ??= flip;
        return frame < count ? first + s.dues[frame + 1] - PREPARATION_NS : null;
      },
      stepOf: (key, isRepeat, step) =>
        (s.foresees && !isRepeat && s.keys.includes(key) && step >= s.target && step <= count ? step + count : null),
    })[0],
    words("p", "prompt", s.prompt),
  ];
};
