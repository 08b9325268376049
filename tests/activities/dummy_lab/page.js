/** @param {{ taps: number }} screen */
export const draw = (screen, message, { words }) => [words("p", "taps", `${screen.taps} taps`)];
