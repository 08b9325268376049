// Where in a world's first state what is. Generated: edit minihuman/worlds/grid/core/state.py or
// minihuman/worlds/first_person/rules.py, then run `python -m minihuman.web.page_rows`.
export const WIDTH = 0;
export const HEIGHT = 1;
export const DIRECTION = 4;
export const CARRYING = 5;
export const STEP = 6;
export const MAX_STEPS = 7;
export const PHASE = 8;
export const ACTIONS = 10;
export const MISSION = 19;
export const FAILED = 23;
export const HEADER = 24;
export const PLAYING = 1;
export const NUMBERS_REWARD = 24;
