// A trial in the page: its pictures and sounds come and go by the clock, and some of them go at the response.

/** @import { ActivityValues, ScreenMessage } from "../../web/page/messages" */
/** @import { PageTools, SoundCue } from "../../web/page/page_tools" */
/** @typedef {SoundCue & { onset: number, early: boolean, until_response: boolean }} TrialSound */
/**
 * @typedef {ActivityValues & { pictures: number[], step: number, dues: number[], start: number | null, first: number | null,
 * keys: string[], target: number, foresees: boolean, lead: number | null, sounds: TrialSound[],
 * digests: string[] }} TrialScreen
 */

const PREPARATION_NS = 10e6; // a picture that is put into the page so long before it is due is seen at the nearest frame

/** @param {TrialScreen} s @param {ScreenMessage} message @param {PageTools} page */
export const draw = (s, message, { films, sounds, words }) => {
  const count = s.dues.length - 1; // of the pictures before the response, which those after it follow
  const frameOf = (/** @type {number} */ step) => (step > count ? step - count : step);
  let { first } = s;
  let hasResponse = s.step > count;
  const wanted = () => s.sounds.filter((sound) => !(hasResponse && sound.until_response));
  const keepWanted = () => sounds.keep(new Set(wanted().map(({ cue }) => cue)));
  /** Hand over the sounds whose time is known. @param {boolean} early @param {number | null} start */
  const playSounds = (early, start) => {
    if (start !== null) for (const sound of wanted()) if (sound.early === early) sounds.play(sound, start + sound.onset);
  };
  keepWanted();
  return [
    films.open(message, {
      sides: [s.pictures], labels: [""], room: [0.88, 0.98], step: s.step, period: null,
      ready: sounds.ready(s.digests),
      dueAfter: (step, flip) => {
        const frame = frameOf(step);
        if (frame === 0) {
          const start = s.lead === null ? s.start : flip + s.lead;
          playSounds(true, start);
          return start === null ? null : start - PREPARATION_NS;
        }
        first ??= flip;
        playSounds(false, first);
        return frame < count ? first + s.dues[frame + 1] - PREPARATION_NS : null;
      },
      stepOf: (key, isRepeat, step) => {
        if (!s.foresees || isRepeat || !s.keys.includes(key) || step < s.target || step > count) return null;
        hasResponse = true;
        keepWanted();
        return step + count;
      },
    })[0],
    words("p", "prompt", s.prompt),
  ];
};
