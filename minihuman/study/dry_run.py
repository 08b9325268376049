"""A session's plan as lines to read: the experimenter's dry run."""

from collections.abc import Iterator

from minihuman.study.plan import EpisodePlan, SessionPlan


def lines(plan: SessionPlan) -> Iterator[str]:
    """Everything a participant will play, block by block."""
    who = plan.participant
    yield f"study        {plan.study} {plan.study_version}, seed {plan.study_seed}"
    yield f"protocol     SHA-256 {plan.protocol_sha256}"
    if plan.allocation_sha256:
        yield f"allocation   SHA-256 {plan.allocation_sha256}"
    yield f"participant  {who.id}, group {who.group}, session {plan.session}"
    yield f"consent      {'SHA-256 ' + plan.consent_sha256 if plan.consent_text else 'not asked for'}"
    yield f"keys         {' '.join(plan.key_pool)}{', each checked first' if plan.keyboard_check else ''}"
    for episode in plan.episodes:
        if episode.episode_in_block == 0:
            yield from _block(plan, episode)
        yield f"  {episode.episode + 1:3}  episode {episode.episode_in_block + 1:2} of the block  seed {episode.seed}"


def _block(plan: SessionPlan, first: EpisodePlan) -> Iterator[str]:
    options = "".join(f", {name}={value!r}" for name, value in first.options.items())
    yield ""
    yield f"block {first.block + 1}: {first.block_name}, {first.world}{options}, {first.view} view, {first.palette}"
    keys = ", ".join(f"{key} {action}" for key, action in sorted(first.key_map.keys.items()))
    yield f"  keys   {keys}{' (shown)' if first.show_keys else ''}"
    pace = "one press one step" + (", held keys repeat" if first.auto_repeat else "")
    if first.pace == "real_time":
        pace = f"a step every {first.step_period_ms:g} ms, without a key {first.noop or 'none'}"
    yield f"  pace   {pace}; at most {first.max_steps} steps"
    rest_s = plan.texts[first.block].rest_s
    if rest_s and first.block + 1 < len(plan.texts):
        yield f"  rest   {rest_s:g} s or longer afterwards"
