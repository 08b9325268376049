"""Run episodes by BALROG's own evaluator, agent and client, in its environment; for `tests.models.balrog_endpoint`.

    python balrog_evaluator.py BALROG MINIGRID OUT < EPISODES

EPISODES is JSON, [[level, seed], ...]; OUT gets what BALROG writes for each. The endpoint is that of OPENAI_BASE_URL.
One function of BALROG's is replaced: its own tasks are a level of its Minigrid alone, so this makes the level named.
"""

import json
import sys
from pathlib import Path
from typing import Any

balrog, minigrid, out = (Path(each).resolve() for each in sys.argv[1:4])
sys.path[:0] = [str(balrog), str(minigrid)]

import gymnasium  # noqa: E402 - the folders are on the path now
from balrog.agents import AgentFactory  # noqa: E402
from balrog.environments.babyai_text import babyai_env  # noqa: E402
from balrog.evaluator import Evaluator  # noqa: E402
from omegaconf import OmegaConf  # noqa: E402


def make_level(env_name: str, task: str, config: Any, render_mode: str | None = None) -> Any:
    return babyai_env.BabyAITextCleanLangWrapper(gymnasium.make(task, disable_env_checker=True))


babyai_env.make_babyai_env = make_level
config = OmegaConf.load(balrog / "balrog" / "config" / "config.yaml")
config.client.model_id, config.eval.max_steps_per_episode = "scripted", 60
for number, (level, seed) in enumerate(json.load(sys.stdin)):
    config.envs.env_kwargs.seed = seed
    agent = AgentFactory(config).create_agent()
    Evaluator("babyai", config, output_dir=str(out)).run_episode(level, agent, episode_idx=number)
