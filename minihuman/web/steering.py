"""What an agent beside a person means for a page: told once, so that keys and its steps are seen at once. No I/O."""

from minihuman.study.activities.agent_play import AgentPlaying
from minihuman.study.activities.rating import APART_NS, FLASH_NS
from minihuman.web.wire import Beside


def beside(part: AgentPlaying, episode: int) -> Beside:
    """What the page has to know to go ahead of the session."""
    good, bad = part.rating_keys
    return Beside(
        episode=episode,
        period=part.period_ns,
        takes_over=part.takes_over,
        hand_back=part.hand_back_key,
        good=good,
        bad=bad,
        flash=FLASH_NS,
        apart=APART_NS,
        said={who: part.said_of(who) for who in ("agent", "person")},
    )


def steers(part: AgentPlaying, step: int) -> tuple[str, int]:
    """Who does, and the action that the agent makes next from a step; -1 where that is not known."""
    advised = part.advised
    return part.who, advised.action if advised is not None and advised.step == step else -1
