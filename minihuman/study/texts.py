"""The words of every screen but the world's own: what a participant reads, from the plan and what just happened."""

from minihuman.study.events import EndReason, Outcome
from minihuman.study.plan import EpisodePlan, SessionPlan
from minihuman.study.play import Play
from minihuman.study.screens import TextScreen

GO_ON = "Press Enter to go on"
ABORT_REASONS = (
    "the participant asked to stop",
    "the participant is unwell",
    "technical trouble",
    "wrong participant or protocol",
    "another reason",
)
_OUTCOME_WORDS: dict[Outcome, str] = {
    "goal": "goal reached",
    "timeout": "out of time",
    "failure": "failed",
    "abandoned": "ended early",
}
_END_TITLES: dict[EndReason, str] = {
    "complete": "The end",
    "quit": "The session has ended",
    "aborted": "The session has ended",
    "window_closed": "The session has ended",
    "signal": "The session has ended",
    "disk_full": "The session had to stop: the log cannot be written",
    "world_error": "The session had to stop: the world has failed",
    "internal_error": "The session had to stop: the program has failed",
}


def progress(plan: SessionPlan, episode: EpisodePlan) -> str:
    """Where in the session an episode is: "Part 1 of 2, episode 3 of 10"."""
    count = f"pisode {episode.episode_in_block + 1} of {episode.episodes_in_block}"
    parts = len(plan.texts)
    return f"E{count}" if parts < 2 else f"Part {episode.block + 1} of {parts}, e{count}"


def consent(plan: SessionPlan) -> TextScreen:
    """The consent text, as the protocol has it."""
    return TextScreen("Consent", plan.consent_text.strip(), "Press Enter if you agree, Escape if you do not")


def keyboard_check(plan: SessionPlan, pressed: frozenset[str]) -> TextScreen:
    """Every key of the pool, and whether it has arrived yet."""
    keys = tuple((key, key in pressed) for key in plan.key_pool)
    left = len(plan.key_pool) - len(pressed)
    body = "Press each of these keys once. A key lights up when it has arrived."
    return TextScreen("Keyboard check", body, f"{left} {'key' if left == 1 else 'keys'} to go", keys=keys)


def instructions(plan: SessionPlan, episode: EpisodePlan) -> TextScreen:
    """The block's instruction."""
    parts = len(plan.texts)
    title = "Instructions" if parts < 2 else f"Part {episode.block + 1} of {parts}"
    return TextScreen(title, plan.texts[episode.block].instruction.strip(), GO_ON)


def ready(plan: SessionPlan, episode: EpisodePlan, mission: str) -> TextScreen:
    """The last screen before play; the mission is there to be read in peace."""
    return TextScreen("Ready?", mission.capitalize(), "Press Enter to start", progress(plan, episode))


def paused(plan: SessionPlan, episode: EpisodePlan) -> TextScreen:
    """Play is suspended."""
    return TextScreen("Paused", "Nothing is lost.", GO_ON, progress(plan, episode))


def feedback(plan: SessionPlan, played: Play) -> TextScreen:
    """The block's feedback text with its fields filled in."""
    episode = played.plan
    body = plan.texts[episode.block].feedback.format(
        outcome=_OUTCOME_WORDS[played.outcome or "abandoned"],
        reward=played.return_,
        steps=played.steps,
        episode=episode.episode_in_block + 1,
        episodes=episode.episodes_in_block,
    )
    body = body.strip()
    return TextScreen("", body[:1].upper() + body[1:], GO_ON, progress(plan, episode))


def rest(plan: SessionPlan, block: int, left_s: int) -> TextScreen:
    """The rest after a block, with the seconds that must still pass."""
    body = plan.texts[block].rest.strip() or "Time for a rest."
    return TextScreen("Rest", body, GO_ON if left_s <= 0 else f"You can go on in {left_s} s")


def closing(plan: SessionPlan) -> TextScreen:
    """The study's last words."""
    return TextScreen("Thank you", plan.closing_text.strip(), "Press Enter to finish")


def quit_question() -> TextScreen:
    """Asked before Escape ends anything."""
    return TextScreen(
        "End the session?", "What you have done so far is kept.", "Escape: stay and go on    Enter: end the session"
    )


def abort_question() -> TextScreen:
    """For the experimenter: why the session is to end."""
    body = "\n".join(f"{number}  {reason}" for number, reason in enumerate(ABORT_REASONS, start=1))
    return TextScreen("Experimenter: end the session, because", body, "Press a number to end it, Escape to go on")


def abort_reason(key: str) -> str | None:
    """The reason a digit stands for, on the digit row or the keypad; None for any other key."""
    reasons = {str(number): reason for number, reason in enumerate(ABORT_REASONS, start=1)}
    return reasons.get(key.removeprefix("kp_"))


def over(reason: EndReason, detail: str) -> TextScreen:
    """The session is over; a failure says what failed and that the data is kept."""
    failed = reason in ("disk_full", "world_error", "internal_error")
    body = f"{detail}\n\nEverything up to here is kept. Please call the experimenter." if failed else ""
    return TextScreen(_END_TITLES[reason], body, "")
