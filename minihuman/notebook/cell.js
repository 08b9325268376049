// A world in a notebook's cell, for anywidget: the page's own modules, which the kernel sends with the packed world.
// Keys count while the picture has the focus, and the notebook does not get them then.

/** @typedef {{ get(name: string): any, set(name: string, content: unknown): void, save_changes(): void }} Model */
/** @typedef {{ name: string, seeds: string[], view: "partial" | "full", keys: Record<string, string> }} Settings */

const LABELS = /** @type {Record<string, string>} */ ({
  ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", " ": "space",
});

/** @param {DataView} view @returns {ArrayBuffer} */
const copyBytes = (view) => /** @type {ArrayBuffer} */ (view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));

/**
 * Import modules from their texts, in the order of their imports.
 * @param {[string, string][]} sources name and text @returns {Promise<Record<string, any>>} by name
 */
async function importModules(sources) {
  /** @type {Record<string, string>} */ const addresses = {};
  for (const [name, text] of sources) {
    const linked = text.replaceAll(/from "\.\/([a-z_]+\.js)"/g, (_, file) => `from "${addresses[file]}"`);
    addresses[name] = URL.createObjectURL(new Blob([linked], { type: "text/javascript" }));
  }
  const modules = await Promise.all(Object.entries(addresses).map(async ([name, address]) => [name, await import(address)]));
  for (const address of Object.values(addresses)) URL.revokeObjectURL(address);
  return Object.fromEntries(modules);
}

/** The files of a packed world, by path. @param {ArrayBuffer} pack @returns {Map<string, ArrayBuffer>} */
function splitFiles(pack) {
  const length = new DataView(pack).getUint32(0, true);
  /** @type {[string, number][]} */ const extents = JSON.parse(new TextDecoder().decode(pack.slice(4, 4 + length)));
  let at = 4 + length;
  return new Map(extents.map(([path, size]) => [path, pack.slice(at, at += size)]));
}

/** @param {Settings} settings */
const describeKeys = ({ keys }) => Object.entries(keys).map(([key, action]) => `${LABELS[key] ?? key} ${action.replaceAll("_", " ")}`).join(" · ");

/** Play episodes, one for each seed and then from the first again. @param {{ model: Model, el: HTMLElement }} cell */
async function render({ model, el }) {
  /** @type {Settings} */ const settings = model.get("settings");
  const modules = await importModules(model.get("modules"));
  const pack = await modules["packed_world.js"].WorldPack.ofFiles(splitFiles(copyBytes(model.get("pack"))));
  const world = await modules["packed_world.js"].World.make("world", { from: pack });
  const host = el.appendChild(document.createElement("div"));
  host.className = "minihuman-cell";
  host.dataset.lmSuppressShortcuts = "true"; // JupyterLab's own keys
  const view = new modules["episode_view.js"].EpisodeView(host, world, {
    seed: 0, view: settings.view, key_map: settings.keys, width: "min(100%, 420px)",
  });
  view.canvas.tabIndex = 0;
  view.canvas.setAttribute("role", "application");
  view.canvas.setAttribute("aria-label", settings.name);
  const status = host.appendChild(document.createElement("p"));
  status.className = "minihuman-status";
  status.setAttribute("role", "status");
  const again = host.appendChild(document.createElement("button"));
  again.type = "button";
  const controller = new AbortController();

  /** @param {number} number of the episode in this cell */
  const play = async (number) => {
    const place = number % settings.seeds.length;
    Object.assign(view.settings, { seed: place });
    again.hidden = true;
    status.textContent = `seed ${settings.seeds[place]} · ${describeKeys(settings)}`;
    const columns = await view.play(view.canvas);
    if (controller.signal.aborted) return;
    model.set("played", [...model.get("played"), columns]);
    model.save_changes();
    const steps = columns.actions.length;
    status.textContent = `${columns.success ? "Goal" : columns.end}: reward ${columns.reward.toFixed(3)} in ${steps} steps`;
    again.textContent = settings.seeds.length > 1 ? "Next" : "Again";
    again.hidden = false;
  };
  again.addEventListener("click", () => {
    void play(model.get("played").length);
    view.canvas.focus();
  }, { signal: controller.signal });
  view.canvas.addEventListener("keyup", (/** @type {Event} */ event) => event.stopPropagation(), { signal: controller.signal });
  view.canvas.addEventListener("pointerdown", () => view.canvas.focus(), { signal: controller.signal });
  void play(model.get("played").length);
  return () => {
    controller.abort();
    view.leave();
    world.close();
  };
}

export default { render };
