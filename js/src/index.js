// The package's face: worlds, and the columns of an episode.

export { World, WorldPack } from "./packed_world.js";
export { EpisodeRecord, nameKey, writeGame } from "./episode_record.js";
export { EpisodeView } from "./episode_view.js";
