// What the page knows of its browser and its display, for the study's eligibility check and its log.

import { findGamepad } from "./gamepad.js";

/** @import { BrowserFacts } from "./messages" */
/** @typedef {{ brands: { brand: string, version: string }[], platform: string }} UserAgentData */

// Begun when this module runs, while the page's other modules are still on their way: sixteen frames take a quarter second.
const measuredRefresh = "requestAnimationFrame" in globalThis ? measureRefresh() : Promise.resolve(0);

/** @returns {Promise<BrowserFacts>} */
export async function collectBrowserFacts() {
  const { userAgentData } = /** @type {Navigator & { userAgentData?: UserAgentData }} */ (navigator);
  const known = userAgentData?.brands?.find(({ brand }) => !/not/i.test(brand));
  const [, name, version] = navigator.userAgent.match(/(Firefox|Edg|OPR|Chrome|Version)\/(\d+)/) ?? ["", "unknown", "0"];
  const family = { Version: "Safari", Edg: "Edge", OPR: "Opera" }[name] ?? name;
  const [refresh_hz, trip] = await Promise.all([measuredRefresh, measureRoundTrip()]);
  return {
    browser: known ? known.brand.replace(/[^A-Za-z ]/g, "") : family,
    browser_version: known ? known.version : version,
    platform: (userAgentData?.platform ?? "").replace(/[^A-Za-z ]/g, ""),
    isolated: self.crossOriginIsolated === true,
    framed: self !== top,
    timer_step_ms: measureTimerStep(),
    refresh_hz,
    ...trip,
    pixel_ratio: devicePixelRatio,
    window_px: `${innerWidth} x ${innerHeight}`,
    display_px: `${screen.width} x ${screen.height}`,
    touch: navigator.maxTouchPoints > 0,
    mouse: matchMedia("(pointer: fine)").matches,
    gamepad: findGamepad() !== undefined,
    language: navigator.language,
    utc_offset_min: -new Date().getTimezoneOffset(),
  };
}

function measureTimerStep() {
  let least = Infinity;
  let last = performance.now();
  for (let i = 0; i < 20000 && least > 0.006; i++) {
    const t = performance.now();
    if (t > last) least = Math.min(least, t - last);
    last = t;
  }
  return least === Infinity ? 0 : Math.round(least * 1e6) / 1e6;
}

/** @returns {Promise<number>} the display's refresh rate, Hz; 0 where no frames come */
function measureRefresh() {
  return new Promise((resolve) => {
    /** @type {number[]} */ const frames = [];
    const frame = (/** @type {number} */ t) => {
      frames.push(t);
      if (frames.length < 16) { requestAnimationFrame(frame); return; }
      const between = frames.slice(1).map((t2, i) => t2 - frames[i]).sort((a, b) => a - b);
      resolve(Math.round(10000 / between[7]) / 10);
    };
    requestAnimationFrame(frame);
    setTimeout(() => resolve(0), 1500);
  });
}

// The least of a few requests, before there is a socket.
/** @returns {Promise<{ rtt_ms: number } | {}>} */
async function measureRoundTrip() {
  let rtt_ms = Infinity;
  for (let i = 0; i < 4; i++) {
    const sent = performance.now();
    try { await fetch("/favicon.ico", { cache: "no-store" }); } catch { break; }
    rtt_ms = Math.min(rtt_ms, performance.now() - sent);
  }
  return rtt_ms < Infinity ? { rtt_ms } : {};
}
